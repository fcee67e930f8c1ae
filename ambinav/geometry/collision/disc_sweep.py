"""Exact distance that a disc travels along a line or an arc before it meets a wall.

Where the lattice of clearances tells that nothing is near, the disc moves on by what room it has
(sphere tracing, Hart 1996). Where it does not, the next stretch is held against every wall.
"""

from __future__ import annotations

import math

from ambinav.geometry.collision.gaps import near_arc, near_line
from ambinav.geometry.collision.obstacles import around, cells_over, items_of
from ambinav.runtime.kernels import kernel

# With less room than this in metres a stretch is checked exactly, which costs as much as some
# steps; and how long that stretch is, metres: about one cell of the segment grid.
LEAST_STEP = 0.08
STRETCH = 0.5


@kernel(inline="always")
def place(px, py, ux, uy, curvature, distance):
    """Return the point at a distance along a path from p in the direction u, curving left."""
    if curvature == 0.0:
        return px + distance * ux, py + distance * uy
    turn = 0.5 * distance * curvature
    s, c = math.sin(turn), math.cos(turn)
    chord = 2.0 * s / curvature
    return px + chord * (ux * c - uy * s), py + chord * (uy * c + ux * s)


@kernel
def _line_clear(px, py, ux, uy, length, reach, table):
    """Return whether no wall comes nearer than `reach` to a straight stretch."""
    qx, qy = px + length * ux, py + length * uy
    r0, r1, c0, c1 = cells_over(
        min(px, qx) - reach, min(py, qy) - reach, max(px, qx) + reach, max(py, qy) + reach, table
    )
    for row in range(r0, r1 + 1):
        start, end = items_of(row, c0, c1, table)
        for j in range(start, end, 4):
            if near_line(
                table[j], table[j + 1], table[j + 2], table[j + 3], px, py, ux, uy, length, reach
            ):
                return False
    return True


@kernel
def _arc_clear(px, py, mx, my, qx, qy, cx, cy, half, reach, table):
    """Return the same as `_line_clear` for an arc around c from p over its middle m to q.

    The arc spans twice the angle `half`.
    """
    radius = math.hypot(mx - cx, my - cy)
    cosine = math.cos(half)
    wide = reach + radius * (1.0 - cosine)
    r0, r1, c0, c1 = cells_over(
        min(px, qx) - wide, min(py, qy) - wide, max(px, qx) + wide, max(py, qy) + wide, table
    )
    nx, ny = (mx - cx) / radius, (my - cy) / radius
    for row in range(r0, r1 + 1):
        start, end = items_of(row, c0, c1, table)
        for j in range(start, end, 4):
            if near_arc(
                table[j], table[j + 1], table[j + 2], table[j + 3], cx, cy, radius,
                nx, ny, cosine, px, py, qx, qy, reach,
            ):  # fmt: skip
                return False
    return True


@kernel
def clear_along(px, py, ux, uy, curvature, length, reach, table, bound):
    """Return whether no wall comes nearer than `reach` to a path, and the clear length.

    The path starts at p in the direction of travel u, a unit vector, and goes on for `length`
    metres (0 is allowed) with a curvature in 1/m, positive to the left. `table` and `bound` are
    as `obstacles.pack` gives them, `reach` is above 0.

    Returns:
        True and the length; or False and the metres from the start that are clear.
    """
    stretch = STRETCH
    cx, cy = 0.0, 0.0
    if curvature != 0.0:
        cx, cy = px - uy / curvature, py + ux / curvature
        stretch = min(STRETCH, 1.0 / abs(curvature))
    x, y, s = px, py, 0.0
    while True:
        value, away = around(x, y, table, bound)
        room = value - away - reach
        if room >= length - s:
            return True, length
        if room >= LEAST_STEP:
            s += room
            x, y = place(px, py, ux, uy, curvature, s)
            continue
        if value == -math.inf:
            return False, s
        end = min(s + stretch, length)
        qx, qy = place(px, py, ux, uy, curvature, end)
        if curvature == 0.0:
            clear = _line_clear(x, y, ux, uy, end - s, reach, table)
        else:
            mx, my = place(px, py, ux, uy, curvature, 0.5 * (s + end))
            half = 0.5 * (end - s) * abs(curvature)
            clear = _arc_clear(x, y, mx, my, qx, qy, cx, cy, half, reach, table)
        if not clear:
            return False, s
        if end == length:
            return True, length
        x, y, s = qx, qy, end
