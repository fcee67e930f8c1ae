"""Collision checks for OMPL: the footprint against the exact walls, one kernel call a motion."""

from __future__ import annotations

import itertools
import math
from typing import Any, Final

from ompl import base as ob

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.collision.sweep import motion_free, pose_free
from ambinav.geometry.motion.curves import curve_pose
from ambinav.runtime.kernels import machine_code
from ambinav_planners.spaces import has_heading

SHARES: Final = (0.25, 0.5, 0.75)
"""Shares of a motion at which its curve is compared with OMPL's."""
SAME, PIECE = 1e-6, 0.1
"""Poses of one curve differ by less, and OMPL's curve is followed in such pieces, turning radii."""


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

    Planners of OMPL take a motion to be free if its way back is. In r2, where the robot faces its
    travel, a motion of a polygon that half a turn changes is free only if both are.

    Two Reeds-Shepp curves may be equally long, and OMPL's `interpolate` then may follow another one
    than ambinav does. A motion is free if both are.

    Args:
        si: OMPL's space information.
        checker: The checker of the footprint, for the space's kind of motion.
        both: False: what is driven is ambinav's curve, as by `RoutePlanner`; only that is checked.
    """

    def __init__(
        self, si: ob.SpaceInformation, checker: CollisionChecker, *, both: bool = True
    ) -> None:
        super().__init__(si)
        self._space = si.getStateSpace()
        self._with_heading = has_heading(self._space)
        self._kind, self._radius = checker.steering.kind, checker.steering.kernel_radius
        self._turning_radius = checker.steering.radius
        self._arrays = checker.arrays
        zeros = (0.0,) * 6
        self._free = machine_code(motion_free, self._kind, self._radius, *zeros, *self._arrays)
        self._back = checker.is_directed and not self._with_heading
        self._both_directions = both and checker.steering.space == "reeds-shepp"
        if self._both_directions:
            self._at = machine_code(curve_pose, self._kind, self._radius, *zeros, 0.0)
            self._between = si.allocState()

    def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802 (OMPL's name)
        """Return whether the motion is free, given that its start is."""
        if self._with_heading:
            ends = a.getX(), a.getY(), a.getYaw(), b.getX(), b.getY(), b.getYaw()
            free = bool(self._free(self._kind, self._radius, *ends, *self._arrays))
            return free and (not self._both_directions or self._is_free_by_ompl(a, b, ends))
        free = bool(self._free(0, None, a[0], a[1], 0.0, b[0], b[1], 0.0, *self._arrays))
        if free and self._back:
            return bool(self._free(0, None, b[0], b[1], 0.0, a[0], a[1], 0.0, *self._arrays))
        return free

    def _is_free_by_ompl(self, a: Any, b: Any, ends: tuple[float, ...]) -> bool:
        """Return whether OMPL's curve is ambinav's, which is free, or else free in short pieces."""
        for share in SHARES:
            ours = self._at(self._kind, self._radius, *ends, share)
            if math.dist(self._ompl_pose(a, b, share)[:2], ours[:2]) > SAME * self._turning_radius:
                break
        else:
            return True
        count = math.ceil(self._space.distance(a, b) / (PIECE * self._turning_radius))
        poses = [self._ompl_pose(a, b, k / count) for k in range(1, count)]
        chain = [ends[:3], *poses, ends[3:]]
        return all(
            self._free(self._kind, self._radius, *first, *second, *self._arrays)
            for first, second in itertools.pairwise(chain)
        )

    def _ompl_pose(self, a: Any, b: Any, share: float) -> tuple[float, float, float]:
        self._space.interpolate(a, b, share, self._between)
        return self._between.getX(), self._between.getY(), self._between.getYaw()


class Unchecked(ob.MotionValidator):
    """Calls every motion free: for a roadmap whose motions are all checked afterwards."""

    def checkMotion(self, a: Any, b: Any) -> bool:  # noqa: N802 (OMPL's name)
        """Return true."""
        return True
