"""Lookup tables of a collision check, packed into three arrays.

A planner asks for one motion at a time from Python, and handing numba an array costs as much as
checking a short motion. So all numbers stand in one table, the entries below at its front.
"""

from __future__ import annotations

import math
from weakref import WeakKeyDictionary

import numpy as np

from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel

# Entries of the table. Of the grid of segments (`SegmentGrid`): its origin, cells, and where in
# the table the first item of each cell and the items' lines begin.
GRID_X, GRID_Y, GRID_INVERSE, GRID_ROWS, GRID_COLUMNS, GRID_START, GRID_LINE = range(7)
# The same of the grid of triangles (`Triangulation`).
MESH_X, MESH_Y, MESH_CELL, MESH_ROWS, MESH_COLUMNS, MESH_START, MESH_TRIANGLE = range(7, 14)
# Of the lattice of clearances: its first point, and points per metre.
BOUND_X, BOUND_Y, BOUND_STEP, BOUND_INVERSE = range(14, 18)
# Of the footprint: inner and outer radius, whether it must have room to turn at the ends of a
# motion, how many corners it has and where in the table they begin.
INNER, OUTER, TURNS, CORNERS, CORNER = range(18, 23)
# Of the forbidden cells: the centre of the first one, and cells per metre.
FORBIDDEN_X, FORBIDDEN_Y, FORBIDDEN_INVERSE = range(23, 26)
HEADER = 26

# Spacing of the lattice of clearances in metres, as long as it has at most MAX_POINTS points.
SPACING = 0.1
MAX_POINTS = 4_000_000
# Clearances are capped here, metres: no robot needs more.
FAR = 2.0
# Subtracted from the clearances, metres, so that they stay lower bounds in float32.
ROUNDING = 1e-6

Arrays = tuple[Floats, Floats32, Bools]
Lattice = tuple[float, float, float, Floats32]

# Checkers of one building share it: its clearances are most of what a checker costs.
_lattices: WeakKeyDictionary[Environment, Lattice] = WeakKeyDictionary()


def pack(
    environment: Environment,
    footprint: Footprint,
    turns: bool,
    forbidden: Bools | None,
    origin: tuple[float, float],
    spacing: float,
) -> Arrays:
    """Lay out an environment and a footprint for the kernels.

    Args:
        environment: The environment.
        footprint: The footprint.
        turns: Whether a pose is free only if the footprint can turn there.
        forbidden: Cells that the reference point may not enter, bool, shape (rows, columns);
            row 0 at the smallest y.
        origin: x and y of the centre of forbidden[0, 0], metres.
        spacing: Edge of a forbidden cell, metres.

    Returns:
        The table, float64, one row; the lattice of clearances, float32, shape (rows, columns),
        metres, negative where a point is not in the free space; the forbidden cells, bool, shape
        (0, 0) if there are none.

    Raises:
        InputError: the forbidden cells have no two axes, or their place is not finite.
    """
    if forbidden is None:
        cells, origin, spacing = np.zeros((0, 0), dtype=np.bool_), (0.0, 0.0), 1.0
    else:
        cells = np.ascontiguousarray(forbidden, dtype=np.bool_)
    if cells.ndim != 2:
        raise InputError(f"forbidden has {cells.ndim} axes; give rows and columns of cells.")
    if not (len(origin) == 2 and all(map(math.isfinite, (*origin, spacing))) and spacing > 0.0):
        raise InputError(
            f"forbidden: the origin is {tuple(origin)} and the spacing {spacing}; give two "
            "finite numbers of metres and a spacing above 0."
        )
    if environment not in _lattices:
        _lattices[environment] = _clearances(environment)
    low_x, low_y, step, bound = _lattices[environment]
    grid, mesh = environment.grid, environment.triangulation
    parts = (
        footprint.corners.ravel(), grid.start, grid.line.ravel(), mesh.start, mesh.triangle.ravel(),
    )  # fmt: skip
    corner, grid_start, grid_line, mesh_start, triangle = (
        HEADER + np.cumsum([0, *(part.size for part in parts)])[:-1]
    )
    header = np.zeros(HEADER)
    header[GRID_X : GRID_LINE + 1] = *grid.origin, 1 / grid.cell, *grid.shape, grid_start, grid_line
    header[MESH_X : MESH_TRIANGLE + 1] = (
        *mesh.origin, mesh.cell, *mesh.shape, mesh_start, triangle,
    )  # fmt: skip
    header[BOUND_X : BOUND_INVERSE + 1] = low_x, low_y, step, 1 / step
    header[INNER : CORNER + 1] = (
        footprint.inner, footprint.outer, turns, len(footprint.corners), corner,
    )  # fmt: skip
    header[FORBIDDEN_X : FORBIDDEN_INVERSE + 1] = *origin, 1 / spacing
    return np.concatenate([header, *parts]), bound, cells


def _clearances(environment: Environment) -> Lattice:
    """Return first point, spacing and values of the lattice of clearances over the environment."""
    xmin, ymin, xmax, ymax = environment.bounds
    width, height = xmax - xmin, ymax - ymin
    step = max(SPACING, math.sqrt(width * height / MAX_POINTS))
    x = xmin + step * np.arange(int(width / step) + 2)
    y = ymin + step * np.arange(int(height / step) + 2)
    gx, gy = (axis.ravel() for axis in np.meshgrid(x, y))
    far = np.asarray(environment.clearance(gx, gy, FAR)) - ROUNDING
    signed = np.where(environment.triangulation.contains(gx, gy), 1.0, -1.0) * np.maximum(far, 0.0)
    return float(x[0]), float(y[0]), step, signed.reshape(len(y), len(x)).astype(np.float32)


@kernel(forceinline=True)
def around(x, y, table, bound):
    """Return the clearance at the nearest lattice point, and the distance to that point, metres.

    A point off the lattice, or not finite, is as far outside of the free space as can be.
    """
    u = (x - table[BOUND_X]) * table[BOUND_INVERSE] + 0.5
    v = (y - table[BOUND_Y]) * table[BOUND_INVERSE] + 0.5
    if not (u >= 0.0 and v >= 0.0 and u < bound.shape[1] and v < bound.shape[0]):
        return -math.inf, 0.0
    column, row = int(u), int(v)
    dx = x - table[BOUND_X] - column * table[BOUND_STEP]
    dy = y - table[BOUND_Y] - row * table[BOUND_STEP]
    return bound[row, column], math.sqrt(dx * dx + dy * dy)


@kernel
def in_triangles(x, y, table):
    """Return whether a point lies in the free space or on its border; as `triangulation.locate`."""
    gx = (x - table[MESH_X]) / table[MESH_CELL]
    gy = (y - table[MESH_Y]) / table[MESH_CELL]
    if not (gx >= 0.0 and gy >= 0.0 and gx < table[MESH_COLUMNS] and gy < table[MESH_ROWS]):
        return False
    k = int(table[MESH_START]) + int(gy) * int(table[MESH_COLUMNS]) + int(gx)
    first = int(table[MESH_TRIANGLE])
    for j in range(first + 6 * int(table[k]), first + 6 * int(table[k + 1]), 6):
        ax, ay = table[j] - x, table[j + 1] - y
        bx, by = table[j + 2] - x, table[j + 3] - y
        cx, cy = table[j + 4] - x, table[j + 5] - y
        if (ax * by - ay * bx >= 0) & (bx * cy - by * cx >= 0) & (cx * ay - cy * ax >= 0):
            return True
    return False


@kernel(inline="always")
def cells_over(xmin, ymin, xmax, ymax, table):
    """Return first and last row, first and last column of the segment cells that meet a box."""
    inverse = table[GRID_INVERSE]
    rows, columns = int(table[GRID_ROWS]), int(table[GRID_COLUMNS])
    # Clipped before they become integers: a box may lie anywhere.
    low_row = int(min(max((ymin - table[GRID_Y]) * inverse, 0.0), rows - 1.0))
    high_row = int(min(max((ymax - table[GRID_Y]) * inverse, 0.0), rows - 1.0))
    low_column = int(min(max((xmin - table[GRID_X]) * inverse, 0.0), columns - 1.0))
    high_column = int(min(max((xmax - table[GRID_X]) * inverse, 0.0), columns - 1.0))
    return low_row, high_row, low_column, high_column


@kernel(inline="always")
def items_of(row, low_column, high_column, table):
    """Return where the lines of neighbouring cells of a row begin and end in the table.

    The cells of a row follow each other, and so do their items.
    """
    k = int(table[GRID_START]) + row * int(table[GRID_COLUMNS])
    first = int(table[GRID_LINE])
    return first + 4 * int(table[k + low_column]), first + 4 * int(table[k + high_column + 1])


@kernel
def nearest_gap(x, y, limit, table):
    """Return the distance from a point to a segment, at most `limit`; as `raycast.clearances`."""
    best = limit * limit
    r0, r1, c0, c1 = cells_over(x - limit, y - limit, x + limit, y + limit, table)
    for row in range(r0, r1 + 1):
        start, end = items_of(row, c0, c1, table)
        for j in range(start, end, 4):
            wx, wy = x - table[j], y - table[j + 1]
            ex, ey = table[j + 2], table[j + 3]
            s = min(max((wx * ex + wy * ey) / (ex * ex + ey * ey), 0.0), 1.0)
            dx, dy = wx - s * ex, wy - s * ey
            best = min(best, dx * dx + dy * dy)
    return math.sqrt(best)
