"""Packets of rays and single rays, cast through a building of prisms."""

from __future__ import annotations

import math

import numpy as np

from ambinav.casting.prisms.kernel import cast_column, cast_upright, length_along, within_solid
from ambinav.casting.prisms.wedge import cast_wedge, no_marks
from ambinav.casting.ray_packets import UPRIGHT
from ambinav.runtime.kernels import kernel


@kernel(_nrt=False)
def longest_of(packets):
    """Return the number of rays in the longest packet, at least 1."""
    longest = 1
    for c in range(packets.column.size):
        longest = max(longest, packets.start[c + 1] - packets.start[c])
    return longest


@kernel(inline="always")
def same_origin(origin, c):
    """Return whether packet c starts at the same point as the packet before it."""
    return (
        (origin[c, 0] == origin[c - 1, 0])
        & (origin[c, 1] == origin[c - 1, 1])
        & (origin[c, 2] == origin[c - 1, 2])
    )


@kernel(_nrt=False)
def turn_packet(low, high, co, si, packets, ux, uy):
    """Write the directions in the plane of n rays, turned by a heading.

    Args:
        low: Entry of the first of them.
        high: One past that of the last.
        co: Cosine of the heading.
        si: Sine of the heading.
        packets: See `Packets`.
        ux: The first n are written: x of unit vectors in the plane, map frame.
        uy: Likewise: y of them.
    """
    for i in range(low, high):
        cosine, sine = packets.cosine[i], packets.sine[i]
        ux[i - low], uy[i - low] = co * cosine - si * sine, si * cosine + co * sine


@kernel(_nrt=False)
def packet_ranges(c, low, high, px, py, ux, uy, packets, scene, reach, best, hit, seen):
    """Write the distances of n rays of packet c, which must not start in a solid.

    Args:
        c: Which packet.
        low: The first of its entries that is cast.
        high: One past the last of them.
        px: Origin, metres, map frame.
        py: Origin.
        ux: See `turn_packet`.
        uy: Likewise.
        packets: See `Packets`.
        scene: See `PrismArrays`.
        reach: How far to look, metres.
        best: The first n are written, metres; inf where nothing is met.
        hit: The first n are written: the surface that is met, -1 for none.
        seen: See `no_marks`.
    """
    ux, uy, best, hit = ux[: high - low], uy[: high - low], best[: high - low], hit[: high - low]
    pz, upright = packets.origin[c, 2], packets.flat[low] < UPRIGHT
    if upright:
        best[0], hit[0] = cast_upright(px, py, pz, packets.rise[low], reach, scene)
    else:
        for i in range(low, high):
            best[i - low] = reach * packets.flat[i]
        slope, per_slope = packets.slope[low:high], packets.per_slope[low:high]
        if packets.column[c] or high - low == 1:
            cast_column(px, py, pz, ux, uy, slope, per_slope, best, hit, scene)
        else:
            cast_wedge(px, py, pz, ux, uy, slope, per_slope, best, hit, scene, seen)
    for i in range(low, high):
        k = hit[i - low]
        if k < 0:
            best[i - low] = math.inf
        elif not upright:
            flat, rise = packets.flat[i], packets.rise[i]
            best[i - low] = length_along(best[i - low], k, pz, flat, rise, scene)


@kernel(inline="always")
def incidence_at(vx, vy, vz, normal, k):
    """Return the angle between a ray and the normal of surface k, radians in [0, pi/2].

    The ray is a unit vector.
    """
    nx, ny, nz = normal[k, 0], normal[k, 1], normal[k, 2]
    facing = abs(vx * nx + vy * ny + vz * nz)
    cx, cy, cz = vy * nz - vz * ny, vz * nx - vx * nz, vx * ny - vy * nx
    return math.atan2(math.sqrt(cx * cx + cy * cy + cz * cz), facing)


@kernel
def scan_packets(begin, end, x, y, theta, packets, scene, reach, distance, surface, incidence):
    """Cast the scans at poses `begin` to `end` - 1; see `Prisms.cast_scans`."""
    longest = longest_of(packets)
    best, hit = np.empty(longest), np.empty(longest, dtype=np.int64)
    ux, uy = np.empty(longest), np.empty(longest)
    seen = no_marks(packets, scene)
    for p in range(begin, end):
        oblique = incidence[p] if incidence.size > 0 else incidence[:0].ravel()
        _scan(
            x[p], y[p], theta[p], packets, scene, reach, ux, uy, best, hit, seen, distance[p],
            surface[p], oblique,
        )  # fmt: skip


@kernel(_nrt=False)
def _scan(
    x, y, theta, packets, scene, reach, ux, uy, best, hit, seen, distance, surface, incidence
):
    co, si = math.cos(theta), math.sin(theta)
    inside = False
    for c in range(packets.column.size):
        ox, oy, pz = packets.origin[c, 0], packets.origin[c, 1], packets.origin[c, 2]
        px, py = x + co * ox - si * oy, y + si * ox + co * oy
        low, high = packets.start[c], packets.start[c + 1]
        if c == 0 or not same_origin(packets.origin, c):
            inside = within_solid(px, py, pz, scene)
        turn_packet(low, high, co, si, packets, ux, uy)
        if inside:
            best[:], hit[:] = math.nan, -1
        else:
            packet_ranges(c, low, high, px, py, ux, uy, packets, scene, reach, best, hit, seen)
        for i in range(low, high):
            r, k = packets.ray[i], hit[i - low]
            surface[r], distance[r] = k, best[i - low]
            if incidence.size > 0:
                flat = packets.flat[i]
                incidence[r] = math.nan
                if k >= 0:
                    incidence[r] = incidence_at(
                        ux[i - low] * flat, uy[i - low] * flat, packets.rise[i], scene.normal, k
                    )


@kernel
def cast_single(begin, end, origin, direction, scene, reach, distance, surface):
    """Cast rays `begin` to `end` - 1, unit vectors; see `Prisms.cast`."""
    slope, per_slope, best = np.empty(1), np.empty(1), np.empty(1)
    ux, uy = np.empty(1), np.empty(1)
    hit = np.empty(1, dtype=np.int64)
    for r in range(begin, end):
        px, py, pz = origin[r, 0], origin[r, 1], origin[r, 2]
        flat, rise = math.hypot(direction[r, 0], direction[r, 1]), direction[r, 2]
        if flat < UPRIGHT:
            distance[r], surface[r] = cast_upright(px, py, pz, rise, reach, scene)
            continue
        slope[0], best[0] = rise / flat, reach * flat
        per_slope[0] = 1.0 / slope[0]
        ux[0], uy[0] = direction[r, 0] / flat, direction[r, 1] / flat
        cast_column(px, py, pz, ux, uy, slope, per_slope, best, hit, scene)
        surface[r] = hit[0]
        distance[r] = reach
        if hit[0] >= 0:
            distance[r] = length_along(best[0], hit[0], pz, flat, rise, scene)
