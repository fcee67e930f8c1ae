"""Driving as slowly as the episode's time limit permits.

Odometry errs by the metre and scans come by the second, so who drives slowly has more scans against
the same error.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.array_types import Bools, Floats
from ambinav_envs.parameters import NavigationParameters

DETOUR: Final = 1.5
"""The robot would drive this multiple of the straight line to the goal in the time left ..."""
NEAR: Final = 1.0
"""... with this many metres more, for stopping and turning;"""
SLOWEST: Final = 0.25
"""and at least this share of the highest speed, or a robot with much time would never arrive."""


class Pace:
    """Remaining time of N robots, and the speed that uses it up.

    Attributes:
        gone: Share of the episode's steps that is gone, float32, shape (N,).
    """

    def __init__(self, parameters: NavigationParameters) -> None:
        self._steps = parameters.max_steps
        # Metres at full speed in all of them.
        self._top = parameters.robot.max_speed * parameters.dt * parameters.max_steps
        self.gone = np.zeros(0, np.float32)

    def step(self, starts: Bools) -> None:
        """Count a step; call it once a step, before driving.

        Args:
            starts: Robots whose episode has just begun, bool, shape (N,).
        """
        if len(self.gone) != len(starts):
            self.gone = np.zeros(len(starts), np.float32)
        self.gone = np.minimum(self.gone + np.float32(1.0 / self._steps), np.float32(1.0))
        self.gone[starts] = 0.0

    def share(self, goal: NDArray[Any]) -> Floats:
        """Return the share of the highest speed, shape (N,).

        Args:
            goal: The part of the observation, shape (N, 3).
        """
        metres = DETOUR * (10.0 * np.nan_to_num(goal[:, 0]) + NEAR)
        share = np.maximum(1.0 - self.gone.astype(np.float64), 1e-6)
        return np.asarray(np.clip(metres / (share * self._top), SLOWEST, 1.0), dtype=np.float64)
