"""The optimization objective: the integral of the ambiguity cost along motions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from ompl import base as ob

from ambinav.errors import InputError
from ambinav.geometry.steering import Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.service.motion import line_integral, motion_integral
from ambinav.service.service import AmbiguityService
from ambinav_planners.direct import direct
from ambinav_planners.spaces import kind_of, steering_of

Cost = ob.Cost


class AmbiguityObjective(ob.PathLengthOptimizationObjective):
    """Metres-equivalent of a path: the integral of c = 1 + weight * layer over its length.

    This *is* a state cost integral, exact along straight motions. It derives from OMPL's path
    length for two reasons: a Python subclass of `StateCostIntegralObjective` is silently ignored
    by OMPL 2.0, and with c >= 1 the length is a lower bound of the cost, so that the informed
    samplers that OMPL keeps for path length stay valid.

    Args:
        si: OMPL's space information; its state space is R^2, SE(2), Dubins or Reeds-Shepp.
        service_or_map: The service whose cost counts, or a map, read at its `cost_layer`.
        weight: How many extra metres a metre at layer 1 is worth, at least 0. None takes the
            service's own.
        steering: The kind of motion; needed for Dubins and Reeds-Shepp, which do not tell their
            turning radius.

    Raises:
        InputError: a weight below 0 or not a number, a space that ambiguity cannot be read in, or
            a steering that does not suit it.

    Attributes:
        service: What a metre costs.
        steering: The kind of motion.
        symmetric: Whether a motion costs the same both ways. A map with headings in R^2 is read
            along the travel, which there makes the way back another way.
    """

    def __init__(
        self,
        si: ob.SpaceInformation,
        service_or_map: AmbiguityService | AmbiguityMap,
        weight: float | None = None,
        *,
        steering: Steering | None = None,
    ) -> None:
        super().__init__(si)
        if isinstance(service_or_map, AmbiguityMap):
            service = AmbiguityService(service_or_map, weight=5.0 if weight is None else weight)
        else:
            service = service_or_map if weight is None else service_or_map.with_weight(weight)
        space = si.getStateSpace()
        kind = kind_of(space)
        self.steering = steering_of(space) if steering is None else steering
        if kind != self.steering.space:
            raise InputError(
                f"steering {self.steering.space!r} does not suit the state space "
                f"{space.getName()!r}; give one of the space {kind!r}."
            )
        self.service = service
        self._with_heading = kind != "r2"
        self.symmetric = self._with_heading or not service.has_headings
        self._kind, self._radius = self.steering.kind, self.steering.kernel_radius
        values, _, left, low, inverse = service.density.arrays
        self._field = (values, left, low, inverse)
        # No metre costs less, so a straight line at this price is a lower bound of any way.
        self._least = float(np.min(values))
        zeros = (0.0,) * 6
        self._integral = direct(motion_integral, self._kind, self._radius, *zeros, *self._field)
        self._line = direct(line_integral, *zeros[:4], *self._field)

    def stateCost(self, state: Any) -> ob.Cost:  # noqa: N802 (OMPL's name)
        """Cost per metre at a state; in walls that of the nearest free place."""
        x, y, theta = self._pose(state)
        return Cost(self.service.density.near(x, y, theta))

    def motionCost(self, a: Any, b: Any) -> ob.Cost:  # noqa: N802 (OMPL's name)
        """Cost of a motion, metres-equivalent."""
        if self._with_heading:
            return Cost(
                self._integral(
                    self._kind, self._radius, a.getX(), a.getY(), a.getYaw(),
                    b.getX(), b.getY(), b.getYaw(), *self._field,
                )
            )  # fmt: skip
        return Cost(self._line(a[0], a[1], b[0], b[1], *self._field))

    def motionCostHeuristic(self, a: Any, b: Any) -> ob.Cost:  # noqa: N802 (OMPL's name)
        """Lower bound of the cost of every way from a to b: the line at the map's lowest price."""
        if self._with_heading:
            return Cost(self._least * math.hypot(b.getX() - a.getX(), b.getY() - a.getY()))
        return Cost(self._least * math.hypot(b[0] - a[0], b[1] - a[1]))

    def motionCostBestEstimate(self, a: Any, b: Any) -> ob.Cost:  # noqa: N802 (OMPL's name)
        """The cost itself: one kernel call is cheap."""
        return self.motionCost(a, b)

    def _pose(self, state: Any) -> tuple[float, float, float]:
        if self._with_heading:
            return state.getX(), state.getY(), state.getYaw()
        return state[0], state[1], 0.0
