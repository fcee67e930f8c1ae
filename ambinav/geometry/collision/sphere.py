"""Collision checks of a sphere or an upright cylinder among triangles, along straight motions.

A moving sphere sweeps a capsule: it is free if the segment that its centre moves along stays a
radius away from every triangle. Distances of points, segments and triangles follow Ericson,
Real-Time Collision Detection (2005), sections 5.1.5, 5.1.9 and 5.3.6. Of the cylinder see
`upright_cylinder`.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_positive
from ambinav.geometry.collision.upright_cylinder import cylinder_meets
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.kernels import kernel

CELL: Final = 0.5
"""Edge of a cell in which triangles are looked up, metres."""
# Cells of the grid at the most; in larger buildings they are larger.
_MOST_CELLS: Final = 2_000_000


class SphereChecker:
    """Checker of a sphere, or of an upright cylinder, among surfaces; it may touch them.

    Only surfaces count: a body in the middle of a large solid is free. Who starts in free space
    gets into none.

    Args:
        triangles: Shape (T, 3, 3), metres (`ambinav.casting.triangles.triangles_of`).
        radius: Metres, above 0.
        half_height: Half the height of an upright cylinder around the centre, metres, above 0;
            None: a sphere.

    Attributes:
        arrays: Arguments of `sphere_free` behind the two ends.

    Raises:
        InputError: the radius or the half height is not a positive number.
    """

    def __init__(self, triangles: Floats, radius: float, half_height: float | None = None) -> None:
        radius = as_positive(radius, "radius", "metres")
        if half_height is not None:
            half_height = as_positive(half_height, "half_height", "metres")
        self.radius, self.half_height = radius, half_height
        half = -1.0 if half_height is None else half_height
        corners = np.ascontiguousarray(triangles, dtype=np.float64).reshape(-1, 3, 3)
        reach = np.array([radius, radius, radius if half_height is None else half_height])
        low, high = corners.min(axis=1) - reach, corners.max(axis=1) + reach
        origin = low.min(axis=0)
        size = high.max(axis=0) - origin
        cell = max(CELL, float(np.cbrt(size.prod() / _MOST_CELLS)))
        counts = (size // cell).astype(np.int64) + 1
        first = ((low - origin) // cell).astype(np.int64)
        last = np.minimum(((high - origin) // cell).astype(np.int64), counts - 1)
        start = np.zeros(int(counts.prod()) + 1, dtype=np.int64)
        _sort(first, last, counts, start, np.empty(0, dtype=np.int64))
        start = np.cumsum(start)
        item = np.empty(int(start[-1]), dtype=np.int64)
        _sort(first, last, counts, start[:-1].copy(), item)
        self.arrays = (radius, half, origin, cell, counts, start, item, corners)

    @property
    def size(self) -> str:
        """Size of the body, in words."""
        if self.half_height is None:
            return f"radius of {self.radius:g} m"
        return f"radius of {self.radius:g} m and half height of {self.half_height:g} m"

    def motions_free(self, a: ArrayLike, b: ArrayLike) -> Bools:
        """Return whether straight motions from a to b, (N, 3) each, are free; shape (N,)."""
        ends = np.concatenate(np.broadcast_arrays(np.atleast_2d(a), np.atleast_2d(b)), axis=1)
        rows = np.asarray(ends, dtype=np.float64)
        return np.array([sphere_free(*row, *self.arrays) for row in rows], dtype=np.bool_)

    def free(self, points: ArrayLike) -> Bools:
        """Return whether the body is free at points, shape (N, 3), metres; shape (N,)."""
        return self.motions_free(points, points)


@kernel
def _sort(first, last, counts, cursor, item):
    """Count items into cursor[k + 1] if `item` is empty, else write them and advance cursor[k]."""
    for t in range(first.shape[0]):
        for i in range(first[t, 0], last[t, 0] + 1):
            for j in range(first[t, 1], last[t, 1] + 1):
                for k in range(first[t, 2], last[t, 2] + 1):
                    cell = (i * counts[1] + j) * counts[2] + k
                    if item.size > 0:
                        item[cursor[cell]] = t
                        cursor[cell] += 1
                    else:
                        cursor[cell + 1] += 1


@kernel
def sphere_free(x0, y0, z0, x1, y1, z1, radius, half, origin, cell, counts, start, item, corners):
    """Return whether a body is free all along a straight motion; the rest as in the class."""
    a, b = (x0, y0, z0), (x1, y1, z1)
    if not math.isfinite(x0 + y0 + z0 + x1 + y1 + z1):
        return False
    length = math.sqrt(_dot(_minus(b, a), _minus(b, a)))
    pieces = max(int(math.ceil(length / cell)), 1)
    least = radius * radius * (1.0 - 1e-9)
    tall = radius if half < 0.0 else half
    ends = np.empty((18, 2))
    for piece in range(pieces):
        p = _between(a, b, piece / pieces)
        q = _between(a, b, (piece + 1.0) / pieces)
        # Cells list the triangles within a radius of them.
        i0, i1 = _cells(p[0], q[0], origin[0], cell, counts[0])
        j0, j1 = _cells(p[1], q[1], origin[1], cell, counts[1])
        k0, k1 = _cells(p[2], q[2], origin[2], cell, counts[2])
        for i in range(i0, i1):
            for j in range(j0, j1):
                for k in range(k0, k1):
                    here = (i * counts[1] + j) * counts[2] + k
                    for n in range(start[here], start[here + 1]):
                        t = corners[item[n]]
                        if _apart(p, q, t, radius, tall):
                            continue
                        if half >= 0.0:
                            if cylinder_meets(p, q, t, half * (1.0 - 1e-9), least, ends):
                                return False
                            continue
                        u = (t[0, 0], t[0, 1], t[0, 2])
                        v = (t[1, 0], t[1, 1], t[1, 2])
                        w = (t[2, 0], t[2, 1], t[2, 2])
                        if segment_triangle(p, q, u, v, w) < least:
                            return False
    return True


@kernel(inline="always")
def _cells(u, v, origin, cell, count):
    """Return the range of cells between two coordinates; an empty one off the grid."""
    low = int(math.floor((min(u, v) - origin) / cell))
    high = int(math.floor((max(u, v) - origin) / cell)) + 1
    return max(low, 0), min(high, count)


@kernel(inline="always")
def _apart(p, q, t, radius, tall):
    """Return whether the boxes around a segment and a triangle are as far apart as the body is."""
    for axis in range(3):
        reach = tall if axis == 2 else radius
        low, high = min(t[0, axis], t[1, axis], t[2, axis]), max(t[0, axis], t[1, axis], t[2, axis])
        if max(p[axis], q[axis]) < low - reach or min(p[axis], q[axis]) > high + reach:
            return True
    return False


@kernel(inline="always")
def _minus(a, b):
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@kernel(inline="always")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel(inline="always")
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel(inline="always")
def _between(a, b, share):
    return (
        a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2])
    )  # fmt: skip


@kernel
def _point_triangle(p, a, b, c):
    """Compute the squared distance of a point from a triangle's face, inf beside the face."""
    normal = _cross(_minus(b, a), _minus(c, a))
    size = _dot(normal, normal)
    if size == 0.0:
        return math.inf
    for u, v in ((a, b), (b, c), (c, a)):
        if _dot(_cross(_minus(v, u), _minus(p, u)), normal) < 0.0:
            return math.inf
    off = _dot(_minus(p, a), normal)
    return off * off / size


@kernel
def _segment_segment(p, q, a, b):
    """Compute the squared distance of two segments, which may be points."""
    d, e, r = _minus(q, p), _minus(b, a), _minus(p, a)
    dd, ee, de = _dot(d, d), _dot(e, e), _dot(d, e)
    dr, er = _dot(d, r), _dot(e, r)
    s, t = 0.0, 0.0
    if dd > 0.0:
        across = dd * ee - de * de
        if across > 1e-12 * dd * ee:
            s = min(max((de * er - dr * ee) / across, 0.0), 1.0)
        t = (de * s + er) / ee if ee > 0.0 else 0.0
        if t < 0.0 or ee == 0.0:
            t = 0.0
            s = min(max(-dr / dd, 0.0), 1.0)
        elif t > 1.0:
            t = 1.0
            s = min(max((de - dr) / dd, 0.0), 1.0)
    elif ee > 0.0:
        t = min(max(er / ee, 0.0), 1.0)
    gap = _minus(_between(p, q, s), _between(a, b, t))
    return _dot(gap, gap)


@kernel
def segment_triangle(p, q, a, b, c):
    """Compute the squared distance of the segment from p to q from the triangle a, b, c."""
    normal = _cross(_minus(b, a), _minus(c, a))
    first, last = _dot(_minus(p, a), normal), _dot(_minus(q, a), normal)
    if first * last < 0.0:
        crossing = _between(p, q, first / (first - last))
        if _point_triangle(crossing, a, b, c) < math.inf:
            return 0.0
    least = min(_point_triangle(p, a, b, c), _point_triangle(q, a, b, c))
    least = min(least, _segment_segment(p, q, a, b))
    least = min(least, _segment_segment(p, q, b, c))
    return min(least, _segment_segment(p, q, c, a))
