"""What may steer the robots of a drive in the place of the route follower."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class Controller(Protocol):
    """Steers R robots by what they know; made for one drive, it may remember what was before."""

    def want(
        self, belief: Floats, covariance: Floats, speeds: Floats, ranges: NDArray[np.float32]
    ) -> Floats:
        """What to tell each robot now, speed (m/s) and turn rate (rad/s), shape (R, 2).

        Args:
            belief: Where the localizer believes them to be, shape (R, 3), metres and radians, map
                frame.
            covariance: How sure it is, shape (R, 3, 3); zero if it knows the truth.
            speeds: Speed and turn rate, shape (R, 2).
            ranges: Readings, shape (R, B), metres: inf no echo, -inf too near.
        """
