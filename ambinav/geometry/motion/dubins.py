"""Shortest curves forwards with a bounded turning radius (Dubins 1957).

Words as in Shkel and Lumelsky, "Classification of the Dubins set" (2001): CSC and CCC, six in
all. Written for the circles of `ambinav.geometry.motion.circles`; of every word the one that
begins to the left is computed, the other is the same word of the mirrored goal.
"""

from __future__ import annotations

import math

from ambinav.geometry.motion.circles import NEAR, TURN, polar
from ambinav.runtime.kernels import kernel

SAME = 1e-6
"""Poses nearer than this, in radii and radians, are one: no loop is driven (as in OMPL)."""


@kernel
def shortest_dubins(x, y, phi):
    """Find the shortest of the six words to the pose (x, y, phi), in radii.

    Returns the three lengths, and of each piece the side to which it turns: 1 left, -1 right,
    0 straight.
    """
    d = math.sqrt(x * x + y * y)
    if d < SAME and abs(phi) < SAME:
        return 0.0, d, 0.0, 1.0, 0.0, 1.0
    s, c = math.sin(phi), math.cos(phi)
    best, first, second, third = math.inf, math.inf, 0.0, 0.0
    side_1, side_2, side_3 = 1.0, 0.0, 1.0
    for side in (1.0, -1.0):
        height, sine, turn = side * y, side * s, side * phi
        d, theta = polar(x - sine, height - 1.0 + c)
        if d < best:
            t, v = _left_straight_left(d, theta, turn)
            if t + d + v < best:
                best, first, second, third = t + d + v, t, d, v
                side_1, side_2, side_3 = side, 0.0, side
        if d < 4.0 and best > math.pi:
            u = math.pi + 2.0 * math.acos(0.25 * d)
            t = _ahead(theta + 0.5 * u, NEAR)
            v = _ahead(turn - t + u, NEAR)
            if t + u + v < best:
                best, first, second, third = t + u + v, t, u, v
                side_1, side_2, side_3 = side, -side, side
        d, theta = polar(x + sine, height - 1.0 - c)
        # Rounding may bring two circles that touch slightly too near to each other.
        square = d * d - 4.0
        if -NEAR < square < best * best:
            u = math.sqrt(max(square, 0.0))
            t = _ahead(theta + math.atan2(2.0, u), NEAR)
            v = _ahead(t - turn, NEAR)
            if t + u + v < best:
                best, first, second, third = t + u + v, t, u, v
                side_1, side_2, side_3 = side, 0.0, -side
    return first, second, third, side_1, side_2, side_3


@kernel(forceinline=True)
def _left_straight_left(d, theta, turn):
    """Compute both arcs of LSL; rounding must not turn an arc of 0 into a whole turn.

    The shorter the straight piece, the less is known of its angle: where the angle may be that of
    the start or of the goal, it is.
    """
    if d < NEAR:
        return 0.0, _ahead(turn, NEAR)
    slack = NEAR + NEAR / d
    t = _ahead(theta, slack)
    v = _ahead(turn - t, NEAR)
    if v > TURN - slack:
        return _ahead(turn, NEAR), 0.0
    return t, v


@kernel(inline="always")
def _ahead(angle, slack):
    """Wrap an angle to [0, one turn); return 0 if it is one turn within the slack."""
    angle -= TURN * math.floor(angle / TURN)
    return angle if angle < TURN - slack else 0.0
