"""Edges of a simplified ring: the line through their points, and the points' distances to it.

All lengths are in the units of the points (cells, where the points come from a grid).
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.runtime.kernels import kernel

# An edge shorter than this many points is drawn from end to end, not fitted.
FIT_POINTS = 5
# Points beside a corner lie on its chamfer; they do not enter a fit that has enough others.
_TRIM = 2
# An edge of fewer points is never split for being bowed.
BOW_POINTS = 10


@kernel(error_model="python")
def furthest(x, y, a, b):
    """Find the index strictly between a and b furthest from the chord a-b, and its distance."""
    ax, ay = x[a], y[a]
    dx, dy = x[b] - ax, y[b] - ay
    length = math.hypot(dx, dy)
    best, index = -1.0, -1
    for i in range(a + 1, b):
        if length > 1e-9:
            along = ((x[i] - ax) * dx + (y[i] - ay) * dy) / length
            along = min(max(along, 0.0), length) / length
        else:
            along = 0.0
        away = math.hypot(x[i] - ax - along * dx, y[i] - ay - along * dy)
        if away > best:
            best, index = away, i
    return index, best


@kernel(error_model="python")
def fit_line(x, y, a, b):
    """Fit a line through the points a..b: mean, direction from a to b, and number of points."""
    count = b - a + 1
    if count < FIT_POINTS:
        length = max(math.hypot(x[b] - x[a], y[b] - y[a]), 1e-12)
        dx, dy = (x[b] - x[a]) / length, (y[b] - y[a]) / length
        return 0.5 * (x[a] + x[b]), 0.5 * (y[a] + y[b]), dx, dy, count
    if count >= FIT_POINTS + 2 * _TRIM:
        a, b = a + _TRIM, b - _TRIM
        count = b - a + 1
    mx, my = x[a : b + 1].mean(), y[a : b + 1].mean()
    xx = yy = xy = 0.0
    for i in range(a, b + 1):
        u, v = x[i] - mx, y[i] - my
        xx += u * u
        yy += v * v
        xy += u * v
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    dx, dy = math.cos(angle), math.sin(angle)
    if dx * (x[b] - x[a]) + dy * (y[b] - y[a]) < 0.0:
        dx, dy = -dx, -dy
    return mx, my, dx, dy, count


@kernel(error_model="python")
def spread(x, y, a, b):
    """Return the largest distance of points a..b from their edge, and the sagitta of a bow.

    The edge is the piece of their line between a and b: what lies beyond its ends is as far as
    it is from the end. Otherwise the end of a thin wall, to which the ring runs out and back
    along one line, would be no distance away from the wall's foot.

    Bowed: a parabola explains more than half of the variance about the line. Roughness does not.
    """
    mx, my, dx, dy, _ = fit_line(x, y, a, b)
    count = b - a + 1
    ta = (x[a] - mx) * dx + (y[a] - my) * dy
    tb = (x[b] - mx) * dx + (y[b] - my) * dy
    first, last = min(ta, tb), max(ta, tb)
    low, high, most = np.inf, -np.inf, 0.0
    for i in range(a, b + 1):
        t = (x[i] - mx) * dx + (y[i] - my) * dy
        low, high = min(low, t), max(high, t)
        beyond = max(first - t, t - last, 0.0)
        most = max(most, math.hypot(beyond, (y[i] - my) * dx - (x[i] - mx) * dy))
    half = 0.5 * (high - low)
    if count < BOW_POINTS or half < 1e-9:
        return most, 0.0
    # Residual against the second Legendre polynomial of the place along the edge.
    total = projection = norm = 0.0
    for i in range(a, b + 1):
        t = ((x[i] - mx) * dx + (y[i] - my) * dy - low) / half - 1.0
        away = (y[i] - my) * dx - (x[i] - mx) * dy
        p = 1.5 * t * t - 0.5
        total += away * away
        projection += away * p
        norm += p * p
    if projection * projection <= 0.5 * total * norm:
        return most, 0.0
    return most, 1.5 * abs(projection) / norm


@kernel(error_model="python")
def extreme(x, y, a, b, dx, dy):
    """Return the index of the point among a..b that lies furthest along (dx, dy)."""
    best, index = -np.inf, a
    for i in range(a, b + 1):
        along = x[i] * dx + y[i] * dy
        if along > best + 1e-9:
            best, index = along, i
    return index


@kernel(error_model="python")
def strays(x, y, kind, index, place, limit):
    """Find stretches of a contour that lie too far from its simplified edges.

    What counts is the cell beyond each point: its centre lies half a cell to the right of the
    contour, which has the free cells on its left.

    Args:
        x: Coordinates of the points, shape (n,), cells; not closed by repetition.
        y: Likewise.
        kind: shape (n,), class of each point; an edge has one class.
        index: Ascending indices of the points at which the edges begin, shape (m,).
        place: Where the edges begin, shape (m, 2).
        limit: For each class, the largest distance of a cell's centre from its own edge, or from
            one of the two beside it.

    Returns:
        int64, shape (K, 4), at most one row an edge: the edge, the last point before and the
        first point after whose cells lie within half the limit, and between them the point of
        the furthest cell. The points count on past n where the edge does.
    """
    n, m = len(x), len(index)
    stretches = np.empty((m, 4), dtype=np.int64)
    count = 0
    for j in range(m):
        a, b = index[j], index[(j + 1) % m]
        if b <= a:
            b += n
        bound = limit[kind[a]]
        most, far = bound, -1
        for i in range(a, b):
            cell_x, cell_y = _cell_beyond(x, y, i % n)
            away = np.inf
            for edge in (j, j - 1 if j > 0 else m - 1, (j + 1) % m):
                away = min(away, _apart(cell_x, cell_y, place[edge], place[(edge + 1) % m]))
                if away <= most:
                    break
            if away > most:
                most, far = away, i
        if far < 0:
            continue
        start, end = place[j], place[(j + 1) % m]
        before, after = far - 1, far + 1
        while before > a and _apart(*_cell_beyond(x, y, before % n), start, end) > 0.5 * bound:
            before -= 1
        while after < b and _apart(*_cell_beyond(x, y, after % n), start, end) > 0.5 * bound:
            after += 1
        row = stretches[count]
        row[0], row[1], row[2], row[3] = j, before, after, far
        count += 1
    return stretches[:count]


@kernel(error_model="python")
def _cell_beyond(x, y, i):
    """Return the centre of the cell on the far side of point i, the middle of a cell's side."""
    n = len(x)
    dx, dy = x[(i + 1) % n] - x[i - 1], y[(i + 1) % n] - y[i - 1]
    if x[i] == np.floor(x[i]):
        return x[i] + 0.5 * np.sign(dy), y[i]
    return x[i], y[i] - 0.5 * np.sign(dx)


@kernel(error_model="python")
def _apart(x, y, start, end):
    """Return the distance of (x, y) from the edge between two points."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    square = dx * dx + dy * dy
    along = 0.0
    if square > 1e-18:
        along = min(max(((x - start[0]) * dx + (y - start[1]) * dy) / square, 0.0), 1.0)
    return math.hypot(x - start[0] - along * dx, y - start[1] - along * dy)
