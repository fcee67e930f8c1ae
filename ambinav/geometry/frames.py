"""Composition of planar poses, as arrays of shape (..., 3): x, y, theta."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ambinav.runtime.array_types import Floats


def compose(first: ArrayLike, second: ArrayLike) -> Floats:
    """Return the pose that is `second` as seen from `first`; arrays broadcast.

    The heading is the plain sum of the two, so that a turn beyond pi stays what it is.
    """
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    return np.stack(
        [
            a[..., 0] + c * b[..., 0] - s * b[..., 1],
            a[..., 1] + s * b[..., 0] + c * b[..., 1],
            a[..., 2] + b[..., 2],
        ],
        axis=-1,
    )


def between(first: ArrayLike, second: ArrayLike) -> Floats:
    """Return `second` as seen from `first`, heading in [-pi, pi); arrays broadcast."""
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    c, s = np.cos(a[..., 2]), np.sin(a[..., 2])
    dx, dy = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    return np.stack([c * dx + s * dy, c * dy - s * dx, wrap_angles(b[..., 2] - a[..., 2])], axis=-1)


def inverse(pose: ArrayLike) -> Floats:
    """Return the origin as seen from `pose`."""
    p = np.asarray(pose, dtype=np.float64)
    c, s = np.cos(p[..., 2]), np.sin(p[..., 2])
    x, y = p[..., 0], p[..., 1]
    return np.stack([-c * x - s * y, s * x - c * y, -p[..., 2]], axis=-1)


def wrap_angles(angle: ArrayLike) -> Floats:
    """Return the same angles in [-pi, pi)."""
    return (np.asarray(angle, dtype=np.float64) + math.pi) % (2.0 * math.pi) - math.pi
