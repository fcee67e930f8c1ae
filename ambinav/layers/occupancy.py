"""Probabilistic grid map made from the walls, and ranges of rays on it.

Each cell has a probability of being occupied. A ray ends in a cell with the cell's probability
times that of having passed all cells before it; the range's mean and variance follow. This is the
map that localizability by Wang and Chen is defined on. How the grid is made is ours: a cell is
occupied with `PEAK` where a wall runs through its centre, and less by a Gaussian of the map's
deviation with the distance of its centre to the nearest wall. So is how a ray is followed: the
chance of ending is spread evenly over a cell's width and linear between cells. Cell by cell the
expected range jumps where a ray comes to cut another cell, and its differences make a corridor
localizable that is turned against the grid: a feature that no wall has.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_cdt

from ambinav.casting.plane.grid import SegmentGrid
from ambinav.casting.plane.raycast import clearances
from ambinav.config import as_positive
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments
from ambinav.maps.lattice_values import bilinear
from ambinav.runtime.array_types import Bools, Floats, Floats32, Ints32
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel

PEAK: Final = 0.97
"""Occupancy of a cell that a wall runs through: as much as a mapper holds possible."""

UNKNOWN: Final = -1.0

# A wall is blurred to this many deviations; beyond, cells are free for certain.
REACH = 3.0
# A ray is followed until it has ended with all but this chance.
LEFT = 0.005
MAX_CELLS = 100_000_000
HALF_DIAGONAL = math.sqrt(0.5)


class Occupancy(NamedTuple):
    """Cells of a probabilistic grid map; plain arrays, so that kernels can take it.

    Attributes:
        x0: Outer corner of cell (0, 0), metres, map frame.
        y0: Likewise.
        cell: Edge of a cell, metres.
        hazard: -log(1 - occupancy) of each cell, float32, shape (rows, columns): a ray that runs
            through the middle of a cell passes it with the chance exp(-hazard). 0 where unknown.
        room: int32, shape (rows, columns). 0: unknown. Else the number of columns or rows to the
            nearest cell that is not free for certain, at least 1.
    """

    x0: float
    y0: float
    cell: float
    hazard: Floats32
    room: Ints32


def occupancy(environment: Environment, cell: float, blur: float) -> Occupancy:
    """Make a probabilistic grid over an environment.

    Args:
        environment: The environment. The frontier, and what is neither free nor wall, is unknown.
        cell: Edge of a cell, metres.
        blur: Standard deviation of the walls' position, metres; half a cell at least.

    Raises:
        InputError: the cell is no positive number, or so small that the grid is too large.
    """
    cell = as_positive(cell, "cell", "metres")
    xmin, ymin, xmax, ymax = environment.bounds
    columns, rows = (math.ceil(size / cell) + 4 for size in (xmax - xmin, ymax - ymin))
    if columns * rows > MAX_CELLS:
        raise InputError(
            f"cell is {cell:g} m, which makes {columns * rows:.3g} cells of {environment.name}; "
            "give a larger one."
        )
    x0, y0 = xmin - 2 * cell, ymin - 2 * cell
    x, y = np.meshgrid(x0 + (np.arange(columns) + 0.5) * cell, y0 + (np.arange(rows) + 0.5) * cell)
    flat_x, flat_y = x.ravel(), y.ravel()
    spread = max(blur, 0.5 * cell)
    reach = max(REACH * spread, HALF_DIAGONAL * cell)
    walls = environment.segments.walls
    to_wall = to_segments(environment.segments, walls, flat_x, flat_y, reach)
    to_frontier = to_segments(environment.segments, ~walls, flat_x, flat_y, reach)
    chance = PEAK * np.exp(-0.5 * (to_wall / spread) ** 2)
    chance[to_wall >= reach] = 0.0
    outside = ~environment.triangulation.contains(flat_x, flat_y)
    blocked = (to_frontier < HALF_DIAGONAL * cell) | (outside & (chance == 0.0))
    chance[blocked & (to_wall >= HALF_DIAGONAL * cell)] = UNKNOWN
    unknown = (chance == UNKNOWN).reshape(rows, columns)
    hazard = -np.log1p(-np.where(chance == UNKNOWN, 0.0, chance)).reshape(rows, columns)
    room = distance_transform_cdt((hazard == 0.0) & ~unknown, metric="chessboard")
    room = np.where(unknown, 0, np.maximum(room, 1)).astype(np.int32)
    return Occupancy(x0, y0, cell, hazard.astype(np.float32), room)


def to_segments(segments: Segments, which: Bools, x: Floats, y: Floats, limit: float) -> Floats:
    """Return the distance of points (x, y) to the chosen segments, at most `limit`, metres."""
    if not which.any():
        return np.full(len(x), limit)
    chosen = Segments(segments.xy[which], segments.kind[which])
    return clearances(SegmentGrid.build(chosen), x, y, limit)


@kernel(inline="always")
def hazard_at(gx, gy, hazard):
    """Return the hazard at a point in cells, linear between the centres of cells."""
    u, v = gx - 0.5, gy - 0.5
    column, row = int(math.floor(u)), int(math.floor(v))
    if row < 0 or column < 0 or row + 1 >= hazard.shape[0] or column + 1 >= hazard.shape[1]:
        return 0.0
    u -= column
    v -= row
    return bilinear(
        hazard[row, column], hazard[row, column + 1],
        hazard[row + 1, column], hazard[row + 1, column + 1], u, v,
    )  # fmt: skip


@kernel
def grid_range(px, py, ux, uy, limit, grid, most=math.inf):
    """Return mean (metres) and variance (square metres) of a ray's range on an `Occupancy`.

    With S(t) = exp(-integral of the hazard up to t) the mean is the integral of S and the mean
    square that of 2 t S, up to `limit`, which what passes every cell reads. The third value is
    the chance that the ray ends in unknown space. A ray whose mean comes beyond `most` metres is
    not followed to its end.
    """
    rows, columns = grid.room.shape
    # Lengths are in cells from here on.
    scale = 1.0 / grid.cell
    x, y, far = (px - grid.x0) * scale, (py - grid.y0) * scale, limit * scale
    per_x, per_y = 1.0 / max(abs(ux), 1e-12), 1.0 / max(abs(uy), 1e-12)
    right, up = ux >= 0.0, uy >= 0.0
    left, mean, square, unknown = 1.0, 0.0, 0.0, 0.0
    t, most = 0.0, most * scale
    before = hazard_at(x, y, grid.hazard)
    while t < far and left > LEFT and mean <= most:
        gx, gy = x + t * ux, y + t * uy
        # On a line between cells it is the cell ahead.
        column = int(math.floor(gx)) if right else int(math.ceil(gx)) - 1
        row = int(math.floor(gy)) if up else int(math.ceil(gy)) - 1
        if row < 0 or column < 0 or row >= rows or column >= columns:
            break
        room = grid.room[row, column]
        if room == 0:
            unknown = left
            break
        if room > 1:
            # Through all cells at once that have none but free ones beside them.
            beyond_x = (column + room - 1 - gx if right else gx - column + room - 2) * per_x
            beyond_y = (row + room - 1 - gy if up else gy - row + room - 2) * per_y
            # A little into the next cell, to be in it for certain.
            step = min(min(beyond_x, beyond_y) + 1e-9, far - t)
            mean += left * step
            square += left * step * (2.0 * t + step)
            before = 0.0
        else:
            step = min(1.0, far - t)
            ahead = hazard_at(gx + step * ux, gy + step * uy, grid.hazard)
            after = left * math.exp(-0.5 * step * (before + ahead))
            mean += 0.5 * step * (left + after)
            square += step * (left * t + after * (t + step))
            left, before = after, ahead
        t += step
    return mean * grid.cell, max(square - mean * mean, 0.0) * grid.cell**2, unknown
