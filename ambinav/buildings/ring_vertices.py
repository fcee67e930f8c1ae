"""Vertices between the edges of a simplified ring: corners, wall joints, ends of thin walls."""

from __future__ import annotations

import math

import numpy as np

from ambinav.buildings.edge_fit import BOW_POINTS, extreme, fit_line
from ambinav.geometry.segments import WALL
from ambinav.runtime.kernels import kernel

# Cosine between edges that run out and back: the two sides of a thin wall, or of a slot.
BACK = -0.5
# A corner this much sharper than a right angle moves no further than this from its point.
_SHARP_REACH = 1.5
# Points this near to the end of a thin wall, in points, lie on its end and not on its sides.
_CAP = 0.75
# Sides of a thin wall that come nearer to each other than this meet in a point.
_THINNEST = 0.25


@kernel(error_model="python")
def meet(x, y, kind, vertex, tolerance):
    """Compute indices and positions of the vertices, where the lines of two edges meet.

    Args:
        x: Coordinates of the points of a ring, its first point repeated at its end.
        y: Likewise.
        kind: Class of each point.
        vertex: Indices of the chosen points, the first and the last point among them.
        tolerance: Largest distance of a point from its edge; 0 leaves the points as they are.

    Returns:
        Indices, shape (m,), ascending, without the last point's, and places, shape (m, 2). At
        the end of a thin wall there are two for one chosen point.
    """
    m = len(vertex) - 1
    line = np.empty((m, 5))
    for j in range(m):
        fit = line[j]
        fit[0], fit[1], fit[2], fit[3], fit[4] = fit_line(x, y, vertex[j], vertex[j + 1])
    index = np.empty(2 * m, dtype=np.int64)
    place = np.empty((2 * m, 2))
    count = 0
    for j in range(m):
        i = j - 1 if j > 0 else m - 1
        v, before, after = vertex[j], line[i], line[j]
        index[count] = v
        last_place = place[count]
        last_place[0], last_place[1] = x[v], y[v]
        count += 1
        if tolerance <= 0.0:
            continue
        back = before[2] * after[2] + before[3] * after[3] < BACK
        reach = _SHARP_REACH if back else 2.0 * tolerance + 1.0
        crossed, px, py = _cross(before, after, x[v], y[v], reach)
        if crossed:
            last_place[0], last_place[1] = px, py
        elif not back:
            last_place[0], last_place[1] = _between(
                before, after, kind[vertex[i]], kind[v], x[v], y[v]
            )
        elif j > 0:
            a, b = vertex[j - 1], vertex[j + 1]
            first, last, px, py, qx, qy = _end(x, y, before, after, a, v, b)
            long = min(v - a, b - v) >= BOW_POINTS
            if long and first < last and kind[a] == WALL and kind[v] == WALL:
                index[count - 1], index[count] = first, last
                last_place[0], last_place[1] = px, py
                place[count, 0], place[count, 1] = qx, qy
                count += 1
            else:
                last_place[0], last_place[1] = 0.5 * (px + qx), 0.5 * (py + qy)
    return index[:count], place[:count]


@kernel(error_model="python")
def _cross(first, second, x, y, reach):
    """Return whether two lines cross within `reach` of (x, y) at a clear angle, and where."""
    sine = first[2] * second[3] - first[3] * second[2]
    if abs(sine) <= 0.1:
        return False, x, y
    wx, wy = second[0] - first[0], second[1] - first[1]
    t = (wx * second[3] - wy * second[2]) / sine
    px, py = first[0] + t * first[2], first[1] + t * first[3]
    return math.hypot(px - x, py - y) <= reach, px, py


@kernel(error_model="python")
def _between(first, second, kind0, kind1, x, y):
    """Return the point where nearly parallel lines join beside (x, y).

    Between the feet on both, nearer to the one that more points support; a wall's line counts,
    a frontier's hardly does.
    """
    w0, w1 = first[4], second[4]
    if kind0 != kind1:
        w0 *= 1e-3 if kind0 != WALL else 1.0
        w1 *= 1e-3 if kind1 != WALL else 1.0
    t0 = (x - first[0]) * first[2] + (y - first[1]) * first[3]
    t1 = (x - second[0]) * second[2] + (y - second[1]) * second[3]
    return (
        (w0 * (first[0] + t0 * first[2]) + w1 * (second[0] + t1 * second[2])) / (w0 + w1),
        (w0 * (first[1] + t0 * first[3]) + w1 * (second[1] + t1 * second[3])) / (w0 + w1),
    )


@kernel(error_model="python")
def _end(x, y, side0, side1, a, v, b):
    """Return the end of a thin wall or slot with sides `side0` (points a..v) and `side1` (v..b).

    Returns:
        Indices of the first and the last point of the end, equal where the sides come together
        before it, and the places (x, y) at which the one and the other side end.
    """
    dx, dy = side0[2] - side1[2], side0[3] - side1[3]
    size = math.hypot(dx, dy)
    dx, dy = dx / size, dy / size
    # Short of the middle of the edge before: its other half may belong to another wall's end.
    low, high = v - (v - a - 1) // 2, v + (b - v) // 2
    tip = extreme(x, y, low, high, dx, dy)
    end = x[tip] * dx + y[tip] * dy
    first, last = v, v
    while first > low and x[first - 1] * dx + y[first - 1] * dy >= end - _CAP:
        first -= 1
    while last < high and x[last + 1] * dx + y[last + 1] * dy >= end - _CAP:
        last += 1
    t0 = (end - side0[0] * dx - side0[1] * dy) / (side0[2] * dx + side0[3] * dy)
    t1 = (end - side1[0] * dx - side1[1] * dy) / (side1[2] * dx + side1[3] * dy)
    px, py = side0[0] + t0 * side0[2], side0[1] + t0 * side0[3]
    qx, qy = side1[0] + t1 * side1[2], side1[1] + t1 * side1[3]
    # To which side the ring turns at the end, by the points and by the lines.
    points = dx * (y[last] - y[first]) - dy * (x[last] - x[first])
    lines = dx * (qy - py) - dy * (qx - px)
    if points * lines <= 0.0 or abs(lines) < _THINNEST:
        first = last = v
    return first, last, px, py, qx, qy
