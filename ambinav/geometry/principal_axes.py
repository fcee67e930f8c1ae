"""Axes of symmetric 2 x 2 tensors: how far a spread reaches, and in which direction."""

from __future__ import annotations

import numpy as np

from ambinav.runtime.array_types import Floats


def principal_axes(xx: Floats, xy: Floats, yy: Floats) -> tuple[Floats, Floats, Floats]:
    """Return square roots of the eigenvalues of [[xx, xy], [xy, yy]] and the first's direction.

    Returns:
        Major and minor radius in the root of the tensor's unit, and the direction of the major
        axis in radians in [0, pi); all of the arguments' shape.
    """
    middle = (xx + yy) / 2
    half = np.hypot((xx - yy) / 2, xy)
    direction = np.mod(0.5 * np.arctan2(2 * xy, xx - yy), np.pi)
    # np.mod of a tiny negative angle rounds up to pi itself, and so does float32 later on.
    direction = np.where(direction.astype(np.float32) >= np.pi, 0.0, direction)
    return np.sqrt(middle + half), np.sqrt(np.maximum(middle - half, 0.0)), direction
