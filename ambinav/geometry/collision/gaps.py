"""Distance tests between a wall and a line, an arc, or a moving polygon.

A wall is a point (ax, ay) and the vector (ex, ey) to its other end.
"""

from __future__ import annotations

import math

from ambinav.runtime.kernels import kernel


@kernel(inline="always")
def point_gap2(px, py, ax, ay, ex, ey):
    """Return the squared distance from a point to a wall, which may have length 0."""
    wx, wy = px - ax, py - ay
    s = min(max((wx * ex + wy * ey) / max(ex * ex + ey * ey, 1e-300), 0.0), 1.0)
    dx, dy = wx - s * ex, wy - s * ey
    return dx * dx + dy * dy


@kernel(forceinline=True)
def near_line(ax, ay, ex, ey, px, py, ux, uy, length, reach):
    """Return whether a wall comes nearer than `reach` to the line from p along the unit vector u.

    In the line's own frame most walls are off to one side, which four comparisons tell.
    """
    wx, wy = ax - px, ay - py
    along, across = wx * ux + wy * uy, ux * wy - uy * wx
    end_along, end_across = along + ex * ux + ey * uy, across + ux * ey - uy * ex
    if (min(across, end_across) >= reach) | (max(across, end_across) <= -reach):
        return False
    if (min(along, end_along) >= length + reach) | (max(along, end_along) <= -reach):
        return False
    # The distance of two lines that do not cross is that of one of the four end points.
    limit = reach * reach
    beyond = along - min(max(along, 0.0), length)
    if beyond * beyond + across * across < limit:
        return True
    beyond = end_along - min(max(end_along, 0.0), length)
    if beyond * beyond + end_across * end_across < limit:
        return True
    dx, dy = end_along - along, end_across - across
    if point_gap2(0.0, 0.0, along, across, dx, dy) < limit:
        return True
    if point_gap2(length, 0.0, along, across, dx, dy) < limit:
        return True
    if (across > 0.0) == (end_across > 0.0):
        return False
    crossing = along - across * dx / dy
    return (crossing >= 0.0) & (crossing <= length)


@kernel(inline="always")
def _in_span(x, y, mx, my, cosine):
    """Return whether the angle between (x, y) and the unit vector m has at least this cosine."""
    return x * mx + y * my >= cosine * math.sqrt(x * x + y * y)


@kernel(forceinline=True)
def near_arc(ax, ay, ex, ey, cx, cy, radius, mx, my, cosine, px, py, qx, qy, reach):
    """Return whether a wall comes nearer than `reach` to the arc from p to q.

    The arc lies around the centre c at `radius`, within the angle of this cosine of the
    direction m to its middle. The distance between the two is least at an end of either, where
    they cross, or where a perpendicular of the wall goes through the centre.
    """
    limit = reach * reach
    x, y = ax - cx, ay - cy
    d2 = ex * ex + ey * ey
    s = -(x * ex + y * ey) / d2
    fx, fy = x + s * ex, y + s * ey
    foot2 = fx * fx + fy * fy
    if foot2 >= (radius + reach) * (radius + reach):
        return False
    if point_gap2(px, py, ax, ay, ex, ey) < limit or point_gap2(qx, qy, ax, ay, ex, ey) < limit:
        return True
    if abs(math.sqrt(x * x + y * y) - radius) < reach and _in_span(x, y, mx, my, cosine):
        return True
    bx, by = x + ex, y + ey
    if abs(math.sqrt(bx * bx + by * by) - radius) < reach and _in_span(bx, by, mx, my, cosine):
        return True
    if (
        (s > 0.0)
        & (s < 1.0)
        & (abs(math.sqrt(foot2) - radius) < reach)
        & _in_span(fx, fy, mx, my, cosine)
    ):
        return True
    if foot2 > radius * radius:
        return False
    half = math.sqrt((radius * radius - foot2) / d2)
    for side in (-half, half):
        t = s + side
        if (t >= 0.0) & (t <= 1.0) & _in_span(x + t * ex, y + t * ey, mx, my, cosine):
            return True
    return False


@kernel(forceinline=True)
def _near_lines(ax, ay, ex, ey, bx, by, fx, fy, limit):
    """Return whether two walls, which may have length 0, come nearer than the root of `limit`."""
    wx, wy = bx - ax, by - ay
    cross = ex * fy - ey * fx
    # Divided by `cross`, these would be the positions of the crossing on the two walls.
    s, t = wx * fy - wy * fx, wx * ey - wy * ex
    if cross < 0.0:
        cross, s, t = -cross, -s, -t
    if (cross > 0.0) & (s >= 0.0) & (s <= cross) & (t >= 0.0) & (t <= cross):
        return True
    return (
        (point_gap2(ax, ay, bx, by, fx, fy) < limit)
        | (point_gap2(ax + ex, ay + ey, bx, by, fx, fy) < limit)
        | (point_gap2(bx, by, ax, ay, ex, ey) < limit)
        | (point_gap2(bx + fx, by + fy, ax, ay, ex, ey) < limit)
    )


@kernel
def near_moving_polygon(ax, ay, ex, ey, mx, my, table, first, count, reach):
    """Return whether a polygon that moves by the vector m comes nearer than `reach` to a wall.

    The polygon does not turn.

    Seen from the polygon, the wall moves by -m and covers a parallelogram. Two shapes that do
    not overlap are as far apart as their nearest edges; shapes whose edges stay apart overlap
    only if one holds a point of the other.

    The wall and the vector are given in the polygon's frame where it starts; x and y of its
    `count` corners stand in turn in the table from `first` on.
    """
    limit = reach * reach
    moves = (mx != 0.0) | (my != 0.0)
    inside = False
    last = first + 2 * (count - 1)
    px, py = table[last], table[last + 1]
    for j in range(first, last + 2, 2):
        qx, qy = table[j], table[j + 1]
        fx, fy = qx - px, qy - py
        if _near_lines(ax, ay, ex, ey, px, py, fx, fy, limit):
            return True
        if moves and (
            _near_lines(ax - mx, ay - my, ex, ey, px, py, fx, fy, limit)
            or _near_lines(ax, ay, -mx, -my, px, py, fx, fy, limit)
            or _near_lines(ax + ex, ay + ey, -mx, -my, px, py, fx, fy, limit)
        ):
            return True
        # The rule of odd crossings of the ray from the wall's start to the right.
        if (py > ay) != (qy > ay) and ax < px + (ay - py) * fx / fy:
            inside = not inside
        px, py = qx, qy
    if inside:
        return True
    # The last corner, as shares of the two sides of the parallelogram.
    area = ex * -my + ey * mx
    if area == 0.0:
        return False
    x, y = px - ax, py - ay
    u, v = (x * -my + y * mx) / area, (ex * y - ey * x) / area
    return (u >= 0.0) & (u <= 1.0) & (v >= 0.0) & (v <= 1.0)
