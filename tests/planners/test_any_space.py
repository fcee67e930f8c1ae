"""The objective in spaces that it does not know: along the space's own motions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from ompl import base as ob
from ompl import control as oc
from ompl import geometric as og

from ambinav.geometry.motion.steering import Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.goal import PoseGoal
from ambinav_planners.objective import AmbiguityObjective
from ambinav_planners.spaces import make_space, new_state, pose_reader
from tests.planners.test_objective import BOUNDS, information

RNG_LOW, RNG_HIGH = [2.0, 2.0, -3.0], [40.0, 25.0, 3.0]


def pairs_of(si: ob.SpaceInformation, count: int, with_heading: bool) -> list[tuple[Any, Any]]:
    ends = np.random.default_rng(8).uniform(RNG_LOW, RNG_HIGH, (count, 2, 3))
    return [
        (new_state(si, tuple(a), with_heading), new_state(si, tuple(b), with_heading))
        for a, b in ends.tolist()
    ]


@pytest.mark.parametrize(
    ("steering", "error"),
    [
        (Steering(), 1e-9), (Steering("se2"), 1e-5),
        (Steering("dubins", 0.7), 2e-3), (Steering("reeds-shepp", 0.7), 2e-3),
    ],
    ids=["r2", "se2", "dubins", "reeds-shepp"],
)  # fmt: skip
@pytest.mark.parametrize("headings", [False, True])
def test_known_spaces_taken_for_unknown_ones_cost_the_same(
    demo_map: AmbiguityMap,
    heading_map: AmbiguityMap,
    steering: Steering,
    error: float,
    headings: bool,
) -> None:
    si = information(steering)
    service = AmbiguityService(heading_map if headings else demo_map, weight=6.0)
    known = AmbiguityObjective(si, service)
    with_heading = steering.space != "r2"
    read = pose_reader(with_heading)
    unknown = AmbiguityObjective(si, service, pose=read if with_heading else lambda s: read(s)[:2])
    assert unknown.steering is None
    for a, b in pairs_of(si, 12, with_heading):
        cost = known.motionCost(a, b).value()
        assert unknown.motionCost(a, b).value() == pytest.approx(cost, rel=error)
        assert unknown.stateCost(a).value() == known.stateCost(a).value()
        least = unknown.motionCostHeuristic(a, b).value()
        assert least == known.motionCostHeuristic(a, b).value()
    assert unknown.symmetric == known.symmetric


@pytest.mark.slow(kept=("0.5",))
@pytest.mark.parametrize("radius", [0.5, 1.0])
def test_short_motions_with_cusps_cost_the_same(demo: AmbiguityService, radius: float) -> None:
    """Of Reeds-Shepp curves, where OMPL drives ours, and there is not a second one as long."""
    si = information(Steering("reeds-shepp", radius))
    space, read = si.getStateSpace(), pose_reader(True)
    known, unknown = AmbiguityObjective(si, demo), AmbiguityObjective(si, demo, pose=read)
    rng = np.random.default_rng(3)
    away = np.empty((3, 200))
    for row, std in enumerate((0.1, 0.3, 1.0)):
        starts = rng.uniform((2.0, 2.0, -3.0), (40.0, 25.0, 3.0), (away.shape[1], 3))
        for k, (start, end) in enumerate(
            zip(starts, starts + rng.normal(0.0, std, starts.shape), strict=True)
        ):
            a, b = new_state(si, tuple(start), True), new_state(si, tuple(end), True)
            cost = unknown.motionCost(a, b).value()
            assert cost > space.distance(a, b) * (1.0 - 2e-3)
            away[row, k] = abs(cost / known.motionCost(a, b).value() - 1.0)
    assert np.quantile(away, 0.95) < 2e-3
    assert (away > 5e-3).mean() < 0.02


def test_symmetric_dubins_costs_what_its_motion_does(demo: AmbiguityService) -> None:
    si = ob.SpaceInformation(ob.DubinsStateSpace(0.7, True))
    plain = information(Steering("dubins", 0.7))
    objective = AmbiguityObjective(si, demo, 0.0, pose=pose_reader(True))
    there_only = AmbiguityObjective(plain, demo, 0.0)
    for a, b in pairs_of(si, 8, True):
        either = min(there_only.motionCost(*ends).value() for ends in ((a, b), (b, a)))
        assert objective.motionCost(a, b).value() == pytest.approx(either, rel=2e-3)


def flat_box(low: float, high: float) -> ob.RealVectorBounds:
    bounds = ob.RealVectorBounds(3)
    bounds.setLow(low)
    bounds.setHigh(high)
    return bounds


def flying(weight: float, demo: AmbiguityService) -> tuple[og.SimpleSetup, AmbiguityObjective]:
    """x, y and z as a vector, which any sound path costs at least its length in."""
    space = ob.RealVectorStateSpace(3)
    space.setBounds(flat_box(0.0, 28.0))
    setup = og.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: True)
    objective = AmbiguityObjective(
        setup.getSpaceInformation(), demo, weight,
        pose=lambda s: (s[0], s[1]), height=lambda s: s[2],
    )  # fmt: skip
    setup.setOptimizationObjective(objective)
    return setup, objective


def vector(si: ob.SpaceInformation, values: Any) -> Any:
    state = si.allocState()
    for axis, value in enumerate(values):
        state[axis] = float(value)
    return state


@pytest.mark.slow
def test_in_space_the_price_is_paid_for_the_length_in_space(demo: AmbiguityService) -> None:
    setup, objective = flying(6.0, demo)
    si, service = setup.getSpaceInformation(), demo.with_weight(6.0)
    ends = np.random.default_rng(3).uniform((3, 3, 0), (25, 20, 9), (20, 2, 3))
    ends[0, 1, :2] = ends[0, 0, :2]  # straight up
    ends[1, 1, :2] = ends[1, 0, :2] + 1e-7
    share = (np.arange(20_000) + 0.5) / 20_000
    for first, last in ends:
        a, b = vector(si, first), vector(si, last)
        length, cost = math.dist(first, last), objective.motionCost(a, b).value()
        x, y, _ = first[:, None] + (last - first)[:, None] * share
        price = np.array([service.density.near(*at, 0.0) for at in zip(x, y, strict=True)])
        assert cost == pytest.approx(price.mean() * length, rel=1e-5)
        assert cost >= objective.motionCostHeuristic(a, b).value() >= length * (1.0 - 1e-12)
        assert objective.motionCost(b, a).value() == pytest.approx(cost, rel=1e-9)


@pytest.mark.slow
def test_informed_planners_in_space(demo: AmbiguityService) -> None:
    """At weight 0 they come down to about the straight line, and never below its length."""
    setup, objective = flying(0.0, demo)
    si = setup.getSpaceInformation()
    start, goal = (3.0, 3.0, 0.0), (25.0, 20.0, 9.0)
    setup.setStartAndGoalStates(vector(si, start), vector(si, goal))
    planner = og.InformedRRTstar(si)
    setup.setPlanner(planner)
    near = 1.05 * math.dist(start, goal)  # OMPL's seed is not set: some runs need more samples
    setup.solve(
        ob.PlannerTerminationCondition(
            lambda: planner.bestCost().value() < near or planner.numIterations() >= 2000
        )
    )
    path = og.PathGeometric(setup.getSolutionPath())
    assert path.cost(objective).value() == pytest.approx(path.length())
    assert setup.haveExactSolutionPath()
    assert 1.0 - 1e-9 <= path.length() / math.dist(start, goal) < 1.05


def test_axes_that_cost_nothing_are_refused(demo: AmbiguityService) -> None:
    """A mast in a vector would be pruned wrongly; beside the base it is fine."""
    space = ob.RealVectorStateSpace(3)
    space.setBounds(flat_box(0.0, 28.0))
    si = ob.SpaceInformation(space)
    with pytest.raises(InputError, match=r"axis 2 of the state space .* is 0 m by `pose` and `hei"):
        AmbiguityObjective(si, demo, pose=lambda s: (s[0], s[1]))
    with pytest.raises(InputError, match=r"axis 2 of the state space .* is 0.001 m"):
        AmbiguityObjective(si, demo, pose=lambda s: (s[0], s[1]), height=lambda s: 0.001 * s[2])
    with pytest.raises(InputError, match="height is given without pose"):
        AmbiguityObjective(si, demo, height=lambda s: s[2])
    with pytest.raises(InputError, match="height gives nan for a state"):
        AmbiguityObjective(si, demo, pose=lambda s: (s[0], s[1]), height=lambda s: math.nan)
    posed = ob.SpaceInformation(ob.SE3StateSpace())
    with pytest.raises(InputError, match=r"axis 2 of the state space 'SE3"):
        AmbiguityObjective(posed, demo, pose=lambda s: (s.getX(), s.getY()))


def test_who_turns_as_it_climbs_pays_for_each_heading(heading_map: AmbiguityMap) -> None:
    """The mean over the turn, both ways, against a sum over many headings."""
    service = AmbiguityService(heading_map, weight=6.0)
    space = ob.CompoundStateSpace()
    space.addSubspace(ob.SE2StateSpace(), 1.0)
    space.addSubspace(ob.RealVectorStateSpace(1), 1.0)
    si = ob.SpaceInformation(space)
    objective = AmbiguityObjective(
        si, service, pose=lambda s: (s[0].getX(), s[0].getY(), s[0].getYaw()),
        height=lambda s: s[1][0],
    )  # fmt: skip
    a, b = si.allocState(), si.allocState()
    for state, yaw, z in ((a, -0.3, 0.0), (b, 1.7, 1.5)):
        state[0].setX(12.0)
        state[0].setY(6.0)
        state[0].setYaw(yaw)
        state[1][0] = z
    headings = -0.3 + 2.0 * (np.arange(4000) + 0.5) / 4000
    mean = np.mean([service.density.near(12.0, 6.0, theta) for theta in headings.tolist()])
    assert np.ptp([service.cost(12.0, 6.0, theta) for theta in (0.0, 0.8, 1.6)]) > 0.03
    for ends in ((a, b), (b, a)):
        assert objective.motionCost(*ends).value() == pytest.approx(1.5 * mean, rel=1e-4)


def test_places_that_are_not_in_metres_are_refused(demo: AmbiguityService) -> None:
    """Nor sheared ones, where both axes are and the diagonal is not."""
    cells = ob.SpaceInformation(make_space(Steering(), BOUNDS))
    with pytest.raises(InputError, match=r"axis 0 of the state space .* is 0.05 m by `pose`"):
        AmbiguityObjective(cells, demo, pose=lambda s: (s[0] / 20.0, s[1] / 20.0))
    with pytest.raises(InputError, match=r"axis 0 and 1 of the state space"):
        AmbiguityObjective(cells, demo, pose=lambda s: (s[0] + s[1], s[1]))
    turned = ob.SpaceInformation(make_space(Steering("se2"), BOUNDS))
    with pytest.raises(InputError, match=r"axis 1 of the state space 'SE2"):
        AmbiguityObjective(turned, demo, pose=lambda s: (s.getX(), 0.5 * s.getY(), s.getYaw()))
    AmbiguityObjective(turned, demo, pose=lambda s: (s.getX(), 2.0 * s.getY(), s.getYaw()))


def test_places_are_asked_for_within_the_bounds_alone(demo: AmbiguityService) -> None:
    """An elevation model ends where the space does."""
    space = ob.RealVectorStateSpace(2)
    bounds = ob.RealVectorBounds(2)
    for axis, (low, high) in enumerate(((100.0, 120.0), (50.0, 50.5))):
        bounds.setLow(axis, low)
        bounds.setHigh(axis, high)
    space.setBounds(bounds)

    def height(state: Any) -> float:
        assert 100.0 <= state[0] <= 120.0 and 50.0 <= state[1] <= 50.5
        return 0.1 * state[0]

    AmbiguityObjective(ob.SpaceInformation(space), demo, pose=lambda s: (s[0], s[1]), height=height)


def test_poses_in_space(demo: AmbiguityService) -> None:
    """SE(3): turning costs nothing, climbing costs its metres; so does the goal count them."""
    space = ob.SE3StateSpace()
    space.setBounds(flat_box(0.0, 28.0))
    si = ob.SpaceInformation(space)
    read: dict[str, Any] = {
        "pose": lambda s: (s.getX(), s.getY()), "height": lambda s: s.getZ()
    }  # fmt: skip
    objective = AmbiguityObjective(si, demo, **read)
    a, b = si.allocState(), si.allocState()
    a.setXYZ(5.0, 5.0, 1.0)
    b.setXYZ(5.0, 5.0, 3.0)
    a.rotation().setIdentity()
    b.rotation().setAxisAngle(0.0, 0.0, 1.0, 2.0)
    assert objective.motionCost(a, b).value() == pytest.approx(2.0 * demo.cost(5.0, 5.0))
    assert PoseGoal(si, b, **read).distanceGoal(a) == pytest.approx(2.0)
    assert space.distance(a, b) > 2.5


def base_of(state: Any) -> tuple[float, float, float]:
    return state[0].getX(), state[0].getY(), state[0].getYaw()


def with_an_arm() -> tuple[og.SimpleSetup, Any, Any]:
    """A base that turns and an arm on it, and two of their states."""
    space = ob.CompoundStateSpace()
    space.addSubspace(make_space(Steering("se2"), (2.0, 2.0, 10.0, 6.0)), 1.0)
    space.addSubspace(ob.SO2StateSpace(), 0.1)
    space.lock()
    setup = og.SimpleSetup(space)
    si = setup.getSpaceInformation()
    setup.setStateValidityChecker(lambda state: True)
    si.setup()
    a, b = si.allocState(), si.allocState()
    for state, (x, y, yaw), arm in ((a, (3.0, 3.0, 0.0), 0.0), (b, (9.0, 5.0, 2.0), 3.0)):
        state[0].setX(x)
        state[0].setY(y)
        state[0].setYaw(yaw)
        state[1].value = arm
    return setup, a, b


def test_a_compound_space(demo: AmbiguityService) -> None:
    """The arm moves for nothing."""
    setup, a, b = with_an_arm()
    objective = AmbiguityObjective(setup.getSpaceInformation(), demo, pose=base_of)
    cost = demo.motion_cost(3.0, 3.0, 9.0, 5.0, 0.0, 2.0)
    assert objective.motionCost(a, b).value() == pytest.approx(cost, rel=1e-6)


def test_a_route_in_a_compound_space(demo: AmbiguityService) -> None:
    """What OMPL minimises is the cost of the base's route, whatever the arm does."""
    setup, a, b = with_an_arm()
    si = setup.getSpaceInformation()
    objective = AmbiguityObjective(si, demo, pose=base_of)
    setup.setOptimizationObjective(objective)
    setup.addStartState(a)
    setup.setGoal(PoseGoal(si, b, pose=base_of))
    planner = og.RRTstar(si)
    setup.setPlanner(planner)
    setup.solve(
        ob.PlannerTerminationCondition(
            lambda: planner.numIterations() >= 60 and math.isfinite(planner.bestCost().value())
        )
    )
    assert setup.haveExactSolutionPath()
    path = og.PathGeometric(setup.getSolutionPath())
    poses = np.array([base_of(state) for state in path.getStates()])
    np.testing.assert_allclose(poses[[0, -1]], [base_of(a), base_of(b)], atol=1e-6)
    cost = demo.route_cost(poses, Steering("se2"))
    assert path.cost(objective).value() == pytest.approx(cost, rel=1e-5)
    assert planner.bestCost().value() == pytest.approx(cost, rel=1e-5)
    assert cost >= math.dist(poses[0, :2], poses[-1, :2])
    assert path.getState(path.getStateCount() - 1)[1].value == pytest.approx(3.0)


def test_control_planners_ignore_every_objective(demo: AmbiguityService) -> None:
    """What they found can be costed afterwards: that is all that 2.0.1 leaves."""
    space = make_space(Steering("se2"), BOUNDS)
    controls = oc.RealVectorControlSpace(space, 2)
    limits = ob.RealVectorBounds(2)
    limits.setLow(-1.0)
    limits.setHigh(1.0)
    controls.setBounds(limits)
    setup = oc.SimpleSetup(controls)
    si = setup.getSpaceInformation()
    setup.setStateValidityChecker(lambda state: space.satisfiesBounds(state))

    def drive(state: Any, control: Any, seconds: float, result: Any) -> None:
        speed, turn = control[0], control[1]
        result.setX(state.getX() + speed * math.cos(state.getYaw()) * seconds)
        result.setY(state.getY() + speed * math.sin(state.getYaw()) * seconds)
        result.setYaw(math.remainder(state.getYaw() + turn * seconds, 2.0 * math.pi))

    setup.setStatePropagator(drive)
    si.setPropagationStepSize(0.2)
    calls = []

    class Counting(AmbiguityObjective):
        def motionCost(self, a: Any, b: Any) -> ob.Cost:  # noqa: N802
            calls.append(1)
            return super().motionCost(a, b)

    objective = Counting(si, demo)
    setup.setOptimizationObjective(objective)
    setup.setStartAndGoalStates(
        new_state(si, (3.0, 3.0, 0.0), True), new_state(si, (6.0, 4.0, 0.0), True), 1.0
    )
    setup.setPlanner(oc.RRT(si))
    setup.solve(20.0)
    assert not calls, "control planners ask for costs now: docs/planning.md may promise more"
    path = setup.getSolutionPath()
    path.interpolate()
    states = path.getStates()
    poses = np.array([(s.getX(), s.getY(), s.getYaw()) for s in states])
    assert objective.cost_of(states) == pytest.approx(demo.route_cost(poses, Steering("se2")))


@pytest.mark.parametrize("pose", [None, (1.0,), (1.0, math.nan), ("a", "b"), 3.0])
def test_poses_that_are_none(demo: AmbiguityService, pose: object) -> None:
    si = information(Steering())
    with pytest.raises(InputError, match=r"pose gives .* for a state; let it return x and y in"):
        AmbiguityObjective(si, demo, pose=lambda state: pose)  # type: ignore[arg-type,return-value]


def test_motions_that_jump(demo: AmbiguityService) -> None:
    si = information(Steering())
    objective = AmbiguityObjective(si, demo, pose=lambda s: (s[0] + 3.0 * (s[0] > 5.0), s[1]))
    a, b = (new_state(si, pose, False) for pose in ((3.0, 3.0, 0.0), (9.0, 3.0, 0.0)))
    with pytest.raises(InputError, match="jumps from pose to pose; its cost cannot be integrated"):
        objective.motionCost(a, b)


def test_a_steering_and_a_pose_are_too_much(demo: AmbiguityService) -> None:
    with pytest.raises(InputError, match="both steering and pose are given"):
        AmbiguityObjective(
            information(Steering()), demo, steering=Steering(), pose=pose_reader(False)
        )
