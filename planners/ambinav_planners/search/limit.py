"""A hard limit on consecutive bad metres, beside the soft cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ambinav.config import as_nonnegative, as_positive
from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.array_types import Floats
from ambinav.service.service import AmbiguityService
from ambinav_planners.search.graph import MotionGraph
from ambinav_planners.search.stretches import bad_stretches


@dataclass(frozen=True)
class BadStretchLimit:
    """Largest number of consecutive metres where the layer is above a level.

    That is what dead reckoning survives: in between, the robot must have seen something.

    Attributes:
        metres: Longest stretch, above 0.
        level: Where the layer is above it, a metre is bad; at least 0.

    Raises:
        InputError: a value that is not such a number.
    """

    metres: float
    level: float = 0.5

    def __post_init__(self) -> None:
        """Check the values."""
        metres = as_positive(self.metres, "max_bad_metres", "metres")
        object.__setattr__(self, "metres", metres)
        object.__setattr__(self, "level", as_nonnegative(self.level, "bad_level"))

    def kept_by(self, poses: Floats, service: AmbiguityService, steering: Steering) -> bool:
        """Return whether a path through poses, shape (N, 3), keeps the limit."""
        return longest_bad(poses, service, steering, self.level) <= self.metres + 1e-6


def longest_bad(
    poses: Floats, service: AmbiguityService, steering: Steering, level: float
) -> float:
    """Return the longest stretch above a level of the layer on a path (N, 3), metres."""
    motions = len(poses) - 1
    length = steering.lengths(poses[:-1], poses[1:])
    chain = MotionGraph(
        poses=poses,
        first=np.minimum(np.arange(motions + 2), motions).astype(np.int64),
        target=np.arange(1, motions + 1, dtype=np.int32),
        length=length.astype(np.float32),
        fixed=length.astype(np.float32),
        exposure=np.zeros(motions, dtype=np.float32),
        steering=steering,
    )
    bad = bad_stretches(chain, service.ambiguity, level)
    longest = running = 0.0
    for k in range(motions):
        if bad.all_bad[k]:
            running += length[k]
            longest = max(longest, running)
        else:
            longest = max(longest, running + bad.head[k], bad.longest[k])
            running = float(bad.tail[k])
    return float(longest)
