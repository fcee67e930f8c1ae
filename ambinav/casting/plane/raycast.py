"""Clearances, and rays from anywhere, with the segment grid.

Rays that start in the free space go through `ambinav.casting.plane.walk`, which is faster.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.casting.plane.grid import SegmentGrid
from ambinav.runtime.array_types import Floats, Ints32
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

# Tolerance on the position along a segment, relative to its length: two segments that share an
# end leave no gap between them.
END = 1e-9


def cast_rays(
    grid: SegmentGrid, x: Floats, y: Floats, angle: Floats, max_range: float
) -> tuple[Floats, Ints32]:
    """Find the first segment that each ray meets.

    Args:
        grid: The segments.
        x: Origins, shape (N,), metres, map frame.
        y: Origins, shape (N,), metres, map frame.
        angle: Directions, shape (N,), radians counter-clockwise from the map's x axis.
        max_range: How far to look, metres.

    Returns:
        Distance, shape (N,), metres, `max_range` where nothing is met; and the index of the
        segment, int32, shape (N,), -1 where nothing is met.
    """
    distance = np.empty(len(x))
    segment = np.empty(len(x), dtype=np.int32)
    run_rows(
        _cast, len(x), x, y, np.cos(angle), np.sin(angle), float(max_range), *grid.arrays,
        distance, segment, least=512,
    )  # fmt: skip
    return distance, segment


def clearances(grid: SegmentGrid, x: Floats, y: Floats, limit: float) -> Floats:
    """Compute each point's distance, shape (N,), to a segment, at most `limit` metres.

    It is nan where the point is not finite.
    """
    distance = np.empty(len(x))
    # One layout: columns of an array of points would be compiled for anew.
    x, y = np.ascontiguousarray(x), np.ascontiguousarray(y)
    run_rows(_clearances, len(x), x, y, float(limit), *grid.arrays, distance, least=128)
    return distance


@kernel(forceinline=True)
def cast_inside(px, py, ux, uy, reach, x0, y0, inverse, rows, columns, start, line):
    """Walk the cells along a ray that starts in the grid (Amanatides and Woo 1987).

    Returns the distance and the item that was hit, -1 for none.
    """
    gx, gy = (px - x0) * inverse, (py - y0) * inverse
    column, row = int(gx), int(gy)
    step_x, step_y = 1.0 / inverse / max(abs(ux), 1e-12), 1.0 / inverse / max(abs(uy), 1e-12)
    right, up = ux > 0, uy > 0
    to_x = (column + 1 - gx if right else gx - column) * step_x
    to_y = (row + 1 - gy if up else gy - row) * step_y
    # The grid's margin holds no segment: the walk ends before it leaves the last cell.
    end_x = to_x + (columns - 1 - column if right else column) * step_x
    end_y = to_y + (rows - 1 - row if up else row) * step_y
    best = min(reach, min(end_x, end_y) * (1.0 - 1e-9))
    k = row * columns + column
    along, across = (1 if right else -1), (columns if up else -columns)
    hit = -1
    while True:
        for j in range(start[k], start[k + 1]):
            wx, wy = line[j, 0] - px, line[j, 1] - py
            ex, ey = line[j, 2], line[j, 3]
            per_cross = 1.0 / (ux * ey - uy * ex)
            t = (wx * ey - wy * ex) * per_cross
            s = (wx * uy - wy * ux) * per_cross
            if (s >= -END) & (s <= 1.0 + END) & (t >= 0.0) & (t < best):
                best = t
                hit = j
        sideways = to_x < to_y
        if min(to_x, to_y) >= best:
            break
        k += along if sideways else across
        to_x += step_x if sideways else 0.0
        to_y += 0.0 if sideways else step_y
    return (best if hit >= 0 else reach), hit


@kernel
def cast_from_outside(px, py, ux, uy, reach, x0, y0, inverse, rows, columns, start, line):
    """Cast a ray that starts outside of the grid; see `cast_inside`."""
    width, height = columns / inverse, rows / inverse
    ahead_x = x0 - px if ux > 0 else px - x0 - width
    ahead_y = y0 - py if uy > 0 else py - y0 - height
    enter = max(ahead_x / max(abs(ux), 1e-12), ahead_y / max(abs(uy), 1e-12), 0.0)
    # A step into the margin, which holds nothing, so that rounding does not leave it outside.
    enter += 1e-3 / inverse
    x, y = px + ux * enter, py + uy * enter
    if enter >= reach or not (x0 <= x < x0 + width and y0 <= y < y0 + height):
        return reach, -1
    t, hit = cast_inside(x, y, ux, uy, reach - enter, x0, y0, inverse, rows, columns, start, line)
    return (t + enter if hit >= 0 else reach), hit


@kernel(inline="always")
def cast_one(px, py, ux, uy, reach, x0, y0, cell, rows, columns, start, line):
    """Return the distance to the first segment along a ray, and its item; `reach`, -1 for none."""
    inverse = 1.0 / cell
    gx, gy = (px - x0) * inverse, (py - y0) * inverse
    if (gx >= 0.0) & (gy >= 0.0) & (gx < columns) & (gy < rows):
        return cast_inside(px, py, ux, uy, reach, x0, y0, inverse, rows, columns, start, line)
    return cast_from_outside(px, py, ux, uy, reach, x0, y0, inverse, rows, columns, start, line)


@kernel
def _cast(
    low, high, x, y, ux, uy, reach, x0, y0, cell, rows, columns, start, item, line, distance,
    segment,
):  # fmt: skip
    for i in range(low, high):
        t, j = cast_one(x[i], y[i], ux[i], uy[i], reach, x0, y0, cell, rows, columns, start, line)
        distance[i] = t
        segment[i] = item[j] if j >= 0 else -1


@kernel
def _clearances(low, high, x, y, limit, x0, y0, cell, rows, columns, start, item, line, distance):
    """Search rings of cells outwards until no nearer segment is possible."""
    for i in range(low, high):
        if not (math.isfinite(x[i]) and math.isfinite(y[i])):
            distance[i] = np.nan
            continue
        column = min(max(int(math.floor((x[i] - x0) / cell)), 0), columns - 1)
        row = min(max(int(math.floor((y[i] - y0) / cell)), 0), rows - 1)
        best = limit * limit
        # From a point outside the grid the distance to a ring is the hypotenuse, not the sum.
        outside_x = max(x0 - x[i], x[i] - x0 - columns * cell, 0.0)
        outside_y = max(y0 - y[i], y[i] - y0 - rows * cell, 0.0)
        outside = outside_x * outside_x + outside_y * outside_y
        ring = 0
        while ring <= max(rows, columns) and max((ring - 1) * cell, 0.0) ** 2 + outside <= best:
            for r in range(max(row - ring, 0), min(row + ring, rows - 1) + 1):
                edge = abs(r - row) == ring
                stride = 1 if edge or ring == 0 else 2 * ring
                for c in range(column - ring, column + ring + 1, stride):
                    if c < 0 or c >= columns:
                        continue
                    for j in range(start[r * columns + c], start[r * columns + c + 1]):
                        best = min(best, squared_distance(x[i], y[i], line, j))
            ring += 1
        distance[i] = math.sqrt(best)


@kernel(inline="always")
def squared_distance(px, py, line, j):
    """Return the squared distance from a point to line j of `SegmentGrid.line`, square metres."""
    wx, wy = px - line[j, 0], py - line[j, 1]
    ex, ey = line[j, 2], line[j, 3]
    s = min(max((wx * ex + wy * ey) / (ex * ex + ey * ey), 0.0), 1.0)
    dx, dy = wx - s * ex, wy - s * ey
    return dx * dx + dy * dy
