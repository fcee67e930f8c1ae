"""Rays against vertical obstacles that stand on the floor or move: cylinders and boxes."""

from __future__ import annotations

import math

from ambinav.casting.ray_packets import UPRIGHT
from ambinav.runtime.kernels import kernel


@kernel
def cylinder_entry(wx, wy, ux, uy, rise, z, radius, top):
    """Compute the distance along a ray to its entry into an upright cylinder.

    Args:
        wx: From the ray's start to the axis, metres.
        wy: Likewise.
        ux: x of the ray's unit vector.
        uy: Likewise.
        rise: Likewise, upward.
        z: Height of the start above the floor, metres.
        radius: Radius of the cylinder, metres.
        top: Height of it, metres; it stands on the floor.

    Returns:
        Metres; inf where the ray passes it or starts in it.
    """
    flat = math.sqrt(ux * ux + uy * uy)
    if flat < UPRIGHT:
        if wx * wx + wy * wy > radius * radius:
            return math.inf
        return _between_heights(-math.inf, math.inf, rise, z, top)
    along, across = (wx * ux + wy * uy) / flat, (wx * uy - wy * ux) / flat
    inside = radius * radius - across * across
    if inside <= 0.0:
        return math.inf
    half = math.sqrt(inside)
    return _between_heights((along - half) / flat, (along + half) / flat, rise, z, top)


@kernel
def box_entry(wx, wy, ux, uy, rise, z, ax, ay, bx, by, top):
    """Compute the distance along a ray to its entry into an upright box; see `cylinder_entry`.

    The box has a middle and two vectors from there to the middles of two sides.

    Args:
        wx: From the ray's start to the middle, metres.
        wy: Likewise.
        ux: See `cylinder_entry`.
        uy: See there.
        rise: See there.
        z: See there.
        ax: One of the two vectors, metres; they are at right angles.
        ay: Likewise.
        bx: The other.
        by: Likewise.
        top: See there.
    """
    a2, b2 = ax * ax + ay * ay, bx * bx + by * by
    # Between the two pairs of parallel sides: shares of the half edges along the ray.
    va, vb = (ux * ax + uy * ay) / a2, (ux * bx + uy * by) / b2
    oa, ob = (wx * ax + wy * ay) / a2, (wx * bx + wy * by) / b2
    into, out = -math.inf, math.inf
    if va != 0.0:
        into, out = oa / va - 1.0 / abs(va), oa / va + 1.0 / abs(va)
    elif abs(oa) > 1.0:
        return math.inf
    if vb != 0.0:
        into = max(into, ob / vb - 1.0 / abs(vb))
        out = min(out, ob / vb + 1.0 / abs(vb))
    elif abs(ob) > 1.0:
        return math.inf
    return _between_heights(into, out, rise, z, top)


@kernel
def _between_heights(into, out, rise, z, top):
    """Return the distance at which a ray over a body from `into` to `out` enters it.

    Return inf if it does not.
    """
    if rise == 0.0:
        if z > top:
            return math.inf
    else:
        at_floor, at_top = -z / rise, (top - z) / rise
        into, out = max(into, min(at_floor, at_top)), min(out, max(at_floor, at_top))
    return into if 0.0 < into <= out else math.inf
