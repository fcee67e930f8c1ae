"""Fronts over weights: longer and less exposed with the weight, whatever the planner."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.fronts import WEIGHTS, pareto
from ambinav_planners.planning import NotFoundError, RoutePlanner

START, GOAL = (3.0, 3.0), (42.0, 20.0)
# The finish at any angle stops at gains of 0.05 %, so neighbours may be out of order by as much.
SLACK = 2e-3


@pytest.mark.slow(kept=("prmstar",))
@pytest.mark.parametrize("name", ["reference", "prmstar"])
def test_more_weight_is_longer_and_less_exposed(robot: RoutePlanner, name: str) -> None:
    front = pareto(robot, START, GOAL, planner_name=name, iterations=2000, seconds=math.inf, seed=1)
    assert [point.weight for point in front.points] == list(WEIGHTS)
    routes = [point.route for point in front.points]
    assert [route.weight for route in routes] == list(WEIGHTS)
    assert all(route.planner == name for route in routes)
    length = np.array([route.length for route in routes])
    exposure = np.array([route.exposure for route in routes])
    assert (np.diff(length) >= -SLACK * length[:-1]).all()
    assert (np.diff(exposure) <= SLACK * length[:-1]).all()
    assert exposure[-1] < exposure[0]
    if name == "reference":
        assert exposure[-1] < 0.5 * exposure[0]
    # Each is the cheapest of all at its own weight.
    for route in routes:
        service = robot.service.with_weight(route.weight)
        costs = [service.route_cost(other.poses, other.steering) for other in routes]
        assert route.cost == pytest.approx(service.route_cost(route.poses, route.steering))
        assert route.cost <= min(costs) * (1.0 + SLACK)


@pytest.mark.slow
def test_a_front_has_the_routes_that_plan_finds(robot: RoutePlanner) -> None:
    front = pareto(robot, START, GOAL, weights=(5.0, 0.0, 5.0))
    assert [point.weight for point in front.points] == [0.0, 5.0]
    alone = robot.plan(START, GOAL, planner_name="reference", weight=5.0)
    np.testing.assert_allclose(front.points[1].route.poses, alone.poses)
    assert front.points[1].route.curve[-1][1] == pytest.approx(alone.cost)


@pytest.mark.sweep
def test_other_planners_plan_anew_for_every_weight(robot: RoutePlanner) -> None:
    front = pareto(
        robot, START, (12.0, 6.0), weights=(0.0, 5.0), planner_name="bitstar",
        seconds=math.inf, iterations=30_000,
    )  # fmt: skip
    assert [point.route.planner for point in front.points] == ["bitstar"] * 2
    assert [point.route.weight for point in front.points] == [0.0, 5.0]
    assert front.points[0].route.length <= front.points[1].route.length * 1.05


@pytest.mark.sweep
def test_seeded_fronts_are_the_same(robot: RoutePlanner) -> None:
    fronts = [
        pareto(
            robot, START, (12.0, 6.0), weights=(0.0, 5.0), planner_name="prmstar",
            seconds=math.inf, iterations=800, seed=3,
        )
        for _ in range(2)
    ]  # fmt: skip
    for one, other in zip(fronts[0].points, fronts[1].points, strict=True):
        np.testing.assert_array_equal(one.route.poses, other.route.poses)
        assert one.route.seed == 3


@pytest.mark.sweep
def test_a_limit_holds_for_the_whole_front(demo: AmbiguityService) -> None:
    before, behind = (7.9, 20.7), (22.3, 20.7)
    robot = RoutePlanner(demo, max_bad_metres=6.0)
    front = pareto(robot, before, behind, weights=(0.0, 5.0))
    free = pareto(RoutePlanner(demo), before, behind, weights=(0.0, 5.0))
    assert front.points[0].route.length > 1.02 * free.points[0].route.length
    tight = RoutePlanner(demo, max_bad_metres=0.05, bad_level=0.01)
    with pytest.raises(NotFoundError, match=r"at most 0\.05 m in a row above level 0\.01"):
        pareto(tight, before, behind, weights=(0.0, 5.0))


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ((), r"weights are \[\]; a front needs at least two"),
        ((1.0,), "at least two different ones"),
        ((1.0, 1.0), "at least two different ones"),
        ((1.0, -1.0), r"weight is -1\.0; give a number of at least 0"),
        ((1.0, math.nan), "weight is nan"),
        ((1.0, math.inf), "weight is inf"),
    ],
)
def test_bad_weights(robot: RoutePlanner, weights: tuple[float, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        pareto(robot, START, GOAL, weights=weights)


def test_bad_planners_and_budgets(robot: RoutePlanner, demo: AmbiguityService) -> None:
    with pytest.raises(InputError, match="'aorrtc' is refused"):
        pareto(robot, START, GOAL, planner_name="aorrtc")
    with pytest.raises(InputError, match=r"seconds is 0\.0"):
        pareto(robot, START, GOAL, seconds=0.0)
    with pytest.raises(InputError, match="'reference' does not plan in se2"):
        pareto(RoutePlanner(demo, space="se2"), START, GOAL, planner_name="reference")
