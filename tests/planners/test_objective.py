"""The objective in OMPL: against plain NumPy sums along the paths that OMPL found."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from ompl import base as ob
from ompl import geometric as og
from scipy.ndimage import map_coordinates

from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Pose
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.objective import AmbiguityObjective
from ambinav_planners.ompl_setup import Setup, Watch, prepare
from ambinav_planners.planning import RoutePlanner
from ambinav_planners.problem import make_checker
from ambinav_planners.registry import Budget, planner
from ambinav_planners.spaces import make_space, new_state, pose_reader
from ambinav_planners.validator import FootprintMotionValidator

SPACES = [
    Steering(), Steering("se2"), Steering("dubins", 0.5), Steering("reeds-shepp", 0.5)
]  # fmt: skip
steerings = pytest.mark.parametrize("steering", SPACES, ids=lambda steering: steering.space)
BOUNDS = (0.0, 0.0, 45.0, 28.0)
HALF_TURN = math.pi
poses = st.tuples(st.floats(1.0, 44.0), st.floats(1.0, 27.0), st.floats(-HALF_TURN, HALF_TURN))


def information(steering: Steering) -> ob.SpaceInformation:
    si = ob.SpaceInformation(make_space(steering, BOUNDS))
    si.setStateValidityChecker(lambda state: True)
    si.setup()
    return si


def read(service: AmbiguityService, at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cost per metre at poses (N, 3), linear between the cells of the map."""
    dataset = service.map.dataset
    layer = dataset[service.layer].values
    layer = layer.reshape(*layer.shape[:2], -1)
    values = service.density.values.astype(np.float64)
    free = dataset["free"].values
    np.testing.assert_allclose(values[free], 1.0 + service.weight * layer[free], rtol=1e-5)
    x, y = dataset["x"].values, dataset["y"].values
    turns = (at[:, 2] / (2.0 * np.pi)) % 1.0 * values.shape[2]
    around = np.concatenate([values, values[:, :, :1]], axis=2)
    step = service.map.spacing
    places = np.stack([(at[:, 1] - y[0]) / step, (at[:, 0] - x[0]) / step, turns])
    return np.asarray(map_coordinates(around, places, order=1, mode="nearest"))


def summed(setup: Setup, path: og.PathGeometric, step: float = 0.002) -> float:
    """Cost of a path by the midpoint rule, on points between states from OMPL itself."""
    space, planar = setup.si.getStateSpace(), setup.steering.space == "r2"
    pose = pose_reader(not planar)
    between = setup.si.allocState()
    total = 0.0
    states = path.getStates()
    for a, b in itertools.pairwise(states):
        count = max(4, math.ceil(space.distance(a, b) / step))
        ends = []
        for share in np.linspace(0.0, 1.0, count + 1):
            space.interpolate(a, b, share, between)
            ends.append(pose(between))
        line = np.array(ends)
        step_x, step_y = np.diff(line[:, :2], axis=0).T
        middle = 0.5 * (line[:-1] + line[1:])
        turned = (np.diff(line[:, 2]) + np.pi) % (2.0 * np.pi) - np.pi
        middle[:, 2] = np.arctan2(step_y, step_x) if planar else line[:-1, 2] + 0.5 * turned
        total += float(np.sum(np.hypot(step_x, step_y) * read(setup.objective.service, middle)))
    return total


def found(robot: RoutePlanner, name: str) -> tuple[Setup, og.PathGeometric, float]:
    """What a planner finds from room to room (any path will do), and its best cost."""
    setup = prepare(robot.problem((3.0, 3.0, 0.0), (12.0, 6.0, 1.0)))
    make = planner(name).make
    assert make is not None
    chosen = make(setup.si)
    setup.simple.setPlanner(chosen)
    # It ends with the first path; the time is for machines that do much else.
    watch = Watch(Budget(120.0))
    setup.simple.solve(
        ob.PlannerTerminationCondition(
            lambda: math.isfinite(chosen.bestCost().value()) or watch.over
        )
    )
    assert setup.simple.haveExactSolutionPath()
    path = og.PathGeometric(setup.simple.getSolutionPath())
    return setup, path, chosen.bestCost().value()


@pytest.mark.slow
@steerings
def test_the_cost_that_ompl_reports_is_the_integral(
    demo: AmbiguityService, steering: Steering
) -> None:
    robot = RoutePlanner(demo, space=steering.space, turning_radius=steering.radius)
    setup, path, _ = found(robot, "bitstar")
    cost = path.cost(setup.objective).value()
    assert cost == pytest.approx(summed(setup, path), rel=1e-3)
    path = np.array([pose_reader(steering.space != "r2")(state) for state in path.getStates()])
    assert demo.route_cost(path, steering) == pytest.approx(cost, rel=1e-9)


@pytest.mark.slow
@steerings
def test_a_map_with_headings_is_read_at_the_heading(
    heading_map: AmbiguityMap, steering: Steering
) -> None:
    service = AmbiguityService(heading_map)
    robot = RoutePlanner(service, space=steering.space, turning_radius=steering.radius)
    setup, path, _ = found(robot, "bitstar")
    assert setup.objective.symmetric == (steering.space != "r2")
    assert path.cost(setup.objective).value() == pytest.approx(summed(setup, path), rel=1e-3)


@pytest.mark.parametrize("name", ["rrtstar", "informed-rrtstar", "sorrtstar", "bitstar"])
def test_the_best_cost_of_a_planner_is_that_of_its_path(robot: RoutePlanner, name: str) -> None:
    setup, path, best = found(robot, name)
    assert best == pytest.approx(path.cost(setup.objective).value(), rel=1e-9)


@steerings
@pytest.mark.parametrize("headings", [False, True])
def test_the_heuristic_is_never_above_the_cost(
    demo_map: AmbiguityMap, heading_map: AmbiguityMap, steering: Steering, headings: bool
) -> None:
    si = information(steering)
    service = AmbiguityService(heading_map if headings else demo_map, weight=3.0)
    objective = AmbiguityObjective(si, service, steering=steering)
    with_heading = steering.space != "r2"

    @settings(max_examples=50, deadline=None)
    @given(poses, poses, poses)
    def holds(a: Pose, b: Pose, c: Pose) -> None:
        first, second, third = (new_state(si, pose, with_heading) for pose in (a, b, c))
        path = [objective.motionCost(*ends).value() for ends in ((first, second), (second, third))]
        least = objective.motionCostHeuristic(first, second).value()
        assert least <= path[0] * (1.0 + 1e-6) + 1e-9
        # Nor above the cost of a detour; the bound is at least the length.
        around = objective.motionCostHeuristic(first, third).value()
        assert around <= sum(path) * (1.0 + 1e-6) + 1e-9
        assert around >= math.dist(a[:2], c[:2]) * (1.0 - 1e-9)

    holds()


def test_the_weight_is_its_own_or_that_of_the_service(
    demo_map: AmbiguityMap, demo: AmbiguityService
) -> None:
    si = information(Steering())
    weights = [
        AmbiguityObjective(si, source, weight).service.weight
        for source, weight in (
            (demo_map, None), (demo_map, 2.0), (demo, None), (demo, 0.0),
            (demo.with_weight(7.0), None),
        )
    ]  # fmt: skip
    assert weights == [5.0, 2.0, 5.0, 0.0, 7.0]
    a, b = new_state(si, (3.0, 3.0, 0.0), False), new_state(si, (30.0, 20.0, 0.0), False)
    free_of_charge = AmbiguityObjective(si, demo, 0.0)
    assert free_of_charge.motionCost(a, b).value() == pytest.approx(math.hypot(27.0, 17.0))
    cost = demo.motion_cost(3.0, 3.0, 30.0, 20.0)
    assert AmbiguityObjective(si, demo).motionCost(a, b).value() == pytest.approx(cost)


def test_state_costs_go_on_into_the_walls(demo: AmbiguityService) -> None:
    si = information(Steering())
    objective = AmbiguityObjective(si, demo)
    free = objective.stateCost(new_state(si, (3.0, 3.0, 0.0), False)).value()
    assert free == pytest.approx(demo.cost(3.0, 3.0))
    assert 1.0 <= objective.stateCost(new_state(si, (0.0, 0.0, 0.0), False)).value() <= 6.0


@pytest.mark.parametrize("weight", [-1.0, math.nan, math.inf])
def test_bad_weights(demo_map: AmbiguityMap, demo: AmbiguityService, weight: float) -> None:
    si = information(Steering())
    for source in (demo_map, demo):
        with pytest.raises(
            InputError, match=r"weight is .*; give a (finite number|number of at least 0)\."
        ):
            AmbiguityObjective(si, source, weight)


def test_a_layer_that_is_missing(demo_map: AmbiguityMap) -> None:
    with pytest.raises(InputError, match="'levle'"):
        AmbiguityObjective(information(Steering()), AmbiguityService(demo_map, "levle"))


def test_steerings_that_do_not_suit_the_space(demo: AmbiguityService) -> None:
    for steering, other in itertools.permutations(SPACES, 2):
        with pytest.raises(InputError, match=f"suit the state space .* space '{steering.space}'"):
            AmbiguityObjective(information(steering), demo, steering=other)


def test_spaces_that_ambiguity_cannot_be_read_in(demo: AmbiguityService) -> None:
    bounds = ob.RealVectorBounds(3)
    bounds.setLow(0.0)
    bounds.setHigh(1.0)
    space = ob.RealVectorStateSpace(3)
    space.setBounds(bounds)
    for unsuitable in (space, ob.SO2StateSpace()):
        with pytest.raises(InputError, match="does not tell where the robot is; give `pose`"):
            AmbiguityObjective(ob.SpaceInformation(unsuitable), demo)


@steerings
def test_states_that_are_no_numbers_cost_infinitely_much(
    demo: AmbiguityService, steering: Steering
) -> None:
    si = information(steering)
    objective = AmbiguityObjective(si, demo)
    with_heading = steering.space != "r2"
    good = new_state(si, (3.0, 3.0, 0.0), with_heading)
    for bad in ((math.nan, 3.0, 0.0), (3.0, math.nan, 0.0)):
        state = new_state(si, bad, with_heading)
        assert objective.stateCost(state).value() == math.inf
        assert objective.motionCost(state, good).value() == math.inf
        assert objective.motionCost(good, state).value() == math.inf
        assert objective.motionCostHeuristic(good, state).value() == 0.0


def test_a_heading_of_many_turns_costs_as_one(heading_map: AmbiguityMap) -> None:
    service = AmbiguityService(heading_map, weight=6.0)
    si = information(Steering("se2"))
    objective = AmbiguityObjective(si, service)
    ends = [new_state(si, (3.0, 3.0, 0.5), True), new_state(si, (9.0, 5.0, 0.5), True)]
    once = objective.motionCost(*ends).value()
    for state in ends:
        state.setYaw(0.5 + 2.0 * math.pi * 1e6)
    assert objective.motionCost(*ends).value() == pytest.approx(once, rel=1e-6)
    ends[0].setYaw(1e16)
    assert math.isfinite(objective.motionCost(*ends).value())


@pytest.mark.slow(kept=("1.0",))
@pytest.mark.parametrize("radius", [1.0, 2.0])
def test_a_free_reeds_shepp_motion_is_free_as_ompl_drives_it(
    demo: AmbiguityService, radius: float
) -> None:
    """Also where it drives another curve than ours, which is as long."""
    steering = Steering("reeds-shepp", radius)
    si = information(steering)
    space, between = si.getStateSpace(), si.allocState()
    checker = make_checker(demo, Footprint.disc(0.2), steering)
    ours = FootprintMotionValidator(si, checker, both=False)
    both = FootprintMotionValidator(si, checker)
    room = demo.map.environment.free.buffer(-0.2 + 2e-3)
    shapely.prepare(room)
    rng = np.random.default_rng(0)
    free, differ = 0, 0
    starts = rng.uniform((0.0, 0.0, -3.0), (45.0, 28.0, 3.0), (60_000, 3))
    starts = starts[checker.poses_free(starts) & (checker.clearance(starts) < 0.3)]
    ends = starts + rng.normal(0.0, 0.3 * radius, starts.shape)
    chosen = checker.motions_free(starts, ends)
    for start, end in zip(starts[chosen], ends[chosen], strict=True):
        a, b = new_state(si, tuple(start), True), new_state(si, tuple(end), True)
        assert ours.checkMotion(a, b)
        points = []
        for k in range(41):
            space.interpolate(a, b, k / 40, between)
            points.append((between.getX(), between.getY()))
        driven = bool(room.covers(shapely.LineString(points)))
        if both.checkMotion(a, b):
            assert driven
            free += 1
        else:
            differ += 1
    assert free > 300
    assert differ > 3
