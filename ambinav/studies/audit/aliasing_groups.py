"""Grouping of aliased poses into regions, by the offsets between neighbouring poses.

If p looks like q, turned by t, then a step s from p leads to an aliased pose a step s, turned by t,
from q.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ambinav.layers.context import LayerContext
from ambinav.runtime.array_types import Bools, Floats

Cells = NDArray[np.intp]

SAME_TURN = 0.2
"""Radians by which the turns of neighbours may differ."""
STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Columns and rows from a cell to its neighbours."""
CHUNK = 2048


def stepped(spacing: float, alike: Floats, step: tuple[int, int]) -> Floats:
    """Predict the aliased poses after a step of the pose: x, y and turn, shape (..., 3).

    Args:
        spacing: Spacing of the lattice, metres.
        alike: x, y and turn, and perhaps more, shape (..., 3 or more).
        step: Columns and rows.
    """
    dx, dy = step
    cos, sin = np.cos(alike[..., 2]), np.sin(alike[..., 2])
    x = alike[..., 0] + spacing * (dx * cos - dy * sin)
    y = alike[..., 1] + spacing * (dx * sin + dy * cos)
    return np.stack([x, y, alike[..., 2]], axis=-1)


def same(spacing: float, poses: Floats, other: Floats) -> Bools:
    """Return which poses, shape (..., 3 or more), agree within half a spacing and `SAME_TURN`."""
    off = np.hypot(poses[..., 0] - other[..., 0], poses[..., 1] - other[..., 1])
    bend = np.abs(np.mod(poses[..., 2] - other[..., 2] + np.pi, 2.0 * np.pi) - np.pi)
    return np.asarray((off <= 0.5 * spacing) & (bend <= SAME_TURN))


def neighbours(context: LayerContext, cells: Cells, step: tuple[int, int]) -> Cells:
    """Return the free cell one step away from each cell, -1 where there is none."""
    index = np.pad(context.lattice.index, 1, constant_values=-1)
    row, column = context.lattice.rows_columns[cells].T + 1
    return np.asarray(index[row + step[1], column + step[0]], dtype=np.intp)


def join(
    context: LayerContext, entries: Floats, linked: Bools, least: int
) -> list[tuple[Cells, Cells]]:
    """Join cells along lattice steps while their aliased poses follow the predicted offsets.

    Args:
        context: Context with the poses.
        entries: x, y, turn and likeness of the aliased poses of P cells, shape (P, count, 4).
        linked: Mask of those that take part, shape (P, count).
        least: Fewest cells of a region.

    Returns:
        For each region its cells, in order, and which aliased pose of each, shape (M,) both.
    """
    count = entries.shape[1]
    ends = [(np.empty(0, dtype=np.intp),) * 2]
    for begin in range(0, len(entries), CHUNK):
        for step in STEPS[:2]:
            cell = np.arange(begin, min(begin + CHUNK, len(entries)))
            to = neighbours(context, cell, step)
            cell, to = cell[to >= 0], to[to >= 0]
            predicted = stepped(context.spacing, entries[cell], step)[:, :, np.newaxis]
            targets = entries[to][:, np.newaxis]
            fits = linked[cell][:, :, np.newaxis] & linked[to][:, np.newaxis]
            fits &= same(context.spacing, predicted, targets)
            off = np.hypot(predicted[..., 0] - targets[..., 0], predicted[..., 1] - targets[..., 1])
            off = np.where(fits, off, np.inf)
            # One to one: otherwise a pose that slides along a wall would join with all its aliases.
            for axis in (1, 2):
                fits &= off <= off.min(axis=axis, keepdims=True)
            row, source, target = np.nonzero(fits)
            ends.append((cell[row] * count + source, to[row] * count + target))
    joined = tuple(np.concatenate(side) for side in zip(*ends, strict=True))
    size = linked.size
    graph = coo_array((np.ones(len(joined[0]), dtype=np.int8), joined), shape=(size, size))
    label = connected_components(graph, directed=False)[1]
    nodes = np.flatnonzero(linked)
    likeness = entries[..., 3].ravel()[nodes]
    nodes = nodes[np.lexsort((-likeness, nodes // count, label[nodes]))]
    # A cell counts once, by its most similar aliased pose.
    _, first = np.unique([label[nodes], nodes // count], axis=1, return_index=True)
    nodes = nodes[first]
    pieces = np.split(nodes, np.flatnonzero(np.diff(label[nodes])) + 1)
    return [(piece // count, piece % count) for piece in pieces if len(piece) >= least]
