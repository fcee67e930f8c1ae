"""Starts and goals of all kinds: headings beyond half a turn, turns on the spot, narrow doors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely

from ambinav import (
    AmbiguityMap,
    Footprint,
    InputError,
    RangeScanner,
    build_map,
    environment_from_shapes,
)
from ambinav_planners import NoPathError, Replanner, RoutePlanner
from tests.planners.conftest import LASER

START, GOAL = (1.0, 1.0), (7.0, 5.0)
ITERATIONS = {"rrtstar": 600, "informed-rrtstar": 600, "bitstar": 3000, "fmt": 500, "prmstar": 600}
SCANNER = RangeScanner.planar(sensor=LASER, beams=36, aperture=2.0 * math.pi)


def fixed(iterations: int) -> dict[str, Any]:
    """A budget that no other load on the processors shortens."""
    return {"seconds": math.inf, "iterations": iterations, "seed": 1}


@pytest.fixture(scope="module")
def hall() -> AmbiguityMap:
    block = shapely.box(3.0, 2.0, 5.0, 4.0)
    shape = shapely.box(0.0, 0.0, 8.0, 6.0).difference(block)
    return build_map(environment_from_shapes([shape], name="hall"), SCANNER, spacing=0.25)


@pytest.mark.slow(
    kept=(*(f"0.5-{name}" for name in ITERATIONS if name != "rrtstar"), "16.0-bitstar")
)
@pytest.mark.parametrize("name", ITERATIONS)
@pytest.mark.parametrize("turns", [0.5, 16.0])
def test_headings_are_angles(hall: AmbiguityMap, name: str, turns: float) -> None:
    """OMPL's are below half a turn: 180 and 270 degrees were out of its bounds."""
    heading = 2.0 * math.pi * turns
    robot = RoutePlanner(hall, space="se2")
    for start, goal in (((*START, heading), GOAL), (START, (*GOAL, heading))):
        route = robot.plan(start, goal, planner_name=name, **fixed(ITERATIONS[name]))
        for pose, end in zip(route.poses[[0, -1]], (start, goal), strict=True):
            assert pose[:2] == pytest.approx(end[:2])
            turn = pose[2] - (*end, 0.0)[2]
            assert math.remainder(turn, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.slow
def test_a_goal_half_a_turn_round_is_reached_by_car(hall: AmbiguityMap) -> None:
    robot = RoutePlanner(hall, space="reeds-shepp", turning_radius=0.4)
    for heading in (math.pi, -math.pi):
        route = robot.plan(START, (*GOAL, heading), planner_name="bitstar", **fixed(3000))
        assert math.cos(route.poses[-1, 2]) == pytest.approx(-1.0)


@pytest.mark.parametrize("name", ["informed-rrtstar", "sorrtstar", "rrtstar", "prmstar"])
def test_a_turn_on_the_spot(hall: AmbiguityMap, name: str) -> None:
    robot = RoutePlanner(hall, space="se2")
    route = robot.plan((*START, 0.0), (*START, 3.0), planner_name=name, seconds=0.3)
    assert (route.length, route.cost) == (0.0, 0.0)
    assert route.poses[[0, -1], 2] == pytest.approx([0.0, 3.0])


def test_a_turn_that_a_wall_blocks_needs_room(hall: AmbiguityMap) -> None:
    """A long robot beside a wall drives away from it to turn."""
    long = Footprint.polygon([(0.5, 0.1), (-0.5, 0.1), (-0.5, -0.1), (0.5, -0.1)])
    robot = RoutePlanner(hall, space="se2", footprint=long)
    beside = (1.5, 0.2)
    route = robot.plan((*beside, 0.0), (*beside, math.pi), planner_name="sorrtstar", **fixed(1500))
    assert route.length > 0.1


@pytest.mark.slow(kept=("0.49",))
@pytest.mark.parametrize("passage", [0.45, 0.49])
def test_a_map_for_a_robot_hides_no_passage(passage: float) -> None:
    """It has no values between walls where its robot fits at no cell's centre."""
    top = 1.875 + passage
    outline = [(0, 0), (4, 0), (4, 1.875), (6, 1.875), (6, 0), (10, 0), (10, 8), (0, 8)]
    island = [(4, top), (6, top), (6, 6.5), (4, 6.5)]
    env = environment_from_shapes([shapely.Polygon(outline, [island])], name="passage")
    lengths = []
    for radius in (0.0, 0.2):
        amap = build_map(env, SCANNER, spacing=0.1, robot_radius=radius)
        for name in ("reference", "prmstar"):
            robot = RoutePlanner(amap, footprint=Footprint.disc(0.2))
            lengths.append(robot.plan((2, 2), (8, 2), planner_name=name, **fixed(2000)).length)
    assert lengths == pytest.approx([6.0] * 4, abs=0.1)


def test_an_outline_that_crosses_itself_is_an_obstacle(hall: AmbiguityMap) -> None:
    bow = shapely.Polygon([(3, 0), (5, 2), (5, 0), (3, 2)])
    replanner = Replanner(RoutePlanner(hall), (7.0, 1.0))
    route = replanner.replan(START, obstacles=bow).route
    assert shapely.make_valid(bow).distance(shapely.LineString(route.poses[:, :2])) > 0.0
    with pytest.raises(InputError, match="keep_out has coordinates that are not finite"):
        RoutePlanner(hall, keep_out=shapely.Point(math.nan, 1.0))


@pytest.mark.parametrize("space", ["r2", "se2"])
def test_floor_that_is_kept_out_of_may_part_the_building(hall: AmbiguityMap, space: str) -> None:
    """The error says so for every robot, and not that a planner needs more time."""
    long = Footprint.polygon([(0.3, 0.1), (-0.3, 0.1), (-0.3, -0.1), (0.3, -0.1)])
    across = shapely.box(5.5, -1.0, 6.0, 7.0)
    robot = RoutePlanner(hall, space=space, footprint=long, keep_out=across)
    with pytest.raises(NoPathError, match="exclude less floor"):
        robot.plan(START, GOAL, planner_name="prmstar", seconds=0.3)
    assert np.isfinite(RoutePlanner(hall, footprint=long).plan(START, GOAL, **fixed(600)).cost)
