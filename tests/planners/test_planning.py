"""Routes by every planner: that they are free, near the optimum, and keep what was asked for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.footprint import Footprint
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.planning import NotFoundError, RoutePlanner, default_planner, plan
from ambinav_planners.registry import PLANNERS, Planner, planners

START, GOAL = (3.0, 3.0), (42.0, 20.0)
# Left and right of the hall, whose middle is open.
BEFORE_HALL, BEHIND_HALL = (7.9, 20.7), (22.3, 20.7)
# Those that look for the cheapest path; belief-aware planners minimise something else.
CHEAPEST = sorted(name for name in planners() if not name.startswith("belief"))
# What takes half a second through the whole building: edges, milestones, or samples.
ITERATIONS = {"bitstar": 32_000, "prmstar": 1000, "fmt": 1000, "bfmt": 1000}
SAMPLES = 12_000


def check(
    robot: RoutePlanner, route: Route, start: tuple[float, ...], goal: tuple[float, ...]
) -> None:
    """Held by every route: it is free, ends where it should, and is as dear as it says."""
    checker = robot.checker
    np.testing.assert_allclose(route.poses[0, : len(start)], start, atol=1e-9)
    np.testing.assert_allclose(route.poses[-1, : len(goal)], goal, atol=1e-9)
    assert roomy(checker).poses_free(route.poses).all()
    free = checker.motions_free(route.poses[:-1], route.poses[1:])
    if checker.steering.space == "se2":
        # BFMT* has checked some of them from their ends; within `polygon_sweep.SKIN` of a wall a
        # turning robot may be called blocked from one end and free from the other.
        free |= checker.motions_free(route.poses[1:], route.poses[:-1])
    assert free.all()
    service = robot.service.with_weight(route.weight)
    assert route.cost == pytest.approx(service.route_cost(route.poses, checker.steering))
    assert route.cost >= route.length * (1.0 - 1e-9)
    when, costs = np.array(route.curve).T
    assert (np.diff(when) > 0.0).all()
    assert (np.diff(costs) < 0.0).all()
    assert route.cost <= costs[-1] * (1.0 + 1e-9)


def roomy(checker: CollisionChecker) -> CollisionChecker:
    """The same check for a disc by the tolerance of motions smaller, or for the polygon."""
    if not checker.footprint.is_disc:
        return checker
    disc = Footprint.disc(checker.footprint.radius - 1e-8)
    return CollisionChecker(checker.environment, disc, checker.steering)


def longest_above(robot: RoutePlanner, route: Route, level: float, step: float = 0.01) -> float:
    """Metres in a row where the level is above `level`, by sampling."""
    dense, _, along = route.steering.dense(route.poses, step)
    most = begun = 0.0
    for (x, y, theta), gone in zip(dense.tolist(), along.tolist(), strict=True):
        if robot.service.ambiguity.near(x, y, theta) <= level:
            begun = gone
        most = max(most, gone - begun)
    return most


def planned(
    robot: RoutePlanner,
    start: tuple[float, ...],
    goal: tuple[float, ...],
    name: str,
    most: float = math.inf,
    weight: float | None = None,
    iterations: int | None = None,
) -> Route:
    """A route that costs at most `most`: random numbers that serve badly get more iterations."""
    options = {"planner_name": name, "seconds": math.inf, "weight": weight}
    count = iterations or ITERATIONS.get(name, SAMPLES)
    for factor in (1, 1, 2, 2, 4, 4, 8, 8):
        try:
            route = robot.plan(start, goal, iterations=factor * count, **options)
        except NotFoundError:
            continue
        if route.cost <= most:
            break
    return route


@pytest.fixture(scope="module")
def cheapest(robot: RoutePlanner) -> Route:
    return robot.plan(START, GOAL, planner_name="reference")


@pytest.fixture(scope="module")
def shortest(robot: RoutePlanner) -> Route:
    return robot.plan(START, GOAL, planner_name="reference", weight=0.0)


@pytest.mark.parametrize(
    "name",
    [
        name if name in ("prmstar", "reference", "rrtstar") else pytest.param(
            name, marks=pytest.mark.slow
        )
        for name in CHEAPEST
    ],
)  # fmt: skip
def test_every_planner_finds_a_way_near_the_reference(
    robot: RoutePlanner, cheapest: Route, name: str
) -> None:
    most = 1.1 * cheapest.cost
    route = planned(robot, START, GOAL, name, most)
    check(robot, route, START, GOAL)
    assert route.cost <= most
    assert route.planner == name
    assert route.first_seconds == route.curve[0][0]
    assert (route.iterations is None) == (planners()[name].iteration == "")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["belief", "belief-roadmap"])
def test_belief_aware_planners_find_a_way(robot: RoutePlanner, name: str) -> None:
    budget = {"iterations": 1500, "seconds": math.inf}
    route = robot.plan(START, (12.0, 6.0), planner_name=name, **budget)
    np.testing.assert_allclose(route.poses[[0, -1], :2], [START, (12.0, 6.0)])
    assert robot.checker.motions_free(route.poses[:-1], route.poses[1:]).all()
    assert route.covariances is not None
    assert route.covariances.shape == (len(route.poses), 3, 3)


@pytest.mark.slow(kept=("reference", "prmstar"))
@pytest.mark.parametrize("name", ["prmstar", "bitstar", "reference"])
def test_without_weight_the_way_is_the_shortest(
    robot: RoutePlanner, shortest: Route, name: str
) -> None:
    route = planned(robot, START, GOAL, name, 1.01 * shortest.cost, weight=0.0)
    assert route.length == pytest.approx(shortest.length, rel=0.01)
    assert route.cost == pytest.approx(route.length)


def test_the_aware_route_has_fewer_bad_metres(cheapest: Route, shortest: Route) -> None:
    assert shortest.bad_metres > 10.0
    assert cheapest.bad_metres <= 0.5 * shortest.bad_metres
    assert cheapest.length <= 1.1 * shortest.length
    assert cheapest.exposure < 0.5 * shortest.exposure


@pytest.mark.slow
def test_improving_never_raises_the_cost(robot: RoutePlanner) -> None:
    options = {"planner_name": "prmstar", "iterations": 800, "seconds": math.inf, "seed": 3}
    plain = robot.plan(START, GOAL, improved=False, **options)
    better = robot.plan(START, GOAL, **options)
    assert better.cost < plain.cost
    check(robot, plain, START, GOAL)
    check(robot, better, START, GOAL)


@pytest.mark.slow(kept=("reference", "prmstar"))
@pytest.mark.parametrize("name", ["reference", "prmstar", "rrtstar"])
def test_the_open_zone_is_never_entered_if_so_asked(demo: AmbiguityService, name: str) -> None:
    zones: list[dict[str, float]] = []
    for avoid in (False, True):
        robot = RoutePlanner(demo, avoid_open=avoid)
        route = planned(robot, BEFORE_HALL, BEHIND_HALL, name, weight=0.0)
        check(robot, route, BEFORE_HALL, BEHIND_HALL)
        zones.append(route.zone_metres)
    assert zones[0]["open"] > 5.0
    assert zones[1]["open"] < 0.02
    with pytest.raises(InputError, match=r"goal \(15, 20.7\) is in a forbidden zone; the nearest"):
        robot.plan(BEFORE_HALL, (15.0, 20.7))


@pytest.mark.slow(kept=("prmstar",))
@pytest.mark.parametrize("name", ["reference", "prmstar"])
def test_the_limit_on_bad_metres_in_a_row_is_kept(demo: AmbiguityService, name: str) -> None:
    costs = []
    for most in (20.0, 4.0):
        robot = RoutePlanner(demo, max_bad_metres=most, bad_level=0.5)
        route = planned(robot, BEFORE_HALL, BEHIND_HALL, name, weight=0.0)
        check(robot, route, BEFORE_HALL, BEHIND_HALL)
        assert longest_above(robot, route, 0.5) <= most + 0.02
        costs.append(route.cost)
    assert costs[0] < 0.95 * costs[1]
    with pytest.raises(NotFoundError, match=r"at most 0.05 m in a row above level 0\.01; allow"):
        plan(demo, START, GOAL, planner=name, max_bad_metres=0.05, bad_level=0.01)


@pytest.mark.parametrize("name", ["rrtstar", "bitstar", "fmt", "belief"])
def test_planners_that_cannot_keep_the_limit_are_refused(demo: AmbiguityService, name: str) -> None:
    with pytest.raises(InputError, match=r"cannot keep a limit .* one of .*prmstar, reference"):
        plan(demo, START, GOAL, planner=name, max_bad_metres=5.0)


@pytest.mark.slow
def test_a_price_on_walls_keeps_away_from_them(demo_map: AmbiguityMap) -> None:
    away = []
    for weight in (0.0, 3.0):
        service = AmbiguityService(demo_map, weight=1.0, clearance_weight=weight, comfort=1.0)
        robot = RoutePlanner(service)
        route = planned(robot, START, GOAL, "prmstar")
        check(robot, route, START, GOAL)
        away.append(robot.checker.clearance(route.steering.dense(route.poses, 0.05)[0]).mean())
    assert away[1] > 1.4 * away[0]


@pytest.mark.sweep
def test_on_a_map_with_headings_a_way_and_its_way_back_differ(heading_map: AmbiguityMap) -> None:
    robot = RoutePlanner(heading_map)
    for name in ("rrtstar", "informed-rrtstar", "sorrtstar", "fmt", "bfmt"):
        with pytest.raises(InputError, match=r"cost the same both ways.* or the space se2\."):
            robot.plan(START, GOAL, planner_name=name)
    there = robot.plan(START, GOAL, planner_name="reference")
    back = robot.plan(GOAL, START, planner_name="reference")
    check(robot, there, START, GOAL)
    reverse = robot.checker.steering.oriented(there.poses[::-1])
    assert abs(robot.service.route_cost(reverse) / there.cost - 1.0) > 0.01
    assert back.cost <= robot.service.route_cost(reverse, robot.checker.steering) * 1.01
    for name in ("bitstar", "prmstar"):
        most = 1.1 * there.cost
        route = planned(robot, START, GOAL, name, most)
        check(robot, route, START, GOAL)
        assert route.cost <= most


@pytest.mark.slow
@pytest.mark.parametrize("name", ["reference", "prmstar"])
def test_routes_on_the_way_to_the_result_get_cheaper(robot: RoutePlanner, name: str) -> None:
    routes: list[Route] = []
    found = robot.plan(
        START, GOAL, planner_name=name, iterations=None if name == "reference" else 500,
        seed=1, seconds=math.inf if name != "reference" else 1.0, on_route=routes.append,
    )  # fmt: skip
    costs = [route.cost for route in routes]
    assert len(costs) > 1
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] == found.cost
    assert {route.planner for route in routes} == {name}


def test_the_default_is_the_reference_where_it_can_plan(demo: AmbiguityService) -> None:
    square = Footprint.polygon([(0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)])
    assert default_planner(RoutePlanner(demo).checker) == "reference"
    assert default_planner(RoutePlanner(demo).checker, iterations=100) == "prmstar"
    assert default_planner(RoutePlanner(demo, footprint=square).checker) == "prmstar"
    assert default_planner(RoutePlanner(demo, space="se2").checker) == "prmstar"
    for name in (None, "auto"):
        route = RoutePlanner(demo).plan(START, (4.0, 3.0), planner_name=name)
        assert route.planner == "reference"


@pytest.mark.slow(kept=("prmstar",))
@pytest.mark.parametrize("name", ["prmstar", "bitstar", "bfmt"])
def test_a_long_robot_in_se2(demo: AmbiguityService, name: str) -> None:
    corners = [(0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2), (0.3, -0.2)]
    robot = RoutePlanner(demo, footprint=Footprint.polygon(corners), space="se2")
    start, goal = (3.0, 3.0, 0.5), (12.0, 6.0, 2.0)
    route = planned(robot, start, goal, name, iterations=4000 if name == "bitstar" else 1000)
    check(robot, route, start, goal)
    placed = robot.checker.footprint.placed(route.steering.dense(route.poses, 0.1)[0])
    walls = demo.map.environment
    assert all(walls.free.buffer(1e-6).covers(shape) for shape in placed)


@pytest.mark.slow(kept=("dubins-prmstar", "reeds-shepp-fmt", "dubins-bitstar"))
@pytest.mark.parametrize(
    ("space", "name"),
    [("dubins", "prmstar"), ("dubins", "bitstar"), ("reeds-shepp", "prmstar"),
     ("reeds-shepp", "rrtstar"), ("reeds-shepp", "fmt")],
)  # fmt: skip
def test_cars(demo: AmbiguityService, space: str, name: str) -> None:
    robot = RoutePlanner(demo, space=space, turning_radius=0.4)
    start, goal = (3.0, 3.0, 0.0), (12.0, 6.0, 1.0)
    route = planned(robot, start, goal, name, iterations=1000)
    check(robot, route, start, goal)
    assert bends(route.steering.dense(route.poses, 0.01)[0]) <= 1.0 / 0.4 + 0.1


def bends(dense: NDArray[np.float64]) -> float:
    """The sharpest bend along dense poses, per metre."""
    gone = np.hypot(*np.diff(dense[:, :2], axis=0).T)
    turned = np.abs((np.diff(dense[:, 2]) + np.pi) % (2.0 * np.pi) - np.pi)
    moving = gone > 1e-3
    return float((turned[moving] / gone[moving]).max())


def test_names_are_taken_once() -> None:
    with pytest.raises(InputError, match="planner 'fmt': there is one of that name in ambinav"):
        PLANNERS.register(Planner("fmt", lambda problem, budget: None, ""))  # type: ignore[arg-type]
