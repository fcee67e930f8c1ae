"""`ambinav design sweep` as a user meets it: report, pictures, JSON, and what is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import shapely
from PIL import Image
from typer.testing import CliRunner, Result

import ambinav as an
from ambinav.cli import app
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.files import save_route
from ambinav.routes.route import Route
from ambinav.service.service import AmbiguityService
from ambinav.studies.design.sweep.document import Document
from tests.geometry.furnished import ROOM, TABLES, box

CAMERA = """
name: "camera | <b>"
parts:
  - sensor: {name: camera, max_range: 4.0, resolution: 0.01, std: 0.03}
    planar: {beams: 13, aperture_deg: 60, mount: [0.1, 0, 0]}
"""
RIG = """
name: rig
parts:
  - sensor: {name: left, max_range: 4.0, resolution: 0.01, std: 0.03}
    planar: {beams: 7, aperture_deg: 60, mount: [0.0, 0.1, 90]}
  - sensor: {name: sonar, aperture_deg: 20, max_range: 3.0, resolution: 0.01, std: 0.05}
    ring: {count: 8, radius: 0.1}
"""
QUICK = ("--spacing", "0.2")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    plan = shapely.union(shapely.box(0, 0, 4, 3), shapely.box(4, 1, 9, 2.5))
    (tmp_path / "plan.geojson").write_text(json.dumps(shapely.geometry.mapping(plan)))
    (tmp_path / "zone.geojson").write_text(
        json.dumps(shapely.geometry.mapping(shapely.box(5, 0, 9, 3)))
    )
    (tmp_path / "camera.yaml").write_text(CAMERA)
    (tmp_path / "rig.yaml").write_text(RIG)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: str, scanner: str = "camera.yaml") -> Result:
    command = ["design", "sweep", "plan.geojson", "-s", scanner, *QUICK, *arguments]
    return CliRunner().invoke(app, command)


def written(folder: Path) -> Document:
    return Document.model_validate_json((folder / "report.json").read_text(encoding="utf-8"))


def is_picture(path: Path) -> bool:
    with Image.open(path) as picture:
        return min(picture.size) > 300 and len(set(picture.convert("L").tobytes())) > 4


@pytest.mark.slow
def test_a_report_of_one_variation(folder: Path) -> None:
    result = run("--vary", "aperture=60:360:150", "--places", "60", "-o", "out")
    assert result.exit_code == 0, result.output
    out = folder / "out"
    names = {"report.json", "report.html", "report.md", "scanner.yaml", "settings.png"}
    assert {item.name for item in out.iterdir()} == names
    assert is_picture(out / "settings.png")
    report = written(out)
    assert [one.values["aperture"] for one in report.settings] == [60.0, 210.0, 360.0]
    assert report.region.places == 60
    assert report.region.of_places > 60
    assert report.region.headings == "8, weighted equally"
    assert report.best.mean == min(one.mean or 1.0 for one in report.settings)
    assert sum(one or 0.0 for one in report.best.areas.values()) == pytest.approx(
        report.region.amount, abs=0.1
    )
    assert report.best_interval.low is not None
    assert report.turning is None
    assert report.summary.split(".")[0] in " ".join(result.stdout.split())
    assert "present" in result.stdout
    best = an.RangeScanner.from_yaml(out / "scanner.yaml")
    assert best.name == f"camera | <b> (aperture {report.best.values['aperture']:g})"
    page = (out / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    assert "<b>" not in page.replace("&lt;b&gt;", "")
    assert "camera | &lt;b&gt;" in page
    text = (out / "report.md").read_text(encoding="utf-8")
    # A table is one block: nothing but the head and its rule, the settings, the present one.
    table = text.split("## Settings")[1].split("## How")[0].strip().splitlines()
    assert len(table) == 6
    assert len({line.count(" |") for line in table[2:]}) == 1
    assert "60 of " in text
    assert "| open (about m²) |" in text and "Open (about m²)" in page


@pytest.mark.slow
def test_a_report_of_two_variations_along_a_route(folder: Path) -> None:
    amap = an.build_map(
        an.load_environment("plan.geojson"),
        an.RangeScanner.from_yaml("camera.yaml"), 0.2, store=False,
    )  # fmt: skip
    route = Route.through([[1.0, 1.7], [8.0, 1.7]])
    save_route(
        evaluate_route(AmbiguityService(amap), route.poses, route.steering, planner="given"),
        folder / "route.csv",
    )
    result = run(
        "--vary", "yaw=-90:90:90", "--vary", "aperture=60,120", "--route", "route.csv", "-o", "out",
        "--pictures", "svg", "--by", "bad",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    report = written(folder / "out")
    assert (report.region.kind, report.region.unit) == ("route", "m")
    assert report.region.amount == pytest.approx(7.0)
    assert report.region.seed is None
    assert (report.criterion, len(report.settings)) == ("bad", 6)
    assert report.turning is not None
    assert set(report.turning.shares) == {"-90", "0", "90"}
    assert (folder / "out" / "directions.svg").is_file()
    assert (folder / "out" / "settings.svg").is_file()
    # An earlier one is replaced.
    again = run("--vary", "beams=4,8", "--places", "5", "-o", "out")
    assert again.exit_code == 0, again.output
    assert not (folder / "out" / "directions.svg").exists()


def test_json_is_all_that_is_printed(folder: Path) -> None:
    result = run(
        "--vary", "beams=4", "--vary", "std=0.01,0.1", "--vary", "max_range=2,4", "--polygon",
        "zone.geojson", "--places", "0", "--json", "--heading", "90",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    report = Document.model_validate_json(result.stdout)
    # 4 m by 1.5 m less 0.2 m along three walls.
    assert report.region.amount == pytest.approx(3.8 * 1.1, abs=0.5)
    assert report.region.headings == "90° in the map, which the robot keeps"
    assert (report.best.values["beams"], report.best.values["std"]) == (4.0, 0.01)
    assert report.margin_over_present.low == report.margin_over_present.high


def test_a_part_of_a_rig_is_varied(folder: Path) -> None:
    arguments = ("--vary", "yaw=0,90", "--places", "8", "--json")
    result = run(*arguments, "--part", "sonar", scanner="rig.yaml")
    assert result.exit_code == 0, result.output
    assert Document.model_validate_json(result.stdout).part == "sonar"
    refused = run(*arguments, scanner="rig.yaml")
    assert refused.exit_code == 2
    assert "has 2 parts; name the one to vary: 1 (left), 2 (sonar)" in refused.stderr


@pytest.mark.slow
def test_a_plan_with_a_height(folder: Path) -> None:
    space = ("--extrude", "2.5", "--scanner-height", "0.4")
    vary = ("--vary", "pitch=0,-15", "--vary", "height=0.4,0.8", "--places", "30")
    result = run(*vary, *space, "-o", "out")
    assert result.exit_code == 0, result.output
    report = written(folder / "out")
    assert [(one.name, one.unit) for one in report.variations] == [
        ("pitch", "deg"),
        ("height", "m"),
    ]
    assert report.present.values == {"pitch": 0.0, "height": 0.4}
    assert report.present.same_beams_as == 0
    assert is_picture(folder / "out" / "settings.png")
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert "Height (m)" in page
    assert "Pitch (degrees)" in page
    # Walls alone: a level camera has the figures of the plan.
    plan = run("--vary", "std=0.03", "--places", "30", "--json")
    mean = Document.model_validate_json(plan.stdout).present.mean
    assert report.present.mean == pytest.approx(mean, abs=1e-3)


@pytest.mark.slow
def test_a_mesh(folder: Path) -> None:
    parts = [box(*ROOM), *(box(*table) for table in TABLES)]
    lines = [f"v {x} {y} {z}" for vertices, _ in parts for x, y, z in vertices.tolist()]
    for part, (_, faces) in enumerate(parts):
        lines += ["f " + " ".join(str(k + 1 + 8 * part) for k in face) for face in faces.tolist()]
    (folder / "room.obj").write_text("\n".join(lines))
    arguments = [
        "design", "sweep", "room.obj", "-s", "camera.yaml", *QUICK, "--places", "60", "-o", "out",
        "--vary", "height=0.3,0.9",
    ]  # fmt: skip
    refused = CliRunner().invoke(app, arguments)
    assert refused.exit_code == 2
    assert "does not say how high it is mounted; give --scanner-height" in refused.stderr
    result = CliRunner().invoke(app, [*arguments, "--scanner-height", "0.3"])
    assert result.exit_code == 0, result.output
    low, high = written(folder / "out").settings
    # The table is passed below, but not by a mast.
    assert low.standing == 1.0
    assert high.standing is not None
    assert high.standing < 1.0
    share = f"{100 * high.standing:.1f} %"
    assert re.search(rf"fits on *\n +0\.3 .* 100\.0 % *\n +0\.9 .* {share}", result.stdout)
    assert f"| {share} |" in (folder / "out" / "report.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (("--vary", "aperture=360:60:30"), "runs backwards; give aperture=60:360:30"),
        (("--vary", "aperture=60:360:0"), "has a step of 0"),
        (("--vary", "colour=1"), "is not a property of a scanner"),
        (("--vary", "yaw=0:359:1", "--vary", "beams=4:30"), "settings; give wider steps"),
        (("--vary", "yaw=0", "--polygon", "far.wkt"), "the robot can be at no point of it"),
        (
            ("--vary", "yaw=0", "--polygon", "line.wkt"),
            "line.wkt: it is a LineString; give polygons",
        ),
        (("--vary", "yaw=0", "--polygon", "none.wkt"), "none.wkt"),
        (("--vary", "yaw=0", "--route", "none.csv"), "none.csv"),
        (("--vary", "yaw=0", "--route", "a", "--polygon", "b"), "--polygon: it excludes --route"),
        (("--vary", "yaw=0", "--by", "price"), "--by: 'price' is unknown; choose from mean"),
        (("--vary", "yaw=0", "--places", "-1"), "--places: -1 is negative"),
        (("--vary", "yaw=0", "--spacing", "0"), "--spacing"),
        (("--vary", "yaw=0", "--pictures", "gif"), "--pictures"),
        (("--vary", "yaw=0", "--heading", "nan"), "--heading: nan is not a heading"),
        (("--vary", "yaw=0", "--headings", "0"), "--headings: 0 is too few"),
        (("--vary", "yaw=0", "--spacing", "2"), "--ambiguity-radius: 0.5 m is less than the"),
        (("--vary", "yaw=0", "--seed", "1", "--places", "0"), "--seed has no effect"),
        (("--vary", "yaw=0", "--start", "99", "99"), "--start: from (99, 99): a robot"),
        (("--vary", "yaw=0", "--part", "9"), "--part: "),
        (("--vary", "beams=8:16:4:2"), "--vary: 'beams=8:16:4:2' is not a range; give beams=first"),
        (("--vary", "yaw=0", "-o", "."), "which is not of an earlier sweep"),
        (
            ("--vary", "yaw=0", "--heading", "1", "--headings", "2"),
            "--headings is a number of headings, and --heading keeps",
        ),
        (("--vary", "max_range=0.001", "--places", "5"), "vary max_range 0.001: "),
        (("--vary", "height=0.5"), "vary height: plan is a plan, which has no heights; give the "),
        (("--vary", "pitch=5"), "vary pitch: plan is a plan, which has no heights; give the "),
        (
            ("--vary", "yaw=0", "--extrude", "2.5"),
            "on its floor; give the mount a height: `z:` in "
            "its file, `--scanner-height M` on the command line",
        ),
        (("--vary", "height=0", "--extrude", "2.5"), "vary height: 0 m is not above the floor"),
        (("--vary", "yaw=0", "--extrude", "-1"), "--extrude: -1 is not above zero"),
        (("--vary", "yaw=0", "--scanner-height", "-1"), "--scanner-height: -1 is not above zero"),
    ],
)
def test_bad_input_is_one_sentence_and_status_2(
    folder: Path, arguments: tuple[str, ...], what: str
) -> None:
    (folder / "far.wkt").write_text("POLYGON((50 50, 60 50, 60 60, 50 50))")
    (folder / "line.wkt").write_text("LINESTRING(0 0, 1 1)")
    result = run(*arguments)
    assert result.exit_code == 2, result.output
    assert what in " ".join(result.stderr.split())
    assert len(result.stderr.splitlines()) == 1
    assert not (folder / "out").exists()
