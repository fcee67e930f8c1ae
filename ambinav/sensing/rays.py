"""The rays that stand for a scanner's beams, and what their hits make of the true range."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

WIDEST_SPACING = math.radians(2.0)


@dataclass(frozen=True, eq=False)
class RayTable:
    """All rays of a scanner in the robot frame, beam after beam.

    Beam b owns the rays start[b] to start[b + 1] - 1: one for a laser; for a cone an odd number
    spread evenly over it, both edges and the axis included, at most 2 degrees apart. In space a
    cone is what it is in the plane: a level fan.

    Attributes:
        origin: float64, shape (R, 2), metres.
        angle: float64, shape (R,), radians.
        start: intp, shape (B + 1,).
        max_range: float32, shape (R,): farthest distance in metres that returns an echo.
        max_incidence: float32, shape (R,): largest angle in radians to the surface normal that
            returns an echo, inf where every angle does.
        height: float64, shape (R,), metres above the floor.
        elevation: float64, shape (R,), radians above the horizon; 0 in the plane.
    """

    origin: NDArray[np.float64]
    angle: NDArray[np.float64]
    start: NDArray[np.intp]
    max_range: NDArray[np.float32]
    max_incidence: NDArray[np.float32]
    height: NDArray[np.float64]
    elevation: NDArray[np.float64]

    def __len__(self) -> int:
        """Number of rays R."""
        return len(self.angle)

    @property
    def specular(self) -> bool:
        """Whether some ray echoes only from surfaces that it meets steeply enough."""
        return bool(np.isfinite(self.max_incidence).any())

    def echoes(
        self, distance: NDArray[np.float32], incidence: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Return the distances, shape (N, R), with inf where the hit returns no echo.

        `incidence`, shape (N, R), is read only if the rays are `specular`.
        Only the first hit of a ray counts: a surface too oblique to echo still hides the rest.
        A distance of nan, where the ray starts outside the free space, stays.
        """
        silent = distance > self.max_range
        if self.specular:
            silent |= incidence > self.max_incidence
        return np.where(silent, np.float32(np.inf), distance)

    def nearest(self, echo: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the smallest echo of each beam, shape (N, B), from those of the rays (N, R)."""
        if len(self) == len(self.start) - 1:
            return echo
        return np.asarray(np.minimum.reduceat(echo, self.start[:-1], axis=1))


def cone_offsets(aperture: float) -> NDArray[np.float64]:
    """Return the angles of a cone's rays about its axis, radians, shape (odd,)."""
    half = math.ceil(aperture / 2 / WIDEST_SPACING - 1e-9)
    return np.linspace(-aperture / 2, aperture / 2, 2 * half + 1) if half else np.zeros(1)


def make_rays(
    mounts: NDArray[np.float64],
    aperture: NDArray[np.float64],
    max_range: NDArray[np.float64],
    max_incidence: NDArray[np.float64],
    upright: NDArray[np.float64],
) -> RayTable:
    """Make the rays of beams, one entry each a beam.

    Args:
        mounts: x, y and azimuth, shape (B, 3), metres and radians.
        aperture: Of the cones, radians, shape (B,).
        max_range: Metres, shape (B,).
        max_incidence: Radians, shape (B,), inf where every angle echoes.
        upright: z and elevation, shape (B, 2), metres and radians.
    """
    fans = {a: cone_offsets(a) for a in np.unique(aperture).tolist()}
    offsets = [fans[a] for a in aperture.tolist()]
    counts = np.array([len(offset) for offset in offsets], dtype=np.intp)
    return RayTable(
        origin=np.repeat(mounts[:, :2], counts, axis=0),
        angle=np.repeat(mounts[:, 2], counts) + np.concatenate(offsets),
        start=np.concatenate([np.zeros(1, dtype=np.intp), np.cumsum(counts)]),
        max_range=np.repeat(max_range, counts).astype(np.float32),
        max_incidence=np.repeat(max_incidence, counts).astype(np.float32),
        height=np.repeat(upright[:, 0], counts),
        elevation=np.repeat(upright[:, 1], counts),
    )
