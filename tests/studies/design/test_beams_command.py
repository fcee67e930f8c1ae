"""`ambinav design beams` as a user meets it: what is printed, written and refused."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image
from typer.testing import CliRunner, Result

import ambinav as an
from ambinav.cli import app
from ambinav.geometry.motion.steering import Steering
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.files import save_route
from tests.test_cli import PLAN, SCANNER

QUICK = ("--places", "40", "--spacing", "0.25")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "plan.geojson").write_text(json.dumps(PLAN))
    (tmp_path / "scanner.yaml").write_text(SCANNER)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, ["design", "beams", *arguments])


@pytest.mark.slow
def test_the_report_is_whole_and_the_files_say_the_same(folder: Path) -> None:
    result = run("plan.geojson", "-s", "scanner.yaml", "-o", "out", "--loss", "8", *QUICK)
    assert result.exit_code == 0, result.output
    assert {path.name for path in (folder / "out").iterdir()} == {
        "report.html", "report.md", "report.json", "scanner.yaml", "laser_filters.yaml",
        "kept-beams.png", "loss-by-beams.png",
    }  # fmt: skip
    report = json.loads((folder / "out/report.json").read_text())
    assert report["format"] == "ambinav-design-beams/1"
    kept = report["chosen"]["beams"]
    assert 1 < len(kept) < 36
    assert report["chosen"]["checked"]["zones_points"] <= 8.0
    full = an.RangeScanner.from_yaml(folder / "scanner.yaml")
    written = an.RangeScanner.from_yaml(folder / "out/scanner.yaml")
    np.testing.assert_allclose(written.mounts, full.mounts[kept], atol=1e-12)
    plain = yaml.safe_load((folder / "out/laser_filters.yaml").read_text())
    masks = plain["scan_to_scan_filter_chain"]["ros__parameters"]["filter1"]["params"]["masks"]
    assert sorted([*kept, *masks["laser"]]) == list(range(36))
    page = (folder / "out/report.html").read_text()
    assert not re.findall(r'(?:src|href)="(?!data:)', page)
    text = (folder / "out/report.md").read_text()
    assert report["summary"] in text
    assert html.escape(report["summary"]).replace("&#x27;", "&#39;") in page
    for name in report["pictures"]:
        with Image.open(folder / "out" / name) as picture:
            assert min(picture.size) > 300
    # Again, into the same folder; with the same seed the same is found.
    again = run("plan.geojson", "-s", "scanner.yaml", "-o", "out", "--loss", "8", *QUICK, "--json")
    assert json.loads(again.stdout)["chosen"] == report["chosen"]


@pytest.mark.slow
def test_a_route_counts_at_its_headings(folder: Path) -> None:
    amap = an.build_map(an.load_environment("plan.geojson"), "hc-sr04", 0.5, store=False)
    service = an.AmbiguityService(amap)
    save_route(
        evaluate_route(service, [(0.6, 1.7, 0.0), (10.0, 1.7, 0.0)], Steering(), planner="by hand"),
        folder / "route.csv",
    )
    (folder / "ring.yaml").write_text(
        "parts: [{sensor: {max_range: 2, std: 0.02, resolution: 0.01, aperture_deg: 20}, "
        "ring: {count: 8, radius: 0.1}}]"
    )
    result = run(
        "plan.geojson", "-s", "ring.yaml", "-o", "out", "--loss", "20", "--route", "route.csv",
        "--robot-radius", "0.1", *QUICK, "--json",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    report = json.loads(result.stdout)
    assert report["parameters"]["region"] == "route.csv"
    assert report["files"] == ["scanner.yaml"]
    assert report["gaps"]
    assert "no LaserScan message" in (folder / "out/report.md").read_text()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (
            ("--loss", "0"),
            "--loss: 0 is not a valid loss; give percentage points above 0 and below 100",
        ),
        (("--loss", "nan"), "--loss: nan is not a valid loss"),
        (("--loss", "250"), "--loss: 250 is not a valid loss"),
        (("--places", "0"), "--places: 0 is too few"),
        (("--places", "9000000"), "give at most"),
        (("--ambiguity-radius", "0.1"), "at least one spacing"),
        (("--angle-min", "720"), "--angle-min: 720 is out of range"),
        (("--frame", "a", "--frame", "a", "--frame", "a", "--frame", "a"), "there are 4 names"),
        (("-s", "velodyne-vlp-16"), "--scanner: 'velodyne-vlp-16' looks up or down"),
        (("--polygon", "a.wkt", "--route", "b.csv"), "give one of the two"),
        (("plan.geojson", "--route", "b.csv"), "lies in one building, but 2 maps are given"),
        (("--polygon", "a.wkt"), "a.wkt"),
        (("-s", "hc-sr04"), "scanner 'hc-sr04' has a single beam"),
        (("--robot-radius", "5"), "5 m"),
        (("--pictures", "bmp"), "bmp"),
        (("-o", "."), "not of an earlier search for fewer beams"),
    ],
)
def test_bad_input_is_one_sentence(folder: Path, arguments: tuple[str, ...], sentence: str) -> None:
    given = {"-s": "scanner.yaml", "-o": "out"}
    rest = [part for key, value in given.items() if key not in arguments for part in (key, value)]
    result = run("plan.geojson", *arguments, *rest)
    assert result.exit_code == 2, result.output
    (line,) = result.stderr.strip().splitlines()
    assert line.startswith("ambinav: error: ")
    assert sentence in line
    assert not (folder / "out").exists()


def test_the_order_of_the_maps_does_not_matter(folder: Path) -> None:
    (folder / "hall.wkt").write_text("POLYGON((0 0, 9 0, 9 7, 5 7, 5 4, 0 4, 0 0))")
    reports = []
    for maps in (("plan.geojson", "hall.wkt"), ("hall.wkt", "plan.geojson")):
        words = (*maps, "-s", "scanner.yaml", "-o", "out", "--loss", "20", *QUICK, "--json")
        result = run(*words)
        assert result.exit_code == 0, result.output
        reports.append(json.loads(result.stdout))
    first, second = reports
    assert first["chosen"] == second["chosen"]
    assert first["information"] == pytest.approx(second["information"])
    assert first["maps"] == second["maps"][::-1]


def test_rougher_walls_leave_the_position_less_certain(folder: Path) -> None:
    deviations = []
    for std in ("0.02", "0.3"):
        words = (
            "plan.geojson",
            "-s",
            "scanner.yaml",
            "-o",
            "out",
            "--loss",
            "20",
            *QUICK,
            "--json",
        )
        result = run(*words, "--map-std", std)
        assert result.exit_code == 0, result.output
        deviations.append(json.loads(result.stdout)["information"]["all_m"])
    assert deviations[0] < deviations[1]
