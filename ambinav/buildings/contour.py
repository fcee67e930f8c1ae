"""Contours of the free cells of an occupancy grid, as closed rings of points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, UNKNOWN
from ambinav.geometry.segments import FRONTIER, WALL
from ambinav.runtime.array_types import Bools, Bytes, Floats, Ints
from ambinav.runtime.kernels import kernel

# Free cells to the left: a crack on the east side of a cell runs north, and so on around it.
_OUT = np.array([[0, 1], [1, 0], [0, -1], [-1, 0]])
_AHEAD = np.array([[1, 0], [0, -1], [-1, 0], [0, 1]])


@dataclass(frozen=True, eq=False)
class Contours:
    """Closed rings around the free components, free space on the left, in cells.

    The points are the middles of the edges between a free cell and one that is not (the corners
    that marching squares finds). Rings neither cross nor touch one another or themselves.

    Attributes:
        xy: float64, shape (points, 2): column and row in cells.
        kind: uint8, shape (points,): `WALL` where an occupied cell is near, else `FRONTIER`.
        start: int64, shape (rings + 1,): ring k is start[k]:start[k+1], not closed by repetition.
        component: int64, shape (rings,): the free component that the ring bounds.
        area: int64, shape (rings,): enclosed cells, negative for the holes of a component.
        small: How many free cells are left out as components of too few, and in how many pieces.
        narrow: The same of those in passages that were closed, without the rims of others.
    """

    xy: Floats
    kind: Bytes
    start: Ints
    component: Ints
    area: Ints
    small: tuple[int, int] = (0, 0)
    narrow: tuple[int, int] = (0, 0)


def trace(
    state: Bytes, *, gap: int, min_cells: float, reach: int = 1, speck: int | None = None
) -> Contours:
    """Trace the outline of the free cells of `state`, shape (rows, columns).

    What lies outside the grid is unknown. Free cells connect through their edges only, so that
    no ray slips between two occupied cells that touch at a corner.

    Args:
        state: `FREE`, `OCCUPIED` or `UNKNOWN` of each cell.
        gap: Widest opening that is closed, in cells; see `opened`.
        min_cells: Free components of fewer cells are left out.
        reach: A point is a wall's if an occupied cell lies within this many rows and columns of
            the cell beyond it.
        speck: Widest occupied island that is taken for noise, in cells; `gap` if None.
    """
    rows, columns = np.flatnonzero((state == FREE).any(1)), np.flatnonzero((state == FREE).any(0))
    if len(rows) == 0:
        return _empty()
    # The margin lets the kernels look around a cell without a test.
    margin = reach + 1
    shape = rows[-1] - rows[0] + 1 + 2 * margin, columns[-1] - columns[0] + 1 + 2 * margin
    padded = np.full(shape, UNKNOWN, dtype=np.uint8)
    shift = np.array([rows[0] - margin, columns[0] - margin])
    row0, row1 = max(shift[0], 0), min(rows[-1] + margin + 1, state.shape[0])
    column0, column1 = max(shift[1], 0), min(columns[-1] + margin + 1, state.shape[1])
    padded[row0 - shift[0] : row1 - shift[0], column0 - shift[1] : column1 - shift[1]] = state[
        row0:row1, column0:column1
    ]
    if gap > 0:
        _fill_specks(padded, gap if speck is None else speck, 9 * gap * gap)
    free = opened(padded == FREE, gap)
    labels, _ = ndimage.label(free)
    cells = np.bincount(labels.ravel())
    keep = cells >= min_cells
    keep[0] = False
    less = cells[1:][~keep[1:]]
    narrow = _passages((padded == FREE) & ~free, min_cells) if gap > 0 else (0, 0)
    labels[~keep[labels]] = 0
    cracks = 2 * int(
        np.count_nonzero((labels[:, 1:] == 0) & (labels[:, :-1] != 0))
        + np.count_nonzero((labels[1:] == 0) & (labels[:-1] != 0))
    )
    xy = np.empty((cracks, 2))
    kind = np.empty(cracks, dtype=np.uint8)
    ring = np.empty((cracks // 4 + 1, 3), dtype=np.int64)
    rings = _trace(labels, padded, reach, xy, kind, ring)
    xy += shift[::-1]
    start = np.append(ring[:rings, 0], cracks)
    return Contours(
        xy, kind, start, ring[:rings, 1].copy(), ring[:rings, 2].copy(),
        (int(less.sum()), len(less)), narrow,
    )  # fmt: skip


def _passages(closed: Bools, least: float) -> tuple[int, int]:
    """Count cells in components of at least `least` cells, and these components."""
    if np.count_nonzero(closed) < least:
        return 0, 0
    labels, _ = ndimage.label(closed)
    cells = np.bincount(labels.ravel())[1:]
    large = cells[cells >= least]
    return int(large.sum()), len(large)


def opened(free: Bools, gap: int) -> Bools:
    """Return the free cells that a square of gap + 1 free cells can cover.

    This closes passages of up to `gap` cells. A straight edge at any angle stays where it is.
    """
    for _ in range(gap):
        small = np.zeros_like(free)
        np.logical_and(free[:-1, :-1], free[1:, 1:], out=small[:-1, :-1])
        small[:-1, :-1] &= free[1:, :-1]
        small[:-1, :-1] &= free[:-1, 1:]
        free = small
    for _ in range(gap):
        big = free.copy()
        big[1:] |= free[:-1]
        big[1:, 1:] |= free[:-1, :-1]
        big[:, 1:] |= free[:, :-1]
        free = big
    return free


def _empty() -> Contours:
    none = np.empty(0, dtype=np.int64)
    return Contours(
        np.empty((0, 2)), np.empty(0, np.uint8), np.zeros(1, dtype=np.int64), none, none
    )


@kernel(error_model="python")
def _fill_specks(state, widest, most_unknown):
    """Turn small islands that are not free into free cells, in place.

    An island (connected over edges and corners) with an occupied cell may be up to `widest` rows
    high and columns wide, so that no thin wall goes; one of unknown cells alone may have up to
    `most_unknown` cells.
    """
    rows, columns = state.shape
    most_occupied = widest * widest
    limit = max(most_occupied, most_unknown)
    queue = np.empty((limit + 9, 2), dtype=np.int64)
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            # The first cell of an island in reading order has free cells before it.
            if (
                state[row, column] == FREE
                or state[row, column - 1] != FREE
                or state[row - 1, column - 1] != FREE
                or state[row - 1, column] != FREE
                or state[row - 1, column + 1] != FREE
            ):
                continue
            queue[0, 0], queue[0, 1] = row, column
            size, head, hard = 1, 0, False
            while head < size <= limit:
                r, c = queue[head]
                head += 1
                hard = hard or state[r, c] == OCCUPIED
                for near in range(9):
                    i, j = r + near // 3 - 1, c + near % 3 - 1
                    if i < 0 or j < 0 or i >= rows or j >= columns:
                        size = limit + 1
                        break
                    if state[i, j] == FREE:
                        continue
                    known = False
                    for k in range(size):
                        known = known or (queue[k, 0] == i and queue[k, 1] == j)
                    if not known:
                        queue[size, 0], queue[size, 1] = i, j
                        size += 1
                if hard and size > most_occupied:
                    break
            if hard:
                left, right = queue[:size, 1].min(), queue[:size, 1].max()
                high = queue[:size, 0].max() - row + 1
                if high > widest or right - left + 1 > widest:
                    continue
            if head == size and size <= (most_occupied if hard else most_unknown):
                for k in range(size):
                    state[queue[k, 0], queue[k, 1]] = FREE


@kernel(error_model="python")
def _trace(labels, state, reach, xy, kind, ring):
    """Follow every ring once; fill the arrays of `Contours`; return the number of rings."""
    rows, columns = labels.shape
    seen = np.zeros((rows, columns), dtype=np.bool_)
    rings = 0
    at = 0
    for row in range(1, rows - 1):
        for column in range(1, columns - 1):
            # Every ring runs north somewhere.
            if labels[row, column] == 0 or labels[row, column + 1] != 0 or seen[row, column]:
                continue
            ring[rings, 0] = at
            ring[rings, 1] = labels[row, column]
            area = 0
            r, c, side = row, column, 0
            while True:
                if side == 0:
                    if seen[r, c]:
                        break
                    seen[r, c] = True
                    area += c + 1
                elif side == 2:
                    area -= c
                out_r, out_c = _OUT[side, 0], _OUT[side, 1]
                xy[at, 0] = c + 0.5 + 0.5 * out_c
                xy[at, 1] = r + 0.5 + 0.5 * out_r
                kind[at] = FRONTIER
                beyond_r, beyond_c = r + out_r, c + out_c
                for i in range(beyond_r - reach, beyond_r + reach + 1):
                    for j in range(beyond_c - reach, beyond_c + reach + 1):
                        if state[i, j] == OCCUPIED:
                            kind[at] = WALL
                at += 1
                ahead_r, ahead_c = r + _AHEAD[side, 0], c + _AHEAD[side, 1]
                if labels[ahead_r, ahead_c] == 0:
                    side = (side + 1) % 4
                elif labels[ahead_r + out_r, ahead_c + out_c] == 0:
                    r, c = ahead_r, ahead_c
                else:
                    r, c = ahead_r + out_r, ahead_c + out_c
                    side = (side + 3) % 4
            ring[rings, 2] = area
            rings += 1
    return rings
