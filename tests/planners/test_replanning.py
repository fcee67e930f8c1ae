"""Replanning: as good as new plans, past all obstacles, and along the last route where it holds."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from ambinav import (
    AmbiguityService,
    InputError,
    RangeScanner,
    Route,
    Steering,
    build_map,
    environment_from_shapes,
)
from ambinav_planners import NoPathError, Replanner, RoutePlanner
from ambinav_planners.search.costs_to_go import CostsToGo
from ambinav_planners.search.graph import MotionGraph
from tests.planners.conftest import LASER

START, GOAL = (3.0, 3.0), (28.0, 17.0)


def random_graph(rng: np.random.Generator, nodes: int = 60, motions: int = 240) -> MotionGraph:
    """Return a directed graph of nodes in a square of 1 m; motions are as long as they look."""
    poses = np.column_stack([rng.random((nodes, 2)), np.zeros(nodes)])
    pairs = rng.integers(nodes, size=(motions, 2))
    pairs = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)
    length = np.linalg.norm(np.diff(poses[pairs], axis=1)[:, 0], axis=1)
    first = np.zeros(nodes + 1, dtype=np.int64)
    np.cumsum(np.bincount(pairs[:, 0], minlength=nodes), out=first[1:])
    return MotionGraph(
        poses=poses,
        first=first,
        target=pairs[:, 1].astype(np.int32),
        length=length,
        fixed=length,
        exposure=np.zeros_like(length),
        steering=Steering(),
    )


@pytest.mark.parametrize("seed", range(20))
def test_costs_to_go_follow_changes_as_a_new_search_finds_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    graph = random_graph(rng)
    cost = graph.length.copy()
    costs = CostsToGo(graph, cost.copy(), 0)
    for _ in range(5):
        some = rng.choice(len(cost), 30, replace=False)
        dearer = graph.length[some] * rng.uniform(1.0, 3.0, 30)
        cost[some] = np.where(rng.random(30) < 0.5, math.inf, dearer)
        costs.change(some, cost[some])
        kept = np.isfinite(cost)
        pairs = (cost[kept], (graph.target[kept], graph.source[kept]))  # reversed
        expected = dijkstra(csr_array(pairs, shape=(60, 60)), indices=0)
        # For a robot somewhere, then, now and again, for all.
        place, near = rng.random(2), rng.choice(60, 4, replace=False)
        drive = np.hypot(*(graph.poses[near, :2] - place).T)
        costs.settle(near, drive, tuple(place), 1.0 - 1e-9)
        assert (drive + costs.to_go[near]).min() == pytest.approx((drive + expected[near]).min())
        if rng.random() < 0.5:
            continue
        costs.settle()
        np.testing.assert_allclose(costs.to_go, expected)
        for node in np.flatnonzero(np.isfinite(expected)):
            path = costs.path(node)
            assert path[0] == node
            assert path[-1] == 0


@pytest.mark.slow
def test_a_first_route_is_as_good_as_a_plan(robot: RoutePlanner) -> None:
    first = Replanner(robot, GOAL).replan(START)
    assert first.is_new
    assert first.sentence.startswith("First route")
    assert first.route.cost <= 1.005 * robot.plan(START, GOAL).cost
    assert first.route.goal[:2] == GOAL


@pytest.mark.slow
def test_a_robot_that_moves_goes_on_along_its_route(robot: RoutePlanner) -> None:
    planner = Replanner(robot, GOAL)
    route = planner.replan(START).route
    x, y, _ = route.poses[len(route.poses) // 3]
    moved = planner.replan((x + 0.03, y - 0.02))
    assert not moved.is_new
    assert "along the last route" in moved.sentence
    assert moved.route.cost <= 1.005 * robot.plan((x + 0.03, y - 0.02), GOAL).cost
    # Far off it plans anew.
    away = planner.replan((17.0, 20.0))
    assert away.is_new
    assert away.route.cost <= 1.005 * robot.plan((17.0, 20.0), GOAL).cost


@pytest.mark.slow
def test_obstacles_are_passed_at_the_price_of_a_new_plan(
    robot: RoutePlanner, demo: AmbiguityService
) -> None:
    planner = Replanner(robot, GOAL)
    route = planner.replan(START).route
    middle = route.poses[len(route.poses) // 2, :2]
    obstacle = shapely.Point(middle).buffer(0.3)
    passed = planner.replan(START, obstacles=obstacle)
    assert passed.is_new
    assert "obstacles changed" in passed.sentence
    dense = shapely.linestrings(passed.route.poses[:, :2])
    assert dense.distance(obstacle) >= robot.checker.footprint.outer
    barred = RoutePlanner(demo, keep_out=obstacle.buffer(robot.checker.footprint.outer))
    assert passed.route.cost <= 1.005 * barred.plan(START, GOAL).cost
    assert planner.replan(START, obstacles=obstacle).is_new is False
    freed = planner.replan(START, obstacles=shapely.GeometryCollection())
    # Routes are improved where they are, so another way round may stay a little dearer.
    assert freed.route.cost <= 1.02 * route.cost


@pytest.mark.slow
@pytest.mark.parametrize("gap", [0.50, 0.58, 0.66])
def test_a_gap_beside_an_obstacle_is_found(gap: float) -> None:
    """Of a corridor of 1.6 m, where the lattice has no cell in the middle of what is left."""
    plan = shapely.box(0, 0, 14, 4).difference(shapely.box(6, 1.6, 8, 4))
    scanner = RangeScanner.planar(LASER, 16, 2.0 * math.pi)
    service = AmbiguityService(build_map(environment_from_shapes([plan]), scanner, spacing=0.25))
    pallet = shapely.box(6.8, gap, 7.2, 1.6)
    barred = RoutePlanner(service, keep_out=pallet.buffer(0.2)).plan((2.0, 2.0), (12.0, 2.0))
    first = Replanner(RoutePlanner(service), (12.0, 2.0))
    later = Replanner(RoutePlanner(service), (12.0, 2.0))
    later.replan((2.0, 2.0))
    for planner in (first, later):
        route = planner.replan((2.0, 2.0), obstacles=pallet).route
        assert route.cost <= 1.005 * barred.cost
        assert shapely.linestrings(route.poses[:, :2]).distance(pallet) >= 0.2


def test_the_way_into_the_goal_is_closed_on_a_fine_map(demo: AmbiguityService) -> None:
    # The goal is joined to cells 0.5 m away, ten spacings here.
    hall = environment_from_shapes([shapely.box(0.0, 0.0, 4.0, 3.0)])
    scanner = RangeScanner.planar(LASER, 16, 2.0 * math.pi)
    service = AmbiguityService(build_map(hall, scanner, spacing=0.05, radius=0.1))
    planner = Replanner(RoutePlanner(service), (3.0, 1.5))
    ring = shapely.Point(3.0, 1.5).buffer(0.4).exterior.buffer(0.02)
    with pytest.raises(NoPathError, match="past the obstacles"):
        planner.replan((0.5, 1.5), obstacles=ring)
    beside = planner.replan((0.5, 1.5), obstacles=shapely.Point(2.7, 1.3).buffer(0.05)).route
    assert shapely.linestrings(beside.poses[:, :2]).distance(shapely.Point(2.7, 1.3)) >= 0.25


def test_obstacles_that_close_the_way_are_said(robot: RoutePlanner) -> None:
    planner = Replanner(robot, GOAL)
    route = planner.replan(START).route
    ring = shapely.Point(GOAL).buffer(1.2).difference(shapely.Point(GOAL).buffer(0.8))
    with pytest.raises(NoPathError, match="past the obstacles") as caught:
        planner.replan(START, obstacles=ring)
    labels = caught.value.labels
    assert (labels == caught.value.goal_label).any()
    again = planner.replan(START, obstacles=shapely.GeometryCollection())
    assert again.route.cost == pytest.approx(route.cost, rel=1e-6)


def test_walls_are_not_called_obstacles() -> None:
    """Nor are places of a country, as in UTM, rounded to kilometres."""
    x, y = 500_000.0, 5_000_000.0
    rooms = environment_from_shapes(
        [shapely.box(x, y, x + 3.0, y + 3.0), shapely.box(x + 3.2, y, x + 6.0, y + 3.0)]
    )
    amap = build_map(rooms, RangeScanner.planar(LASER, 16, 2.0 * math.pi), spacing=0.2, radius=0.4)
    planner = Replanner(RoutePlanner(AmbiguityService(amap)), (x + 1.5, y + 1.5))
    with pytest.raises(NoPathError, match=r"\(500004.25, 5000001.5\).*move one of them") as caught:
        planner.replan((x + 4.25, y + 1.5))
    assert "obstacle" not in str(caught.value)


@pytest.mark.slow
def test_changed_costs_change_the_route(robot: RoutePlanner, demo: AmbiguityService) -> None:
    planner = Replanner(robot, GOAL)
    route = planner.replan(START).route
    amap = demo.map
    dataset = amap.dataset.copy(deep=True)
    x, y = route.poses[len(route.poses) // 2, :2]
    near = np.hypot(dataset["x"] - x, dataset["y"] - y) < 1.5
    dataset["level"] = dataset["level"].where(~near | dataset["level"].isnull(), 1.0)
    worse = type(amap)(dataset)
    changed = planner.replan(START, changed=worse)
    new = RoutePlanner(AmbiguityService(worse, weight=5.0)).plan(START, GOAL)
    assert changed.route.cost <= 1.005 * new.cost
    assert changed.route.cost == pytest.approx(
        AmbiguityService(worse, weight=5.0).route_cost(changed.route.poses, Steering())
    )


def test_what_a_replanner_is_not_for(robot: RoutePlanner, demo: AmbiguityService) -> None:
    with pytest.raises(InputError, match="not a disc in r2"):
        Replanner(RoutePlanner(demo, space="se2"), GOAL)
    with pytest.raises(InputError, match="limit on bad metres"):
        Replanner(RoutePlanner(demo, max_bad_metres=3.0), GOAL)
    planner = Replanner(robot, GOAL)
    with pytest.raises(InputError, match="pose"):
        planner.replan((-5.0, 3.0))
    with pytest.raises(InputError, match="goal"):
        Replanner(robot, (-5.0, 3.0))
    with pytest.raises(InputError, match="not finite"):
        planner.replan(START, obstacles=shapely.Point(math.nan, 1.0))
    with pytest.raises(InputError, match=r"\(3, 3\) is nearer to one of the obstacles than"):
        planner.replan(START, obstacles=shapely.Point(START).buffer(0.3))
    with pytest.raises(InputError, match="changed is"):
        planner.replan(START, changed=demo)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="obstacles is"):
        planner.replan(START, obstacles="a box")  # type: ignore[arg-type]


def test_progress_is_the_nearest_point_of_the_route() -> None:
    route = Route.through([(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)])
    here = route.progress(3.0, 0.5)
    assert (here.along, here.remaining, here.aside) == pytest.approx((3.0, 4.0, 0.5))
    assert here.motion == 0
    later = route.progress(5.0, 2.0)
    assert (later.along, later.aside, later.motion) == pytest.approx((6.0, 1.0, 1))
    assert route.progress(9.0, 9.0).remaining == pytest.approx(0.0)
    there_and_back = Route.through([(0.0, 0.0), (4.0, 0.0), (0.0, 0.0)])
    assert there_and_back.progress(1.0, 0.0).along == pytest.approx(1.0)
    assert there_and_back.progress(1.0, 0.0, after=2.0).along == pytest.approx(7.0)
    assert there_and_back.progress(1.0, 0.0, after=99.0).remaining == pytest.approx(0.0)
    arc = Route.through([(0.0, 0.0, 0.0), (2.0, 2.0, math.pi / 2.0)], Steering("dubins", 2.0))
    quarter = arc.progress(math.sqrt(2.0), 2.0 - math.sqrt(2.0))
    assert quarter.along == pytest.approx(math.pi / 2.0, abs=1e-3)
    with pytest.raises(InputError, match="finite"):
        route.progress(math.nan, 0.0)
