"""Grids of cells on which bounds are proved, and the proof that goes from grid to finer grid.

A path that costs no more than a known path stays where the sum of the bounds from the start and to
the goal is no higher. The next grid covers only that part, with cells of half the edges.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, repeat

import numpy as np

from ambinav.runtime.array_types import Bools, Floats, Indices

Place = tuple[float, ...]

# Iterations on the finer grids, one number a round: after each, fewer cells are left.
ROUNDS = (20, 40, 80)
# Share of the bound that is given up for rounding.
ROUNDING = 1e-6
# Ranges of values that are flattened apart.
BINS = 20_000


@dataclass(frozen=True, eq=False)
class ProofGrid:
    """Grid of boxes with three vertices along each edge, of which boxes share those on their sides.

    Places and axes are in the order of the arrays: y, x and, in space, z.

    Attributes:
        origin: Of the first vertex, metres.
        edges: Edges of a cell, two steps from vertex to vertex, metres.
        open_cells: Cells that paths may meet, bool; along each axis half as many as vertices.
        kept: Costs to the goal and from the start, or a part of them, at the vertices; of each
            finer grid, what the one before it has left.
    """

    origin: Place
    edges: Place
    open_cells: Bools
    kept: Floats

    @property
    def axes(self) -> tuple[Floats, ...]:
        """Coordinates of the vertices along each axis, metres."""
        return tuple(
            np.asarray(first + 0.5 * edge * np.arange(count))
            for first, edge, count in zip(self.origin, self.edges, self.kept.shape[1:], strict=True)
        )

    def centres(self) -> tuple[tuple[Indices, ...], tuple[Floats, ...]]:
        """Return indices and centres of the open cells, along each axis."""
        cells = np.nonzero(self.open_cells)
        middle = tuple(
            np.asarray(first + (index + 0.5) * edge, dtype=np.float64)
            for first, edge, index in zip(self.origin, self.edges, cells, strict=True)
        )
        return cells, middle

    def halved(self, carried: float) -> ProofGrid:
        """Return the part with open cells, with cells of half the edges and a share of `kept`."""
        axes = range(self.open_cells.ndim)
        filled = [np.flatnonzero(self._any(axis)) for axis in axes]
        cells = self.open_cells[tuple(slice(index[0], index[-1] + 1) for index in filled)]
        part = tuple(slice(2 * index[0], 2 * index[-1] + 3) for index in filled)
        fine = carried * self.kept[(slice(None), *part)]
        for axis in axes:
            cells = cells.repeat(2, axis=axis)
            fine = _with_middles(fine, axis + 1)
        origin = tuple(
            float(first + edge * index[0])
            for first, edge, index in zip(self.origin, self.edges, filled, strict=True)
        )
        return ProofGrid(origin, tuple(0.5 * edge for edge in self.edges), cells, fine)

    def _any(self, axis: int) -> Bools:
        other_axes = tuple(index for index in range(self.open_cells.ndim) if index != axis)
        return np.asarray(self.open_cells.any(axis=other_axes))

    def cell(self, place: Place) -> tuple[int, ...]:
        """Return indices of the cell around a place."""
        return tuple(
            min(max(int((value - first) // edge), 0), count - 1)
            for value, first, edge, count in zip(
                place, self.origin, self.edges, self.open_cells.shape, strict=True
            )
        )

    def block(self, place: Place) -> tuple[slice, ...]:
        """Return where the vertices of the cell around a place are."""
        return tuple(slice(2 * index, 2 * index + 3) for index in self.cell(place))

    def at(self, values: Floats, place: Place) -> float:
        """Return the function with Bernstein coefficients at the vertices at a place."""
        block = values[self.block(place)]
        for value, first, edge, index in zip(
            place, self.origin, self.edges, self.cell(place), strict=True
        ):
            w = (value - first) / edge - index
            block = np.tensordot(np.array([(1.0 - w) ** 2, 2.0 * w * (1.0 - w), w * w]), block, 1)
        return float(block)

    def least(self, values: Floats) -> Floats:
        """Return the least coefficient of each cell: its function is nowhere lower."""
        for axis in range(values.ndim):
            low, middle, high = (
                values[(slice(None),) * axis + (part,)]
                for part in (slice(None, -1, 2), slice(1, None, 2), slice(2, None, 2))
            )
            values = np.minimum(np.minimum(low, middle), high)
        return values


def _with_middles(values: Floats, axis: int) -> Floats:
    """Return values with the mean of each two neighbours along an axis between them."""
    values = np.moveaxis(values, axis, 0)
    fine = np.empty((2 * len(values) - 1, *values.shape[1:]))
    fine[::2], fine[1::2] = values, 0.5 * (values[:-1] + values[1:])
    return np.ascontiguousarray(np.moveaxis(fine, 0, axis))


def prove(
    grid: ProofGrid,
    met_by_paths: Callable[[ProofGrid], Bools],
    bounds_on: Callable[[ProofGrid], Callable[[ProofGrid, int], Floats]],
    places: tuple[Place, Place],
    path_cost: float,
    gap: float,
    cells: int,
    *,
    first: Sequence[int],
    carried: float,
) -> tuple[float, ProofGrid]:
    """Return a lower bound of the cost of all paths, and the finest grid.

    Args:
        grid: The first grid.
        met_by_paths: Returns which open cells of a grid paths may meet.
        bounds_on: Returns a function that computes bounds on a grid in a number of iterations:
            lower bounds of the costs to the first place and from the second, at the vertices.
        places: Goal and start.
        path_cost: Cost of a path; the bound is at most that.
        gap: Share of `path_cost` below which the bound is good enough.
        cells: No grid with more open cells than these is begun.
        first: Iterations on the first grid, as `ROUNDS`.
        carried: Factor on the values kept in a grid, for the initial values of the next one.
    """
    best = 0.0
    for rounds in chain([first], repeat(ROUNDS)):
        grid = replace(grid, open_cells=met_by_paths(grid))
        compute = bounds_on(grid)
        for iterations in rounds:
            bounds = compute(grid, iterations)
            best = max(best, *(grid.at(bounds[k], places[1 - k]) for k in (0, 1)))
            if best >= (1.0 - gap) * path_cost:
                return min(best, path_cost), grid
            least = grid.least(bounds[0] + bounds[1])
            near = grid.open_cells & (least <= path_cost * (1.0 + ROUNDING))
            grid = replace(grid, open_cells=near)
        if not near.any() or 2**near.ndim * np.count_nonzero(near) > cells:
            break
        grid = grid.halved(carried)
    return min(best, path_cost), grid


def flattened(cost: Floats, worst: Floats, path_cost: float) -> Floats:
    """Return costs with their ranges compressed where the gradient is too steep.

    Args:
        cost: From 0 to `path_cost`.
        worst: By what each of B even ranges is to be compressed, (B,), see `steepness`.
        path_cost: The end of the last range.
    """
    flat = np.concatenate([[0.0], np.cumsum((path_cost / len(worst)) / worst)])
    return np.interp(cost, np.linspace(0.0, path_cost, len(worst) + 1), flat * (1.0 - ROUNDING))
