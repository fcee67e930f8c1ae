"""Rays that represent a scanner's beams, and the true range computed from their hits."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.array_types import Bools, Floats, Floats32, Indices

WIDEST_SPACING = math.radians(2.0)


@dataclass(frozen=True, eq=False)
class RayTable:
    """Rays of a scanner in the robot frame, beam after beam.

    Beam b owns the rays start[b] to start[b + 1] - 1: one for a laser. For a cone in the plane an
    odd number spread evenly over it, both edges and the axis included, at most 2 degrees apart; in
    space the axis and rings around it up to the edge, rings and the rays of each at most 2 degrees
    apart, those of the level fan among them.

    Attributes:
        origin: float64, shape (R, 2), metres.
        angle: float64, shape (R,), radians.
        start: intp, shape (B + 1,).
        max_range: float32, shape (R,): farthest distance in metres that returns an echo.
        max_incidence: float32, shape (R,): largest angle in radians to the surface normal that
            returns an echo, inf where every angle does.
        height: float64, shape (R,), metres above the floor.
        elevation: float64, shape (R,), radians above the horizon; 0 in the plane.
        edge: bool, shape (R,): whether it is at the edge of its cone; of a laser always.
    """

    origin: Floats
    angle: Floats
    start: Indices
    max_range: Floats32
    max_incidence: Floats32
    height: Floats
    elevation: Floats
    edge: Bools

    def __len__(self) -> int:
        """Return the number of rays R."""
        return len(self.angle)

    @property
    def specular(self) -> bool:
        """True if some ray echoes only from surfaces that it meets steeply enough."""
        return bool(np.isfinite(self.max_incidence).any())

    def echoes(self, distance: Floats32, incidence: Floats32) -> Floats32:
        """Return the distances, shape (N, R), with inf where the hit returns no echo.

        `incidence`, shape (N, R), is read only if the rays are `specular`.
        Only the first hit of a ray counts: a surface too oblique to echo still hides the rest.
        A distance of nan, where the ray starts outside the free space, stays.
        """
        silent = distance > self.max_range
        if self.specular:
            silent |= incidence > self.max_incidence
        return np.where(silent, np.float32(np.inf), distance)

    def of_beams(self, beams: NDArray[np.integer]) -> RayTable:
        """Return the rays of some beams, which are renumbered from 0."""
        counts = np.diff(self.start)[beams]
        start = np.concatenate([np.zeros(1, dtype=np.intp), np.cumsum(counts)])
        rays = np.repeat(self.start[beams] - start[:-1], counts) + np.arange(start[-1])
        names = [field.name for field in fields(self) if field.name != "start"]
        return RayTable(start=start, **{name: getattr(self, name)[rays] for name in names})

    def nearest(self, echo: Floats32) -> Floats32:
        """Return the smallest echo of each beam, shape (N, B), from those of the rays (N, R)."""
        if len(self) == len(self.start) - 1:
            return echo
        return np.asarray(np.minimum.reduceat(echo, self.start[:-1], axis=1))


def cone_offsets(aperture: float) -> Floats:
    """Return the angles of a cone's rays about its axis, radians, shape (odd,)."""
    half = math.ceil(aperture / 2 / WIDEST_SPACING - 1e-9)
    return np.linspace(-aperture / 2, aperture / 2, 2 * half + 1) if half else np.zeros(1)


def _fan(aperture: float) -> Floats:
    """Return azimuth and elevation of a level cone's rays about its axis; 1 at its edge, (n, 3)."""
    offset = cone_offsets(aperture)
    edge = np.zeros(len(offset))
    edge[[0, -1]] = 1.0
    return np.column_stack([offset, np.zeros(len(offset)), edge])


def _rings(aperture: float) -> Floats:
    """Return rays over the cone in space: its axis first, then rings, the edge last; see `_fan`."""
    parts = [np.zeros((1, 3))]
    offsets = cone_offsets(aperture)
    outward = offsets[len(offsets) // 2 + 1 :].tolist()
    for offset in outward:
        # A multiple of 4: the same above and below, left and right.
        count = 4 * math.ceil(math.tau * math.sin(offset) / WIDEST_SPACING / 4)
        turn = math.tau * np.arange(count) / count
        across, up = math.sin(offset) * np.cos(turn), math.sin(offset) * np.sin(turn)
        azimuth = np.arctan2(across, math.cos(offset))
        parts.append(np.column_stack([azimuth, np.arcsin(up), np.zeros(count)]))
    parts[-1][:, 2] = 1.0
    return np.concatenate(parts)


def _pitched(azimuth: Floats, elevation: Floats, tilt: Floats) -> tuple[Floats, Floats]:
    """Return azimuth and elevation of rays, (R,), about axes raised by `tilt`, (R,)."""
    flat, z = np.cos(elevation), np.sin(elevation)
    x, y = flat * np.cos(azimuth), flat * np.sin(azimuth)
    along, up = x * np.cos(tilt) - z * np.sin(tilt), x * np.sin(tilt) + z * np.cos(tilt)
    raised = np.arctan2(up, np.hypot(along, y))
    # Axes, and rays about a level axis, keep their exact values.
    same = (tilt == 0.0) | ((azimuth == 0.0) & (elevation == 0.0))
    return (np.where(same, azimuth, np.arctan2(y, along)), np.where(same, elevation + tilt, raised))


def make_rays(
    mounts: Floats,
    aperture: Floats,
    max_range: Floats,
    max_incidence: Floats,
    upright: Floats,
    in_space: bool = False,
) -> RayTable:
    """Make the rays of beams, with one entry per beam in each argument.

    Args:
        mounts: x, y and azimuth, shape (B, 3), metres and radians.
        aperture: Aperture of the cones, radians, shape (B,).
        max_range: Metres, shape (B,).
        max_incidence: Radians, shape (B,), inf where every angle echoes.
        upright: z and elevation of the axes, shape (B, 2), metres and radians.
        in_space: Whether cones reach up and down too.
    """
    shape = _rings if in_space else _fan
    cones = {a: shape(a) for a in np.unique(aperture).tolist()}
    offsets = [cones[a] for a in aperture.tolist()]
    counts = np.array([len(offset) for offset in offsets], dtype=np.intp)
    turned, raised, edge = np.concatenate(offsets).T
    tilt = np.repeat(upright[:, 1], counts)
    turned, raised = (turned, tilt + raised) if not in_space else _pitched(turned, raised, tilt)
    return RayTable(
        origin=np.repeat(mounts[:, :2], counts, axis=0),
        angle=np.repeat(mounts[:, 2], counts) + turned,
        start=np.concatenate([np.zeros(1, dtype=np.intp), np.cumsum(counts)]),
        max_range=np.repeat(max_range, counts).astype(np.float32),
        max_incidence=np.repeat(max_incidence, counts).astype(np.float32),
        height=np.repeat(upright[:, 0], counts),
        elevation=raised,
        edge=edge > 0.0,
    )
