"""Motions between two poses: kernels that planners, collision checks and costs share.

A motion is a straight line, or up to five pieces of constant curvature: a piece is a signed
length in metres, negative in reverse, and a curvature in 1/m, positive to the left.
"""

from __future__ import annotations

import math

from ambinav.geometry.motion.circles import in_radii
from ambinav.geometry.motion.dubins import shortest_dubins
from ambinav.geometry.motion.reeds_shepp import reeds_shepp_pieces, shortest_reeds_shepp
from ambinav.runtime.kernels import kernel

# Kinds of motion. FACING: straight, heading in the direction of travel. STRAIGHT: straight, the
# heading turns evenly from one end's to the other's, the short way round.
FACING, STRAIGHT, DUBINS, REEDS_SHEPP = range(4)


@kernel
def curve_pieces(kind, radius, x0, y0, t0, x1, y1, t1):
    """Find the shortest DUBINS or REEDS_SHEPP curve from pose to pose, as its pieces.

    Radius, x and y in metres, headings t0 and t1 in radians. Returns ten floats: the signed
    lengths of five pieces in metres, then their curvatures in 1/m. Pieces that are not needed
    have length 0.
    """
    x, y, phi = in_radii(radius, x0, y0, t0, x1, y1, t1)
    k = 1.0 / radius
    if kind == DUBINS:
        a, b, c, i, j, m = shortest_dubins(x, y, phi)
        return a * radius, b * radius, c * radius, 0.0, 0.0, i * k, j * k, m * k, 0.0, 0.0
    r = radius
    (a, b, c, d, e), (i, j, m, n, o) = reeds_shepp_pieces(shortest_reeds_shepp(x, y, phi))
    return a * r, b * r, c * r, d * r, e * r, i * k, j * k, m * k, n * k, o * k


@kernel(inline="always")
def advance(x, y, t, length, curvature):
    """Return the pose after a piece of a signed length, metres, and a curvature, 1/m."""
    if curvature == 0.0:
        return x + length * math.cos(t), y + length * math.sin(t), t
    turn = 0.5 * length * curvature
    # The chord, twice the sine of half the turn over the curvature, leans by half the turn: this
    # keeps its digits where the difference of two sines would lose them.
    chord = 2.0 * math.sin(turn) / curvature
    return x + chord * math.cos(t + turn), y + chord * math.sin(t + turn), t + 2.0 * turn


@kernel
def motion_length(kind, radius, x0, y0, t0, x1, y1, t1):
    """Return the length of a motion of any kind, metres; reverse counts as much as forwards.

    nan for a curve without a radius.
    """
    if kind in (FACING, STRAIGHT):
        return math.hypot(x1 - x0, y1 - y0)
    if radius is None:
        return math.nan
    x, y, phi = in_radii(radius, x0, y0, t0, x1, y1, t1)
    if kind == DUBINS:
        a, b, c, _, _, _ = shortest_dubins(x, y, phi)
        return radius * (a + b + c)
    return radius * shortest_reeds_shepp(x, y, phi)[0]


@kernel
def pieces_of(kind, radius, a, b):
    """Return the pieces of a curve from pose a to pose b; zeros for a straight motion."""
    if radius is not None and kind >= DUBINS:
        return curve_pieces(kind, radius, a[0], a[1], a[2], b[0], b[1], b[2])
    return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def pose_along(kind, pieces, length, a, b, share):
    """Return the pose at a share of the motion's length from a to b; see `pieces_of`."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    if kind < DUBINS:
        if kind == FACING:
            theta = math.atan2(dy, dx)
        else:
            theta = a[2] + share * ((b[2] - a[2] + math.pi) % (2.0 * math.pi) - math.pi)
        return a[0] + share * dx, a[1] + share * dy, theta
    x, y, theta = a[0], a[1], a[2]
    remaining = share * length
    for k in range(5):
        piece_length = abs(pieces[k])
        part = min(remaining, piece_length)
        if part > 0.0:
            x, y, theta = advance(x, y, theta, math.copysign(part, pieces[k]), pieces[k + 5])
        remaining -= part
    return x, y, theta


@kernel
def curve_pose(kind, radius, x0, y0, t0, x1, y1, t1, share):
    """Return the pose at a share of the length of the curve between two poses."""
    pieces = curve_pieces(kind, radius, x0, y0, t0, x1, y1, t1)
    length = 0.0
    for k in range(5):
        length += abs(pieces[k])
    return pose_along(kind, pieces, length, (x0, y0, t0), (x1, y1, t1), share)
