"""Layouts of reflectors: search against all subsets, figures against shapely, the command."""

from __future__ import annotations

import itertools
import json
import math

import numpy as np
import pytest
import shapely
from PIL import Image
from typer.testing import CliRunner

import ambinav as an
from ambinav.buildings.load import load_environment
from ambinav.buildings.obstacle_file import obstacles_of
from ambinav.cli import app
from ambinav.geometry.collision.reach import find_reach
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.layers.context import LayerContext
from ambinav.layers.reflectors.positioning import Site
from ambinav.layers.reflectors.targets import Targets
from ambinav.layers.reflectors.views import ReflectorRules
from ambinav.runtime.errors import InputError
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav.studies.design.place.candidates import PlaceRules
from ambinav.studies.design.place.positions import Positions
from ambinav.studies.design.reflectors.document import Document
from ambinav.studies.design.reflectors.search import Search
from ambinav.studies.design.reflectors.study import ReflectorLayout, plan_reflectors

POSTS = PlaceRules(radius=0.05, most=60)
RULES = ReflectorRules()


def hall() -> Environment:
    """Return two rooms with a door between them, and a block in one."""
    rooms = [[(0, 0), (12, 0), (12, 7), (7, 7), (7, 9), (12, 9), (12, 14), (0, 14)]]
    block = Obstacle.wall([(3.0, 4.0), (5.0, 4.0)], 0.6)
    return an.environment_from_shapes(rooms).edited(add=[block])


def laser(beams: int = 720, max_range: float = 9.0) -> RangeScanner:
    """Return a laser that looks all around and measures intensities."""
    channel = Intensity(wall=0.3, reflector=1.0, std=0.15)
    sensor = RangeSensor(max_range=max_range, std=0.01, resolution=0.001, intensity=channel)
    return RangeScanner.planar(sensor, beams, 2 * math.pi)


def planned(
    count: int, environment: Environment | None = None, positions: PlaceRules = POSTS
) -> ReflectorLayout:
    """Plan reflectors in the hall on a map of 0.25 m."""
    building = hall() if environment is None else environment
    amap = an.build_map(building, laser(), spacing=0.25, store=False)
    reach = find_reach(building, 0.3)
    return plan_reflectors(building, laser(), amap, reach, RULES, positions, count)


@pytest.mark.slow(kept=("0", "1"))
@pytest.mark.parametrize("seed", range(4))
def test_search_comes_near_the_best_of_all_subsets(seed: int) -> None:
    building = hall()
    amap = an.build_map(building, laser(), spacing=0.5, store=False)
    site = Site.of(LayerContext.of(amap, building), RULES)
    reach = find_reach(building, 0.3)
    counted = amap.for_robot(reach).judged.counted[site.lattice.free]
    points = np.column_stack(site.lattice.points)
    spread, _ = Positions(building, POSTS, points, 9.0, reach.floor).spread_evenly(60)
    some = np.random.default_rng(seed).choice(len(spread), 10, replace=False)
    search = Search(site, counted, Targets.of_outlines([]), [spread[i] for i in some], 0.9)

    def worth(chosen: tuple[int, ...]) -> float:
        return float(search.state(chosen).positioning.good[counted].sum())

    found = search.place(4)
    assert not search.crowded[np.ix_(found, found)][np.triu_indices(len(found), 1)].any()
    best = max(
        worth(subset)
        for subset in itertools.combinations(range(10), 4)
        if not search.crowded[np.ix_(subset, subset)][np.triu_indices(4, 1)].any()
    )
    assert worth(found) >= 0.95 * best > 0.0


@pytest.mark.slow
def test_floor_that_sees_enough_is_that_of_straight_lines() -> None:
    layout = planned(5)
    assert len(layout.steps) == 5
    lattice = layout.amap.dataset
    x, y = np.meshgrid(lattice["x"].values, lattice["y"].values)
    places = np.column_stack([x[layout.parts.counted], y[layout.parts.counted]])
    posts = [candidate.middle for candidate in layout.chosen]
    walls = shapely.boundary(hall().free)
    step = 2 * math.pi / 720
    count = np.zeros(len(places), dtype=int)
    for post in posts:
        away = np.hypot(*(places - post).T)
        ends = post + (places - post) * (0.051 / away)[:, None]
        lines = shapely.linestrings(np.stack([places, ends], axis=1))
        hidden = shapely.intersects(lines, walls)
        for other in posts:
            if other != post:
                hidden |= shapely.dwithin(lines, shapely.Point(other), 0.05)
        wide = 2.0 * np.arcsin(np.minimum(0.05 / away, 1.0)) >= step
        count += ~hidden & (away - 0.05 <= 9.0) & wide
    area = layout.amap.cell_area
    assert layout.after.enough == pytest.approx((count >= 3).sum() * area, rel=0.01)
    assert layout.after.floor == pytest.approx(len(places) * area)


@pytest.mark.slow
def test_more_reflectors_serve_more_floor_and_come_in_order() -> None:
    few, many = planned(4), planned(10)
    assert many.after.good > few.after.good > few.before.good == 0.0
    enough = [step.after.enough for step in many.steps]
    # New posts may hide each other, by a cell or two.
    assert all(b >= a - 0.5 for a, b in itertools.pairwise(enough))
    assert many.after == many.steps[-1].after
    assert many.after.good <= many.after.unique <= many.after.enough <= many.after.floor
    assert many.after.std < RULES.max_std


@pytest.mark.slow
def test_present_reflectors_count_and_nothing_is_added_to_a_good_layout() -> None:
    first = planned(10)
    again = planned(0, first.edited())
    assert again.present == len(first.steps)
    # Floor under the posts is no longer free.
    assert again.before.good == pytest.approx(first.after.good, rel=0.01)
    more = planned(6, first.edited())
    assert more.after.good >= again.before.good


def test_a_scanner_without_intensities_and_a_wide_robot_are_refused() -> None:
    building = hall()
    blind = RangeScanner.from_preset("turtlebot3-lds")
    amap = an.build_map(building, laser(), spacing=0.5, store=False)
    with pytest.raises(InputError, match="recognises no reflectors"):
        plan_reflectors(building, blind, amap, find_reach(building, 0.3))
    with pytest.raises(InputError, match="robot's width"):
        plan_reflectors(building, laser(), amap, find_reach(building, 0.6), RULES, POSTS, 3)


LASER = """
name: navigation laser
parts:
  - sensor:
      {max_range: 9, std: 0.01, resolution: 0.001, intensity: {wall: 0.3, reflector: 1, std: 0.15}}
    planar: {beams: 720, aperture_deg: 360}
"""
HALL = {
    "type": "Feature",
    "properties": {"kind": "room"},
    "geometry": {"type": "Polygon", "coordinates": [[[0, 0], [9, 0], [9, 6], [0, 6], [0, 0]]]},
}


@pytest.mark.slow
def test_the_command_writes_a_layout_that_is_read_again(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    building = {"type": "FeatureCollection", "features": [HALL]}
    (tmp_path / "hall.geojson").write_text(json.dumps(building))
    (tmp_path / "laser.yaml").write_text(LASER)
    (tmp_path / "zone.wkt").write_text("POLYGON ((0 0, 4.5 0, 4.5 6, 0 6, 0 0))")
    words = ["design", "reflectors", "hall.geojson", "-s", "laser.yaml", "--spacing", "0.25"]
    words += ["--no-store"]
    result = CliRunner().invoke(app, [*words, "--tags", "5", "--keep-out", "zone.wkt", "-o", "out"])
    assert result.exit_code == 0, result.output
    names = {item.name for item in (tmp_path / "out").iterdir()}
    assert names == {
        "report.json", "report.md", "report.html", "reflectors.geojson", "before.png", "after.png"
    }  # fmt: skip
    report = Document.model_validate_json((tmp_path / "out" / "report.json").read_text())
    assert report.after.good_share > 0.65
    assert len(report.reflectors) == 5
    drawn = obstacles_of(json.loads((tmp_path / "out" / "reflectors.geojson").read_text()), "file")
    assert {each.kind for each in drawn} == {"reflector"}
    assert all(x > 4.4 for each in drawn for x, _ in each.points)
    edited = load_environment(tmp_path / "hall.geojson").edited(add=[d.obstacle for d in drawn])
    assert len(Targets.of(edited)) == 5
    with Image.open(tmp_path / "out" / "after.png") as picture:
        assert picture.width > 800
    judged = CliRunner().invoke(app, [*words, "--json"])
    assert judged.exit_code == 0
    assert json.loads(judged.output)["after"]["good_m2"] == 0.0
    for more, message in (
        (["--tags", "2", "--posts", "2"], "give one"),
        (["--tags", "0"], "give 1 or more"),
        (["--needed", "1"], "--needed is 1; give 2 or more: one reflector fixes no position"),
        (["--posts", "2", "--radius", "nan"], "--radius is nan"),
        (["--bottom", "1"], "No such option"),
        (["--tags", "2", "--free-standing"], "a tag is flat on a wall"),
    ):
        refused = CliRunner().invoke(app, [*words, *more])
        assert refused.exit_code == 2
        assert message in refused.output
