"""Cells inside of polygons and under lines, against shapely one by one."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from shapely import affinity

from ambinav.export.raster import Raster

LATTICE = Raster(-1.0, 2.0, 0.25, (40, 60))


def centres(raster: Raster) -> tuple[np.ndarray, np.ndarray]:
    ny, nx = raster.shape
    x = raster.x + (np.arange(nx) + 0.5) * raster.resolution
    y = raster.y + (np.arange(ny) + 0.5) * raster.resolution
    return np.meshgrid(x, y)


@pytest.mark.parametrize("seed", range(5))
def test_inside_is_what_shapely_says_of_the_centres(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = shapely.union_all(
        [
            affinity.rotate(shapely.box(*low, *(low + rng.uniform(0.3, 5.0, 2))), angle)
            for low, angle in zip(
                rng.uniform((-3, 0), (13, 11), (12, 2)), rng.uniform(0, 90, 12), strict=True
            )
        ]
    ).difference(shapely.Point(4, 6).buffer(1.3))
    x, y = centres(LATTICE)
    np.testing.assert_array_equal(LATTICE.inside(shape), shapely.contains_xy(shape, x, y))


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 5))]
)
def test_crossed_are_the_cells_that_a_line_runs_through(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lines = rng.uniform((-3, 0, -3, 0), (16, 14, 16, 14), (20, 4))
    ny, nx = LATTICE.shape
    expected = np.zeros((ny, nx), dtype=bool)
    for row in range(ny):
        for column in range(nx):
            x = LATTICE.x + column * 0.25
            y = LATTICE.y + row * 0.25
            cell = shapely.box(x, y, x + 0.25, y + 0.25)
            strings = shapely.linestrings(lines.reshape(-1, 2, 2))
            expected[row, column] = shapely.length(shapely.intersection(strings, cell)).max() > 1e-9
    np.testing.assert_array_equal(LATTICE.crossed(lines), expected)


def test_lines_along_the_rows_and_columns() -> None:
    lines = np.array([[-0.9, 2.1, 0.1, 2.1], [0.1, 3.9, 0.1, 2.9]])
    found = np.argwhere(LATTICE.crossed(lines)).tolist()
    assert found == [[0, 0], [0, 1], [0, 2], [0, 3], [0, 4], *([row, 4] for row in range(3, 8))]


@pytest.mark.parametrize("seed", range(4))
def test_polygons_cover_the_cells_and_nothing_else(seed: int) -> None:
    mask = np.random.default_rng(seed).random(LATTICE.shape) < (0.3, 0.6, 0.95, 1.0)[seed]
    found = list(LATTICE.outline(mask).geoms)
    whole = shapely.multipolygons(found)
    x, y = centres(LATTICE)
    np.testing.assert_array_equal(shapely.contains_xy(shapely.union_all(found), x, y), mask)
    assert whole.area == pytest.approx(mask.sum() * 0.25**2)
    assert all(polygon.is_valid for polygon in found)
    from scipy.ndimage import label

    assert len(found) == label(mask)[1]
    assert LATTICE.outline(np.zeros_like(mask)).is_empty
