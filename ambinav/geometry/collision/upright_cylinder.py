"""Collision of an upright cylinder that moves straight, with a triangle, exactly.

The cylinder with its centre at c(t) meets a point p if p - c(t) is nearer to the z axis than the
radius and between the heights -h and h. All p - c(t) fill a convex body, the hull of the triangle
less the start and of the triangle less the end. Its edges are among those of the two triangles and
the three lines between them. What of the body lies between the two heights is the hull of the parts
of these edges between them. So the cylinder is free if the hull of these parts, seen from above, is
a radius away from the origin: beside it is a line between two of their ends that is, and the origin
is not inside.
"""

from __future__ import annotations

import math

from ambinav.runtime.kernels import kernel


@kernel
def cylinder_meets(p, q, t, half, least, ends):
    """Return whether an upright cylinder that moves from p to q meets a triangle.

    Args:
        p: x, y, z of its centre at the start.
        q: The same at the end.
        t: Corners of the triangle, shape (3, 3).
        half: Half of its height, metres.
        least: Square of its radius.
        ends: Work, shape (18, 2).
    """
    count = 0
    for k in range(3):
        n = (k + 1) % 3
        count = _clip(t, k, p, t, n, p, half, ends, count)
        count = _clip(t, k, q, t, n, q, half, ends, count)
        count = _clip(t, k, p, t, k, q, half, ends, count)
    return count > 0 and _hull_distance(ends, count) < least


@kernel(inline="always")
def _clip(s, i, p, t, j, q, half, ends, count):
    """Append x, y of both ends of the part of an edge between the heights; return their count."""
    x, y, z = s[i, 0] - p[0], s[i, 1] - p[1], s[i, 2] - p[2]
    dx, dy, dz = t[j, 0] - q[0] - x, t[j, 1] - q[1] - y, t[j, 2] - q[2] - z
    low, high = 0.0, 1.0
    if dz == 0.0:
        if abs(z) >= half:
            return count
    else:
        first, last = (-half - z) / dz, (half - z) / dz
        low, high = max(low, min(first, last)), min(high, max(first, last))
        if low > high:
            return count
    ends[count, 0], ends[count, 1] = x + low * dx, y + low * dy
    ends[count + 1, 0], ends[count + 1, 1] = x + high * dx, y + high * dy
    return count + 2


@kernel
def _hull_distance(points, count):
    """Return the squared distance of the origin from the hull of points in the plane."""
    least = math.inf
    for i in range(count):
        for j in range(i):
            ax, ay = points[i, 0], points[i, 1]
            dx, dy = points[j, 0] - ax, points[j, 1] - ay
            square = dx * dx + dy * dy
            share = min(max(-(ax * dx + ay * dy) / square, 0.0), 1.0) if square > 0.0 else 0.0
            x, y = ax + share * dx, ay + share * dy
            least = min(least, x * x + y * y)
    # Outside, all points lie in a half plane: to one side of the line to one of them.
    for i in range(count):
        left, right = False, False
        for j in range(count):
            across = points[i, 0] * points[j, 1] - points[i, 1] * points[j, 0]
            left |= across > 0.0
            right |= across < 0.0
        if not (left and right):
            return least
    return 0.0
