"""A goal whose cost-to-go is a lower bound of the ambiguity cost in every space."""

from __future__ import annotations

import math
from typing import Any

from ompl import base as ob

from ambinav.config import as_positive
from ambinav_planners.along_space import HeightOf, PoseOf
from ambinav_planners.spaces import kind_of, pose_reader


class PoseGoal(ob.GoalSampleableRegion):
    """One goal state; its distance is the cost to go in metres.

    OMPL takes the distance in the state space for the cost-to-go, and in SE(2) that counts half a
    metre for every radian of yaw, which our cost does not: states from which the goal is cheaper
    would be pruned. The same goes for whatever else a space counts. OMPL lets neither
    `costToGo` nor `GoalState.distanceGoal` be written in Python, but a sampleable region may be.

    Args:
        si: OMPL's space information.
        state: The goal; it is copied.
        tolerance: How near to it a path must end, in the distance of the space, above 0.
        pose: As for `AmbiguityObjective`; needed where that needs it.
        height: As there; None: metres are counted on the floor.

    Raises:
        InputError: the tolerance is not above 0, or `pose` is missing.
    """

    def __init__(
        self,
        si: ob.SpaceInformation,
        state: Any,
        tolerance: float = 1e-6,
        *,
        pose: PoseOf | None = None,
        height: HeightOf | None = None,
    ) -> None:
        super().__init__(si)
        tolerance = as_positive(tolerance, "tolerance")
        if pose is None:
            pose = pose_reader(kind_of(si.getStateSpace()) != "r2")
        self._space = si.getStateSpace()
        self._state = si.allocState()
        self._space.copyState(self._state, state)
        self._pose, self._height = pose, height
        self._place = self._position(self._state)
        self._tolerance = tolerance
        self.setThreshold(tolerance)

    def distanceGoal(self, state: Any) -> float:  # noqa: N802 (OMPL's name)
        """Return the metres to the goal; above the tolerance for states outside it."""
        metres = math.dist(self._position(state), self._place)
        if metres <= self._tolerance < self._space.distance(state, self._state):
            return math.nextafter(self._tolerance, math.inf)
        return metres

    def sampleGoal(self, state: Any) -> None:  # noqa: N802
        """Write the goal into a state."""
        self._space.copyState(state, self._state)

    def maxSampleCount(self) -> int:  # noqa: N802
        """Return 1: there is one goal state."""
        return 1

    def couldSample(self) -> bool:  # noqa: N802
        """Return true: the goal can always be sampled."""
        return True

    def _position(self, state: Any) -> tuple[float, float, float]:
        x, y = tuple(self._pose(state))[:2]
        return float(x), float(y), 0.0 if self._height is None else float(self._height(state))
