"""`ambinav design place` as a user meets it: what is printed, written and refused; the audit."""

from __future__ import annotations

import json

import pytest
from PIL import Image
from typer.testing import CliRunner

from ambinav.buildings.load import load_environment
from ambinav.buildings.obstacle_file import obstacles_of
from ambinav.cli import app
from ambinav.studies.design.place.document import Document

HALL = {
    "type": "FeatureCollection",
    "features": [
        {
            "type": "Feature",
            "properties": {"kind": "room"},
            "geometry": {
                "type": "Polygon",
                "coordinates": [[[0, 0], [8, 0], [8, 6], [0, 6], [0, 0]]],
            },
        }
    ],
}
LASER = """
name: bench laser
parts:
  - sensor: {max_range: 2.5, std: 0.03, resolution: 0.001}
    planar: {beams: 40, aperture_deg: 360}
"""
ASKED = ("hall.geojson", "-s", "laser.yaml", "--spacing", "0.25", "--no-store")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "hall.geojson").write_text(json.dumps(HALL))
    (tmp_path / "laser.yaml").write_text(LASER)
    (tmp_path / "part.wkt").write_text("POLYGON ((2 2, 6 2, 6 4, 2 4, 2 2))")
    (tmp_path / "far.wkt").write_text("POLYGON ((22 2, 26 2, 26 4, 22 4, 22 2))")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: str):
    return CliRunner().invoke(app, ["design", "place", *ASKED, *arguments])


@pytest.mark.slow
def test_a_report_is_written_and_read_again(folder) -> None:
    result = run(
        "--posts",
        "2",
        "--radius",
        "0.15",
        "--candidates",
        "12",
        "--polygon",
        "part.wkt",
        "-o",
        "out",
    )
    assert result.exit_code == 0, result.output
    names = {item.name for item in (folder / "out").iterdir()}
    assert names == {
        "report.json", "report.md", "report.html", "placement.geojson", "before.png", "after.png"
    }  # fmt: skip
    report = Document.model_validate_json((folder / "out" / "report.json").read_text())
    assert 4.0 < report.before.bad <= 8.0
    assert report.after.bad < report.before.bad
    placement = json.loads((folder / "out" / "placement.geojson").read_text())
    drawn = obstacles_of(placement, "placement")
    assert [one.kind for one in drawn] == ["post", "post"]
    edited = load_environment(folder / "hall.geojson").edited(add=[one.obstacle for one in drawn])
    assert edited.free.area == pytest.approx(48.0 - 2 * 0.0707, abs=0.05)
    page = (folder / "out" / "report.html").read_text()
    assert "data:image/png" in page
    assert "{{" not in page
    assert (
        f"| 1 | post | {report.obstacles[0].x_m:.2f} |"
        in (folder / "out" / "report.md").read_text()
    )
    with Image.open(folder / "out" / "after.png") as picture:
        colours = picture.convert("RGB").resize((80, 40)).getcolors(3200)
    assert colours is not None
    assert len(colours) > 20
    # Another run replaces it; other folders are left alone.
    (folder / "mine").mkdir()
    (folder / "mine" / "thesis.tex").touch()
    assert run("--posts", "1", "-o", "mine").exit_code == 2


@pytest.mark.slow
def test_json_is_the_report_alone(folder) -> None:
    result = run("--panels", "1", "--candidates", "4", "--free-standing", "--json")
    assert result.exit_code == 0, result.output
    report = Document.model_validate_json(result.stdout)
    (one,) = report.obstacles
    assert one.kind == "panel"
    assert not one.on_wall
    assert one.direction_deg is not None


@pytest.mark.sweep
def test_aged_buildings_and_zones_without_obstacles(folder) -> None:
    (folder / "lane.wkt").write_text("POLYGON ((0 2, 8 2, 8 4, 0 4, 0 2))")
    asked = ("--posts", "2", "--candidates", "6", "--keep-out", "lane.wkt", "--aged", "2")
    result = run(*asked, "--json")
    assert result.exit_code == 0, result.output
    report = Document.model_validate_json(result.stdout)
    assert report.obstacles
    for one in report.obstacles:
        assert abs(one.y_m - 3.0) >= 1.1
    assert report.aged is not None
    assert report.aged.buildings == 2
    assert 0.0 < report.aged.gain_low <= report.aged.gain <= report.aged.before
    # Without --examine no optimum is looked for.
    assert (report.gains, report.optima, report.coverage) == (None, (), None)
    assert run(*asked, "--json").stdout == result.stdout
    examined = Document.model_validate_json(run(*asked, "--examine", "--json").stdout)
    assert examined.gains is not None
    assert examined.aged == report.aged
    assert "in 2 aged buildings: " in run(*asked).output


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "none of them is given"),
        (("--posts", "2", "--panels", "1"), "2 of them are given"),
        (("--posts", "0"), "--posts: 0"),
        (("--posts", "-3"), "--posts: -3"),
        (("--posts", "3", "--radius", "-0.1"), "--radius: -0.1"),
        (("--posts", "3", "--radius", "0.6"), "not narrower than the passage"),
        (("--posts", "3", "--min-passage", "0"), "--min-passage: 0"),
        (("--posts", "3", "--min-passage", "0.3"), "less than the robot's width"),
        (("--posts", "3", "--candidates", "0"), "--candidates: 0"),
        (("--posts", "3", "--seed", "-1"), "--seed: -1"),
        (("--posts", "3", "--seed", "1"), "--seed is for --aged and --examine; leave it out"),
        (("--posts", "3", "--width", "1"), "--width is not about posts; leave it out"),
        (("--posts", "3", "--layers", "fisher"), "--layers has no effect here"),
        (
            ("--posts", "3", "--extrude", "2", "--scanner-height", "1", "--top", "3"),
            "--top: 3 is above",
        ),
        (("--tags", "3"), "measures no intensities"),
        (("--tags", "3", "--free-standing"), "flat on a wall"),
        (("--posts", "30", "--candidates", "5"), "30 are requested"),
        (("--posts", "1", "--polygon", "far.wkt"), "can be at no point"),
        (("--posts", "1", "--polygon", "part.wkt", "--route", "a.csv"), "give one of the two"),
        (("--posts", "1", "--route", "none.csv"), "none.csv"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(folder, arguments, said) -> None:
    result = run(*arguments)
    assert result.exit_code == 2, result.output
    text = " ".join(result.stderr.split())
    assert said in text
    assert "Traceback" not in text


@pytest.mark.slow
def test_ctrl_c_leaves_nothing(folder, monkeypatch) -> None:
    from ambinav.studies.design.place.effect import Effects

    def stop(*arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Effects, "tried", stop)
    result = run("--posts", "1", "-o", "out")
    assert result.exit_code == 130
    assert not (folder / "out").exists()


@pytest.mark.sweep
def test_the_audit_lists_the_first_posts(folder) -> None:
    command = ["audit", *ASKED, "--no-aliasing", "-o", "audit"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    report = json.loads((folder / "audit" / "report.json").read_text())
    helps = report["helps"]
    assert [one["number"] for one in helps["posts"]] == [1, 2, 3]
    assert helps["candidates"] <= 60
    assert helps["after_m2"] < helps["before_m2"]
    bad = sum(one["area_m2"] for one in report["zones"] if one["zone"] in ("corridor", "open"))
    assert helps["before_m2"] == pytest.approx(bad, abs=0.02)
    text = (folder / "audit" / "report.md").read_text()
    assert "## What would help" in text
    assert "What would help" in (folder / "audit" / "report.html").read_text()


@pytest.mark.slow
def test_an_audit_of_a_good_building_says_that_nothing_would_help(folder) -> None:
    laser = LASER.replace("2.5", "30.0")
    (folder / "laser.yaml").write_text(laser)
    command = ["audit", *ASKED, "--no-aliasing", "--posts", "3", "-o", "audit"]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    helps = json.loads((folder / "audit" / "report.json").read_text())["helps"]
    assert helps["posts"] == []
    assert "nothing can help" in helps["reason"]
    assert "nothing can help" in (folder / "audit" / "report.md").read_text()
