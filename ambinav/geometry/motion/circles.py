"""Turning circles of two poses, in units of the turning radius.

Start at the origin, heading along x. Its left circle has its centre at (0, 1), its right one at
(0, -1). The curves of Dubins and of Reeds and Shepp follow from the vectors between a circle of
the start and one of the goal: once these are known as length and angle, mirrored and reversed
words need sums of angles alone.
"""

from __future__ import annotations

import math

from ambinav.runtime.kernels import kernel

TURN = 2.0 * math.pi
NEAR = 1e-9
"""Tolerance in radii and radians: far above rounding, far below a robot's accuracy."""


@kernel
def in_radii(radius, x0, y0, t0, x1, y1, t1):
    """Express the second pose in the frame of the first: x, y in radii, heading in a half turn."""
    c, s = math.cos(t0), math.sin(t0)
    dx, dy = (x1 - x0) / radius, (y1 - y0) / radius
    return c * dx + s * dy, c * dy - s * dx, wrap(t1 - t0)


@kernel(inline="always")
def polar(x, y):
    """Return length and angle of a vector; the angle of a zero vector is 0."""
    return math.sqrt(x * x + y * y), math.atan2(y, x)


@kernel(inline="always")
def wrap(angle):
    """Wrap an angle to within half a turn of 0."""
    return angle - TURN * math.floor(angle / TURN + 0.5)
