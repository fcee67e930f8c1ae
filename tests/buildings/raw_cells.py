"""What a map's own cells say of its walls, to hold an environment made of them against.

Shares no code with the package: whole-array morphology, a tree of lines, and points along rays.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, OccupancyGrid

Array = NDArray[Any]
EIGHT = np.ones((3, 3), dtype=bool)
# Occupied cells that touch one another; fewer are specks, not walls.
SMALLEST_WALL = 10
# A wall counts as in the way of a ray if it cannot be passed this near to the ray, in cells.
ASIDE = 2.5


def wall_mask(grid: OccupancyGrid) -> Array:
    """Occupied cells of pieces of at least `SMALLEST_WALL` cells, shape (rows, columns)."""
    labels, count = ndimage.label(grid.state == OCCUPIED, EIGHT)
    large = np.bincount(labels.ravel(), minlength=count + 1) >= SMALLEST_WALL
    large[0] = False
    return large[labels]


def floor_mask(grid: OccupancyGrid, gap: int | None = None, min_area: float = 0.25) -> Array:
    """Free cells that are left once specks are filled and gaps are closed, (rows, columns)."""
    if gap is None:
        gap = 1 if grid.resolution <= 0.1 else 0
    free = grid.state == FREE
    if gap > 0:
        labels, count = ndimage.label(~free, EIGHT)
        size = np.bincount(labels.ravel(), minlength=count + 1)
        hard = np.bincount(labels.ravel(), (grid.state == OCCUPIED).ravel(), count + 1) > 0
        rim = np.concatenate([labels[0], labels[-1], labels[:, 0], labels[:, -1]])
        speck = size <= np.where(hard, 1 if gap == 1 else 0, 9 * gap * gap)
        speck[0] = False
        speck[rim] = False
        free |= speck[labels]
        free = ndimage.binary_opening(free, np.ones((gap + 1, gap + 1), dtype=bool))
    labels, count = ndimage.label(free)
    kept = np.bincount(labels.ravel(), minlength=count + 1) >= min_area / grid.resolution**2
    kept[0] = False
    return kept[labels]


def beside(wall: Array, floor: Array) -> Array:
    """Row and column of the wall's cells that share an edge with a cell of the floor, (K, 2)."""
    return np.argwhere(wall & ndimage.binary_dilation(floor))


def from_segments(grid: OccupancyGrid, env: Environment, cells: Array) -> Array:
    """Distance of each cell's centre from the nearest segment, in cells."""
    points = shapely.points(*grid.to_world(cells[:, 1] + 0.5, cells[:, 0] + 0.5))
    tree = shapely.STRtree(shapely.linestrings(env.segments.xy.reshape(-1, 2, 2)))
    _, away = tree.query_nearest(points, return_distance=True, all_matches=False)
    return np.asarray(away) / grid.resolution


def rays_through_walls(
    grid: OccupancyGrid,
    env: Environment,
    wall: Array,
    floor: Array,
    count: int,
    rng: np.random.Generator,
    near: Array,
) -> tuple[int, Array]:
    """Cast rays of 2 to 12 cells from floor to floor on which a wall stands.

    Both ends are middles of floor cells, among the cells `near` the first, and free in `env`.
    The wall parts the strip of `ASIDE` cells to either side of the ray: the place of a wall's
    end, or of a door, may be off by as much.

    Returns:
        How many there were, and row, column (both ends) of those that nothing stopped, (K, 4).
    """
    start = near[rng.integers(0, len(near), count)]
    angle, length = rng.uniform(0.0, math.tau, count), rng.uniform(2.0, 12.0, count)
    step = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    end = np.rint(start + length[:, None] * step).astype(int)
    inside = (end >= 0).all(axis=1) & (end < floor.shape).all(axis=1)
    start, end = start[inside], end[inside]
    met = floor[tuple(end.T)] & floor[tuple(start.T)] & (start != end).any(axis=1)
    start, end = start[met], end[met]
    run = (end - start).astype(float)
    normal = run[:, ::-1] * [1.0, -1.0] / np.hypot(*run.T)[:, None]
    for aside in np.linspace(-ASIDE, ASIDE, 9):
        blocked = np.zeros(len(start), dtype=bool)
        for t in np.linspace(0.0, 1.0, 61):
            at = np.rint(start + t * run + aside * normal).astype(int)
            at = np.clip(at, 0, np.array(wall.shape) - 1)
            blocked |= wall[tuple(at.T)]
        start, end, run, normal = (part[blocked] for part in (start, end, run, normal))
    x0, y0 = grid.to_world(start[:, 1] + 0.5, start[:, 0] + 0.5)
    x1, y1 = grid.to_world(end[:, 1] + 0.5, end[:, 0] + 0.5)
    both = np.asarray(env.is_free(x0, y0)) & np.asarray(env.is_free(x1, y1))
    x0, y0, x1, y1 = x0[both], y0[both], x1[both], y1[both]
    far = np.hypot(x1 - x0, y1 - y0)
    if not len(far):
        return 0, np.empty((0, 4))
    seen = np.asarray(env.cast(x0, y0, np.arctan2(y1 - y0, x1 - x0), 100.0 * grid.resolution))
    ends = np.hstack([start, end])[both][seen >= far]
    through = [parted(wall, each) for each in ends]
    return len(far), ends[np.array(through, dtype=bool)]


def parted(wall: Array, ends: Array) -> bool:
    """Whether no steps over cells that are not wall lead from end to end within `ASIDE` cells."""
    start, end = ends[:2].astype(float), ends[2:].astype(float)
    low = np.maximum(np.minimum(ends[:2], ends[2:]) - 3, 0)
    high = np.maximum(ends[:2], ends[2:]) + 4
    at = np.moveaxis(np.mgrid[low[0] : high[0], low[1] : high[1]], 0, -1)
    at = at[: wall.shape[0] - low[0], : wall.shape[1] - low[1]]
    run = end - start
    along = np.clip(((at - start) @ run) / (run @ run), 0.0, 1.0)
    away = np.hypot(*np.moveaxis(at - start - along[..., None] * run, -1, 0))
    labels, _ = ndimage.label((away <= ASIDE) & ~wall[tuple(np.moveaxis(at, -1, 0))])
    return bool(labels[tuple(ends[:2] - low)] != labels[tuple(ends[2:] - low)])


def close_to(wall: Array, floor: Array, cells: int = 6) -> Array:
    """Row and column of the floor's cells up to so many cells from a wall, shape (K, 2)."""
    return np.argwhere(floor & ndimage.binary_dilation(wall, EIGHT, iterations=cells))
