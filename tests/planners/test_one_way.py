"""One-way lanes: files, motions, and routes checked by samples."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import affinity

import ambinav as an
from ambinav.geometry.footprint import Footprint
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.fronts import pareto
from ambinav_planners.missions import Mission, plan_mission
from ambinav_planners.one_way import OneWayLanes
from ambinav_planners.planning import NotFoundError, RoutePlanner

# The demo's long corridor, driven to the east on the south side and to the west on the north side.
SOUTH, NORTH = shapely.box(10, 12, 28, 13), shapely.box(10, 13, 28, 14)
EAST, WEST = (10.5, 13.0), (27.5, 13.0)


def metres_against(polygons: Any, degrees: Any, poses: Any) -> float:
    """Metres of a polyline against its lanes, by samples a centimetre apart."""
    steps = [max(int(np.hypot(*(b - a)[:2]) / 0.01), 1) for a, b in itertools.pairwise(poses)]
    points = np.concatenate(
        [
            *(
                np.linspace(a, b, count, endpoint=False)
                for (a, b), count in zip(itertools.pairwise(poses), steps, strict=True)
            ),
            poses[-1:],
        ]
    )[:, :2]
    middle, step = 0.5 * (points[1:] + points[:-1]), np.diff(points, axis=0)
    metres = 0.0
    for polygon, angle in zip(polygons, degrees, strict=True):
        along = step @ [np.cos(np.radians(angle)), np.sin(np.radians(angle))]
        inside = shapely.contains_xy(polygon.buffer(-0.001), *middle.T)
        back = inside & (along < -1e-5 * np.hypot(*step.T))
        metres += float(np.hypot(*step[back].T).sum())
    return metres


@pytest.mark.slow
def test_two_lanes_are_driven_on_their_sides(demo: AmbiguityService) -> None:
    robot = RoutePlanner(demo, one_way=OneWayLanes.of([SOUTH, NORTH], [0.0, 180.0]))
    for start, goal in ((EAST, WEST), (WEST, EAST)):
        route = robot.plan(start, goal, weight=0.0)
        assert route.length == pytest.approx(17.0, abs=0.1)
        assert metres_against([SOUTH, NORTH], [0.0, 180.0], route.poses) == 0.0


@pytest.mark.slow
def test_against_the_only_lane_the_route_leads_round_it(demo: AmbiguityService) -> None:
    corridor = shapely.union(SOUTH, NORTH)
    robot = RoutePlanner(demo, one_way=OneWayLanes.of([corridor], [180.0]))
    start, goal = (8.0, 13.0), (30.0, 13.0)
    ahead, back = (robot.plan(*ends, weight=0.0) for ends in ((goal, start), (start, goal)))
    assert ahead.length == pytest.approx(22.0, abs=0.01)
    assert 24.0 < back.length < 24.5
    assert metres_against([corridor], [180.0], back.poses) == 0.0
    # Through the lane the tour has to go from east to west.
    mission = Mission((29.0, 13.0), (goal,), ((14.0, 13.0), (24.0, 13.0)), any_order=True)
    assert plan_mission(robot, mission, weight=0.0).order == (1, 0)
    front = pareto(robot, start, goal, weights=(0.0, 2.0))
    for point in front.points:
        assert metres_against([corridor], [180.0], point.route.poses) == 0.0


def test_a_goal_in_a_lane_is_reached_along_its_edge() -> None:
    hall = an.environment_from_shapes([shapely.box(0, 0, 4, 4)])
    amap = an.build_map(hall, an.RangeScanner.from_preset("turtlebot3-lds"), spacing=0.25)
    lanes = OneWayLanes.of([shapely.box(1, 1, 3, 3)], [270.0])
    robot = RoutePlanner(AmbiguityService(amap, weight=0.0), footprint=0.1, one_way=lanes)
    start, goal, corner = (0.4, 0.3), (1.3, 2.171), (1.0, 2.171)
    route = robot.plan(start, goal)
    assert lanes.allow(route.poses)
    assert route.length == pytest.approx(math.dist(start, corner) + 0.3, rel=0.002)


@pytest.mark.slow
def test_lanes_choose_the_planner_that_keeps_them(demo: AmbiguityService) -> None:
    lanes = OneWayLanes.of([SOUTH], [0.0])
    square = Footprint.polygon([(-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)])
    robot = RoutePlanner(demo, one_way=lanes, footprint=square)
    assert robot.plan((12.0, 13.0), (14.0, 13.0), weight=0.0).planner == "reference"
    with pytest.raises(InputError, match="in r2 alone; give the space r2, or leave the lanes out"):
        RoutePlanner(demo, one_way=lanes, space="se2").plan((12.0, 13.0, 0.0), (14.0, 13.0, 0.0))


@pytest.mark.slow
def test_slanted_lanes(demo: AmbiguityService) -> None:
    """In the hall, lanes at any angle, across each other."""
    rng = np.random.default_rng(0)
    polygons, degrees = [], []
    for _ in range(5):
        (x, y), angle = rng.uniform((10, 17), (20, 25)), rng.uniform(0.0, 180.0)
        box = shapely.box(x - 3.0, y - 0.6, x + 3.0, y + 0.6)
        polygons.append(affinity.rotate(box, angle, origin=(x, y)))
        degrees.append(angle + 180.0 * rng.integers(2))
    robot = RoutePlanner(demo, one_way=OneWayLanes.of(polygons, degrees))
    route = robot.plan((7.6, 15.0), (22.4, 27.5), weight=0.0)
    raw = robot.plan((7.6, 15.0), (22.4, 27.5), weight=0.0, improved=False)
    assert metres_against(polygons, degrees, route.poses) == 0.0
    assert np.hypot(22.4 - 7.6, 27.5 - 15.0) < route.length < raw.length


def test_motions() -> None:
    lanes = OneWayLanes.of([shapely.box(0, 0, 10, 1)], [0.0])
    a = np.array([[1, 0.5, 0], [5, 0.5, 0], [5, -1, 0], [5, -1, 0], [9, 1, 0], [9, 2, 0]], float)
    b = np.array([[5, 0.5, 0], [1, 0.5, 0], [5, 2, 0], [4, 2, 0], [1, 1, 0], [1, 2, 0]], float)
    assert lanes.allowed(a, b).tolist() == [True, False, True, False, True, True]


def write(path: Path, kind: str, coordinates: Any, **properties: Any) -> Path:
    feature = {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": kind, "coordinates": coordinates},
    }
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return path


def test_lanes_of_a_file(tmp_path: Path) -> None:
    ring = [[0, 0], [10, 0], [10, 1], [0, 1], [0, 0]]
    drawn = OneWayLanes.read(write(tmp_path / "a.geojson", "Polygon", [ring], direction=0))
    line = [[0, 0.5], [10, 0.5], [10, 5]]
    bent = OneWayLanes.read(write(tmp_path / "b.geojson", "LineString", line, width=1.0))
    difference = shapely.symmetric_difference(drawn.polygons[0], bent.polygons[0])
    assert difference.area == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(bent.directions, [[1, 0], [0, 1]], atol=1e-12)


RING = [[[0, 0], [1, 0], [1, 1], [0, 0]]]


@pytest.mark.parametrize(
    ("kind", "coordinates", "properties", "message"),
    [
        ("Polygon", RING, {}, r"features\[0\]: direction is None; give a finite number"),
        ("Polygon", [[[0, 0], [1, 0]]], {"direction": 0}, "fewer than 4 points"),
        ("Polygon", [[[0, 0], [1, 1], [1, 0], [0, 1], [0, 0]]], {"direction": 0}, "crosses itself"),
        ("LineString", [[0, 0], [1, 0]], {"width": 0}, r"features\[0\]: width is 0; give metres"),
        ("LineString", [[0, 0]], {"width": 1}, "there is no lane in it"),
        ("Point", [0, 0], {}, "type is 'Point'; draw lanes as Polygons"),
    ],
)
def test_files_that_hold_no_lanes(
    tmp_path: Path, kind: str, coordinates: Any, properties: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        OneWayLanes.read(write(tmp_path / "l.geojson", kind, coordinates, **properties))


@pytest.mark.parametrize("degrees", [[math.nan], [0.0, 90.0], 0.0, "north"])
def test_directions_that_are_none(degrees: Any) -> None:
    with pytest.raises(InputError, match="degrees is"):
        OneWayLanes.of([shapely.box(0.0, 0.0, 6.0, 4.0)], degrees)


@pytest.mark.slow
def test_what_cannot_keep_lanes(demo: AmbiguityService) -> None:
    lanes = OneWayLanes.of([shapely.box(10, 11, 28, 14)], [90.0])
    robot = RoutePlanner(demo, one_way=lanes, max_bad_metres=5.0)
    with pytest.raises(InputError, match="in r2 alone; leave the limit on bad metres in a row out"):
        robot.plan(EAST, WEST)
    with pytest.raises(InputError, match="in r2 alone; give that planner"):
        RoutePlanner(demo, one_way=lanes).plan(EAST, WEST, planner_name="prmstar")
    with pytest.raises(NotFoundError, match="goes against no one-way lane"):
        RoutePlanner(demo, one_way=OneWayLanes.of([shapely.box(0, 0, 45, 29)], [180.0])).plan(
            EAST, WEST
        )
    with pytest.raises(InputError, match=r"polygons\[0\] is not a valid polygon"):
        OneWayLanes.of([shapely.LineString([(0, 0), (1, 0)])], [0.0])
