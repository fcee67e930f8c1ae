"""Cells of a plan that the triangles of a mesh touch between two heights."""

from __future__ import annotations

import numpy as np

from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.kernels import kernel

# Of a triangle cut at two heights five corners are left at the most; one more for the cut between.
_CORNERS = 8
# Cells count as touched within this share of a cell.
_SLACK = 1e-6


def touched(
    triangles: Floats,
    low: float,
    high: float,
    origin: tuple[float, float],
    cell: float,
    shape: tuple[int, int],
) -> Bools:
    """Find cells that a triangle touches with a part of it from `low` to `high`, from above.

    Args:
        triangles: Shape (T, 3, 3), metres.
        low: Lowest z that counts, metres.
        high: Highest z that counts.
        origin: Lower left corner of cell (0, 0), metres.
        cell: Edge of a cell, metres.
        shape: Rows and columns.

    Returns:
        bool, `shape`.
    """
    state = np.zeros(shape, dtype=np.bool_)
    inside = (triangles[:, :, 2].max(axis=1) >= low) & (triangles[:, :, 2].min(axis=1) <= high)
    scaled = triangles[inside] - (*origin, 0.0)
    scaled[..., :2] /= cell
    _mark(scaled, low, high, state)
    return state


@kernel
def _cut(points, count, height, above, kept):
    """Keep the part of a polygon above (or below) a height; return its number of corners."""
    sign = 1.0 if above else -1.0
    left = 0
    for i in range(count):
        j = (i + 1) % count
        a, b = sign * (points[i, 2] - height), sign * (points[j, 2] - height)
        if a >= 0.0:
            kept[left] = points[i]
            left += 1
        if (a < 0.0 < b) or (b < 0.0 < a):
            for axis in range(3):
                kept[left, axis] = points[i, axis] + (points[j, axis] - points[i, axis]) * (
                    a / (a - b)
                )
            left += 1
    return left


@kernel
def _mark(triangles, low, high, state):
    first, second, third = np.empty((_CORNERS, 3)), np.empty((_CORNERS, 3)), np.empty((_CORNERS, 3))
    rows, columns = state.shape
    for t in range(triangles.shape[0]):
        first[:3] = triangles[t]
        count = _cut(first, 3, low, True, second)
        count = _cut(second, count, high, False, third)
        if count == 0:
            continue
        x, y = third[:count, 0], third[:count, 1]
        bottom, top = max(int(np.floor(y.min() - _SLACK)), 0), int(np.floor(y.max() + _SLACK))
        left, right = max(int(np.floor(x.min() - _SLACK)), 0), int(np.floor(x.max() + _SLACK))
        for row in range(bottom, min(top, rows - 1) + 1):
            for column in range(left, min(right, columns - 1) + 1):
                if not state[row, column]:
                    state[row, column] = _intersects(x, y, column, row)


@kernel
def _intersects(x, y, column, row):
    """Return whether a convex polygon, which may have no area, meets a cell.

    It does if no edge separates the two.
    """
    count = x.size
    for i in range(count):
        j = (i + 1) % count
        nx, ny = y[i] - y[j], x[j] - x[i]
        size = abs(nx) + abs(ny)
        if size == 0.0:
            continue
        middle = nx * (column + 0.5) + ny * (row + 0.5)
        half = (0.5 + _SLACK) * size
        least = most = nx * x[0] + ny * y[0]
        for k in range(1, count):
            at = nx * x[k] + ny * y[k]
            least, most = min(least, at), max(most, at)
        if least > middle + half or most < middle - half:
            return False
    return True
