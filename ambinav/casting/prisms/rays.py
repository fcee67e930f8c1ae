"""Rays of a scanner in a building of prisms, cast within kernels: one pose at a time."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ambinav.casting.plane.triangulation import locate
from ambinav.casting.prisms.kernel import PrismArrays, within_solid
from ambinav.casting.prisms.scans import (
    incidence_at,
    longest_of,
    packet_ranges,
    same_origin,
    turn_packet,
)
from ambinav.casting.prisms.wedge import no_marks
from ambinav.casting.ray_packets import Packets
from ambinav.runtime.array_types import Floats
from ambinav.runtime.kernels import kernel

# A grid without cells, of the types that `Triangulation.index` has.
NOWHERE = (
    0.0, 0.0, 1.0, 0, 0, np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32),
    np.empty((0, 6)),
)  # fmt: skip


class PrismRays(NamedTuple):
    """Input of `cast_prism_rays`; made by `Prisms.rays`.

    Attributes:
        packets: The R rays; heights count from z = 0 of the building.
        scene: The building.
        reach: How far to look, metres.
        bounded: Whether rays may start in `plan` alone.
        plan: What `triangulation.locate` takes, in its order.
        incidence: Largest angle to the normal that returns an echo, shape (R,), radians; inf where
            every angle does.
    """

    packets: Packets
    scene: PrismArrays
    reach: float
    bounded: bool
    plan: tuple[Any, ...]
    incidence: Floats


@kernel
def cast_prism_rays(x, y, theta, rays, ux, uy, distance, hit, beam, reading):
    """Cast the rays of a scanner at one pose, at any heading; write lengths and surfaces hit.

    Args:
        x: The robot, metres, map frame.
        y: Likewise.
        theta: Its heading, radians.
        rays: See `PrismRays`.
        ux: Written, shape (R,): x of each ray's unit vector, map frame.
        uy: Written: y of it.
        distance: Written, shape (R,), metres; inf where nothing is within reach, nan where the ray
            starts in what is solid or beside the plan.
        hit: Written, int32, shape (R,): surfaces, -1 for none.
        beam: Which beam each ray is of, shape (R,); read with `reading` alone.
        reading: Reading of each beam; packets whose beams all have no finite one are not cast, and
            meet nothing. None: all are cast.
    """
    packets, scene = rays.packets, rays.scene
    co, si = math.cos(theta), math.sin(theta)
    longest = longest_of(packets)
    best, met = np.empty(longest), np.empty(longest, dtype=np.int64)
    vx, vy = np.empty(longest), np.empty(longest)
    seen = no_marks(packets, scene)
    inside = False
    for c in range(packets.column.size):
        ox, oy = packets.origin[c, 0], packets.origin[c, 1]
        px, py = x + co * ox - si * oy, y + si * ox + co * oy
        low, high = packets.start[c], packets.start[c + 1]
        turn_packet(low, high, co, si, packets, vx, vy)
        if c == 0 or not same_origin(packets.origin, c):
            inside = _no_start(px, py, packets.origin[c, 2], rays)
        wanted = not inside
        if reading is not None:
            has_reading = False
            for i in range(low, high):
                has_reading |= math.isfinite(reading[beam[packets.ray[i]]])
            wanted = wanted and has_reading
        if wanted:
            packet_ranges(c, low, high, px, py, vx, vy, packets, scene, rays.reach, best, met, seen)
        else:
            best[:], met[:] = math.nan if inside else math.inf, -1
        for i in range(low, high):
            r, flat = packets.ray[i], packets.flat[i]
            ux[r], uy[r] = vx[i - low] * flat, vy[i - low] * flat
            distance[r], hit[r] = best[i - low], met[i - low]


@kernel
def cast_prism_sweep(poses, rays, ux, uy, distance, hit):
    """Cast each ray from its own pose of the robot; see `cast_prism_rays`.

    Rays of a packet that have the same pose are cast together.

    Args:
        poses: x, y (metres, map frame) and heading (radians) for each ray, shape (R, 3).
        rays: See `cast_prism_rays`, as all that follows.
        ux: See there.
        uy: See there.
        distance: See there.
        hit: See there.
    """
    packets, scene = rays.packets, rays.scene
    longest = longest_of(packets)
    best, met = np.empty(longest), np.empty(longest, dtype=np.int64)
    vx, vy = np.empty(longest), np.empty(longest)
    seen = no_marks(packets, scene)
    for c in range(packets.column.size):
        ox, oy = packets.origin[c, 0], packets.origin[c, 1]
        high = packets.start[c]
        while high < packets.start[c + 1]:
            low, high = high, high + 1
            x, y, theta = poses[packets.ray[low]]
            while high < packets.start[c + 1]:
                other = poses[packets.ray[high]]
                if not (other[0] == x and other[1] == y and other[2] == theta):
                    break
                high += 1
            co, si = math.cos(theta), math.sin(theta)
            px, py = x + co * ox - si * oy, y + si * ox + co * oy
            turn_packet(low, high, co, si, packets, vx, vy)
            if _no_start(px, py, packets.origin[c, 2], rays):
                best[:], met[:] = math.nan, -1
            else:
                packet_ranges(
                    c, low, high, px, py, vx, vy, packets, scene, rays.reach, best, met, seen
                )
            for i in range(low, high):
                r, flat = packets.ray[i], packets.flat[i]
                ux[r], uy[r] = vx[i - low] * flat, vy[i - low] * flat
                distance[r], hit[r] = best[i - low], met[i - low]


@kernel
def silence_oblique(rays, ux, uy, distance, hit):
    """Remove, in place, the hits of rays that meet a surface too obliquely for an echo.

    A ray that ends before any surface (-1) is left as it is.

    Args:
        rays: See `PrismRays`.
        ux: As `cast_prism_rays` leaves it, as all that follows.
        uy: See there.
        distance: See there.
        hit: See there.
    """
    packets, normal = rays.packets, rays.scene.normal
    for i in range(packets.ray.size):
        r = packets.ray[i]
        if hit[r] >= 0 and rays.incidence[r] < math.inf:
            oblique = incidence_at(ux[r], uy[r], packets.rise[i], normal, hit[r])
            if oblique > rays.incidence[r]:
                distance[r], hit[r] = math.inf, -1


@kernel(inline="always")
def _no_start(px, py, pz, rays):
    """Return whether no ray can start at a point: it is in a solid, or outside of the plan."""
    x0, y0, cell, grid_rows, grid_columns, start, item, triangle = rays.plan
    inside = within_solid(px, py, pz, rays.scene)
    if rays.bounded and not inside:
        inside = locate(px, py, x0, y0, cell, grid_rows, grid_columns, start, item, triangle) < 0
    return inside
