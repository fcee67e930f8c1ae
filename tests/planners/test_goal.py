"""Cost-to-go: a lower bound in every space, of which informed planners make use."""

from __future__ import annotations

import numpy as np
import pytest
from ompl import base as ob

from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.goal import PoseGoal
from ambinav_planners.objective import AmbiguityObjective
from ambinav_planners.ompl_setup import prepare
from ambinav_planners.planning import RoutePlanner
from ambinav_planners.spaces import new_state
from tests.planners.test_objective import information

STATES = 3000
GOAL = (20.0, 14.0, 1.0)


def costs_to_go(
    service: AmbiguityService, steering: Steering, weight: float, ours: bool
) -> tuple[np.ndarray, np.ndarray]:
    """OMPL's costs-to-go of random states, and what their motions to the goal cost."""
    si = information(steering)
    with_heading = steering.space != "r2"
    objective = AmbiguityObjective(si, service, weight)
    end = new_state(si, GOAL, with_heading)
    if ours:
        goal = PoseGoal(si, end)
    else:
        goal = ob.GoalState(si)
        goal.setState(end)
        goal.setThreshold(1e-6)
    state = si.allocState()
    costs = []
    poses = np.random.default_rng(4).uniform([1.0, 1.0, -3.1], [44.0, 27.0, 3.1], (STATES, 3))
    for pose in poses.tolist():
        state = new_state(si, tuple(pose), with_heading)
        cost = objective.motionCost(state, end).value()
        costs.append((objective.costToGo(state, goal).value(), cost))
    least, cost = np.array(costs).T
    return least, cost


@pytest.mark.parametrize("weight", [0.0, 1.0, 5.0])
@pytest.mark.parametrize(
    ("steering", "ours"),
    [
        (Steering(), False), (Steering(), True), (Steering("se2"), True),
        (Steering("dubins", 0.5), False), (Steering("reeds-shepp", 0.5), False),
    ],
    ids=lambda each: each.space if isinstance(each, Steering) else "PoseGoal" * each,
)  # fmt: skip
def test_the_cost_to_go_is_a_lower_bound(
    demo: AmbiguityService, steering: Steering, ours: bool, weight: float
) -> None:
    least, cost = costs_to_go(demo, steering, weight, ours)
    assert (least <= cost * (1.0 + 1e-6)).all()
    assert least.mean() > 0.1 * cost.mean()


def test_the_cost_to_go_of_ompl_s_own_goal_is_none_in_se2(demo: AmbiguityService) -> None:
    """Half a metre for every radian: if this fails, `PoseGoal` may go."""
    least, cost = costs_to_go(demo, Steering("se2"), 0.0, False)
    assert (least > cost).mean() > 0.99


def test_the_planners_of_se2_are_given_the_bound(demo: AmbiguityService) -> None:
    robot = RoutePlanner(demo, space="se2")
    setup = prepare(robot.problem((3.0, 3.0, 0.0), (12.0, 6.0, 1.0)))
    state = new_state(setup.si, (12.0, 10.0, -2.0), True)
    bound = setup.objective.costToGo(state, setup.simple.getGoal()).value()
    assert bound == pytest.approx(4.0, abs=1e-5)


def test_the_heading_is_part_of_the_goal() -> None:
    si = information(Steering("se2"))
    goal = PoseGoal(si, new_state(si, GOAL, True), 0.1)
    for pose, there in (
        (GOAL, True), ((20.05, 14.0, 1.0), True), ((20.2, 14.0, 1.0), False),
        ((20.0, 14.0, 2.0), False), ((20.05, 14.0, -2.0), False),
    ):  # fmt: skip
        assert (goal.distanceGoal(new_state(si, pose, True)) <= 0.1) == there
        assert goal.isSatisfied(new_state(si, pose, True)) == there
    drawn = si.allocState()
    goal.sampleGoal(drawn)
    assert (drawn.getX(), drawn.getY(), drawn.getYaw()) == GOAL


@pytest.mark.parametrize("tolerance", [0.0, -1.0, float("nan")])
def test_bad_tolerances(tolerance: float) -> None:
    si = information(Steering())
    with pytest.raises(InputError, match=r"tolerance is .*; give a (number above 0|finite number)"):
        PoseGoal(si, new_state(si, GOAL, False), tolerance)
