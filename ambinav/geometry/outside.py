"""What lies outside of the free space: solid, or not known."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.geometry.lattice import Lattice
from ambinav.geometry.occupancy_grid import OCCUPIED

MOST_SAMPLES: Final = 3
"""Points along the side of a lattice's cell at which a finer grid is looked at, at most."""
THICKEST: Final = 1.0
"""Metres; in a drawn plan a thinner strip between two rooms is a wall."""


def solid_cells(lattice: Lattice) -> NDArray[np.bool_]:
    """Cells of a lattice in which something is known to be solid, bool, shape (R, C).

    Over an occupancy grid those with an occupied cell in them (looked for at up to 3 x 3 points),
    also if the cell's centre is free. In a drawn plan those whose centre is not free but lies
    within the outline of a piece of free space or between two pieces: holes, obstacles, walls of
    up to `THICKEST`; of what lies beyond nothing is known.
    """
    return _drawn(lattice) if lattice.environment.occupancy is None else _occupied(lattice)


def _occupied(lattice: Lattice) -> NDArray[np.bool_]:
    grid = lattice.environment.occupancy
    assert grid is not None
    samples = min(max(math.ceil(lattice.spacing / grid.resolution - 1e-6), 1), MOST_SAMPLES)
    offsets = ((np.arange(samples) + 0.5) / samples - 0.5) * lattice.spacing
    x = lattice.x[:, np.newaxis] + offsets
    found = np.zeros(lattice.free.shape, dtype=np.bool_)
    # Row by row: a building's lattice may have millions of cells.
    for row, y in enumerate(lattice.y):
        for offset in offsets:
            state = grid.state_at(x, np.full_like(x, y + offset))
            found[row] |= (state == OCCUPIED).any(axis=1)
    return found


def _drawn(lattice: Lattice) -> NDArray[np.bool_]:
    parts = shapely.get_parts(lattice.environment.free).tolist()
    polygons = [part for part in parts if isinstance(part, shapely.Polygon)]
    outlines = shapely.union_all([shapely.Polygon(part.exterior) for part in polygons])
    # Closed in the sense of morphology: strips between rooms are filled, corners stay.
    # GEOS divides by zero where a mitre has no tip, and cuts it off then; its result is right.
    with np.errstate(invalid="ignore"):
        wide = shapely.buffer(outlines, 0.5 * THICKEST, join_style="mitre")
        closed = shapely.buffer(wide, -0.5 * THICKEST, join_style="mitre")
    inside = shapely.union(outlines, closed)
    shapely.prepare(inside)
    x, y = np.meshgrid(lattice.x, lattice.y)
    return np.asarray(shapely.contains_xy(inside, x, y) & ~lattice.free, dtype=np.bool_)
