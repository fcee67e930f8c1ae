"""Rays and cones against arrays of segments, in plain NumPy: no code of ambinav takes part."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

# Rays times segments at a time.
AT_ONCE = 4_000_000


def cast(
    xy: Floats, x: Floats, y: Floats, angle: Floats, reach: float = math.inf
) -> tuple[Floats, Indices]:
    """Distance to the first segment along each ray, and which: inf and -1 beyond `reach`.

    Args:
        xy: Ends of the segments, shape (K, 4), metres.
        x: Where the rays start, metres; x, y and angle broadcast.
        y: Likewise.
        angle: Where they look, radians.
        reach: Metres.
    """
    x, y, angle = np.broadcast_arrays(x, y, angle)
    shape, x, y, angle = x.shape, x.ravel(), y.ravel(), angle.ravel()
    near = np.arange(len(xy))
    if math.isfinite(reach):
        # None farther off than this from the middle of all rays is met within reach.
        middle = np.array([(x.min() + x.max()) / 2, (y.min() + y.max()) / 2])
        wide = reach + math.hypot(np.ptp(x), np.ptp(y)) / 2
        near = np.flatnonzero(to_segments(xy, middle) <= wide)
    distance = np.full(x.shape, np.inf)
    index = np.full(x.shape, -1, dtype=np.int64)
    if len(near):
        ax, ay, bx, by = xy[near].T
        ex, ey = bx - ax, by - ay
        count = max(AT_ONCE // len(near), 1)
        for low in range(0, len(x), count):
            part = slice(low, low + count)
            ux, uy = np.cos(angle[part])[:, None], np.sin(angle[part])[:, None]
            wx, wy = ax - x[part, None], ay - y[part, None]
            cross = ux * ey - uy * ex
            with np.errstate(divide="ignore", invalid="ignore"):
                along = (wx * ey - wy * ex) / cross
                share = (wx * uy - wy * ux) / cross
            # A ray through an end, or where two segments meet, must not slip between them.
            met = (along >= 0.0) & (share >= -1e-9) & (share <= 1.0 + 1e-9) & (along <= reach)
            along = np.where(met, along, np.inf)
            first = along.argmin(axis=1)
            distance[part] = along[np.arange(len(first)), first]
            index[part] = np.where(np.isfinite(distance[part]), near[first], -1)
    return distance.reshape(shape), index.reshape(shape)


def cone(
    xy: Floats,
    x: Floats,
    y: Floats,
    angle: Floats,
    aperture: float,
    reach: float,
    max_incidence: float = math.inf,
) -> tuple[Floats, Indices, Floats]:
    """Nearest echo within cones about `angle`, of rays at most 2 degrees apart, edges included.

    A surface that a ray meets at more than `max_incidence` to its normal (radians) returns no
    echo but hides what is behind it.

    Returns:
        Distance, segment (inf and -1 for none) and the angle of the ray that has the echo.
    """
    half = math.ceil(math.degrees(aperture) / 4.0 - 1e-9)
    fan = np.linspace(-aperture / 2, aperture / 2, 2 * half + 1) if half else np.zeros(1)
    x, y, angle = np.broadcast_arrays(x, y, angle)
    look = angle[..., None] + fan
    distance, index = cast(xy, x[..., None], y[..., None], look, reach)
    wall = xy[index]
    along = np.arctan2(wall[..., 3] - wall[..., 1], wall[..., 2] - wall[..., 0])
    incidence = np.arccos(np.clip(np.abs(np.sin(look - along)), 0.0, 1.0))
    distance = np.where(incidence > max_incidence, np.inf, distance)
    first = distance.argmin(axis=-1)[..., None]
    nearest = np.take_along_axis(distance, first, axis=-1)[..., 0]
    which = np.take_along_axis(index, first, axis=-1)[..., 0]
    which = np.where(np.isfinite(nearest), which, -1)
    return nearest, which, np.take_along_axis(look, first, axis=-1)[..., 0]


def to_segments(xy: Floats, point: Floats) -> Floats:
    """Distance of a point (2,) to each segment, shape (K,), metres."""
    a, e = xy[:, :2] - point, xy[:, 2:] - xy[:, :2]
    share = np.clip(-(a * e).sum(axis=1) / np.maximum((e * e).sum(axis=1), 1e-18), 0.0, 1.0)
    return np.asarray(np.hypot(*(a + share[:, None] * e).T))
