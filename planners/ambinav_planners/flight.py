"""Routes of flying robots: OMPL's tree planners in R^3, at the cost of an ambiguity volume."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

from ambinav.casting.triangles import triangles_of
from ambinav.config import check_kind
from ambinav.geometry.collision.sphere import SphereChecker, sphere_free
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_volume import AmbiguityVolume
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import machine_code
from ambinav.service.motion import integral_in_space
from ambinav.service.volume_service import VolumeService
from ambinav_planners.flight_route import FlightRoute
from ambinav_planners.improve.shortcuts import shortened
from ambinav_planners.objective import as_cost
from ambinav_planners.ompl_setup import CHECK_STEP, GOAL_TOLERANCE, Watch
from ambinav_planners.planning import NotFoundError
from ambinav_planners.registry import UNLIMITED, Budget, planner
from ambinav_planners.search.lower_bound_in_space import are_apart
from ambinav_planners.seeded import call_seeded

PLANNERS: Final = ("rrtstar", "informed-rrtstar", "sorrtstar", "bitstar")
"""The planners that plan in space."""
# Points that are tried for one that is free near a start or goal.
_NEAREST: Final = 1000


class FlightObjective(ob.PathLengthOptimizationObjective):
    """Cost of a path in RealVectorStateSpace(3), equivalent metres, exact on straight motions.

    At least the length in space, so that informed sampling stays valid; see `AmbiguityObjective`
    for the base class.

    Args:
        si: OMPL's space information; states are x, y, z in metres.
        service: Service for the cost per metre.

    Raises:
        InputError: the space is another one.
    """

    def __init__(self, si: ob.SpaceInformation, service: VolumeService) -> None:
        super().__init__(si)
        space = si.getStateSpace()
        if not (isinstance(space, ob.RealVectorStateSpace) and space.getDimension() == 3):
            raise InputError(
                f"state space {space.getName()!r} is not x, y, z; give a RealVectorStateSpace(3)."
            )
        self.service = service
        self._field = service.kernel_arrays
        self._least = float(service.density.min())
        self._integral = machine_code(integral_in_space, *(0.0,) * 6, *self._field)

    def stateCost(self, state: Any) -> ob.Cost:  # noqa: N802 (OMPL's name)
        """Return the cost per metre at a state; in walls that of the nearest free point."""
        return as_cost(self.service.near(state[0], state[1], state[2]))

    def motionCost(self, a: Any, b: Any) -> ob.Cost:  # noqa: N802 (OMPL's name)
        """Return the cost of a motion, metres-equivalent."""
        return as_cost(self._integral(a[0], a[1], a[2], b[0], b[1], b[2], *self._field))

    def motionCostHeuristic(self, a: Any, b: Any) -> ob.Cost:  # noqa: N802 (OMPL's name)
        """Return a lower bound of the cost from a to b: the line at the volume's lowest price."""
        least = self._least * math.dist((a[0], a[1], a[2]), (b[0], b[1], b[2]))
        return as_cost(least, 0.0)

    def motionCostBestEstimate(self, a: Any, b: Any) -> ob.Cost:  # noqa: N802 (OMPL's name)
        """Return the cost itself: one kernel call is cheap."""
        return self.motionCost(a, b)


class FlightPlanner:
    """Planner for a flying robot in a sphere or upright cylinder, between the heights of a volume.

    The body is checked exactly against all surfaces of the building, along whole motions. Its
    yaw is free and costs nothing.

    Args:
        service_or_volume: Service for the cost per metre, or a volume, read at weight 5.
        env: The building in space; None: the one that the volume was made of, whose surfaces it
            keeps.
        radius: Radius of the sphere, or of the cylinder, metres; None: that of the volume.
        half_height: Half the height of an upright cylinder that covers the robot, metres; None: a
            sphere does.

    Raises:
        InputError: the building is a plan, the volume does not keep its surfaces, or the radius is
            not a positive number.
    """

    def __init__(
        self,
        service_or_volume: VolumeService | AmbiguityVolume,
        env: Environment | None = None,
        radius: float | None = None,
        half_height: float | None = None,
    ) -> None:
        if isinstance(service_or_volume, AmbiguityVolume):
            service_or_volume = VolumeService(service_or_volume)
        check_kind(service_or_volume, VolumeService, "service_or_volume")
        volume = service_or_volume.volume
        if env is None:
            surfaces = volume.surfaces
        elif env.space is None:
            raise InputError(f"{env.name}: it is a plan; give the building in space.")
        else:
            surfaces = triangles_of(env.space, env.bounds)
        self.service = service_or_volume
        radius = volume.robot_radius if radius is None else radius
        self.checker = SphereChecker(surfaces, radius, half_height)

    def plan(
        self,
        start: Sequence[float],
        goal: Sequence[float],
        *,
        planner_name: str = "bitstar",
        seconds: float = 1.0,
        iterations: int | None = None,
        seed: int | None = None,
        improved: bool = True,
    ) -> FlightRoute:
        """Plan one route.

        Args:
            start: x, y, z, metres, map frame.
            goal: As `start`.
            planner_name: One of rrtstar, informed-rrtstar, sorrtstar and bitstar.
            seconds: Time limit.
            iterations: Budget in the planner's own iterations; None for no limit.
            seed: With a seed and iterations (unless the time limit ends planning first) the route
                is always the same.
            improved: True: take shortcuts of the planner's path where they cost less.

        Raises:
            NotFoundError: the planner found no path in its time.
            InputError: another argument is of no use; the message names it.
        """
        if planner_name not in PLANNERS:
            raise InputError(
                f"planner is {planner_name!r}, which does not plan in space; give one of "
                f"{', '.join(PLANNERS)}."
            )
        if math.isinf(seconds) and iterations is None:
            raise InputError(UNLIMITED)
        started, budget = time.perf_counter(), Budget(seconds, iterations, seed)
        ends = self._checked("start", start), self._checked("goal", goal)
        points: Floats | None
        curve: tuple[tuple[float, float], ...]
        if math.dist(*ends) <= GOAL_TOLERANCE:
            # OMPL's informed samplers have no ellipse around a single place.
            points, curve = np.array(ends), ((0.0, self.service.route_cost(np.array(ends))),)
        else:
            points, curve = call_seeded(
                seed, _solve, planner_name, self.service, self.checker, ends, budget
            )
        if points is None:
            if are_apart(self.service, self.checker, *ends):
                low, *_, high = self.service.volume.heights
                raise NotFoundError(
                    f"no path leads from start to goal between {low:g} and {high:g} m: every way "
                    f"is too narrow for the {self.checker.size}."
                )
            budget_text = f"{seconds:g} s" if iterations is None else f"{iterations} iterations"
            raise NotFoundError(
                f"planner {planner_name!r} found no path in its {budget_text}; give it more, or "
                f"{self._smaller}."
            )
        if improved:
            points = shortened(points, self.service, self.checker)
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        cost = self.service.route_cost(points)
        if improved and cost < curve[-1][1]:
            curve = (*curve, (time.perf_counter() - started, cost))
        body = self.checker.radius, self.checker.half_height
        return FlightRoute(points, cost, length, curve, self.service, *body, planner_name, seed)

    def _checked(self, name: str, point: Sequence[float]) -> tuple[float, ...]:
        """Return a start or goal as numbers.

        Raises:
            InputError: it is not three finite numbers, outside of the volume, or not free.
        """
        try:
            place = tuple(float(value) for value in point)
        except (TypeError, ValueError):
            place = ()
        if len(place) != 3 or not all(map(math.isfinite, place)):
            raise InputError(f"{name} is {point!r}; give x, y and z in metres.")
        where = f"{name} ({place[0]:g}, {place[1]:g}, {place[2]:g})"
        try:
            reached = math.isfinite(self.service.cost(*place))
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        if not self.checker.free([place])[0]:
            raise InputError(
                f"{where} is nearer to a surface than the {self.checker.size}, or in a wall; "
                f"{self._remedy(place)}"
            )
        if not reached:
            raise InputError(
                f"{where} is in a wall, or outside of what the robot of the volume can reach; "
                f"{self._remedy(place)}"
            )
        return place

    def _remedy(self, place: tuple[float, ...]) -> str:
        """Return where to move a start or goal: the nearest point of the lattice that is free."""
        dataset = self.service.volume.dataset
        cells = np.argwhere(self.service.volume.free)
        points = np.column_stack([dataset[n].values[cells[:, 2 - k]] for k, n in enumerate("xyz")])
        away = np.linalg.norm(points - np.array(place), axis=1)
        for k in np.argsort(away)[:_NEAREST].tolist():
            if self.checker.free(points[k])[0]:
                x, y, z = points[k].tolist()
                return (
                    f"the nearest free place is ({x:.4g}, {y:.4g}, {z:.4g}), {away[k]:.2g} m away."
                )
        return f"no place near it is free; give {self._smaller}."

    @property
    def _smaller(self) -> str:
        """Remedy for a robot that does not fit."""
        return "a smaller robot" if self.checker.half_height else "a smaller radius"


class _SphereValidity(ob.StateValidityChecker):
    def __init__(self, si: ob.SpaceInformation, checker: SphereChecker) -> None:
        super().__init__(si)
        self._arrays = checker.arrays
        self._free = machine_code(sphere_free, *(0.0,) * 6, *self._arrays)

    def isValid(self, state: Any) -> bool:  # noqa: N802 (OMPL's name)
        x, y, z = state[0], state[1], state[2]
        return bool(self._free(x, y, z, x, y, z, *self._arrays))


class _SphereMotions(ob.MotionValidator):
    def __init__(self, si: ob.SpaceInformation, checker: SphereChecker) -> None:
        super().__init__(si)
        self._arrays = checker.arrays
        self._free = machine_code(sphere_free, *(0.0,) * 6, *self._arrays)

    def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802 (OMPL's name)
        return bool(self._free(a[0], a[1], a[2], b[0], b[1], b[2], *self._arrays))


def _solve(
    name: str,
    service: VolumeService,
    checker: SphereChecker,
    ends: tuple[tuple[float, ...], tuple[float, ...]],
    budget: Budget,
) -> tuple[Floats | None, tuple[tuple[float, float], ...]]:
    """Return the points of OMPL's path, or None, and its seconds and costs."""
    ou.setLogLevel(ou.LogLevel.LOG_WARN)
    volume = service.volume
    limits = ob.RealVectorBounds(3)
    for axis, values in enumerate((*(volume.dataset[n].values for n in "xy"), volume.heights)):
        # A place may be half a cell beside the outermost cells.
        limits.setLow(axis, min(float(values[0]), *(place[axis] for place in ends)))
        limits.setHigh(axis, max(float(values[-1]), *(place[axis] for place in ends)))
    space = ob.RealVectorStateSpace(3)
    space.setBounds(limits)
    simple = og.SimpleSetup(space)
    si = simple.getSpaceInformation()
    simple.setStateValidityChecker(_SphereValidity(si, checker))
    si.setStateValidityCheckingResolution(CHECK_STEP / space.getMaximumExtent())
    si.setMotionValidator(_SphereMotions(si, checker))
    si.setup()
    simple.setOptimizationObjective(FlightObjective(si, service))
    states = si.allocState(), si.allocState()
    for state, place in zip(states, ends, strict=True):
        for axis, value in enumerate(place):
            state[axis] = value
    simple.setStartAndGoalStates(*states, GOAL_TOLERANCE)
    make = planner(name).make
    assert make is not None  # all of PLANNERS are OMPL's own
    solver = make(si)
    simple.setPlanner(solver)
    watch = Watch(budget, time.perf_counter())
    simple.solve(watch.condition(solver.bestCost, solver.numIterations))
    watch.note(solver.bestCost().value())
    if not simple.haveExactSolutionPath():
        return None, tuple(watch.curve)
    path = og.PathGeometric(simple.getSolutionPath())
    points = np.array([[state[0], state[1], state[2]] for state in path.getStates()])
    return (points if len(points) > 1 else np.array(ends)), tuple(watch.curve)
