"""Space outside of the free space: solid or unknown."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.geometry.occupancy_grid import OCCUPIED, OccupancyGrid
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

MOST_SAMPLES: Final = 3
"""Points along the side of a lattice's cell at which a finer grid is looked at, at most."""
THICKEST: Final = 1.0
"""Metres; in a drawn plan a thinner strip between two rooms is a wall."""


def solid_cells(lattice: Lattice) -> Bools:
    """Return the cells of a lattice that contain something known to be solid, bool, shape (R, C).

    Over an occupancy grid those with an occupied cell in them (looked for at up to 3 x 3 points),
    also if the cell's centre is free. In a drawn plan those whose centre is not free but lies
    within the outline of a piece of free space or between two pieces: holes, obstacles, walls of
    up to `THICKEST`; of what lies beyond nothing is known.
    """
    backdrop = Backdrop.of(lattice.environment)
    return backdrop.solid(backdrop.over(lattice.x, lattice.y, lattice.spacing), lattice.free)


@dataclass(frozen=True, eq=False)
class Backdrop:
    """Solid space of a building, evaluated for one part of its lattice after the other.

    Attributes:
        grid: Its occupancy grid; None: it is drawn.
        occupied: Mask of the occupied cells of that.
        inside: What is solid or free in a drawn plan; None: it has a grid.
    """

    grid: OccupancyGrid | None
    occupied: Bools | None
    inside: BaseGeometry | None

    @classmethod
    def of(cls, environment: Environment) -> Backdrop:
        """Make the backdrop of a building."""
        grid = environment.occupancy
        if grid is None:
            return cls(None, None, _closed(environment.free))
        return cls(grid, grid.state == OCCUPIED, None)

    def over(self, x: Floats, y: Floats, spacing: float) -> Bools:
        """Return candidate cells, which are solid unless `solid` excludes them.

        Args:
            x: Centres of the columns, shape (C,), metres.
            y: Centres of the rows, shape (R,), metres.
            spacing: Edge of a cell, metres.

        Returns:
            Shape (R, C).
        """
        if self.grid is None:
            return np.asarray(shapely.contains_xy(self.inside, *np.meshgrid(x, y)), dtype=np.bool_)
        samples = min(max(math.ceil(spacing / self.grid.resolution - 1e-6), 1), MOST_SAMPLES)
        offsets = ((np.arange(samples) + 0.5) / samples - 0.5) * spacing
        solid = np.zeros((len(y), len(x)), dtype=np.bool_)
        run_rows(
            _mark_occupied, len(y), x, y, offsets, self.occupied, *self.grid.origin,
            self.grid.resolution, solid, least=32,
        )  # fmt: skip
        return solid

    def solid(self, over: Bools, free: Bools) -> Bools:
        """Return which of the cells `over` are solid, given which are free."""
        return over if self.inside is None else over & ~free


@kernel
def _mark_occupied(low, high, x, y, offsets, occupied, x0, y0, yaw, edge, solid):
    """Mark cells with an occupied state (`OccupancyGrid.state_at`) at one of the offsets."""
    c, s = math.cos(yaw), math.sin(yaw)
    rows, columns = occupied.shape
    for i in range(low, high):
        for j in range(x.size):
            for down in offsets:
                for right in offsets:
                    dx, dy = (x[j] + right - x0) / edge, (y[i] + down - y0) / edge
                    column, row = math.floor(c * dx + s * dy), math.floor(c * dy - s * dx)
                    if 0 <= column < columns and 0 <= row < rows:
                        solid[i, j] |= occupied[row, column]


def _closed(free: BaseGeometry) -> BaseGeometry:
    """Fill the outlines of pieces of free space, and the space between them."""
    parts = shapely.get_parts(free).tolist()
    polygons = [part for part in parts if isinstance(part, shapely.Polygon)]
    outlines = shapely.union_all([shapely.Polygon(part.exterior) for part in polygons])
    # Closed in the sense of morphology: strips between rooms are filled, corners stay.
    # GEOS divides by zero where a mitre has no tip, and cuts it off then; its result is right.
    with np.errstate(invalid="ignore"):
        wide = shapely.buffer(outlines, 0.5 * THICKEST, join_style="mitre")
        closed = shapely.buffer(wide, -0.5 * THICKEST, join_style="mitre")
    inside = shapely.union(outlines, closed)
    shapely.prepare(inside)
    return inside
