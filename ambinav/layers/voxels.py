"""Probabilistic grid map of a building of prisms, and ranges of rays on it.

As `occupancy`, with heights: a place is occupied by its distance in space to the nearest surface,
whatever lies over and under it. In plan the cells are those of `occupancy`; upwards there are
levels, a cell apart where surfaces begin, end or lie level, and as far apart as may be where the
building is the same for a while. Between two of them the hazard is linear. So an extruded plan has,
away from its floor and ceiling, the very grid of the plan.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_cdt

from ambinav.casting.prisms.faces import Pieces
from ambinav.casting.prisms.prisms import Prisms
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER
from ambinav.layers.occupancy import HALF_DIAGONAL, LEFT, PEAK, REACH, hazard_at, to_segments
from ambinav.runtime.array_types import Bools, Floats, Floats32, Ints32
from ambinav.runtime.kernels import kernel

# Surfaces at heights that differ by less are at one, metres.
SAME_HEIGHT = 1e-6


class Voxels(NamedTuple):
    """Cells of a probabilistic grid map with L levels; plain arrays, so that kernels can take it.

    Attributes:
        x0: Outer corner of cell (0, 0), metres, map frame.
        y0: Likewise.
        cell: Edge of a cell, metres.
        z: Height of each level, float64, ascending, shape (L,), metres.
        hazard: As that of `Occupancy`, float32, shape (L, rows, columns).
        room: As that of `Occupancy` between a level and the next, int32, (L - 1, rows, columns).
    """

    x0: float
    y0: float
    cell: float
    z: Floats
    hazard: Floats32
    room: Ints32


def levels(prisms: Prisms, cell: float, spread: float, low: float, high: float) -> Floats:
    """Return the heights of the levels that rays between two heights need.

    Args:
        prisms: The building.
        cell: Edge of a cell, metres.
        spread: Standard deviation of the walls' position, metres.
        low: Lowest z of the rays, metres.
        high: Highest z of them.

    Returns:
        Ascending, metres, at least two; the first and the last are beyond all that is solid, or
        beyond what the rays reach.
    """
    edges = _heights(prisms)
    reach = REACH * spread
    near = edges[(edges > low - 2.0 * reach) & (edges < high + 2.0 * reach)]
    steps = np.arange(-math.ceil(reach / cell), math.ceil(reach / cell) + 1) * cell
    heights = np.unique(np.append((near[:, None] + steps).ravel(), (low - reach, high + reach)))
    within_reach = heights[(heights >= low - reach) & (heights <= high + reach)]
    # Two that nearly coincide are one, unless an edge needs it: a surface lies on a level.
    is_distinct = np.append(True, np.diff(within_reach) > 0.5 * cell) | np.isin(within_reach, near)
    return np.asarray(within_reach[is_distinct])


def voxels(environment: Environment, prisms: Prisms, cell: float, blur: float, z: Floats) -> Voxels:
    """Make a probabilistic grid over a building of prisms.

    Args:
        environment: The building; the grid spans its floor.
        prisms: What it is in space.
        cell: Edge of a cell, metres.
        blur: Standard deviation of the walls' position, metres; half a cell at least.
        z: See `levels`.
    """
    xmin, ymin, xmax, ymax = environment.bounds
    columns, rows = (math.ceil(size / cell) + 4 for size in (xmax - xmin, ymax - ymin))
    x0, y0 = xmin - 2 * cell, ymin - 2 * cell
    x, y = np.meshgrid(x0 + (np.arange(columns) + 0.5) * cell, y0 + (np.arange(rows) + 0.5) * cell)
    plan = _Plan(prisms, x.ravel(), y.ravel(), x0, y0, cell, (rows, columns))
    spread = max(blur, 0.5 * cell)
    reach = max(REACH * spread, HALF_DIAGONAL * cell)
    hazard = np.empty((len(z), rows, columns), dtype=np.float32)
    for level, height in enumerate(z.tolist()):
        to_wall = plan.to_surface(height, reach)
        chance = PEAK * np.exp(-0.5 * (to_wall / spread) ** 2)
        chance[to_wall >= reach] = 0.0
        hazard[level] = -np.log1p(-chance).reshape(rows, columns)
    room = np.empty((len(z) - 1, rows, columns), dtype=np.int32)
    for level in range(len(z) - 1):
        middle = (z[level] + z[level + 1]) / 2
        empty = (hazard[level] == 0.0) & (hazard[level + 1] == 0.0)
        blocked = plan.to_frontier(middle, reach) < HALF_DIAGONAL * cell
        blocked |= plan.within_solid(middle) & empty.ravel()
        blocked &= plan.to_surface(middle, reach) >= HALF_DIAGONAL * cell
        unknown = blocked.reshape(rows, columns)
        free = distance_transform_cdt(empty & ~unknown, metric="chessboard")
        room[level] = np.where(unknown, 0, np.maximum(free, 1))
    return Voxels(x0, y0, cell, z, hazard, room)


class _Plan:
    """Section of the building at a height, at the centres of the cells of a plan."""

    def __init__(
        self, prisms: Prisms, x: Floats, y: Floats, x0: float, y0: float, cell: float,
        shape: tuple[int, int],
    ) -> None:  # fmt: skip
        self._prisms, self._x, self._y = prisms, x, y
        self._frame = x0, y0, cell
        self._shape = shape
        self._pieces = Pieces.of([solid.outline for solid in prisms.solids])
        self._z = np.array([(body.bottom, body.top) for body in prisms.solids]).reshape(-1, 2)
        beside = np.zeros(len(x), dtype=np.bool_)
        if prisms.plan is not None:
            beside = ~prisms.plan.contains(x, y)
        self._beside = beside

    def to_surface(self, z: float, reach: float) -> Floats:
        """Return the distance to the nearest wall or level surface, at most `reach`, (cells,)."""
        prisms = self._prisms
        walls = prisms.walls.kind != FRONTIER
        distance = self._to_walls(walls, z, reach)
        for side in (0, 1):
            for off, solids in _groups(np.abs(self._z[:, side] - z), reach):
                distance[self._over(solids)] = np.minimum(distance[self._over(solids)], off)
        for plane in (prisms.floor, prisms.ceiling):
            if abs(plane - z) < reach:
                distance = np.minimum(distance, abs(plane - z))
        return distance

    def to_frontier(self, z: float, reach: float) -> Floats:
        """Return the distance to the nearest frontier, at most `reach`, shape (cells,)."""
        return self._to_walls(self._prisms.walls.kind == FRONTIER, z, reach)

    def within_solid(self, z: float) -> Bools:
        """Return the mask of cells that are solid or unknown at this height, shape (cells,)."""
        if not self._prisms.floor <= z <= self._prisms.ceiling:
            return np.ones(len(self._x), dtype=np.bool_)
        return self._beside | self._over((self._z[:, 0] < z) & (z < self._z[:, 1]))

    def _to_walls(self, which: Bools, z: float, reach: float) -> Floats:
        height, walls = self._prisms.wall_z, self._prisms.walls
        off = np.maximum(np.maximum(height[:, 0] - z, z - height[:, 1]), 0.0)
        distance = np.full(len(self._x), reach)
        for above, walls_here in _groups(np.where(which, off, np.inf), reach):
            flat = to_segments(walls, walls_here, self._x, self._y, reach)
            if above > 0.0:
                flat = np.hypot(flat, above)
            distance = np.minimum(distance, flat)
        return distance

    def _over(self, solids: Bools) -> Bools:
        """Return the cells whose centre lies in the outline of one of the solids."""
        mask = np.zeros(self._shape, dtype=np.bool_)
        if solids.any():
            covered = solids[self._pieces.owner][self._pieces.piece]
            _fill(np.ascontiguousarray(self._pieces.triangle[covered]), *self._frame, mask)
        return mask.ravel()


def _heights(prisms: Prisms) -> Floats:
    """Return all heights at which something begins, ends or is level, ascending."""
    z = np.concatenate([prisms.wall_z.ravel(), (prisms.floor, prisms.ceiling)])
    return np.unique(np.round(z[np.isfinite(z)] / SAME_HEIGHT)) * SAME_HEIGHT


def _groups(off: Floats, reach: float) -> Iterable[tuple[float, Bools]]:
    """Group surfaces by their vertical distance, up to `reach`."""
    for value in np.unique(np.round(off[off < reach] / SAME_HEIGHT)).tolist():
        yield value * SAME_HEIGHT, np.abs(off / SAME_HEIGHT - value) <= 0.5


@kernel
def _fill(triangles, x0, y0, cell, mask):
    """Mark the cells whose centre lies in one of the triangles, counter-clockwise."""
    rows, columns = mask.shape
    for t in range(triangles.shape[0]):
        x = (triangles[t, :, 0] - x0) / cell - 0.5
        y = (triangles[t, :, 1] - y0) / cell - 0.5
        for row in range(max(math.ceil(y.min()), 0), min(math.floor(y.max()) + 1, rows)):
            for column in range(max(math.ceil(x.min()), 0), min(math.floor(x.max()) + 1, columns)):
                inside = True
                for e in range(3):
                    f = (e + 1) % 3
                    turn = (x[f] - x[e]) * (row - y[e]) - (y[f] - y[e]) * (column - x[e])
                    inside &= turn >= 0.0
                mask[row, column] |= inside


@kernel
def voxel_range(px, py, pz, ux, uy, uz, limit, grid, most=math.inf):
    """Compute a range in space, as `occupancy.grid_range` does; (ux, uy, uz) is a unit vector.

    Above the highest level and below the lowest there is nothing.
    """
    count, rows, columns = grid.hazard.shape
    # Lengths are in cells from here on.
    scale = 1.0 / grid.cell
    x, y, z, far = (px - grid.x0) * scale, (py - grid.y0) * scale, pz * scale, limit * scale
    per_x, per_y = 1.0 / max(abs(ux), 1e-12), 1.0 / max(abs(uy), 1e-12)
    per_z = 1.0 / max(abs(uz), 1e-12)
    right, up, rises = ux >= 0.0, uy >= 0.0, uz >= 0.0
    left, mean, square, unknown = 1.0, 0.0, 0.0, 0.0
    t, most = 0.0, most * scale
    k = 0
    while k < count - 2 and grid.z[k + 1] <= pz:
        k += 1
    before = _hazard(x, y, z, k, grid, scale)
    while t < far and left > LEFT and mean <= most:
        gx, gy, gz = x + t * ux, y + t * uy, z + t * uz
        # On a line between cells it is the cell ahead.
        column = int(math.floor(gx)) if right else int(math.ceil(gx)) - 1
        row = int(math.floor(gy)) if up else int(math.ceil(gy)) - 1
        if row < 0 or column < 0 or row >= rows or column >= columns:
            break
        while rises and k < count - 1 and gz >= grid.z[k + 1] * scale:
            k += 1
        while not rises and k >= 0 and gz <= grid.z[k] * scale:
            k -= 1
        if k < 0 or k >= count - 1:
            mean += left * (far - t)
            square += left * (far - t) * (far + t)
            break
        room = grid.room[k, row, column]
        if room == 0:
            unknown = left
            break
        beyond_z = (grid.z[k + 1] * scale - gz if rises else gz - grid.z[k] * scale) * per_z
        if room > 1:
            # Through all cells at once that have none but free ones beside them.
            beyond_x = (column + room - 1 - gx if right else gx - column + room - 2) * per_x
            beyond_y = (row + room - 1 - gy if up else gy - row + room - 2) * per_y
            # A little into the next cell, to be in it for certain.
            step = min(min(min(beyond_x, beyond_y), beyond_z) + 1e-9, far - t)
            mean += left * step
            square += left * step * (2.0 * t + step)
            before = 0.0
        else:
            step = min(min(1.0, beyond_z + 1e-9), far - t)
            ahead = _hazard(gx + step * ux, gy + step * uy, gz + step * uz, k, grid, scale)
            after = left * math.exp(-0.5 * step * (before + ahead))
            mean += 0.5 * step * (left + after)
            square += step * (left * t + after * (t + step))
            left, before = after, ahead
        t += step
    return mean * grid.cell, max(square - mean * mean, 0.0) * grid.cell**2, unknown


@kernel(inline="always")
def _hazard(gx, gy, gz, k, grid, scale):
    """Return the hazard at a point in cells, between level k and the next, or at the nearer one."""
    low, high = grid.z[k] * scale, grid.z[k + 1] * scale
    share = min(max((gz - low) / (high - low), 0.0), 1.0)
    below = hazard_at(gx, gy, grid.hazard[k])
    above = hazard_at(gx, gy, grid.hazard[k + 1])
    return below + (above - below) * share
