"""Robots whose way back is another: polygons in r2 that half a turn changes."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
import shapely

from ambinav import AmbiguityMap, RangeScanner, RangeSensor, build_map
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.routes.route import Route
from ambinav.service.service import AmbiguityService
from ambinav_planners.planning import NotFoundError, RoutePlanner
from ambinav_planners.search.lattice_graph import LatticeGraph

BESIDE = [(0.3, 0.4), (-0.3, 0.4), (-0.3, -0.1), (0.3, -0.1)]
CENTRED = [(0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)]
PLACES = [(0.8, 0.8), (7.2, 5.2), (7.2, 0.8), (0.8, 5.2)]


@pytest.fixture(scope="module")
def pillars() -> AmbiguityMap:
    return pillars_map(0.1)


def pillars_map(spacing: float) -> AmbiguityMap:
    """A room with pillars that leave gaps of 0.95 to 1.3 m: room to turn, and little more."""
    rng = np.random.default_rng(4)
    room = shapely.box(0.0, 0.0, 8.0, 6.0)
    for x, y in itertools.product(np.arange(1.6, 7.0, 1.6), np.arange(1.6, 5.0, 1.45)):
        size = rng.uniform(0.15, 0.3, 2)
        room = room.difference(shapely.box(x - size[0], y - size[1], x + size[0], y + size[1]))
    laser = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    scanner = RangeScanner.planar(sensor=laser, beams=30, aperture=2.0 * math.pi)
    return build_map(environment_from_shapes([room]), scanner, spacing=spacing)


def worst_overlap(route: Route, corners: list[tuple[float, float]], free: shapely.Polygon) -> float:
    """Square metres of wall that a convex body covers on straight motions, facing its travel."""
    worst = 0.0
    for a, b in itertools.pairwise(route.poses[:, :2]):
        heading = math.atan2(*(b - a)[::-1])
        c, s = math.cos(heading), math.sin(heading)
        body = np.array(corners) @ np.array([[c, s], [-s, c]])
        swept = shapely.MultiPoint(np.concatenate([a + body, b + body])).convex_hull
        worst = max(worst, swept.difference(free).area)
    return worst


@pytest.mark.parametrize("planner", ["prmstar", "reference", "rrtstar", "bfmt", "bitstar"])
def test_no_route_leads_through_a_wall(pillars: AmbiguityMap, planner: str) -> None:
    service = AmbiguityService(pillars)
    robot = RoutePlanner(service, footprint=Footprint.polygon(BESIDE))
    free = robot.checker.geometry.free
    budget: dict[str, Any] = {"iterations": 400, "seconds": math.inf, "seed": 1}
    if planner == "reference":
        budget = {}
    found = 0
    for start, goal in itertools.permutations(PLACES, 2):
        try:
            route = robot.plan(start, goal, planner_name=planner, **budget)
        except NotFoundError:
            continue
        found += 1
        assert worst_overlap(route, BESIDE, free) < 1e-6, (start, goal)
    assert found >= 8


def test_a_lattice_has_the_motions_that_are_free() -> None:
    service = AmbiguityService(pillars_map(0.3))
    for corners, directed in ((BESIDE, True), (CENTRED, False)):
        checker = RoutePlanner(service, footprint=Footprint.polygon(corners)).checker
        assert checker.is_directed == directed
        graph = LatticeGraph.build(service, checker, parts=1).graph
        assert checker.motions_free(graph.poses[graph.source], graph.poses[graph.target]).all()
        pairs = set(zip(graph.source.tolist(), graph.target.tolist(), strict=True))
        one_way = sum((b, a) not in pairs for a, b in pairs)
        assert (one_way > 0) == directed
        if directed:
            cost = service.motion_costs(
                graph.poses[graph.source], graph.poses[graph.target], checker.steering
            )
            assert graph.cost(service.weight) == pytest.approx(cost, rel=1e-5)


@pytest.mark.parametrize(
    ("corners", "expected"),
    [
        (CENTRED, True),
        (BESIDE, False),
        ([(0.4, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.4, -0.2)], False),
        ([(0.5, 0.0), (0.0, 0.3), (-0.5, 0.0), (0.0, -0.3)], True),
        ([(0.5, 0.1), (0.0, 0.3), (-0.5, -0.1), (0.0, -0.3)], True),
        ([(0.3, 0.0), (-0.15, 0.26), (-0.15, -0.26)], False),
    ],
)
def test_symmetric_footprints(corners: list[tuple[float, float]], expected: bool) -> None:
    assert Footprint.polygon(corners).is_symmetric == expected
    assert Footprint.disc(0.2).is_symmetric
    room = environment_from_shapes([shapely.box(0, 0, 3, 3)])
    for space, radius in (("r2", 0.0), ("se2", 0.0), ("dubins", 1.0), ("reeds-shepp", 1.0)):
        checker = CollisionChecker(room, Footprint.polygon(corners), Steering(space, radius))
        assert checker.is_directed == (space == "dubins" or (space == "r2" and not expected))
