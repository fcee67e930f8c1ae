"""Casting of rays from anywhere: the free space, the outside, and positions that are not finite."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ambinav.casting.plane.grid import SegmentGrid
from ambinav.casting.plane.raycast import cast_rays
from ambinav.casting.plane.walk import walk_rays
from ambinav.casting.scene import Scene
from ambinav.config import as_arrays
from ambinav.runtime.array_types import Floats, Ints32


def cast_anywhere(
    scene: Scene, grid: SegmentGrid, x: ArrayLike, y: ArrayLike, angle: ArrayLike, max_range: float
) -> tuple[Floats, Ints32]:
    """Find the first segment that each ray meets; arguments are broadcast.

    Args:
        scene: The free space and its segments.
        grid: The same segments, for rays that start outside the free space.
        x: Origins, metres, map frame.
        y: Origins, metres, map frame.
        angle: Directions, radians counter-clockwise from the map's x axis.
        max_range: How far to look, metres.

    Returns:
        Distances in metres, `max_range` where nothing is met and nan for rays that are not finite;
        and indices of the segments, int32, -1 where nothing is met.
    """
    shape, parts = as_arrays(x=x, y=y, angle=angle)
    px, py, direction = (_flat(part, shape) for part in parts)
    finite = np.isfinite(px) & np.isfinite(py) & np.isfinite(direction)
    if not finite.all():
        px, py, direction = (np.where(finite, part, 0.0) for part in (px, py, direction))
    distance, segment, inside = walk_rays(scene, px, py, direction, max_range)
    outside = np.flatnonzero(~inside)
    if len(outside):
        distance[outside], segment[outside] = cast_rays(
            grid, px[outside], py[outside], direction[outside], max_range
        )
    distance[~finite] = np.nan
    segment[~finite] = -1
    return distance.reshape(shape), segment.reshape(shape)


def _flat(values: Floats, shape: tuple[int, ...]) -> Floats:
    """Broadcast values to `shape` and flatten them; copy only where necessary."""
    if values.shape != shape or not values.flags.writeable:
        return np.broadcast_to(values, shape).flatten()
    return np.ascontiguousarray(values).reshape(-1)
