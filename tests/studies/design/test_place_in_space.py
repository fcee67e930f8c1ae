"""`design place`, `design for` and the audit's posts in buildings in space."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

import ambinav as an
from ambinav.buildings.obstacle_file import obstacles_of
from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.triangles import triangles_of
from ambinav.cli import app
from ambinav.geometry.collision.reach import find_reach
from ambinav.runtime.errors import InputError
from ambinav.sensing.intensity import Intensity
from ambinav.studies.design.place.candidates import PlaceRules
from ambinav.studies.design.place.study import Remedy, place_obstacles

LASER = an.RangeScanner.planar(
    an.RangeSensor(max_range=2.5, std=0.03, resolution=0.001), 40, math.tau, (0.0, 0.0, 0.003)
).raised(0.3)
BRIGHT = LASER.with_intensity(Intensity(wall=100.0, reflector=400.0, std=60.0))
SPACING = 0.25
POSTS = PlaceRules(radius=0.15, most=20)


def hall() -> an.Environment:
    return an.environment_from_shapes([shapely.box(0, 0, 8, 6)])


def tall() -> an.Environment:
    return hall().in_space(an.extruded(hall(), 2.5))


def meshed() -> an.Environment:
    building = tall()
    assert building.space is not None
    corners = triangles_of(building.space, (0.0, 0.0, 8.0, 6.0)).reshape(-1, 3)
    return hall().in_space(Mesh(corners, np.arange(len(corners)).reshape(-1, 3)))


def placed(
    env: an.Environment, scanner: an.RangeScanner = LASER, rules: PlaceRules = POSTS
) -> Remedy:
    amap = an.build_map(env, scanner, SPACING, store=False)
    return place_obstacles(env, scanner, amap, rules, 2, find_reach(env, 0.2))


@pytest.mark.sweep
def test_as_high_as_the_building_they_are_those_of_the_plan() -> None:
    """Of a level scanner; in prisms and in a mesh of the same hall."""
    plan, prisms, mesh = (placed(env) for env in (hall(), tall(), meshed()))
    for study in (prisms, mesh):
        assert [c.drawn for c in study.chosen] == [c.drawn for c in plan.chosen]
        assert study.placement.after.bad == pytest.approx(plan.placement.after.bad, abs=0.2)


@pytest.mark.slow(kept=("tall",))
@pytest.mark.parametrize("made", [tall, meshed])
def test_what_is_promised_is_what_a_whole_map_has(made) -> None:
    env = made()
    study = placed(env, rules=replace(POSTS, top=0.8))
    built = an.build_map(study.edited(), LASER, SPACING, store=False)
    levels = [amap.dataset["level"].values for amap in (study.after, built)]
    np.testing.assert_allclose(*levels, atol=1e-5)
    assert study.placement.after.bad < 0.9 * study.placement.before.bad


@pytest.mark.slow
def test_what_the_scanner_looks_over_does_not_help() -> None:
    """But for neighbours that it parts, and floor that it covers."""
    seen, below = (placed(tall(), rules=replace(POSTS, top=top)) for top in (0.4, 0.2))
    gains = [s.placement.before.bad - s.placement.after.bad for s in (seen, below)]
    assert gains[0] > 2.0
    assert gains[1] < 0.3


@pytest.mark.slow
def test_tags_at_the_height_of_the_scanner() -> None:
    rules = PlaceRules(kind="tag", width=0.5, reflective=True, most=12)
    seen, above = (
        placed(tall(), BRIGHT, replace(rules, bottom=low, top=low + 0.3)) for low in (0.2, 1.0)
    )
    level = [s.placement.before.level - s.placement.after.level for s in (seen, above)]
    assert level[0] > 0.1
    assert level[1] == 0.0
    assert not above.chosen


def test_nothing_reflects_in_a_mesh() -> None:
    env = meshed()
    assert not replace(POSTS, reflective=True).suited(env).reflective
    assert replace(POSTS, reflective=True).suited(tall()).reflective
    with pytest.raises(InputError, match=r"--tags: .* is a mesh, in which nothing is known"):
        PlaceRules(kind="tag", reflective=True).suited(env)


def test_a_mesh_cannot_be_aged() -> None:
    env, rng = meshed(), np.random.default_rng(1)
    amap = an.build_map(env, LASER, SPACING, store=False)
    with pytest.raises(InputError, match=r"--aged: .* is a mesh.*leave this out"):
        place_obstacles(env, LASER, amap, POSTS, 2, find_reach(env, 0.2), rng=rng, aged=3)


@pytest.mark.slow(kept=("meshed",))
@pytest.mark.parametrize("made", [tall, meshed])
def test_a_top_at_the_height_of_the_scanner_helps(made) -> None:
    env = made()
    study = placed(env, rules=replace(POSTS, top=0.3))
    bad = sum(share.area for share in study.after.zone_shares()[2:])
    assert study.placement.after.bad == pytest.approx(bad, abs=2.5)
    assert study.placement.after.bad < 0.5 * study.placement.before.bad


def test_heights_that_cannot_be_are_refused() -> None:
    with pytest.raises(InputError, match=r"--top: .* is a plan, without heights; .*--extrude M"):
        replace(POSTS, top=1.0).suited(hall())
    with pytest.raises(InputError, match=r"--bottom: .* is a plan"):
        replace(POSTS, bottom=1.0).suited(hall())
    with pytest.raises(InputError, match=r"--bottom: 2\.5 is not below the top of .*, 2\.5 m"):
        replace(POSTS, bottom=2.5).suited(tall())
    with pytest.raises(InputError, match=r"--top: 0\.5 is not above the bottom of 0\.5, or"):
        replace(POSTS, bottom=0.5, top=0.5)
    with pytest.raises(InputError, match="--bottom: -1 is below the floor"):
        replace(POSTS, bottom=-1.0)


BENCH = """
name: bench laser
parts:
  - sensor: {max_range: 2.5, std: 0.03, resolution: 0.001}
    planar: {beams: 40, aperture_deg: 360, mount: [0, 0, 0.2]}
"""
ASKED = ("hall.wkt", "-s", "laser.yaml", "--spacing", "0.25", "--no-store")
SPACE = ("--extrude", "2.5", "--scanner-height", "0.3")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "hall.wkt").write_text("POLYGON ((0 0, 8 0, 8 6, 0 6, 0 0))")
    (tmp_path / "laser.yaml").write_text(BENCH)
    (tmp_path / "costs.yaml").write_text("{post: 40, scanner: {turtlebot3-lds: 99}}")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: str):
    return CliRunner().invoke(app, list(arguments))


@pytest.mark.slow
def test_the_command_writes_heights_that_are_read_again(folder) -> None:
    more = ("--posts", "1", "--candidates", "8", "--bottom", "0.1", "--top", "1", "-o", "out")
    result = run("design", "place", *ASKED, *SPACE, *more)
    assert result.exit_code == 0, result.output
    (post,) = obstacles_of(json.loads((folder / "out" / "placement.geojson").read_text()), "it")
    assert (post.bottom, post.top) == (0.1, 1.0)
    assert (post.obstacle.bottom, post.obstacle.top) == (0.1, 1.0)
    rules = json.loads((folder / "out" / "report.json").read_text())["rules"]
    assert (rules["bottom_m"], rules["top_m"]) == (0.1, 1.0)
    assert "0.1 to 1 m above the floor" in (folder / "out" / "report.md").read_text()


@pytest.mark.slow
def test_requirements_are_met_in_space(folder) -> None:
    more = ("bad < 40 %", "--may", "posts=4,scanner", "--cost", "costs.yaml", "--candidates", "8")
    plan, space = (
        json.loads(run("design", "for", *ASKED, *more, *options, "--json").stdout)
        for options in ((), SPACE)
    )
    assert space["met"] is plan["met"] is True
    assert [step["text"] for step in space["steps"]] == [step["text"] for step in plan["steps"]]


@pytest.mark.sweep
def test_an_audit_in_space_gives_the_advice_of_the_plan(folder) -> None:
    """Of a level scanner in an extruded hall: the same changes, posts and lost routes."""
    reports = []
    for name, options in (("plan", ()), ("space", SPACE)):
        more = ("--no-aliasing", "--posts", "2", "-o", name)
        result = run("audit", *ASKED, *options, *more)
        assert result.exit_code == 0, result.output
        reports.append(json.loads((folder / name / "report.json").read_text()))
    plan, space = (report["verdict"] for report in reports)
    assert space["decision"] == plan["decision"]
    assert len(plan["tried"]) > 3
    after = [{t["title"]: t["after_m2"] for t in part["tried"]} for part in (plan, space)]
    assert after[0].keys() == after[1].keys()
    for title, area in after[0].items():
        assert after[1][title] == pytest.approx(area, abs=0.7), title
    helps = [report["helps"] for report in reports]
    assert helps[1]["after_m2"] < helps[1]["before_m2"]
    assert helps[1]["after_m2"] == pytest.approx(helps[0]["after_m2"], abs=0.3)
    assert (reports[0]["lost"] is None) == (reports[1]["lost"] is None)


@pytest.mark.parametrize("height", [2.7, 2.6, 3.3])
def test_obstacles_may_be_as_high_as_the_building_and_no_higher(height: float) -> None:
    """Of heights that the building holds in float32, below or above what was given."""
    building = hall().in_space(an.extruded(hall(), height))
    rules = PlaceRules(radius=0.15, top=height).suited(building)
    assert rules.top == pytest.approx(height)
    with pytest.raises(InputError, match=f"--top: {height + 0.01:g} is above"):
        PlaceRules(radius=0.15, top=height + 0.01).suited(building)


def test_heights_in_a_plan_are_refused_in_a_sentence(folder) -> None:
    result = run("design", "place", *ASKED, "--posts", "1", "--top", "1")
    assert result.exit_code == 2
    assert "--top: hall is a plan, without heights" in " ".join(result.stderr.split())
    result = run("design", "place", *ASKED, "--posts", "1", "--extrude", "2.5")
    assert result.exit_code == 2
    assert "on its floor; give the mount a height" in " ".join(result.stderr.split())
