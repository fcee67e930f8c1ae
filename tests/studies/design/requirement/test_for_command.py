"""`ambinav design for` as a user meets it: what is printed, written and refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from PIL import Image
from typer.testing import CliRunner

from ambinav.buildings.obstacle_file import obstacles_of
from ambinav.cli import app
from ambinav.studies.design.requirement.costs import read_costs
from ambinav.studies.design.requirement.document import Document

ROOT = Path(__file__).parents[4]
LASER = """
name: bench laser
parts:
  - sensor: {max_range: 2.5, std: 0.03, resolution: 0.001}
    planar: {beams: 40, aperture_deg: 360}
"""
COSTS = "{post: 40, tag: 15, mount: 0, scanner: {turtlebot3-lds: 99}}"
ASKED = ("hall.wkt", "-s", "laser.yaml", "--spacing", "0.25", "--no-store", "--cost", "costs.yaml")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "hall.wkt").write_text("POLYGON ((0 0, 8 0, 8 6, 0 6, 0 0))")
    (tmp_path / "laser.yaml").write_text(LASER)
    (tmp_path / "costs.yaml").write_text(COSTS)
    (tmp_path / "long.wkt").write_text("POLYGON ((0 0, 16 0, 16 8, 0 8, 0 0))")
    (tmp_path / "places.yaml").write_text("places: {west: [1.5, 4], east: [14.5, 4]}")
    (tmp_path / "all.wkt").write_text("POLYGON ((-1 -1, 9 -1, 9 7, -1 7, -1 -1))")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: str):
    return CliRunner().invoke(app, ["design", "for", *ASKED, *arguments])


@pytest.mark.slow
def test_a_report_is_written(folder) -> None:
    result = run("bad < 50 %", "--may", "posts=4", "--candidates", "8", "-o", "out")
    assert result.exit_code == 0, result.output
    assert {item.name for item in (folder / "out").iterdir()} == {
        "report.json", "report.md", "report.html", "changes.geojson", "before.png", "after.png",
        "curve.png",
    }  # fmt: skip
    report = Document.model_validate_json((folder / "out" / "report.json").read_text())
    assert report.met
    assert report.after.bad_share < 0.5 <= report.before.bad_share
    assert report.cost == 40.0 * len(report.steps)
    front = [point for point in report.curve if point.on_front]
    assert [point.bad_area_m2 for point in front] == sorted(
        (point.bad_area_m2 for point in front), reverse=True
    )
    drawn = obstacles_of(json.loads((folder / "out" / "changes.geojson").read_text()), "changes")
    assert len(drawn) == len(report.steps)
    text = (folder / "out" / "report.md").read_text()
    assert "is met by" in report.summary
    assert report.summary.partition("is met by")[2] in text
    assert f"| 1 | Put up a post | {report.steps[0].x_m:.2f} |" in text
    page = (folder / "out" / "report.html").read_text()
    assert page.count("data:image/png") == 3
    assert "{{" not in page
    with Image.open(folder / "out" / "curve.png") as picture:
        assert len(picture.convert("RGB").resize((80, 40)).getcolors(3200) or ()) > 5


@pytest.mark.slow
def test_a_report_on_lost_robots_is_written(folder) -> None:
    (folder / "longer.yaml").write_text(LASER.replace("2.5", "6").replace("bench", "longer"))
    (folder / "costs.yaml").write_text("{post: 40, scanner: {longer.yaml: 90}}")
    arguments = ["design", "for", "long.wkt", "lost < 10 %", *ASKED[1:], "--may", "posts=1,scanner"]
    arguments += ["--places", "places.yaml", "--candidates", "4", "-o", "out"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "worst trip" in result.stdout
    report = Document.model_validate_json((folder / "out" / "report.json").read_text())
    assert report.met
    assert [(trip.start, trip.goal) for trip in report.trips] == [
        ("west", "east"),
        ("east", "west"),
    ]
    worst = max(trip.after.lost for trip in report.trips)
    assert report.after.value == pytest.approx(100.0 * worst, abs=0.01)
    assert all(trip.after.driven.high <= 0.1 for trip in report.trips)
    driven = [trip.before.driven for trip in report.trips if trip.before.driven is not None]
    assert len(driven) == 1, "of what does not meet it the worst trip is driven"
    assert driven[0].low > 0.1
    front = [point.lost for point in report.curve if point.on_front]
    assert front == sorted(front, reverse=True)
    text, page = ((folder / "out" / f"report.{kind}").read_text() for kind in ("md", "html"))
    assert f"| west | east | {report.trips[0].after.length_m:.2f} |" in text
    assert "product" in page
    for document in (text, page):
        assert "drives confirm the limit" in document
        assert "{{" not in document


@pytest.mark.slow
def test_scanners_alone_that_do_not_meet_it_end_with_status_3(folder) -> None:
    (folder / "costs.yaml").write_text("{scanner: {turtlebot3-lds: 99}}")
    for required, hall, trips in (
        ("bad < 1 %", "hall.wkt", ()),
        ("lost < 1 %", "long.wkt", ("--places", "places.yaml")),
    ):
        arguments = ["design", "for", hall, required, *ASKED[1:], "--may", "scanner", "--json"]
        result = CliRunner().invoke(app, [*arguments, *trips])
        assert result.exit_code == 3, result.output
        assert Document.model_validate_json(result.stdout).met is False


def test_zones_do_not_refuse_what_a_scanner_cannot_use(folder) -> None:
    (folder / "corner.wkt").write_text("POLYGON ((0 0, 1 0, 1 1, 0 1, 0 0))")
    result = run("bad < 1 %", "--may", "tags=1", "--keep-out", "corner.wkt", "--json")
    assert result.exit_code == 3, result.output
    assert "measures no intensities" in " ".join(json.loads(result.stdout)["remarks"])


def test_what_cannot_be_met_ends_with_status_3(folder) -> None:
    result = run("bad < 1 %", "--may", "posts=1", "--candidates", "6", "--json")
    assert result.exit_code == 3, result.output
    report = Document.model_validate_json(result.stdout)
    assert report.met is False
    assert report.steps
    (rules,) = report.rules
    assert 0 < rules.candidates <= 6
    assert rules.candidates == sum(option.candidates for option in report.options)


def test_a_budget_below_everything_changes_nothing(folder) -> None:
    result = run("--budget", "39", "--may", "posts=2,scanner", "--json")
    assert result.exit_code == 0, result.output
    report = Document.model_validate_json(result.stdout)
    assert (report.met, report.cost, report.steps) == (None, 0.0, ())
    assert "Nothing helps within a budget of 39" in report.summary
    assert run("bad < 1 %", "--budget", "39", "--may", "posts=2", "-q").exit_code == 3


@pytest.mark.parametrize(
    ("required", "may", "more", "said"),
    [
        ("bad < 5 %", "panels=2", (), "costs.yaml: --may allows a panel but the key 'panel'"),
        ("bad < 5 %", "cones=2", (), "--may: 'cones' is not a change"),
        ("bad < 5 %", "posts", (), "the number of posts is missing; write posts=4"),
        ("bad < 5 %", "posts=0", (), "the number of posts is '0', not a whole number"),
        ("bad < 5 %", "posts=1,posts=2", (), "named twice"),
        ("bad < 5 %", "scanner=2", (), "scanner has no number"),
        ("bad < 5 %", "posts=2", ("--keep-out", "all.wkt"), "off the --keep-out zones"),
        ("bad < 5 %", "posts=2,scanner", ("--keep-out", "far.wkt"), "--keep-out: no polygon meets"),
        ("bad < 5 %", "scanner", ("--keep-out", "all.wkt"), "--keep-out is about new obstacles"),
        ("bad < 5 %", "scanner", ("--top", "1"), "--top is about new obstacles; leave it out"),
        ("bad < 5 %", "scanner", ("--candidates", "0"), "--candidates is about new obstacles"),
        ("bad < 5 %", "posts=2", ("--width", "1"), "--width is not about posts; leave it out"),
        ("bad < 5 %", "posts=2", ("--layers", "fisher"), "--layers has no effect here"),
        ("bad < 5 %", "posts=2", ("--may", "posts=1"), "named twice"),
        ("bad < 5 %", "tags=2", ("--free-standing",), "flat on a wall"),
        ("bad < 5 %", "posts=2", ("--budget", "-1"), "--budget: -1"),
        ("bad <", "posts=2", (), "a number is expected"),
        ("places < 3", "posts=2", (), "a requirement is about bad, bad area, corridor"),
        ("bad > 5 %", "posts=2", (), 'says what must hold, e.g. "bad < 5 %"'),
        ("localizable < 5 %", "posts=2", (), "asks for less localizable floor"),
        ("bad < 5 m2", "posts=2", (), 'write "bad area < 5 m²"'),
        ("bad < 5 %", "posts=2", ("--cost", "none.yaml"), "none.yaml"),
        ("lost < 5 %", "posts=2", (), "--places: \"lost < 5 %\" is about trips between places"),
        ("bad < 5 %", "posts=2", ("--places", "places.yaml"), "--places is for a requirement on"),
        ("bad < 5 %", "posts=2", ("--odometry", "poor"), "--odometry is for a requirement on lost"),
        ("lost < 5 %", "posts=2", ("--places", "no.yaml"), "no.yaml: the file cannot be read"),
        ("lost < 5 %", "posts=2", ("--places", "places.yaml"), "east at (14.5, 4) m is outside of"),
        (
            "lost < 5 %", "posts=2", ("--places", "places.yaml", "--localizer", "magic"),
            "--localizer: ",
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_a_sentence(folder, required, may, more, said) -> None:
    (folder / "far.wkt").write_text("POLYGON ((1000 0, 2000 0, 2000 900, 1000 0))")
    result = run(required, "--may", may, *more)
    assert result.exit_code == 2, result.output
    text = " ".join(result.stderr.split())
    assert said in text
    assert "Traceback" not in text


def test_neither_requirement_nor_budget(folder) -> None:
    result = run("--may", "posts=1")
    assert result.exit_code == 2
    assert "REQUIREMENT: none is given" in result.stderr


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{post: 0}", "costs.yaml: post is 0; give a number above 0"),
        ("{pots: 3}", "did you mean post"),
        ("{post: 1e300}", "post is '1e300'; give a number above 0, at most 1e+09"),
        ("{scanner: {rplidar-a1: -3}}", "-3"),
        ("{scanner: 99}", "scanner"),
        ("", "the file is empty"),
        ("{scanner: {rplidar-a11: 3}}", "costs.yaml: scanner:"),
    ],
)
def test_costs_that_are_none_are_refused(folder, text, said) -> None:
    (folder / "costs.yaml").write_text(text)
    result = run("bad < 5 %", "--may", "scanner")
    assert result.exit_code == 2, result.output
    assert said in " ".join(result.stderr.split())


def test_the_example_of_costs_can_be_read() -> None:
    path = ROOT / "configs" / "costs-example.yaml"
    assert "invented examples" in path.read_text()
    assert len(read_costs(path).prices()) == 3


@pytest.mark.slow
def test_listed_scanners_that_cannot_be_used_are_said(folder) -> None:
    (folder / "costs.yaml").write_text("{scanner: {velodyne-vlp-16: 9, laser.yaml: 9}}")
    result = run("bad < 1 %", "--may", "scanner", "--may", "second-scanner", "--json")
    assert result.exit_code == 3, result.output
    remarks = " ".join(json.loads(result.stdout)["remarks"])
    assert "No second scanner velodyne-vlp-16: it is not a fan" in remarks
    assert "laser.yaml of costs.yaml is the present scanner." in remarks


@pytest.mark.slow
def test_of_equally_dear_scanners_the_better_one(folder) -> None:
    """Whichever is listed first; their files are looked for beside the costs."""
    (folder / "sub").mkdir()
    for name, reach in (("near", 3.2), ("far", 12.0)):
        text = LASER.replace("bench laser", name).replace("2.5", str(reach))
        (folder / "sub" / f"{name}.yaml").write_text(text)
    for first, second in (("near", "far"), ("far", "near")):
        costs = f"{{scanner: {{{first}.yaml: 90, {second}.yaml: 90}}}}"
        (folder / "sub" / "costs.yaml").write_text(costs)
        asked = ["hall.wkt", "-s", "laser.yaml", "--spacing", "0.25", "--no-store", "--json"]
        result = CliRunner().invoke(
            app, ["design", "for", *asked, "--cost", "sub/costs.yaml", "bad < 40 %",
                  "--may", "scanner", "-o", f"out-{first}"],
        )  # fmt: skip
        assert result.exit_code == 0, result.output
        assert "is met by far for 90" in json.loads(result.stdout)["summary"]
    (folder / "sub" / "same.yaml").write_text(LASER.replace("2.5", "9.0"))
    (folder / "sub" / "costs.yaml").write_text("{scanner: {same.yaml: 90}}")
    result = CliRunner().invoke(
        app, ["design", "for", *asked, "--cost", "sub/costs.yaml", "bad < 40 %", "--may", "scanner",
              "-o", "out"],
    )  # fmt: skip
    assert result.exit_code == 2
    assert "same.yaml is called 'bench laser', as another one is" in " ".join(result.stderr.split())


def test_zones_beside_the_building_are_refused(folder) -> None:
    (folder / "zones.wkt").write_text("POLYGON ((5000 0, 8000 0, 8000 6000, 5000 0))")
    result = run("bad < 50 %", "--may", "posts=1", "--keep-out", "zones.wkt", "-o", "out")
    assert result.exit_code == 2
    assert "--keep-out: no polygon meets hall" in result.stderr
    assert not (folder / "out").exists()
