"""The page of a fleet in a browser, from a file, on a phone and a desk, light and dark."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ambinav.studies.fleet.fleet import run_fleet, units_of
from ambinav.studies.fleet.sites import read_sites
from ambinav.studies.fleet.unit import FleetSettings
from tests.reports.widths import SIZES
from tests.server.axe import violations
from tests.studies.fleet.conftest import SCANNERS, write_room

pytestmark = pytest.mark.slow(minutes=0.2)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fleet")
    write_room(folder / "sites" / "room.geojson", 3.0)
    write_room(folder / "sites" / "north" / "corridor-of-a-long-name.geojson", 30.0, 2.0)
    (folder / "sites" / "broken.wkt").write_text("POLYGON((")
    units = units_of(read_sites(str(folder / "sites")), SCANNERS)
    run_fleet(units, folder / "out", FleetSettings(spacing=0.5), workers=0)
    return folder / "out" / "index.html"


@pytest.mark.slow(minutes=0.2, kept=("390-light", "1280-dark"))
@pytest.mark.parametrize("colours", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 768, 1280])
def test_it_can_be_read_everywhere(chromium: Any, report: Path, width: int, colours: str) -> None:
    context = chromium.new_context(
        viewport={"width": width, "height": 800}, color_scheme=colours, bypass_csp=True
    )
    page, urls, faults = context.new_page(), [], []
    page.on("request", lambda request: urls.append(request.url))
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(report.as_uri())
    assert page.evaluate(SIZES) == [width, width]
    assert violations(page) == [] and faults == []
    assert [url for url in urls if not url.startswith("data:")] == [report.as_uri()]
    context.close()


def test_sites_are_sorted_and_filtered(chromium: Any, report: Path) -> None:
    page = chromium.new_page()
    page.goto(report.as_uri())

    def sites() -> list[str]:
        rows = page.locator("#sites tbody tr:visible")
        return [row.get_attribute("data-site") for row in rows.all()]

    assert sites()[0] == "north/corridor-of-a-long-name" and sites()[-1] == "broken"
    page.get_by_role("button", name="Site", exact=True).click()
    assert sites() == sorted(sites()) and sites()[0] == "broken"
    page.get_by_label("Scanner", exact=True).select_option("rplidar-a1")
    assert len(sites()) == 3 and page.get_by_text("3 of 6").is_visible()
    page.get_by_label("Site", exact=True).fill("ROO")
    assert sites() == ["room"]
    page.get_by_label("Needs", exact=True).select_option("failed")
    assert sites() == []
    page.close()
