"""Maps made from a log: beams counted in grid cells at the log's corrected poses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ambinav.buildings.boundary import MIN_AREA, environment_from_grid
from ambinav.buildings.map_server import COARSEST, FINEST, FURTHEST, MAX_CELLS
from ambinav.config import as_positive
from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from ambinav.logs.log import Log
from ambinav.logs.ray_counts import count_rays
from ambinav.runtime.array_types import Ints32
from ambinav.runtime.errors import InputError

RESOLUTION: Final = 0.05
# Beyond this an error of half a degree in the pose moves the end of a beam by 0.2 m.
REACH: Final = 25.0
OCCUPIED_SHARE: Final = 0.3


@dataclass(frozen=True, eq=False)
class RayCounts:
    """Number of times that each cell of a grid was seen.

    Attributes:
        hits: int32, shape (rows, columns): beams that end in the cell; row 0 at the smallest y.
        passes: int32, same shape: beams that go through the cell and end behind it.
        resolution: Edge of a cell, metres.
        origin: x, y of the outer corner of cell (0, 0) in the map frame, metres.
    """

    hits: Ints32
    passes: Ints32
    resolution: float
    origin: tuple[float, float]

    def grid(self, occupied_share: float = OCCUPIED_SHARE) -> OccupancyGrid:
        """Classify the cells as occupied, free or unknown.

        A cell is occupied if at least `occupied_share` of the beams that reach it end in it,
        unknown if none reaches it, else free.

        Raises:
            InputError: the share is not above 0 and at most 1.
        """
        if not 0.0 < occupied_share <= 1.0:
            raise InputError(f"occupied_share is {occupied_share}; give more than 0 and at most 1.")
        seen = self.hits + self.passes
        state = np.full(seen.shape, UNKNOWN, dtype=np.uint8)
        state[seen > 0] = FREE
        state[(self.hits > 0) & (self.hits >= occupied_share * seen)] = OCCUPIED
        return OccupancyGrid(state, self.resolution, (*self.origin, 0.0))


def ray_counts(log: Log, resolution: float = RESOLUTION, *, reach: float = REACH) -> RayCounts:
    """Count the beams of all scans of a log in the cells of a grid around them.

    Args:
        log: Scans with poses.
        resolution: Edge of a cell, metres.
        reach: Readings beyond this many metres show free space as far as that and no wall.
            Beams without return tell nothing: what swallows an echo may be near.

    Raises:
        InputError: the log has no poses or no reading, a value is out of its range, or the grid
            would be too large.
    """
    if not FINEST <= resolution <= COARSEST:
        raise InputError(
            f"resolution is {resolution}; give the edge of a cell, {FINEST:g} to {COARSEST:g} m."
        )
    reach = as_positive(reach, "reach", "metres")
    poses = log.laser_poses
    seen = np.isfinite(log.ranges)
    where = log.source or log.name
    if not seen.any():
        raise InputError(f"{where}: no beam of it returns, so there is nothing to map.")
    far = float(np.abs(poses[:, :2]).max())
    if far > FURTHEST:
        raise InputError(f"{where}: a pose is {far:g} m from the origin; give the poses in metres.")
    length = np.where(seen, np.minimum(log.ranges, reach), 0.0)
    direction = poses[:, 2:] + log.angles
    x = poses[:, :1] + length * np.cos(direction)
    y = poses[:, 1:2] + length * np.sin(direction)
    # A cell of margin all round: whole cells, so that equal maps have equal grids.
    left = (math.floor(min(x.min(), poses[:, 0].min()) / resolution) - 1) * resolution
    low = (math.floor(min(y.min(), poses[:, 1].min()) / resolution) - 1) * resolution
    columns = math.floor((max(x.max(), poses[:, 0].max()) - left) / resolution) + 2
    rows = math.floor((max(y.max(), poses[:, 1].max()) - low) / resolution) + 2
    if rows * columns > MAX_CELLS:
        raise InputError(
            f"{where}: resolution {resolution:g} m makes {rows} x {columns} cells, more than "
            f"{MAX_CELLS}; give a coarser one."
        )
    hits = np.zeros((rows, columns), dtype=np.int32)
    passes = np.zeros((rows, columns), dtype=np.int32)
    count_rays(
        poses, log.angles, log.ranges, float(reach), left, low, float(resolution), hits, passes
    )
    return RayCounts(hits, passes, resolution, (left, low))


def map_from_log(
    log: Log,
    resolution: float = RESOLUTION,
    *,
    reach: float = REACH,
    occupied_share: float = OCCUPIED_SHARE,
    tolerance: float | None = None,
    gap: float | None = None,
    min_area: float = MIN_AREA,
) -> Environment:
    """Make an environment from the scans of a log at its poses, as from a map file.

    To test with scans that the map does not know, make it from a part of them:
    `first, rest = log.every(2)`, `map_from_log(first)`, and replay `rest`.

    The near side of the cells that are hit becomes the wall, so walls stand about half a cell too
    near: on the logs intel and aces the other scans read 3 and 2 cm more than the map at cells of
    5 cm (median; 1.4 and 0.7 cm at 2.5 cm, with nearly three times as many segments).

    Args:
        log: Scans with poses.
        resolution: Edge of a cell, metres.
        reach: See `ray_counts`.
        occupied_share: See `RayCounts.grid`.
        tolerance: See `environment_from_grid`.
        gap: See `environment_from_grid`.
        min_area: See `environment_from_grid`.

    Raises:
        InputError: the log has no poses, a value is out of its range, or no free space is left.
    """
    grid = ray_counts(log, resolution, reach=reach).grid(occupied_share)
    made = environment_from_grid(grid, tolerance=tolerance, gap=gap, min_area=min_area)
    return Environment(
        made.segments,
        made.free,
        name=log.name,
        resolution=made.resolution,
        notes=(*made.notes, f"Made from {log.scans} scans of the log {log.name}."),
        extent=made.extent,
        occupancy=made.occupancy,
        drivable=made.drivable,
    )
