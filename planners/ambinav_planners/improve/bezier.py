"""Rounding of a route's corners by cubic Bezier curves, where that is free and not dearer.

As in Hu et al. 2016 a corner between two straight motions is replaced by a cubic curve that is
tangent to both. Its handles are those of the circular arc that touches both, 4/3 tan(turn/4) radii
long: so looks a shortest path around an obstacle.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.runtime.kernels import kernel
from ambinav_planners.improve.kernel import put, route_price, turn_at, wrap_angle

# Corners that turn by less, radians, are left as they are.
SMALLEST_TURN = math.radians(1.0)
# A curve is laid as straight motions that turn by at most this, radians.
TURN_PER_PIECE = math.radians(5.0)
MOST_PIECES = 36
# How often the offset of a curve from its corner is halved before the corner is left.
HALVINGS = 6
# Points nearer than this, metres, are one: a motion between them would look anywhere.
SAME_PLACE = 1e-6


@kernel
def corner_curve(a, corner, b, offset, pieces, out):
    """Write points of the curve around a corner, from `offset` metres before to as much after it.

    Args:
        a: The pose before, float64, shape (3,).
        corner: The pose at the corner.
        b: The pose behind.
        offset: Metres, at most the length of either motion.
        pieces: How many straight motions.
        out: float64, shape (pieces + 1, 3) at least: takes the points. Headings go evenly from
            the one at the curve's start to the one at its end, through no certain one between.
    """
    ax, ay = corner[0] - a[0], corner[1] - a[1]
    bx, by = b[0] - corner[0], b[1] - corner[1]
    before, behind = math.hypot(ax, ay), math.hypot(bx, by)
    turn = abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by))
    # Handle of an arc of this turn, 4/3 tan(turn/4) radii, the radius being offset / tan(turn/2).
    reach = offset * (1.0 - 4.0 / 3.0 * math.tan(turn / 4.0) / math.tan(turn / 2.0))
    ux, uy, vx, vy = ax / before, ay / before, bx / behind, by / behind
    t0 = corner[2] - wrap_angle(corner[2] - a[2]) * offset / before
    t1 = corner[2] + wrap_angle(b[2] - corner[2]) * offset / behind
    for k in range(pieces + 1):
        s = k / pieces
        # Bernstein polynomials, as weights of the four control points relative to the corner.
        w0, w1 = (1.0 - s) ** 3, 3.0 * s * (1.0 - s) ** 2
        w2, w3 = 3.0 * s * s * (1.0 - s), s**3
        back, forth = w0 * offset + w1 * reach, w3 * offset + w2 * reach
        out[k, 0] = corner[0] - back * ux + forth * vx
        out[k, 1] = corner[1] - back * uy + forth * vy
        out[k, 2] = t0 + s * wrap_angle(t1 - t0)


@kernel
def round_corners(kind, radius, poses, field, walls):
    """Round every corner by the cheapest curve, if it costs no more than the corner.

    Args:
        kind: Kind of motion, a straight one.
        radius: Not used by straight motions.
        poses: float64, shape (N, 3); no motion without length.
        field: Field arguments of `motion_integral`.
        walls: Wall arguments of `motion_free`.

    Returns:
        float64, shape (M, 3); first and last pose as they were.
    """
    count = poses.shape[0]
    room = np.empty(count - 1)
    for i in range(count - 1):
        room[i] = math.hypot(poses[i + 1, 0] - poses[i, 0], poses[i + 1, 1] - poses[i, 1])
    out = np.empty((count * (MOST_PIECES + 1), 3))
    curve, best = np.empty((MOST_PIECES + 1, 3)), np.empty((MOST_PIECES + 1, 3))
    spur = np.empty((3, 3))
    put(poses[0], out, 0)
    size = 1
    for i in range(1, count - 1):
        turn = abs(turn_at(poses, i))
        # The corners at both ends of a motion share it; a route's ends use no part of it.
        most = min(
            room[i - 1] * (1.0 if i == 1 else 0.5), room[i] * (1.0 if i == count - 2 else 0.5)
        )
        pieces = min(max(int(math.ceil(turn / TURN_PER_PIECE)), 2), MOST_PIECES)
        taken = 0
        if turn > SMALLEST_TURN:
            least, offset = np.inf, most
            for _ in range(HALVINGS):
                corner_curve(poses[i - 1], poses[i], poses[i + 1], offset, pieces, curve)
                put(curve[0], spur, 0)
                put(poses[i], spur, 1)
                put(curve[pieces], spur, 2)
                straight = route_price(kind, radius, spur, np.inf, field, walls)
                curved = curve[: pieces + 1]
                saved = straight - route_price(kind, radius, curved, straight, field, walls)
                if saved >= 0.0 and saved > -least:
                    least, taken = -saved, pieces + 1
                    for k in range(taken):
                        put(curve[k], best, k)
                offset *= 0.5
        if taken == 0:
            put(poses[i], out, size)
            size += 1
        for k in range(taken):
            # Two curves may meet in the middle of a motion: one point there is enough.
            if not _same_place(out[size - 1], best[k]):
                put(best[k], out, size)
                size += 1
    if size > 1 and _same_place(out[size - 1], poses[count - 1]):
        size -= 1
    put(poses[count - 1], out, size)
    return out[: size + 1].copy()


@kernel(inline="always")
def _same_place(a, b):
    return math.hypot(a[0] - b[0], a[1] - b[1]) < SAME_PLACE
