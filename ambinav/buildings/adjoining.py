"""Union of rooms, of which some share a stretch of their edges but for rounding."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry


def union_of(rooms: Sequence[BaseGeometry], near: float, shortest: float) -> BaseGeometry:
    """Return the union of rooms, without a crack where two of them adjoin.

    Of rooms that are turned or whose coordinates are rounded, corners of one lie beside the edges
    of the other by what is rounded: the plain union would leave a wall there.

    Args:
        rooms: Valid polygons, metres.
        near: Metres. Edges that are no farther apart are one.
        shortest: Metres. Cracks of this length and less are left as they are.
    """
    parts = shapely.get_parts(list(rooms)).tolist()
    union = shapely.union_all(parts)
    closed = shapely.union_all(_snapped(parts, near))
    # Both sides of a crack count. Without one the plain union stays as it is, to the bit.
    return closed if closed.length < union.length - 2.0 * shortest else union


def _snapped(rooms: Sequence[BaseGeometry], near: float) -> list[BaseGeometry]:
    """Return rooms whose edges lead through the corners of others that lie on them."""
    snapped = list(rooms)
    pairs = shapely.STRtree(rooms).query(rooms, predicate="dwithin", distance=near)
    for k in range(len(rooms)):
        others = [snapped[j] for j in pairs[1, pairs[0] == k] if j != k]
        if others:
            corners = shapely.multipoints(
                np.concatenate(list(map(shapely.get_coordinates, others)))
            )
            room = shapely.snap(snapped[k], corners, near)
            # What is smaller than the tolerance may collapse.
            snapped[k] = room if room.is_valid and not room.is_empty else snapped[k]
    return snapped
