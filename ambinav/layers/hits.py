"""Surfaces that the beams of a scanner meet, one entry a beam: for a cone, at its nearest ray."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambinav.casting.scans import plane_only, scan_rays
from ambinav.geometry.environment import Environment
from ambinav.runtime.array_types import Floats, Floats32
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav.sensing.scanner import RangeScanner

NOTHING = -1


@dataclass(frozen=True, eq=False)
class Hits:
    """Surfaces that the B beams of a scanner meet at N poses.

    Attributes:
        distance: True range, float32, shape (N, B), metres from the sensor; inf where nothing
            returns an echo, nan where a sensor of the beam is outside the free space.
        normal: Unit normal of the surface, towards the sensor, float32, shape (N, B, 2), map
            frame; nan where nothing is met.
        angle: Direction of the ray that the range is of, float32, shape (N, B), radians, map
            frame; nan where nothing is met.
        kind: int8, shape (N, B): one of `ambinav.geometry.segments`, or `NOTHING`.
    """

    distance: Floats32
    normal: Floats32
    angle: Floats32
    kind: NDArray[np.int8]


def beam_hits(
    environment: Environment, scanner: RangeScanner, x: Floats, y: Floats, theta: float
) -> Hits:
    """Cast every beam of the scanner at the poses (x, y, theta), x and y of shape (N,).

    Raises:
        InputError: the building is in space, or the scanner needs one that is.
    """
    plane_only(environment, "what each beam meets")
    rays = scanner.rays()
    distance, segment, incidence = scan_rays(
        environment, x, y, np.full(len(x), theta), rays.origin, rays.angle, scanner.max_range,
        height=rays.height, elevation=rays.elevation, incidence=rays.specular,
    )  # fmt: skip
    shape = (len(x), scanner.beams)
    hits = Hits(
        np.full(shape, np.inf, dtype=np.float32),
        np.full((*shape, 2), np.nan, dtype=np.float32),
        np.full(shape, np.nan, dtype=np.float32),
        np.full(shape, NOTHING, dtype=np.int8),
    )
    run_rows(
        _nearest, len(x), distance, segment, incidence,
        environment.normals(np.arange(len(environment.segments))), environment.segments.kind,
        theta + rays.angle, rays.start, rays.max_range, rays.max_incidence, hits.distance,
        hits.normal, hits.angle, hits.kind, least=128,
    )  # fmt: skip
    return hits


@kernel
def _nearest(
    low, high, distance, segment, incidence, normals, kinds, angles, start, limit, steepest,
    out_distance, out_normal, out_angle, out_kind,
):  # fmt: skip
    for p in range(low, high):
        for b in range(start.size - 1):
            best, blind = -1, False
            d = math.inf
            for r in range(start[b], start[b + 1]):
                blind |= math.isnan(distance[p, r])
                if not distance[p, r] < d or distance[p, r] > limit[r]:
                    continue
                if incidence.size > 0 and incidence[p, r] > steepest[r]:
                    continue
                d = distance[p, r]
                best = r
            if blind:
                out_distance[p, b] = math.nan
            elif best >= 0:
                k = segment[p, best]
                nx, ny = normals[k, 0], normals[k, 1]
                towards = nx * math.cos(angles[best]) + ny * math.sin(angles[best])
                side = -1.0 if towards > 0.0 else 1.0
                out_distance[p, b] = d
                out_normal[p, b, 0] = side * nx
                out_normal[p, b, 1] = side * ny
                out_angle[p, b] = angles[best]
                out_kind[p, b] = kinds[k]
