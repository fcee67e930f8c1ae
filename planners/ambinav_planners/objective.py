"""The optimization objective: the integral of the ambiguity cost along motions."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from ompl import base as ob

from ambinav.geometry.motion.steering import FACING, Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import machine_code
from ambinav.service.motion import line_cost_at, motion_cost_at
from ambinav.service.service import AmbiguityService
from ambinav_planners.along_space import HeightOf, PoseOf, SpaceMotions
from ambinav_planners.spaces import check_axes
from ambinav_planners.steering_check import check_steering, steering_of

Cost = ob.Cost
MotionCost = Callable[[Any, Any], ob.Cost]


def as_cost(value: float, unknown: float = math.inf) -> ob.Cost:
    """Return a cost as OMPL's; `unknown` for that of a state that is not a number."""
    return Cost(unknown if math.isnan(value) else value)


class AmbiguityObjective(ob.PathLengthOptimizationObjective):
    """Cost of a path in equivalent metres: the integral of c = 1 + weight * layer.

    This *is* a state cost integral, exact along straight motions. It derives from OMPL's path
    length for two reasons: a Python subclass of `StateCostIntegralObjective` is silently ignored
    by OMPL 2.0, and with c >= 1 the length is a lower bound of the cost, so that the informed
    samplers that OMPL keeps for path length stay valid. The cost-to-go is OMPL's own; if the
    distance of the space includes more than metres, use `PoseGoal` for a lower bound.

    Args:
        si: OMPL's space information. The motions of R^2, SE(2), Dubins and Reeds-Shepp spaces are
            supported, with the turning radius derived from the space; every other space needs
            `pose`.
        service_or_map: The service that gives the cost, or a map, read at its `cost_layer`.
        weight: Extra cost of a metre where the layer is 1, in metres, at least 0. None: the
            service's own.
        steering: The kind of motion, if it is known: it must be that of the space. Not together
            with `pose`.
        pose: From a state to x, y, theta (metres, radians) or to x, y alone, for any space: the
            cost is then integrated along `space.interpolate`. A hundred times slower.
        height: With `pose`, from a state to the height of the robot, metres: the price is then
            integrated over the length in space. Without it the cost is that of the motion on the
            floor. What else a space counts as distance is no part of the cost: informed planners
            need the space's distance to be at most the metres.

    Raises:
        InputError: a weight below 0 or not a number, a space without the position of the robot, a
            steering that does not suit it, `height` without `pose`, or a RealVectorStateSpace of
            three or more dimensions or an SE3StateSpace with an axis along which `pose` and
            `height` do not count the metres.

    Attributes:
        service: Service for the cost per metre.
        steering: The kind of motion; None with `pose`.
        symmetric: True if a motion costs the same in both directions. With a map with headings that
            is read along the travel the reverse has another cost.
    """

    def __init__(
        self,
        si: ob.SpaceInformation,
        service_or_map: AmbiguityService | AmbiguityMap,
        weight: float | None = None,
        *,
        steering: Steering | None = None,
        pose: PoseOf | None = None,
        height: HeightOf | None = None,
    ) -> None:
        super().__init__(si)
        if isinstance(service_or_map, AmbiguityMap):
            service = AmbiguityService(service_or_map, weight=5.0 if weight is None else weight)
        else:
            service = service_or_map if weight is None else service_or_map.with_weight(weight)
        self.service = service
        # No metre costs less, so a straight line at this price is a lower bound of any path.
        self._least = float(np.min(service.density.values))
        self.steering: Steering | None = None
        self._any: SpaceMotions | None = None
        if pose is not None:
            if steering is not None:
                raise InputError(
                    "both steering and pose are given; leave one of them out: with pose the cost "
                    "is integrated along the space's own motions."
                )
            self._any = space_motions = SpaceMotions(si, service, pose, height)
            check_axes(si, space_motions.distance)
            self._with_heading = False
            self._motion_cost: MotionCost = lambda a, b: as_cost(space_motions.cost(a, b))
        elif height is not None:
            raise InputError("height is given without pose; give both.")
        else:
            if steering is None:
                steering = steering_of(si)
            else:
                check_steering(si, steering)
            self.steering = steering
            self._with_heading = steering.kind != FACING
            self._motion_cost = _bound_cost(service, steering)
        # OMPL calls an attribute of the object without a detour over the class; a subclass that
        # overrides the method must not be bypassed.
        if type(self).motionCost is AmbiguityObjective.motionCost:
            self.motionCost = self._motion_cost  # type: ignore[assignment, method-assign]

    @property
    def symmetric(self) -> bool:
        """True if a motion costs the same in both directions."""
        if self._any is not None and self._any.planar:
            return not self.service.has_headings
        return self._with_heading or self._any is not None or not self.service.has_headings

    def stateCost(self, state: Any) -> ob.Cost:  # noqa: N802 (OMPL's name)
        """Return the cost per metre at a state; in walls that of the nearest free point."""
        x, y, theta = self._pose(state)
        return as_cost(self.service.density.near(x, y, theta))

    def motionCost(self, a: Any, b: Any) -> ob.Cost:  # noqa: N802 (OMPL's name)
        """Return the cost of a motion, metres-equivalent."""
        return self._motion_cost(a, b)

    def motionCostHeuristic(self, a: Any, b: Any) -> ob.Cost:  # noqa: N802 (OMPL's name)
        """Return a lower bound of the cost from a to b: the line at the map's lowest price."""
        if self._any is not None:
            return as_cost(self._least * self._any.distance(a, b), 0.0)
        if self._with_heading:
            return as_cost(self._least * math.hypot(b.getX() - a.getX(), b.getY() - a.getY()), 0.0)
        return as_cost(self._least * math.hypot(b[0] - a[0], b[1] - a[1]), 0.0)

    def motionCostBestEstimate(self, a: Any, b: Any) -> ob.Cost:  # noqa: N802 (OMPL's name)
        """Return the cost itself: one kernel call is cheap."""
        return self.motionCost(a, b)

    def cost_of(self, states: Iterable[Any]) -> float:
        """Return the cost of the motions from state to state, metres-equivalent.

        What `path.cost(objective)` gives for geometric paths. OMPL gives 0 for control paths: of
        those, give `path.getStates()` after `path.interpolate()`.
        """
        return float(sum(self.motionCost(a, b).value() for a, b in itertools.pairwise(states)))

    def _pose(self, state: Any) -> tuple[float, float, float]:
        if self._any is not None:
            return self._any.pose(state)
        if self._with_heading:
            return state.getX(), state.getY(), state.getYaw()
        return state[0], state[1], 0.0


def _bound_cost(service: AmbiguityService, steering: Steering) -> MotionCost:
    """Return the cost of a motion as a function whose constants are local names.

    RRT* calls it for every neighbour of every sample. An array among the arguments of machine code
    takes as long to hand over as a short motion to integrate, so the kernels get its address.
    """
    values, _, left, low, inverse = service.density.arrays
    values = np.ascontiguousarray(values, dtype=np.float32)
    address, (rows, columns, headings) = values.ctypes.data, values.shape
    field = (address, rows, columns, headings, left, low, inverse)
    kind, radius = steering.kind, steering.kernel_radius
    line = machine_code(line_cost_at, *(0.0,) * 4, *field)
    curve = machine_code(motion_cost_at, kind, radius, *(0.0,) * 6, *field)

    def facing(a: Any, b: Any) -> ob.Cost:
        return Cost(
            line(a[0], a[1], b[0], b[1], address, rows, columns, headings, left, low, inverse)
        )

    def between_poses(a: Any, b: Any) -> ob.Cost:
        return Cost(
            curve(
                kind, radius, a.getX(), a.getY(), a.getYaw(), b.getX(), b.getY(), b.getYaw(),
                address, rows, columns, headings, left, low, inverse,
            )
        )  # fmt: skip

    bound: Any = facing if kind == FACING else between_poses
    bound.values = values  # keeps the array alive
    return bound  # type: ignore[no-any-return]
