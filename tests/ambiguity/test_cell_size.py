"""Rasters of one building, fine and coarse, give the same levels."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from ambinav.ambiguity.build import build_map
from ambinav.geometry.boundary import environment_from_grid
from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy import FREE, OCCUPIED, OccupancyGrid, load_map_server
from ambinav.sensing import RangeScanner

CELLS = (0.025, 0.05, 0.1)
SPACING = 0.25
CLEAR = 0.3
WINDOW = 24.0
DEMO_MEDIAN = 0.01
MEDIAN = 0.02


def raster(env: Environment, cell: float) -> OccupancyGrid:
    """Cells are free where their centres are, all others occupied."""
    xmin, ymin, xmax, ymax = env.bounds
    left, low = xmin - 2.37 * cell, ymin - 2.37 * cell
    x = np.arange(left + cell / 2, xmax + 3 * cell, cell)
    y = np.arange(low + cell / 2, ymax + 3 * cell, cell)
    free = np.asarray(env.is_free(*np.meshgrid(x, y)))
    return OccupancyGrid(np.where(free, FREE, OCCUPIED).astype(np.uint8), cell, (left, low, 0.0))


def medians(building: Environment, scanner: RangeScanner) -> list[float]:
    """Median differences of `level` between the rasters, two by two."""
    found: list[np.ndarray] = []
    at: tuple[np.ndarray, np.ndarray] | None = None
    for cell in CELLS:
        amap = build_map(environment_from_grid(raster(building, cell)), scanner, SPACING)
        if at is None:
            row, column = np.nonzero(amap.dataset["clearance"].values >= CLEAR)
            at = amap.dataset["x"].values[column], amap.dataset["y"].values[row]
        found.append(np.asarray(amap.sample("level", *at)))
    return [float(np.nanmedian(np.abs(a - b))) for a, b in combinations(found, 2)]


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_drawn(demo: Environment, laser: RangeScanner, angle: float) -> None:
    assert max(medians(demo.transformed(angle), laser)) < DEMO_MEDIAN


def busiest(grid: OccupancyGrid) -> OccupancyGrid:
    """The window of `WINDOW` metres (and of 100 cells at least) with the most walls."""
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
    return replace(grid, state=np.ascontiguousarray(window), origin=(0.0, 0.0, 0.0))


def test_recorded(data_dir: Path, laser: RangeScanner) -> None:
    """Every map of the folder: its fitted walls, rasterised anew."""
    paths = sorted(data_dir.glob("*maps*/*.yaml"))
    assert len(paths) >= 30
    found = {}
    for path in paths:
        grid = busiest(load_map_server(path))
        # Maps of towns are taken for models of one: a cell of a metre is drawn as one of 25 cm.
        grid = replace(grid, resolution=min(grid.resolution, 0.25))
        building = environment_from_grid(grid)
        found[path.stem] = medians(building, laser)
        print(path.stem, *(f"{value:.4f}" for value in found[path.stem]))
    assert {name: most for name, most in found.items() if max(most) >= MEDIAN} == {}
    assert math.isfinite(sum(map(sum, found.values())))
