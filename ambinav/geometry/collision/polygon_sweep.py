"""Collision check of a polygon that moves along a line or an arc and may turn.

A polygon that does not turn is checked exactly: what it covers is a polygon too. One that turns
is checked in stretches, each as if the polygon kept the heading of the stretch's middle, with
what the turning moves its corners by added to the distance. Stretches that this leaves open are
halved until that is half a millimetre: what is called free is free, what is called blocked comes
within `SKIN` of a wall.
"""

from __future__ import annotations

import math

from ambinav.geometry.collision.disc_sweep import place
from ambinav.geometry.collision.gaps import near_line, near_moving_polygon
from ambinav.geometry.collision.obstacles import (
    CORNER,
    CORNERS,
    OUTER,
    around,
    cells_over,
    items_of,
)
from ambinav.runtime.kernels import kernel

# A turning polygon that comes this near to a wall, in metres, may be called blocked.
SKIN = 1e-3
# What the turning may add on the first stretch that is tried, metres.
FIRST_SLACK = 0.05


@kernel
def moved_clear(px, py, qx, qy, heading, reach, table, bound):
    """Return whether the footprint moved straight from p to q keeps `reach` from every wall."""
    dx, dy = qx - px, qy - py
    length = math.sqrt(dx * dx + dy * dy)
    wide = table[OUTER] + reach
    value, away = around(px + 0.5 * dx, py + 0.5 * dy, table, bound)
    if value - away >= wide + 0.5 * length:
        return True
    ux, uy = (dx / length, dy / length) if length > 0.0 else (1.0, 0.0)
    c, s = math.cos(heading), math.sin(heading)
    mx, my = c * dx + s * dy, c * dy - s * dx
    first, count = int(table[CORNER]), int(table[CORNERS])
    r0, r1, c0, c1 = cells_over(
        min(px, qx) - wide, min(py, qy) - wide, max(px, qx) + wide, max(py, qy) + wide, table
    )
    for row in range(r0, r1 + 1):
        start, end = items_of(row, c0, c1, table)
        for j in range(start, end, 4):
            ax, ay, ex, ey = table[j], table[j + 1], table[j + 2], table[j + 3]
            if not near_line(ax, ay, ex, ey, px, py, ux, uy, length, wide):
                continue
            wx, wy = ax - px, ay - py
            if near_moving_polygon(
                c * wx + s * wy, c * wy - s * wx, c * ex + s * ey, c * ey - s * ex,
                mx, my, table, first, count, reach,
            ):  # fmt: skip
                return False
    return True


@kernel
def polygon_clear(
    px, py, ux, uy, curvature, length, heading, turn, share, touch, table, bound
):  # fmt: skip
    """Return whether the footprint meets no wall along a path; see `disc_sweep.clear_along`.

    The robot has the heading in radians at the start and turns evenly by `turn` on its motion. The
    first `share` of the path is known to be clear. `touch` metres count as touching.
    """
    # No point of the footprint is further away from where the middle heading puts it.
    twist = 0.5 * table[OUTER] * abs(turn)
    bend = 0.125 * abs(curvature) * length * length
    step = 1.0 - share
    while twist * step + bend * step * step > FIRST_SLACK:
        step *= 0.5
    x, y = place(px, py, ux, uy, curvature, share * length)
    while True:
        last = step >= 1.0 - share
        end = 1.0 if last else share + step
        part = end - share
        slack = twist * part + bend * part * part
        qx, qy = place(px, py, ux, uy, curvature, end * length)
        middle = heading + turn * 0.5 * (share + end)
        if moved_clear(x, y, qx, qy, middle, slack + touch, table, bound):
            if last:
                return True
            x, y, share = qx, qy, end
            step *= 2.0
        elif 2.0 * (slack + touch) <= SKIN:
            return False
        else:
            step = 0.5 * part
