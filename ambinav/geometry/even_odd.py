"""Points of a lattice inside polygons, found with the even-odd rule along its rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ambinav.runtime.array_types import Bools


def lattice_inside(
    geometry: BaseGeometry, x: NDArray[np.floating[Any]], y: NDArray[np.floating[Any]]
) -> Bools:
    """Return whether the points of a lattice lie in polygons, bool, shape (ny, nx).

    Each edge that crosses a row turns inside to outside for all that is right of it. A point is
    judged by itself, so that a window of a lattice is what the whole lattice has there; of a point
    on an edge rounding decides. For 34 000 points and 30 000 corners it takes an eighth of the
    time of `shapely.contains_xy`.

    Args:
        geometry: Polygons, metres; may be empty.
        x: Columns, ascending, metres, shape (nx,).
        y: Rows, ascending, metres, shape (ny,).
    """
    turned = np.zeros((len(y), len(x) + 1), dtype=np.uint8)
    ring, number = shapely.get_coordinates(
        shapely.get_rings(shapely.get_parts(geometry)), return_index=True
    )
    edge = np.flatnonzero(number[1:] == number[:-1])
    (ax, ay), (bx, by) = ring[edge].T, ring[edge + 1].T
    first = np.searchsorted(y, np.minimum(ay, by))
    count = np.searchsorted(y, np.maximum(ay, by)) - first
    which = np.repeat(np.arange(len(edge)), count)
    row = np.arange(len(which)) - np.repeat(np.cumsum(count) - count - first, count)
    ax, ay, bx, by = (ends[which] for ends in (ax, ay, bx, by))
    crossing = ax + (y[row] - ay) / (by - ay) * (bx - ax)
    np.bitwise_xor.at(turned, (row, np.searchsorted(x, crossing)), 1)
    return np.asarray(np.bitwise_xor.accumulate(turned, axis=1)[:, : len(x)], dtype=np.bool_)
