"""Simplification of a contour ring to few straight edges in the middle of its points.

All lengths are in the units of the points (cells, where the points come from a grid).
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.buildings.edge_fit import BOW_POINTS, FIT_POINTS, extreme, fit_line, furthest, spread
from ambinav.buildings.ring_vertices import BACK, meet
from ambinav.runtime.array_types import Bytes, Floats, Ints
from ambinav.runtime.kernels import kernel


def simplify_ring(x: Floats, y: Floats, kind: Bytes, tolerance: float) -> tuple[Ints, Floats]:
    """Choose vertices of a closed ring and move them to where the fitted edges meet.

    1. Douglas-Peucker to `tolerance`, between the points where `kind` changes.
    2. A vertex moves along the points to where its two edges part; it goes if one straight
       line does as well without it.
    3. An edge that is bowed throughout by more than tolerance / 4 is split: curved walls.
    4. A line is fitted to each edge's points (total least squares), so that the steps of a
       raster vanish; vertices go to the intersections of neighbouring lines. Where the ring
       turns back at the end of a thin wall, both of its sides end there, with two vertices.

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


@kernel(error_model="python")
def _halve(x, y, keep, tolerance):
    """Run Douglas-Peucker between the points that `keep` already contains, in place."""
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


@kernel(error_model="python")
def _settle(x, y, keep, fixed):
    """Move each vertex to where its points divide best between the lines of its two edges.

    Douglas-Peucker takes the extreme point, which can be some points away from the corner. At
    the end of a thin wall the extreme point is what is wanted: the lines do not part there.
    """
    vertex = np.flatnonzero(keep)
    for j in range(1, len(vertex) - 1):
        a, v, b = vertex[j - 1], vertex[j], vertex[j + 1]
        if fixed[v] or v - a < FIT_POINTS or b - v < FIT_POINTS:
            continue
        x0, y0, ux, uy, _ = fit_line(x, y, a, v)
        x1, y1, vx, vy, _ = fit_line(x, y, v, b)
        low, high = v - (v - a) // 2, v + (b - v) // 2
        cost = best = 0.0
        where = low
        if ux * vx + uy * vy < BACK:
            low, high, where = low, low, extreme(x, y, low, high, ux - vx, uy - vy)
        for i in range(low, high):
            # Point i passes from the second edge to the first.
            cost += ((y[i] - y0) * ux - (x[i] - x0) * uy) ** 2
            cost -= ((y[i] - y1) * vx - (x[i] - x1) * vy) ** 2
            if cost < best:
                best, where = cost, i + 1
        keep[v] = False
        keep[where] = True
        vertex[j] = where


@kernel(error_model="python")
def _merge(x, y, keep, fixed, tolerance, bow):
    """Drop vertices between edges that one straight line replaces, in place."""
    changed = True
    while changed:
        changed = False
        vertex = np.flatnonzero(keep)
        left = len(vertex)
        a = 0
        for j in range(1, len(vertex) - 1):
            if left > 5 and not fixed[vertex[j]]:
                most, sagitta = spread(x, y, a, vertex[j + 1])
                if most <= tolerance and sagitta <= bow:
                    keep[vertex[j]] = False
                    left -= 1
                    changed = True
                    continue
            a = vertex[j]


@kernel(error_model="python")
def _sharpest(x, y, keep):
    """Return the index of the vertex that makes the largest triangle with its neighbours."""
    vertex = np.flatnonzero(keep)[:-1]
    best, index = -1.0, 0
    for j in range(len(vertex)):
        a, v, b = vertex[j - 1], vertex[j], vertex[(j + 1) % len(vertex)]
        area = abs((x[v] - x[a]) * (y[b] - y[v]) - (y[v] - y[a]) * (x[b] - x[v]))
        if area > best:
            best, index = area, v
    return index


@kernel(error_model="python")
def _thicken(x, y, keep):
    """Ensure that a ring has at least four vertices where its points allow that."""
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


@kernel(error_model="python")
def _divide(x, y, fixed, tolerance):
    """Return the mask of the first choice of vertices, the fixed ones included.

    The first and the last are fixed.
    """
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


@kernel(error_model="python")
def _polish(x, y, kind, keep, fixed, tolerance):
    """Refine a first choice of vertices; return their indices and positions."""
    bow = 0.25 * tolerance
    if tolerance > 0.0:
        _settle(x, y, keep, fixed)
        _merge(x, y, keep, fixed, tolerance, bow)
    vertex = np.flatnonzero(keep)
    stack = [(vertex[j], vertex[j + 1]) for j in range(len(vertex) - 1)]
    while stack and tolerance > 0.0:
        a, b = stack.pop()
        if b - a >= BOW_POINTS and spread(x, y, a, b)[1] > bow:
            index, _ = furthest(x, y, a, b)
            # Halves that are too unequal say nothing about a bow.
            index = min(max(index, a + (b - a) // 4), b - (b - a) // 4)
            keep[index] = True
            stack.append((a, index))
            stack.append((index, b))
    if tolerance > 0.0:
        _settle(x, y, keep, fixed)
        _merge(x, y, keep, fixed, tolerance, bow)
    return meet(x, y, kind, np.flatnonzero(keep), tolerance)
