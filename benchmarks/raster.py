"""Rasters of one building, fine and coarse, and the differences of their levels."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ambinav.buildings.boundary import environment_from_grid
from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from ambinav.map_building.build import build_map
from ambinav.sensing.scanner import RangeScanner

CELLS = (0.025, 0.05, 0.1)
"""Edges of the cells, metres."""
COARSEST = 0.25
"""Maps of towns are taken for models of one: a cell of a metre becomes one of so many metres."""
WINDOW = 24.0
CLEAR = 0.3
"""Levels are compared where walls are this far away, metres."""

Floats = NDArray[np.float64]


def raster(env: Environment, cell: float) -> OccupancyGrid:
    """Return a raster: cells are free where their centres are, and walls cross cells anywhere."""
    xmin, ymin, xmax, ymax = env.bounds
    left, low = xmin - 2.37 * cell, ymin - 2.37 * cell
    x = np.arange(left + cell / 2, xmax + 3 * cell, cell)
    y = np.arange(low + cell / 2, ymax + 3 * cell, cell)
    free = np.asarray(env.is_free(*np.meshgrid(x, y)))
    return OccupancyGrid(np.where(free, FREE, OCCUPIED).astype(np.uint8), cell, (left, low, 0.0))


def busiest(grid: OccupancyGrid) -> OccupancyGrid:
    """Return the window of `WINDOW` metres (and of 100 cells at least) with the most walls."""
    size = max(round(WINDOW / grid.resolution), 100)
    step = max(size // 4, 1)
    free = grid.state == FREE
    edges = np.zeros(np.add(grid.state.shape, 1), dtype=np.int64)
    edges[1:-1, 1:] += free[1:] != free[:-1]
    edges[1:, 1:-1] += free[:, 1:] != free[:, :-1]
    edges = np.cumsum(np.cumsum(edges, axis=0), axis=1)
    starts = [np.arange(0, max(n - size, 0) + 1, step) for n in grid.state.shape]
    r, c = np.meshgrid(*starts, indexing="ij")
    r1, c1 = (np.minimum(k + size, n) for k, n in zip((r, c), grid.state.shape, strict=True))
    count = edges[r1, c1] - edges[r, c1] - edges[r1, c] + edges[r, c]
    best = np.unravel_index(count.argmax(), count.shape)
    window = grid.state[r[best] : r1[best], c[best] : c1[best]]
    return replace(
        grid,
        state=np.ascontiguousarray(window),
        origin=(0.0, 0.0, 0.0),
        resolution=min(grid.resolution, COARSEST),
    )


def medians(
    building: Environment, scanner: RangeScanner, spacing: float = 0.25, by_cell: bool = False
) -> list[float]:
    """Return median differences of `level` between pairs of rasters of a building.

    Args:
        building: The building.
        scanner: The scanner.
        spacing: Spacing of the maps' lattices, metres.
        by_cell: Take the cell for the walls' standard deviation instead of the default.
    """
    levels: list[Floats] = []
    at: tuple[Floats, Floats] | None = None
    for cell in CELLS:
        env = environment_from_grid(raster(building, cell))
        amap = build_map(env, scanner, spacing, map_std=cell if by_cell else None, store=False)
        if at is None:
            row, column = np.nonzero(amap.dataset["clearance"].values >= CLEAR)
            at = amap.dataset["x"].values[column], amap.dataset["y"].values[row]
        levels.append(np.asarray(amap.sample("level", *at)))
    return [float(np.nanmedian(np.abs(a - b))) for a, b in combinations(levels, 2)]
