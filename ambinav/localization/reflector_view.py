"""Expectation of a reflector in a scan from a pose, and its change with the pose.

From a pose a reflector of any shape covers the angles between two of its corners. A scan shows the
mean of the ranges over that angle, and the direction halfway, so both are computed from the
outline: a post's mean range is pi/4 of its radius short of its centre (its nearest point, which
noise makes appear nearer, is not used), a strip's is nearly that of its middle.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from ambinav.localization.information import BeamNoise
from ambinav.localization.odometry import wrapped
from ambinav.localization.reflector_detection import ReflectorBeams
from ambinav.runtime.array_types import Floats, Ints
from ambinav.runtime.kernels import kernel

ACROSS: Final = 8
"""Rays over which the mean range of a reflector is taken."""
WIDEST: Final = 1.5
"""Radians: a reflector that covers more is too near to be used."""
(
    MIDDLE, DISTANCE, SLOPE, ROUGH, WIDTH, BEARING_BY, _BY, _BT, RANGE_BY, _RY, _RT, BB, BR, RR,
) = range(14)  # fmt: skip
"""Columns of a view: bearing (robot frame, radians), mean range (metres), its derivative by the
direction, its variance about that line, angle covered; derivatives of the bearing by x, y, theta,
and of the range; variances and covariance of both by that of the pose."""
VIEW: Final = RR + 1
"""Number of columns."""


class ReflectorMap(NamedTuple):
    """L reflectors, and how they are seen.

    Attributes:
        edges: Edges of all, one reflector after the other, shape (E, 4), metres.
        first: Those of reflector l are first[l] to first[l + 1] - 1, shape (L + 1,).
        place: Variance of a reflector's place, square metres.
        gate: Largest squared Mahalanobis distance of a match.
        beams: See there.
        noise: See `information.BeamNoise`; without the map's deviation.
    """

    edges: Floats
    first: Ints
    place: float
    gate: float
    beams: ReflectorBeams
    noise: BeamNoise


@kernel
def expect(mean, cov, h, k, reflectors, view):
    """Compute what head h is expected to read of reflector k; return whether it may be used.

    Args:
        mean: Pose, shape (3,).
        cov: Its covariance, shape (3, 3).
        h: The head.
        k: The reflector.
        reflectors: See `ReflectorMap`.
        view: Written; columns as above.
    """
    co, si = math.cos(mean[2]), math.sin(mean[2])
    mx, my = reflectors.beams.head[h]
    # How the head moves when the robot turns, and where it is.
    jx, jy = -si * mx - co * my, co * mx - si * my
    px, py = mean[0] + jy, mean[1] - jx
    edges, low, high = reflectors.edges, reflectors.first[k], reflectors.first[k + 1]
    base = math.atan2(edges[low, 1] - py, edges[low, 0] - px)
    least = most = 0.0
    right = left = low
    right_end = left_end = 0
    for e in range(low, high):
        for end in (0, 2):
            angle = wrapped(math.atan2(edges[e, end + 1] - py, edges[e, end] - px) - base)
            if angle < least:
                least, right, right_end = angle, e, end
            if angle > most:
                most, left, left_end = angle, e, end
    width = most - least
    if not 0.0 < width <= WIDEST:
        return False
    total = square = along = 0.0
    step = width / ACROSS
    for i in range(ACROSS):
        off = (i + 0.5) * step - 0.5 * width
        d = _distance(px, py, base + 0.5 * (least + most) + off, edges, low, high)
        total, square, along = total + d, square + d * d, along + off * d
    if not total < math.inf:
        return False
    spread = step * step * (ACROSS * ACROSS - 1.0) / 12.0
    distance, slope = total / ACROSS, along / ACROSS / spread
    bearing = base + 0.5 * (least + most)
    bx = by = 0.0
    for e, end in ((right, right_end), (left, left_end)):
        dx, dy = edges[e, end] - px, edges[e, end + 1] - py
        bx += 0.5 * dy / (dx * dx + dy * dy)
        by -= 0.5 * dx / (dx * dx + dy * dy)
    rx, ry = -math.cos(bearing), -math.sin(bearing)
    bt, rt = bx * jx + by * jy - 1.0, rx * jx + ry * jy
    view[MIDDLE], view[DISTANCE], view[WIDTH] = bearing - mean[2], distance, width
    rough = square / ACROSS - distance * distance - slope * slope * spread
    view[SLOPE], view[ROUGH] = slope, max(rough, 0.0)
    view[BEARING_BY], view[_BY], view[_BT] = bx, by, bt
    view[RANGE_BY], view[_RY], view[_RT] = rx, ry, rt
    ux, uy, ut = times(cov, bx, by, bt)
    view[BB], view[BR] = bx * ux + by * uy + bt * ut, rx * ux + ry * uy + rt * ut
    ux, uy, ut = times(cov, rx, ry, rt)
    view[RR] = rx * ux + ry * uy + rt * ut
    return True


@kernel
def _distance(px, py, angle, edges, low, high):
    """Return the distance at which a ray meets some edges, metres; inf for a miss."""
    ux, uy = math.cos(angle), math.sin(angle)
    best = math.inf
    for e in range(low, high):
        ax, ay = edges[e, 0] - px, edges[e, 1] - py
        bx, by = edges[e, 2] - px, edges[e, 3] - py
        a, b = ux * ay - uy * ax, ux * by - uy * bx
        if a * b <= 0.0 and a != b:
            at = a / (a - b)
            d = ux * ax + uy * ay + at * (ux * (bx - ax) + uy * (by - ay))
            if 0.0 <= d < best:
                best = d
    return best


@kernel(inline="always")
def times(cov, x, y, t):
    """Return a covariance times a vector."""
    return (
        cov[0, 0] * x + cov[0, 1] * y + cov[0, 2] * t,
        cov[1, 0] * x + cov[1, 1] * y + cov[1, 2] * t,
        cov[2, 0] * x + cov[2, 1] * y + cov[2, 2] * t,
    )
