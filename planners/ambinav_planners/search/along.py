"""Poses along a motion of any kind, for kernels."""

from __future__ import annotations

import math

from ambinav.geometry.motion.curves import advance, curve_pieces
from ambinav.geometry.motion.steering import DUBINS, FACING
from ambinav.kernels import kernel


@kernel
def pieces_of(kind, radius, a, b):
    """Pieces of a curve from pose a to pose b; zeros for a straight motion."""
    if radius is not None and kind >= DUBINS:
        return curve_pieces(kind, radius, a[0], a[1], a[2], b[0], b[1], b[2])
    return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@kernel
def pose_along(kind, pieces, length, a, b, share):
    """Pose at a share of the length of the motion from a to b, with what `pieces_of` gives."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    if kind < DUBINS:
        if kind == FACING:
            theta = math.atan2(dy, dx)
        else:
            theta = a[2] + share * ((b[2] - a[2] + math.pi) % (2.0 * math.pi) - math.pi)
        return a[0] + share * dx, a[1] + share * dy, theta
    x, y, theta = a[0], a[1], a[2]
    rest = share * length
    for k in range(5):
        whole = abs(pieces[k])
        part = min(rest, whole)
        if part > 0.0:
            x, y, theta = advance(x, y, theta, math.copysign(part, pieces[k]), pieces[k + 5])
        rest -= part
    return x, y, theta
