"""Scans in a building of prisms: the same rays from many poses, on several threads."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from ambinav.casting.plane.triangulation import Triangulation
from ambinav.casting.prisms.kernel import PrismArrays
from ambinav.casting.prisms.scans import scan_packets
from ambinav.casting.ray_packets import packets_of
from ambinav.casting.space import Scans, SpaceRays
from ambinav.runtime.array_types import Floats
from ambinav.runtime.threads import run_rows

# Minimum number of rays for a further thread.
LEAST_RAYS = 2048


class PrismCaster(ABC):
    """Base class of buildings of prisms, whose scans are cast from their arrays."""

    @property
    @abstractmethod
    def arrays(self) -> PrismArrays:
        """Arrays of the building for the kernels."""

    @property
    @abstractmethod
    def plan(self) -> Triangulation | None:
        """Area where rays of scans may start; None: anywhere but in what is solid."""

    def cast_scans(
        self,
        x: Floats,
        y: Floats,
        theta: Floats,
        rays: SpaceRays,
        max_range: float,
        *,
        incidence: bool = True,
    ) -> Scans:
        """Cast the same rays from many poses of the robot; see `SpaceCaster`."""
        x, y, theta = (np.ascontiguousarray(part, dtype=np.float64) for part in (x, y, theta))
        shape = len(x), len(rays.azimuth)
        distance = np.empty(shape, dtype=np.float32)
        surface = np.empty(shape, dtype=np.int32)
        oblique = np.empty(shape if incidence else (0, 0), dtype=np.float32)
        run_rows(
            scan_packets, len(x), x, y, theta, packets_of(rays), self.arrays, float(max_range),
            distance, surface, oblique, least=1 + LEAST_RAYS // max(shape[1], 1),
        )  # fmt: skip
        if self.plan is not None:
            _mask_outside(self.plan, x, y, theta, rays, (distance, surface, oblique))
        return distance, surface, oblique


def _mask_outside(
    plan: Triangulation, x: Floats, y: Floats, theta: Floats, rays: SpaceRays, scans: Scans
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
