"""A scanner's rays in a building of prisms, cast from inside of kernels: one pose at a time."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.raycasting.prism_kernel import PrismArrays, within_solid
from ambinav.geometry.raycasting.prism_scans import (
    incidence_at,
    longest_of,
    packet_ranges,
    same_origin,
    turn_packet,
)
from ambinav.geometry.raycasting.ray_packets import Packets
from ambinav.geometry.raycasting.triangulation import locate
from ambinav.kernels import kernel

# A grid without cells, of the types that `Triangulation.index` has.
NOWHERE = (
    0.0, 0.0, 1.0, 0, 0, np.empty(0, dtype=np.int32), np.empty(0, dtype=np.int32),
    np.empty((0, 6)),
)  # fmt: skip


class PrismRays(NamedTuple):
    """All that `cast_prism_rays` reads; made by `Prisms.rays`.

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
    incidence: NDArray[np.float64]


@kernel
def cast_prism_rays(x, y, theta, rays, ux, uy, distance, hit, beam=None, reading=None):
    """How far the rays of a scanner go at one pose, and what they meet.

    Args:
        x: The robot, metres, map frame.
        y: Likewise.
        theta: Its heading, radians.
        rays: See `PrismRays`.
        ux: Written, shape (R,): x of each ray's unit vector, map frame.
        uy: Written: y of it.
        distance: Written, shape (R,), metres; inf where nothing within reach returns an echo, nan
            where the ray starts in what is solid or beside the plan.
        hit: Written, int32, shape (R,): surfaces, -1 for none.
        beam: Which beam each ray is of, shape (R,); read with `reading` alone.
        reading: Of each beam; packets whose beams all have no finite one are not cast, and meet
            nothing. None: all are cast.
    """
    packets, scene = rays.packets, rays.scene
    x0, y0, cell, grid_rows, grid_columns, start, item, triangle = rays.plan
    co, si = math.cos(theta), math.sin(theta)
    longest = longest_of(packets)
    best, met = np.empty(longest), np.empty(longest, dtype=np.int64)
    vx, vy = np.empty(longest), np.empty(longest)
    inside = False
    for c in range(packets.column.size):
        ox, oy = packets.origin[c, 0], packets.origin[c, 1]
        px, py = x + co * ox - si * oy, y + si * ox + co * oy
        low, high = packets.start[c], packets.start[c + 1]
        if c == 0 or not same_origin(packets.origin, c):
            inside = within_solid(px, py, packets.origin[c, 2], scene)
            if rays.bounded and not inside:
                inside = locate(
                    px, py, x0, y0, cell, grid_rows, grid_columns, start, item, triangle
                ) < 0  # fmt: skip
        wanted = not inside
        if reading is not None:
            some = False
            for i in range(low, high):
                some |= math.isfinite(reading[beam[packets.ray[i]]])
            wanted = wanted and some
        turn_packet(c, co, si, packets, vx, vy)
        if wanted:
            packet_ranges(c, px, py, vx, vy, packets, scene, rays.reach, best, met)
        else:
            best[:], met[:] = math.nan if inside else math.inf, -1
        for i in range(low, high):
            r, k, flat = packets.ray[i], met[i - low], packets.flat[i]
            ux[r], uy[r] = vx[i - low] * flat, vy[i - low] * flat
            distance[r], hit[r] = best[i - low], k
            if k >= 0 and rays.incidence[r] < math.inf:
                oblique = incidence_at(ux[r], uy[r], packets.rise[i], scene.normal, k)
                if oblique > rays.incidence[r]:
                    distance[r], hit[r] = math.inf, -1
