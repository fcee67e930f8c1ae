"""The report in a browser, from a file: it stands alone, and its map tells what the map holds."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ambinav.drive.bootstrap import Interval
from ambinav.sensing.sight import look
from ambinav.studies.audit.counterfactual.search import Counterfactual
from ambinav.studies.audit.report import write_audit
from ambinav.studies.audit.verdict import Verdict
from tests.reports.widths import SIZES
from tests.server.axe import violations

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report(examined, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("page") / "out"
    advice = tuple(
        Counterfactual(kind, title, "", 40.0, Interval(after, after, after, 0))
        for kind, title, after in (
            ("range", "See farther", 4.0), ("routes", "Go around", 8.0), ("heading", "Turn", 16.0),
        )
    )  # fmt: skip
    verdict = Verdict("range", "See farther: 40 m² become 4 m².", 40.0, advice, advice)
    write_audit(replace(examined, verdict=verdict), folder)
    return folder / "report.html"


def visit(chromium: Any, report: Path, **options: Any) -> Any:
    context = chromium.new_context(**{"viewport": {"width": 1280, "height": 900}, **options})
    context.set_default_timeout(60_000)
    page = context.new_page()
    page.urls, page.faults = [], []
    page.on("request", lambda request: page.urls.append(request.url))
    page.on("pageerror", lambda error: page.faults.append(str(error)))
    page.on("console", lambda message: message.type == "error" and page.faults.append(message.text))
    page.goto(report.as_uri())
    page.wait_for_selector(".map[data-shown]")
    page.wait_for_selector(".stage:not([aria-busy])")
    return page


@pytest.fixture
def page(chromium: Any, report: Path) -> Iterator[Any]:
    opened = visit(chromium, report)
    yield opened
    opened.context.close()


def test_it_opens_from_a_file_and_asks_for_nothing(page, report):
    assert page.faults == []
    assert page.urls[0] == report.as_uri()
    assert all(url.startswith(("data:", "blob:")) for url in page.urls[1:])
    assert page.locator(".actions li").count() == 3
    above = page.locator("p.lead").bounding_box()["y"], page.locator(".actions").bounding_box()["y"]
    assert above[0] < above[1] < page.locator("#explorer").bounding_box()["y"]


@pytest.mark.sweep
def test_a_place_of_the_table_is_shown_with_its_values(page, examined):
    for finding in examined.findings[:2]:
        place = finding.place
        page.get_by_role("button", name=f"Show place {place.number} on the map").click()
        readout = page.locator(f".readout[data-x='{place.x:g}']")
        for layer in ("level", "major_radius", "clearance"):
            shown = readout.locator(f"dd[data-layer={layer}]")
            shown.wait_for()
            # Of the cell that the place lies in: its point is a cell's centre.
            expected = examined.amap.sample(layer, place.x, place.y)
            assert float(shown.get_attribute("data-value")) == pytest.approx(expected, abs=2e-4)
        assert place.zone in readout.inner_text().lower()


def test_layers_switch(page):
    page.locator("input[value=major_radius]").check()
    page.wait_for_selector(".map[data-shown=major_radius]")
    assert "badly localized" in page.locator(".legend").inner_text()


@pytest.mark.slow(kept=("place1",))
@pytest.mark.parametrize("place", [(2.0, 2.5, 0.3), (9.3, 2.0, 1.0), (20.0, 5.0, -2.0)])
def test_the_scan_is_that_of_the_audit(page, building, laser, sonar, place):
    page.context.close()
    from ambinav.reports.page.map_data import _rays

    for scanner in (laser, sonar):
        sight = look(building, scanner, *place)
        scan = _cast(page, building, _rays(scanner), place)
        np.testing.assert_array_equal(scan["hit"], np.isfinite(sight.distance))
        ends = np.column_stack([scan["x"], scan["y"]])[scan["hit"]]
        np.testing.assert_allclose(ends, sight.hit[scan["hit"]], atol=1e-4)


def _cast(page: Any, building: Any, rays: Any, place: Any) -> Any:
    """The scan by the page's own module, in a page of its own."""
    import base64

    from ambinav.reports.page.rasters import base64_of
    from ambinav.reports.page.single_file import modules

    text = modules("raycast.js")["raycast.js"]
    address = "data:text/javascript;base64," + base64.b64encode(text.encode()).decode()
    other = page.context.browser.new_page()
    walls = base64_of(building.segments.xy.astype(np.float32))
    found = other.evaluate(
        """async ([address, walls, rays, place]) => {
          const { castScan } = await import(address);
          const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
          const kinds = {start: Int32Array};
          const read = Object.fromEntries(Object.entries(rays).map(
            ([name, text]) => [name, new (kinds[name] ?? Float32Array)(bytes(text))]));
          return castScan(new Float32Array(bytes(walls)), read, ...place);
        }""",
        [address, walls, rays, list(place)],
    )
    other.close()
    return {name: np.array(values) for name, values in found.items()}


@pytest.mark.slow(kept=("dark-390",))
@pytest.mark.parametrize("width", [1280, 768, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_and_nothing_is_too_wide(chromium, report, width, scheme):
    size = {"width": width, "height": 844}
    page = visit(chromium, report, viewport=size, color_scheme=scheme, bypass_csp=True)
    assert violations(page) == []
    assert page.evaluate(SIZES) == [width, width]
    page.context.close()


def test_without_scripts_the_picture_and_all_figures_are_there(chromium, report):
    context = chromium.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(report.as_uri())
    assert page.locator("#explorer img").is_visible()
    assert "can tell its position well on 21 %" in page.inner_text("body")
    context.close()
