"""Connected regions of one zone; regions are never joined through a wall."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ambinav.runtime.array_types import Bools, Bytes, Ints32

Labels = NDArray[np.int32]
Floats = NDArray[np.floating[Any]]
Cells = NDArray[np.intp]

GAP = 1.0
"""Metres of other floor that a region may bridge: a doorway does not cut a corridor in two."""
LEAST_AREA = 1.0
"""Square metres; smaller regions join a neighbour or are left out."""
_ALIGNED = math.radians(20.0)
"""Pieces of corridor are one corridor if their weak directions differ by less."""


def passable(free: Bools, clearance: Floats, spacing: float) -> Bools:
    """Find free cells between which no wall can pass.

    A wall may have no thickness, and then no cell of its own. Of two neighbours on either side of
    one at least one lies within half a cell of it, so without the cells close to walls no path
    along neighbours crosses a wall.
    """
    # Compared in float64, whatever the type of the clearance; NaN means no room.
    return free & (clearance > np.float64(0.5 * spacing * (1 + 1e-6)))


def find_regions(
    zone: Bytes,
    codes: tuple[int, ...],
    direction: Floats,
    passable: Bools,
    *,
    gap: int,
    least: int,
    rim: int = 2,
) -> Labels:
    """Label the regions of the given zones, each of one zone.

    Pieces of the same zone that lie at most `gap` cells apart, along free floor, are one region
    if their weak directions agree. Regions of fewer than `least` cells join their largest
    neighbour within that gap; those without one are left out.

    Args:
        zone: (ny, nx) zone codes.
        codes: Zones to look for. Directions are compared where `direction` is not NaN.
        direction: (ny, nx) weak direction in radians, NaN where none is pronounced.
        passable: (ny, nx) cells that connect, see `passable`.
        gap: Cells.
        least: Cells.
        rim: Cells; so far off `passable` floor of the zone belongs to the region that it touches.

    Returns:
        (ny, nx), 0 outside of regions, otherwise 1 .. N without holes in the numbering.
    """
    # Few cells of a large lattice are in these zones, so later steps use only those.
    labels = np.zeros(zone.shape, dtype=np.int32)
    owner: list[int] = [0]
    for code in codes:
        pieces, count = ndimage.label((zone == code) & passable)
        cells = _labelled_cells(pieces)
        labels.reshape(-1)[cells] = pieces.reshape(-1)[cells] + (len(owner) - 1)
        owner += [code] * count
    owners = np.array(owner)
    cells = _labelled_cells(labels)
    reach = np.zeros(zone.shape, dtype=np.int32)
    reach.reshape(-1)[cells] = labels.reshape(-1)[cells]
    _spread(reach, passable, (gap + 1) // 2)
    _join_pieces(labels, reach, owners, direction)
    _join_small(labels, reach, least)
    # Cells close to a wall were left out; they go to the region that they touch.
    claim = (labels == 0) & ~passable
    claim &= functools.reduce(np.logical_or, [zone == code for code in codes])
    _spread(labels, claim, rim)
    return _renumber(labels)


def _labelled_cells(labels: Labels) -> Cells:
    """Return the cells with a label as indices of the flattened lattice."""
    return np.flatnonzero(labels != 0)  # of integers themselves it takes four times as long


def _neighbour_pairs(cells: Cells, shape: tuple[int, int]) -> Iterator[tuple[Cells, Cells]]:
    """Yield pairs of cells with their neighbours to the right, left, above and below."""
    rows, columns = shape
    row, column = np.divmod(cells, columns)
    for inside, offset in (
        (column < columns - 1, 1),
        (column > 0, -1),
        (row < rows - 1, columns),
        (row > 0, -columns),
    ):
        chosen = cells[inside]
        yield chosen, chosen + offset


def _spread(labels: Labels, mask: Bools, steps: int) -> Labels:
    """Grow all labels in place by `steps` cells within `mask`; the larger label wins a tie."""
    rows, columns = labels.shape
    flat, within = labels.reshape(-1), mask.reshape(-1)
    edge = _labelled_cells(labels)
    for _ in range(steps):
        grown = []
        for cells, near in _neighbour_pairs(edge, (rows, columns)):
            free = within[near] & (flat[near] == 0)
            grown.append((near[free], flat[cells[free]]))
        for near, label in grown:
            np.maximum.at(flat, near, label)
        edge = np.unique(np.concatenate([near for near, _ in grown]))
    return labels


def _touching(labels: Labels) -> Ints32:
    """Return pairs (a, b), a < b, of labels that are adjacent, shape (n, 2)."""
    rows, columns = labels.shape
    flat, pairs = labels.reshape(-1), []
    for cells, near in _neighbour_pairs(_labelled_cells(labels), (rows, columns)):
        border = flat[near] > flat[cells]  # the label 0 is the least
        pairs.append(np.stack([flat[cells[border]], flat[near[border]]], axis=-1))
    return np.unique(np.concatenate(pairs), axis=0)


def _join_pieces(
    labels: Labels, reach: Labels, owners: NDArray[np.int_], direction: Floats
) -> None:
    """Give touching regions of one zone and one direction the same label, in place."""
    index = np.arange(len(owners))
    cells = _labelled_cells(labels)
    angle = np.asarray(direction.reshape(-1)[cells], dtype=np.float64)
    is_finite = np.isfinite(angle)
    axis = np.zeros(len(owners), dtype=np.complex128)
    np.add.at(axis, labels.reshape(-1)[cells[is_finite]], np.exp(2j * angle[is_finite]))
    for a, b in _touching(reach).tolist():
        turned = abs(np.angle(axis[a] * np.conj(axis[b]))) / 2.0
        if owners[a] == owners[b] and turned < _ALIGNED:
            index[_root(index, b)] = _root(index, a)
    roots = np.array([_root(index, i) for i in range(len(index))], dtype=np.int32)
    _rename(labels, roots)
    _rename(reach, roots)


def _join_small(labels: Labels, reach: Labels, least: int) -> None:
    """Give regions of fewer than `least` cells to their largest neighbour, or drop them."""
    flat = labels.reshape(-1)
    size = np.bincount(flat[_labelled_cells(labels)], minlength=1)
    target = np.where(size >= least, np.arange(size.size), 0).astype(np.int32)
    best = np.zeros(size.size, dtype=np.int64)
    for a, b in _touching(reach).tolist():
        for small, big in ((a, b), (b, a)):
            if size[small] < least <= size[big] and size[big] > best[small]:
                best[small], target[small] = size[big], big
    _rename(labels, target)


def _rename(labels: Labels, names: Ints32) -> None:
    """Replace each label by its entry in `names`, in place; label 0 is kept."""
    flat, cells = labels.reshape(-1), _labelled_cells(labels)
    flat[cells] = names[flat[cells]]


def _root(index: NDArray[np.int_], i: int) -> int:
    while index[i] != i:
        index[i] = index[index[i]]
        i = int(index[i])
    return i


def _renumber(labels: Labels) -> Labels:
    """Renumber labels consecutively, in place, and return them."""
    flat = labels.reshape(-1)
    used = np.bincount(flat[_labelled_cells(labels)], minlength=1) > 0
    _rename(labels, (np.cumsum(used) * used).astype(np.int32))
    return labels
