"""Scans in a building of prisms: the same rays from many poses, on several threads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambinav.casting.plane.triangulation import Triangulation
from ambinav.casting.prisms.kernel import PrismArrays
from ambinav.casting.prisms.scans import scan_packets
from ambinav.casting.ray_packets import packets_of
from ambinav.casting.space import Scans, SpaceRays
from ambinav.runtime.threads import run_rows

# Minimum number of rays for a further thread.
LEAST_RAYS = 2048


def cast_packets(
    scene: PrismArrays,
    plan: Triangulation | None,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    theta: NDArray[np.float64],
    rays: SpaceRays,
    max_range: float,
    *,
    incidence: bool,
) -> Scans:
    """Cast the same rays from many poses of the robot; see `SpaceCaster`.

    Args:
        scene: What rays meet.
        plan: Where they may start; None: anywhere but in what is solid.
        x: Poses, shape (N,), metres, map frame.
        y: Poses, shape (N,), metres.
        theta: Headings, shape (N,), radians.
        rays: R rays; heights count from z = 0 of the building.
        max_range: How far to look, metres.
        incidence: Work out the angles of incidence too.
    """
    x, y, theta = (np.ascontiguousarray(part, dtype=np.float64) for part in (x, y, theta))
    shape = len(x), len(rays.azimuth)
    distance = np.empty(shape, dtype=np.float32)
    surface = np.empty(shape, dtype=np.int32)
    oblique = np.empty(shape if incidence else (0, 0), dtype=np.float32)
    packets = packets_of(rays)
    run_rows(
        scan_packets, len(x), x, y, theta, packets, scene, float(max_range), distance,
        surface, oblique, least=1 + LEAST_RAYS // max(shape[1], 1),
    )  # fmt: skip
    if plan is not None:
        _mask_outside(plan, x, y, theta, rays, (distance, surface, oblique))
    return distance, surface, oblique


def _mask_outside(
    plan: Triangulation,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    theta: NDArray[np.float64],
    rays: SpaceRays,
    scans: Scans,
) -> None:
    """Set rays that start outside of the plan to nan."""
    distance, surface, oblique = scans
    c, s = np.cos(theta), np.sin(theta)
    mounts, which = np.unique(rays.origin[:, :2], axis=0, return_inverse=True)
    for k, (mx, my) in enumerate(mounts):
        rows = np.flatnonzero(~plan.contains(x + c * mx - s * my, y + s * mx + c * my))
        beside = np.ix_(rows, np.flatnonzero(which == k))
        distance[beside], surface[beside] = np.nan, -1
        if oblique.size:
            oblique[beside] = np.nan
