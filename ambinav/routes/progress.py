"""Progress of a robot along its route."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

# Points of curves, and of straight motions, are this near to each other, metres.
SPACING = 0.05


@dataclass(frozen=True)
class Progress:
    """Place of a robot on its route.

    Attributes:
        along: Metres travelled along the route, at the point of it nearest to the robot.
        remaining: Metres from there to the goal.
        aside: Distance of the robot from that point, metres.
        motion: Index of the motion that the point lies on.
    """

    along: float
    remaining: float
    aside: float
    motion: int


def progress_along(poses: Floats, steering: Steering, x: float, y: float, after: float) -> Progress:
    """Return where on a route of poses, (N, 3), a robot is; see `Route.progress`."""
    if not np.isfinite([x, y, after]).all():
        raise InputError(f"x, y, after are {x!r}, {y!r}, {after!r}; give finite metres.")
    dense, motion, along = steering.dense(poses, SPACING)
    begin, step, length = dense[:-1, :2], np.diff(dense[:, :2], axis=0), np.diff(along)
    share = ((np.array([x, y]) - begin) * step).sum(axis=1) / np.maximum(length**2, 1e-300)
    # What lies before `after` is behind the robot; the end of the route never is.
    first = (min(after, along[-1]) - along[:-1]) / np.maximum(length, 1e-300)
    share = np.clip(share, np.clip(first, 0.0, 1.0), 1.0)
    aside = np.hypot(*(begin + share[:, np.newaxis] * step - (x, y)).T)
    aside[along[1:] < min(after, along[-1])] = np.inf
    k = int(aside.argmin())
    travelled = float(along[k] + share[k] * length[k])
    return Progress(travelled, float(along[-1]) - travelled, float(aside[k]), int(motion[k + 1]))
