"""The pages of all studies in a browser: on a phone, a tablet and a desk, light and dark."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import shapely
from typer.testing import CliRunner

from ambinav.cli import app
from tests.reports.widths import SIZES

HALL = shapely.Polygon([(0, 0), (20, 0), (20, 2.5), (8, 2.5), (8, 6), (4, 6), (4, 2.5), (0, 2.5)])
HALL_FILE = f"{'long' * 20}/hall.geojson"
"""A path without a place to break it; of the point in the file a note tells, which names it."""
SCANNER = ("--scanner", "turtlebot3-lds", "--spacing", "0.5")
CHANGES = ("--may", "posts=1", "--cost", "costs.yaml")
COMMANDS = {
    "audit": ("audit", HALL_FILE, *SCANNER),
    "diff": ("diff", HALL_FILE, HALL_FILE, *SCANNER, "--scanner-b", "hc-sr04"),
    "sweep": ("design", "sweep", HALL_FILE, *SCANNER, "--vary", "aperture=90:360:90"),
    "scanners": ("design", "scanners", HALL_FILE, *SCANNER, "--scanner", "hc-sr04"),
    "beams": ("design", "beams", HALL_FILE, *SCANNER),
    "place": ("design", "place", HALL_FILE, *SCANNER, "--posts", "1"),
    "for": ("design", "for", HALL_FILE, "bad < 30 %", *SCANNER, *CHANGES),
    "compare": ("compare", "scenario.yaml"),
}
SCENARIO = {
    "name": "hall", "environment": HALL_FILE, "scanner": "turtlebot3-lds",
    "map": {"spacing": 0.5}, "drive": {"runs": 2, "seed": 1},
    "pairs": [{"name": "along", "start": [1, 1], "goal": [18, 1]}],
    "routes": ["shortest", {"kind": "reference", "weight": 5}],
}  # fmt: skip


PICTURES = "() => document.querySelectorAll('figure img').length"
UNDIMMED = """() => [...document.querySelectorAll("figure img")].filter((picture) =>
  ![picture, picture.closest("figure")].some((e) => getComputedStyle(e).filter.includes("bright"))
).length"""
"""Script that counts the pictures that the dark does not dim."""


@pytest.mark.slow(kept=("diff", "for", "compare"))
@pytest.mark.usefixtures("coarse_pictures")
@pytest.mark.parametrize("study", COMMANDS)
def test_nothing_is_wider_than_the_screen(
    chromium: Any, study: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(HALL_FILE).parent.mkdir()
    shapes = shapely.GeometryCollection([HALL, shapely.Point(1.0, 1.0)])
    Path(HALL_FILE).write_text(shapely.to_geojson(shapes))
    Path("scenario.yaml").write_text(json.dumps(SCENARIO))
    Path("costs.yaml").write_text("post: 120\n")
    done = CliRunner().invoke(app, [*COMMANDS[study], "--output", "out"])
    assert done.exit_code == 0, done.output
    (page_file,) = Path("out").glob("*.html")
    for width, scheme in ((390, "light"), (768, "dark"), (1280, "light")):
        context = chromium.new_context(
            viewport={"width": width, "height": 800}, color_scheme=scheme, bypass_csp=True
        )
        page, faults = context.new_page(), []
        page.on("pageerror", lambda error, faults=faults: faults.append(str(error)))
        page.goto(page_file.resolve().as_uri())
        assert page.evaluate(SIZES) == [width, width], (width, scheme)
        assert page.evaluate(UNDIMMED) == (0 if scheme == "dark" else page.evaluate(PICTURES))
        assert faults == []
        context.close()
