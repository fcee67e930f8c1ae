"""A ring of contour points made into few straight edges that lie in the middle of the points.

All lengths are in the units of the points (cells, where the points come from a grid).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

# An edge shorter than this many points is drawn from end to end, not fitted.
_FIT_POINTS = 5
# Points beside a corner lie on its chamfer; they do not enter a fit that has enough others.
_TRIM = 2
# An edge of fewer points is never split for being bowed.
_BOW_POINTS = 10


def simplify_ring(
    x: NDArray[np.float64], y: NDArray[np.float64], kind: NDArray[np.uint8], tolerance: float
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Choose vertices of a closed ring and move them to where the fitted edges meet.

    1. Douglas-Peucker to `tolerance`, between the points where `kind` changes.
    2. A vertex moves along the points to where its two edges part; it goes if one straight
       line does as well without it.
    3. An edge that is bowed throughout by more than tolerance / 4 is split: curved walls.
    4. A line is fitted to each edge's points (total least squares), so that the steps of a
       raster vanish; vertices go to the intersections of neighbouring lines.

    Args:
        x: Coordinates of the points, shape (n,); the ring is not closed by repetition.
        y: Likewise.
        kind: shape (n,), class of each point; an edge has one class.
        tolerance: Largest distance of a point from its edge before the fit.

    Returns:
        Indices of the chosen points in ascending order, shape (m,), and the places of the
        vertices, shape (m, 2).
    """
    n = len(x)
    change = kind != np.roll(kind, 1)
    if change.any():
        first = int(np.argmax(change))
    else:
        # The point furthest from the middle is a corner where there are corners.
        first = int(np.argmax((x - x.mean()) ** 2 + (y - y.mean()) ** 2))
    order = np.concatenate([np.arange(first, n), np.arange(first + 1)])
    fixed = change[order]
    fixed[[0, -1]] = True
    keep = _divide(x[order], y[order], fixed, tolerance)
    if not change.any():
        # The first point stays where it is: begin again at the clearest corner.
        turn = _sharpest(x[order], y[order], keep)
        order = np.concatenate([order[turn:-1], order[: turn + 1]])
        keep = np.concatenate([keep[turn:-1], keep[: turn + 1]])
    chosen, place = _polish(x[order], y[order], kind[order], keep, fixed, tolerance)
    index = order[chosen]
    ascending = np.argsort(index)
    return index[ascending], place[ascending]


@njit(cache=True, nogil=True)
def furthest(x, y, a, b):
    """Index strictly between a and b furthest from the chord a-b, and its distance."""
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


@njit(cache=True, nogil=True)
def _line(x, y, a, b):
    """Line through the points a..b: mean, direction from a to b, and number of points."""
    count = b - a + 1
    if count < _FIT_POINTS:
        length = max(math.hypot(x[b] - x[a], y[b] - y[a]), 1e-12)
        dx, dy = (x[b] - x[a]) / length, (y[b] - y[a]) / length
        return 0.5 * (x[a] + x[b]), 0.5 * (y[a] + y[b]), dx, dy, count
    if count >= _FIT_POINTS + 2 * _TRIM:
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


@njit(cache=True, nogil=True)
def _spread(x, y, a, b):
    """Largest distance of the points a..b from their line, and the sagitta if they are bowed.

    Bowed: a parabola explains more than half of the variance about the line. Roughness does not.
    """
    mx, my, dx, dy, _ = _line(x, y, a, b)
    count = b - a + 1
    low, high, most = np.inf, -np.inf, 0.0
    for i in range(a, b + 1):
        t = (x[i] - mx) * dx + (y[i] - my) * dy
        low, high = min(low, t), max(high, t)
        most = max(most, abs((y[i] - my) * dx - (x[i] - mx) * dy))
    half = 0.5 * (high - low)
    if count < _BOW_POINTS or half < 1e-9:
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


@njit(cache=True, nogil=True)
def _halve(x, y, keep, tolerance):
    """Douglas-Peucker between the points that `keep` holds already, in place."""
    stack = [(0, 0)]
    stack.pop()
    a = 0
    for b in range(1, len(keep)):
        if keep[b]:
            stack.append((a, b))
            a = b
    while stack:
        a, b = stack.pop()
        index, away = furthest(x, y, a, b)
        if index >= 0 and away > tolerance:
            keep[index] = True
            stack.append((a, index))
            stack.append((index, b))


@njit(cache=True, nogil=True)
def _settle(x, y, keep, fixed):
    """Move each vertex to where its points part best between the lines of its two edges.

    Douglas-Peucker takes the extreme point, which can be some points away from the corner.
    """
    vertex = np.flatnonzero(keep)
    for j in range(1, len(vertex) - 1):
        a, v, b = vertex[j - 1], vertex[j], vertex[j + 1]
        if fixed[v] or v - a < _FIT_POINTS or b - v < _FIT_POINTS:
            continue
        x0, y0, ux, uy, _ = _line(x, y, a, v)
        x1, y1, vx, vy, _ = _line(x, y, v, b)
        low, high = v - (v - a) // 2, v + (b - v) // 2
        cost = best = 0.0
        where = low
        for i in range(low, high):
            # Point i passes from the second edge to the first.
            cost += ((y[i] - y0) * ux - (x[i] - x0) * uy) ** 2
            cost -= ((y[i] - y1) * vx - (x[i] - x1) * vy) ** 2
            if cost < best:
                best, where = cost, i + 1
        keep[v] = False
        keep[where] = True
        vertex[j] = where


@njit(cache=True, nogil=True)
def _merge(x, y, keep, fixed, tolerance, bow):
    """Drop the vertices between edges that one straight line replaces, in place."""
    changed = True
    while changed:
        changed = False
        vertex = np.flatnonzero(keep)
        left = len(vertex)
        a = 0
        for j in range(1, len(vertex) - 1):
            if left > 5 and not fixed[vertex[j]]:
                most, sagitta = _spread(x, y, a, vertex[j + 1])
                if most <= tolerance and sagitta <= bow:
                    keep[vertex[j]] = False
                    left -= 1
                    changed = True
                    continue
            a = vertex[j]


@njit(cache=True, nogil=True)
def _sharpest(x, y, keep):
    """Index of the vertex that makes the largest triangle with its two neighbours."""
    vertex = np.flatnonzero(keep)[:-1]
    best, index = -1.0, 0
    for j in range(len(vertex)):
        a, v, b = vertex[j - 1], vertex[j], vertex[(j + 1) % len(vertex)]
        area = abs((x[v] - x[a]) * (y[b] - y[v]) - (y[v] - y[a]) * (x[b] - x[v]))
        if area > best:
            best, index = area, v
    return index


@njit(cache=True, nogil=True)
def _thicken(x, y, keep):
    """Make sure that a ring has at least four vertices where its points allow that."""
    while keep.sum() < 5:
        best, index, a = -1.0, -1, 0
        for b in range(1, len(keep)):
            if keep[b]:
                i, away = furthest(x, y, a, b)
                if i >= 0 and away > best:
                    best, index = away, i
                a = b
        if index < 0:
            break
        keep[index] = True


@njit(cache=True, nogil=True)
def _divide(x, y, fixed, tolerance):
    """Mask of the first choice of vertices, among them the fixed ones (first and last are)."""
    n = len(x)
    keep = fixed.copy()
    if keep.sum() == 2:
        far, most = n // 2, -1.0
        for i in range(1, n - 1):
            away = math.hypot(x[i] - x[0], y[i] - y[0])
            if away > most:
                far, most = i, away
        keep[far] = True
    _halve(x, y, keep, tolerance)
    _thicken(x, y, keep)
    if tolerance > 0.0:
        _settle(x, y, keep, fixed)
    return keep


@njit(cache=True, nogil=True)
def _polish(x, y, kind, keep, fixed, tolerance):
    """Indices and places of the vertices, from a first choice of them."""
    bow = 0.25 * tolerance
    if tolerance > 0.0:
        _settle(x, y, keep, fixed)
        _merge(x, y, keep, fixed, tolerance, bow)
    vertex = np.flatnonzero(keep)
    stack = [(vertex[j], vertex[j + 1]) for j in range(len(vertex) - 1)]
    while stack and tolerance > 0.0:
        a, b = stack.pop()
        if b - a >= _BOW_POINTS and _spread(x, y, a, b)[1] > bow:
            index, _ = furthest(x, y, a, b)
            # Halves that are too unequal say nothing about a bow.
            index = min(max(index, a + (b - a) // 4), b - (b - a) // 4)
            keep[index] = True
            stack.append((a, index))
            stack.append((index, b))
    if tolerance > 0.0:
        _settle(x, y, keep, fixed)
        _merge(x, y, keep, fixed, tolerance, bow)
    vertex = np.flatnonzero(keep)
    return vertex[:-1], _meet(x, y, kind, vertex, tolerance)


@njit(cache=True, nogil=True)
def _meet(x, y, kind, vertex, tolerance):
    """Places of the vertices: where the lines of the two edges of each meet."""
    m = len(vertex) - 1
    line = np.empty((m, 5))
    for j in range(m):
        line[j] = np.array(_line(x, y, vertex[j], vertex[j + 1]))
    place = np.empty((m, 2))
    for j in range(m):
        i = j - 1 if j > 0 else m - 1
        rawx, rawy = x[vertex[j]], y[vertex[j]]
        place[j] = rawx, rawy
        if tolerance <= 0.0:
            continue
        ux, uy, vx, vy = line[i, 2], line[i, 3], line[j, 2], line[j, 3]
        sine = ux * vy - uy * vx
        if abs(sine) > 0.1:
            wx, wy = line[j, 0] - line[i, 0], line[j, 1] - line[i, 1]
            t = (wx * vy - wy * vx) / sine
            mx, my = line[i, 0] + t * ux, line[i, 1] + t * uy
            if math.hypot(mx - rawx, my - rawy) <= 2.0 * tolerance + 1.0:
                place[j] = mx, my
                continue
        # Nearly parallel: between the feet on both, nearer to the one that more points support;
        # a wall's line counts, a frontier's hardly does.
        w0, w1 = line[i, 4], line[j, 4]
        if kind[vertex[i]] != kind[vertex[j]]:
            w0 *= 1e-3 if kind[vertex[i]] else 1.0
            w1 *= 1e-3 if kind[vertex[j]] else 1.0
        t0 = (rawx - line[i, 0]) * ux + (rawy - line[i, 1]) * uy
        t1 = (rawx - line[j, 0]) * vx + (rawy - line[j, 1]) * vy
        place[j, 0] = (w0 * (line[i, 0] + t0 * ux) + w1 * (line[j, 0] + t1 * vx)) / (w0 + w1)
        place[j, 1] = (w0 * (line[i, 1] + t0 * uy) + w1 * (line[j, 1] + t1 * vy)) / (w0 + w1)
    return place
