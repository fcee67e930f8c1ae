"""Certificates: bounds hold for every path, and are near the cheapest one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from ambinav import (
    AmbiguityMap,
    AmbiguityService,
    Footprint,
    InputError,
    RangeScanner,
    Route,
    build_map,
    environment_from_shapes,
    evaluate_route,
)
from ambinav_planners import RoutePlanner, certify
from ambinav_planners.search import lower_bound as bounds_module
from ambinav_planners.search.lower_bound import directions, lower_bound, weights_of_headings
from ambinav_planners.search.subsolution import gauge
from tests.planners.conftest import LASER

RADIUS = 0.2


def room(*walls: shapely.Polygon) -> AmbiguityMap:
    """Return the map of a hall of 6 m by 4 m with walls in it."""
    floor = shapely.box(0.0, 0.0, 6.0, 4.0).difference(shapely.union_all(walls))
    scanner = RangeScanner.planar(sensor=LASER, beams=24, aperture=2.0 * math.pi)
    return build_map(environment_from_shapes([floor]), scanner, spacing=0.2)


def pairs(robot: RoutePlanner, count: int, seed: int) -> np.ndarray:
    """Return the ends of free straight motions, (count, 2, 3)."""
    rng = np.random.default_rng(seed)
    xmin, ymin, xmax, ymax = robot.service.map.bounds
    ends = rng.uniform((xmin, ymin, -3.0), (xmax, ymax, 3.0), (400 * count, 2, 3))
    ends[:, 1, :2] = ends[:, 0, :2] + rng.uniform(-4.0, 4.0, (len(ends), 2))
    fits = robot.checker.poses_free(ends[:, 0]) & robot.checker.poses_free(ends[:, 1])
    ends = ends[fits]
    return ends[robot.checker.motions_free(ends[:, 0], ends[:, 1])][:count]


@pytest.mark.slow
def test_a_straight_route_in_an_empty_room_is_certified() -> None:
    robot = RoutePlanner(AmbiguityService(room(), weight=0.0), footprint=RADIUS)
    route = robot.plan((0.5, 0.5), (5.3, 3.1))
    proof = certify(robot, route, gap=0.01)
    assert proof.cost == pytest.approx(math.hypot(4.8, 2.6))
    assert 0.0 < proof.gap <= 0.01
    assert f"{proof.bound:.2f}" in proof.sentence
    # Above the cheapest, which is not what could be saved of the dearer one.
    far = replace(proof, cost=3.0 * proof.bound)
    assert "at most 200 % above the cheapest" in far.sentence
    assert far.gap == pytest.approx(2.0 / 3.0)
    assert "nothing is proved" in replace(proof, bound=0.0).sentence
    assert "at most 0 % above" in replace(proof, cost=0.0, bound=0.0).sentence


@pytest.mark.slow
def test_the_bound_knows_the_way_round_a_wall() -> None:
    wall = shapely.box(2.9, 0.0, 3.1, 3.0)
    robot = RoutePlanner(AmbiguityService(room(wall), weight=0.0), footprint=RADIUS)
    start, goal = (1.0, 1.0), (5.0, 1.0)
    # Around the two upper corners at the robot's radius: tangents, arcs and the piece between.
    away, rise = 1.9, 2.0
    tangent = math.sqrt(away**2 + rise**2 - RADIUS**2)
    turned = math.atan2(away, rise) - math.asin(RADIUS / math.hypot(away, rise))
    shortest = 2.0 * (tangent + RADIUS * (math.pi / 2.0 - turned)) + 0.2
    bound, _ = lower_bound(robot.problem(start, goal), 2.0 * shortest, 0.01, 4_000)
    assert bound < shortest
    proof = certify(robot, robot.plan(start, goal), cells=10_000)
    assert proof.bound < shortest <= proof.cost + 1e-6
    assert proof.gap <= 0.012


@pytest.mark.sweep
def test_what_proves_the_bound_is_nowhere_steeper_than_the_cost(
    demo: AmbiguityService, monkeypatch: pytest.MonkeyPatch
) -> None:
    compute, seen = bounds_module._bounds, []

    def kept(grid, *arguments):
        seen.append((grid, compute(grid, *arguments)))
        return seen[-1][1]

    monkeypatch.setattr(bounds_module, "_bounds", kept)
    robot = RoutePlanner(demo)
    certify(robot, robot.plan((3.0, 3.0), (12.0, 6.0)), gap=1e-3, cells=10_000)
    rng, step = np.random.default_rng(0), 1e-5
    assert len({grid.edges for grid, _ in seen}) >= 2
    for grid, values in seen:
        cells = np.argwhere(grid.open_cells)
        drawn = cells[rng.integers(len(cells), size=500)] + rng.uniform(0.01, 0.99, (500, 2))
        y, x = (np.array(grid.origin) + np.array(grid.edges) * drawn).T
        for bound in values:
            slope = [
                math.hypot(
                    grid.at(bound, (b, a + step)) - grid.at(bound, (b, a - step)),
                    grid.at(bound, (b + step, a)) - grid.at(bound, (b - step, a)),
                )
                / (2.0 * step)
                for a, b in zip(x, y, strict=True)
            ]
            cost = [demo.density.near(a, b, 0.0) for a, b in zip(x, y, strict=True)]
            assert (np.array(slope) <= np.array(cost) + 1e-5).all()


@pytest.mark.slow(kept=("heading_map-se2",))
@pytest.mark.parametrize("space", ["r2", "se2"])
@pytest.mark.parametrize("which", ["demo_map", "heading_map"])
def test_no_motion_costs_less_than_the_bound(
    which: str, space: str, request: pytest.FixtureRequest
) -> None:
    amap = request.getfixturevalue(which)
    robot = RoutePlanner(
        AmbiguityService(amap, weight=5.0, clearance_weight=1.0), footprint=RADIUS, space=space
    )
    for start, goal in pairs(robot, 3, 5):
        motion = robot.service.motion_costs(start[None], goal[None], robot.checker.steering)
        # A bound that is not held down by what is known.
        bound, _ = lower_bound(robot.problem(start, goal), 1.5 * float(motion[0]), 0.01, 4_000)
        assert 0.0 < bound <= motion[0]


@pytest.mark.slow
def test_routes_of_other_spaces_and_robots_are_certified(heading_map: AmbiguityMap) -> None:
    table = Footprint.polygon([(-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2)])
    for space, radius in (("dubins", 0.4), ("reeds-shepp", 0.4)):  # headings one way and both ways
        robot = RoutePlanner(heading_map, footprint=table, space=space, turning_radius=radius)
        poses = np.array([(3.0, 3.0, 0.0), (5.0, 3.0, 0.0), (7.0, 3.2, 0.2)])
        route = evaluate_route(robot.service, poses, robot.checker.steering, planner="given")
        proof = certify(robot, route, cells=1)
        assert 0.0 < proof.bound < route.cost
        assert proof.cost == pytest.approx(route.cost)


@pytest.mark.slow
def test_excluded_floor_raises_the_bound(demo: AmbiguityService) -> None:
    start, goal = (3.0, 3.0), (9.0, 3.0)
    free = RoutePlanner(demo.with_weight(0.0), footprint=RADIUS)
    barred = RoutePlanner(
        demo.with_weight(0.0), footprint=RADIUS, keep_out=shapely.box(5.0, 1.0, 6.0, 4.2)
    )
    plain, round_it = (
        certify(robot, robot.plan(start, goal), cells=4_000) for robot in (free, barred)
    )
    assert round_it.bound > plain.cost


@pytest.mark.slow
def test_a_point_robot_and_a_route_of_no_length(demo: AmbiguityService) -> None:
    robot = RoutePlanner(demo, footprint=0.0)
    assert certify(robot, robot.plan((3.0, 3.0), (9.0, 3.0)), cells=4_000).gap < 0.1
    there = certify(robot, robot.plan((3.0, 3.0), (3.0, 3.0)))
    assert (there.bound, there.gap) == (0.0, 0.0)


@pytest.mark.slow
def test_what_cannot_be_certified_is_refused(robot: RoutePlanner, demo: AmbiguityService) -> None:
    route = robot.plan((3.0, 3.0), (9.0, 3.0))
    with pytest.raises(InputError, match="gap is 0"):
        certify(robot, route, gap=0.0)
    with pytest.raises(InputError, match="cells is 0"):
        certify(robot, route, cells=0)
    with pytest.raises(InputError, match="layer"):
        certify(robot, Route.through([(3.0, 3.0), (9.0, 3.0)]))
    fat = RoutePlanner(demo, footprint=RADIUS, space="se2")
    with pytest.raises(InputError, match="cannot drive the route"):
        certify(fat, route)


def test_gradients_are_allowed_as_the_half_planes_of_all_headings_say() -> None:
    rng = np.random.default_rng(3)
    circle = directions(64)
    headings = 128
    angle = 2.0 * math.pi / headings * np.arange(headings)
    travel = np.column_stack([np.cos(angle), np.sin(angle)])
    cost = 2.0 + np.cos(angle - 0.4) + 0.3 * np.sin(3.0 * angle)
    radii = (cost * weights_of_headings(circle, headings)).min(axis=1)[None, None]
    for gradient in rng.normal(size=(200, 2)):
        steepest = (-(travel @ gradient) / cost).max()
        rate = gauge.py_func(*gradient, 0, 0, radii, circle)
        # Never less, between headings too; and more by the chords' sagitta at most.
        assert steepest / math.cos(math.pi / headings) <= rate * (1.0 + 1e-9)
        assert rate <= 1.05 * steepest


@pytest.mark.parametrize("steep", [0.0, 10.0, 40.0, 1000.0])
def test_no_gradient_is_too_steep_between_headings_of_unequal_costs(steep: float) -> None:
    """Costs at headings are all that a gradient needs; `steep` from one to the next near 0."""
    headings, parts = 128, 40
    angle = 2.0 * math.pi / (headings * parts) * np.arange(headings * parts + 1)
    gradient = -np.array([[1.0, steep]])
    fall = -(gradient @ np.stack([np.cos(angle), np.sin(angle)]))[0]
    cost = np.maximum(fall[::parts], 1.0)
    radius = (cost[:-1] * weights_of_headings(gradient, headings)).min()
    between = np.interp(np.arange(len(fall)), parts * np.arange(headings + 1), cost)
    assert 0.999 < radius * (fall / between).max() <= 1.0 + 1e-12
