"""Scans in a building of prisms: rays sorted into columns, and all of them cast from many poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.raycasting.prism_kernel import UPRIGHT, Columns, PrismArrays, scan_columns
from ambinav.geometry.raycasting.space import Scans, SpaceRays
from ambinav.geometry.raycasting.triangulation import Triangulation
from ambinav.threads import run_rows

# Fewer rays are not worth waking a thread for.
LEAST_RAYS = 2048


def columns_of(rays: SpaceRays) -> Columns:
    """The rays, sorted into columns: those of exactly one origin and azimuth, lowest first."""
    flat, rise = np.cos(rays.elevation), np.sin(rays.elevation)
    upright = np.where(flat < UPRIGHT, np.arange(len(flat)) + 1.0, 0.0)
    key = np.column_stack([rays.origin, rays.azimuth, upright])
    _, first, which = np.unique(key, axis=0, return_index=True, return_inverse=True)
    order = np.lexsort((rays.elevation, which))
    slope = (rise / np.where(upright > 0.0, 1.0, flat))[order]
    per_slope = np.divide(1.0, slope, out=np.full(len(slope), np.inf), where=slope != 0.0)
    return Columns(
        np.ascontiguousarray(rays.origin[first]),
        np.cos(rays.azimuth[first]),
        np.sin(rays.azimuth[first]),
        np.searchsorted(which[order], np.arange(len(first) + 1)),
        order,
        np.where(upright > 0.0, 0.0, flat)[order],
        rise[order],
        slope,
        per_slope,
    )


def cast_columns(
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
    columns = columns_of(rays)
    run_rows(
        scan_columns, len(x), x, y, theta, columns, scene, float(max_range), distance,
        surface, oblique, least=1 + LEAST_RAYS // max(shape[1], 1),
    )  # fmt: skip
    if plan is not None:
        _leave_out(plan, x, y, theta, rays, (distance, surface, oblique))
    return distance, surface, oblique


def _leave_out(
    plan: Triangulation,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    theta: NDArray[np.float64],
    rays: SpaceRays,
    scans: Scans,
) -> None:
    """Make those rays nan that start beside the plan."""
    distance, surface, oblique = scans
    c, s = np.cos(theta), np.sin(theta)
    mounts, which = np.unique(rays.origin[:, :2], axis=0, return_inverse=True)
    for k, (mx, my) in enumerate(mounts):
        rows = np.flatnonzero(~plan.contains(x + c * mx - s * my, y + s * mx + c * my))
        beside = np.ix_(rows, np.flatnonzero(which == k))
        distance[beside], surface[beside] = np.nan, -1
        if oblique.size:
            oblique[beside] = np.nan
