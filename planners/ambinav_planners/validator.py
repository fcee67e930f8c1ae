"""Collision checks for OMPL: the footprint against the exact walls, one kernel call a motion."""

from __future__ import annotations

from typing import Any

from ompl import base as ob

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.collision.sweep import motion_free, pose_free
from ambinav.runtime.kernels import machine_code
from ambinav_planners.spaces import has_heading


class FootprintStateValidity(ob.StateValidityChecker):
    """Validity check of the footprint at a state: no walls, frontiers or forbidden places."""

    def __init__(self, si: ob.SpaceInformation, checker: CollisionChecker) -> None:
        super().__init__(si)
        self._with_heading = has_heading(si.getStateSpace())
        self._arrays = checker.arrays
        self._free = machine_code(pose_free, 0.0, 0.0, 0.0, *self._arrays)

    def isValid(self, state: Any) -> bool:  # noqa: N802 (OMPL's name)
        """Return whether the robot fits there."""
        if self._with_heading:
            return bool(self._free(state.getX(), state.getY(), state.getYaw(), *self._arrays))
        return bool(self._free(state[0], state[1], 0.0, *self._arrays))


class FootprintMotionValidator(ob.MotionValidator):
    """Validity check of the footprint's motion from state to state.

    Exact for discs on straight motions; see `ambinav.geometry.collision.checker` for the others.
    """

    def __init__(self, si: ob.SpaceInformation, checker: CollisionChecker) -> None:
        super().__init__(si)
        self._with_heading = has_heading(si.getStateSpace())
        self._kind, self._radius = checker.steering.kind, checker.steering.kernel_radius
        self._arrays = checker.arrays
        zeros = (0.0,) * 6
        self._free = machine_code(motion_free, self._kind, self._radius, *zeros, *self._arrays)

    def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802 (OMPL's name)
        """Return whether the motion is free, given that its start is."""
        if self._with_heading:
            return bool(
                self._free(
                    self._kind, self._radius, a.getX(), a.getY(), a.getYaw(),
                    b.getX(), b.getY(), b.getYaw(), *self._arrays,
                )
            )  # fmt: skip
        return bool(self._free(0, None, a[0], a[1], 0.0, b[0], b[1], 0.0, *self._arrays))


class Unchecked(ob.MotionValidator):
    """Calls every motion free: for a roadmap whose motions are all checked afterwards."""

    def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802 (OMPL's name)
        """Return true."""
        return True
