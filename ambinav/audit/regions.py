"""Connected regions of the floor that share a zone, never joined through a wall."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Labels = NDArray[np.int32]
Mask = NDArray[np.bool_]
Floats = NDArray[np.float64]

_ALIGNED = math.radians(20.0)
"""Pieces of corridor are one corridor if their weak directions differ by less."""


def passable(free: Mask, clearance: Floats, spacing: float, room: float = 0.0) -> Mask:
    """Free cells that no wall can pass between, at least `room` metres from all walls.

    A wall may have no thickness, and then no cell of its own. Of two neighbours on either side of
    one at least one lies within half a cell of it, so without the cells close to walls no path
    along neighbours crosses a wall.
    """
    return free & (clearance > max(0.5 * spacing, room) * (1 + 1e-6))


def find_regions(
    zone: NDArray[np.uint8],
    codes: tuple[int, ...],
    direction: Floats,
    passable: Mask,
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
    labels = np.zeros(zone.shape, dtype=np.int32)
    owner: list[int] = [0]
    for code in codes:
        found, count = ndimage.label((zone == code) & passable)
        labels = np.where(found > 0, found + len(owner) - 1, labels).astype(np.int32)
        owner += [code] * count
    owners = np.array(owner)
    reach = _spread(labels, passable, (gap + 1) // 2)
    labels = _join_pieces(labels, reach, owners, direction)
    labels = _join_small(labels, reach, least)
    # Cells close to a wall were left out; they go to the region that they touch.
    claim = np.isin(zone, codes) & (labels == 0) & ~passable
    labels = np.where(claim, _spread(labels, claim, rim), labels)
    return _numbered(labels)


def _spread(labels: Labels, mask: Mask, steps: int) -> Labels:
    """Grow all labels by `steps` cells within `mask`; the larger label wins a tie."""
    # Cell by cell: of a large floor few are to be labelled, and a filter looks at all.
    padded = np.pad(labels, 1)
    flat, width = padded.reshape(-1), padded.shape[1]
    cells = np.flatnonzero(np.pad(mask & (labels == 0), 1))
    for _ in range(steps):
        grown = np.zeros(cells.size, dtype=np.int32)
        for offset in (-width, -1, 1, width):
            np.maximum(grown, flat[cells + offset], out=grown)
        flat[cells] = grown
        cells = cells[grown == 0]
    return padded[1:-1, 1:-1]


def _touching(labels: Labels) -> NDArray[np.int32]:
    """Pairs (a, b), a < b, of labels that lie side by side, shape (n, 2)."""
    pairs = []
    for first, second in ((labels[1:], labels[:-1]), (labels[:, 1:], labels[:, :-1])):
        border = (first != second) & (first > 0) & (second > 0)
        pairs.append(np.stack([first[border], second[border]], axis=-1))
    both = np.concatenate(pairs)
    return np.unique(np.sort(both, axis=1), axis=0)


def _join_pieces(
    labels: Labels, reach: Labels, owners: NDArray[np.int_], direction: Floats
) -> Labels:
    """Give touching regions of one zone and one direction the same label."""
    index = np.arange(len(owners))
    known = np.isfinite(direction) & (labels > 0)
    axis = np.zeros(len(owners), dtype=np.complex128)
    np.add.at(axis, labels[known], np.exp(2j * direction[known]))
    for a, b in _touching(reach).tolist():
        turned = abs(np.angle(axis[a] * np.conj(axis[b]))) / 2.0
        if owners[a] == owners[b] and turned < _ALIGNED:
            index[_root(index, b)] = _root(index, a)
    roots = np.array([_root(index, i) for i in range(len(index))], dtype=np.int32)
    np.copyto(reach, roots[reach])
    return roots[labels]


def _join_small(labels: Labels, reach: Labels, least: int) -> Labels:
    """Give regions of fewer than `least` cells to their largest neighbour, or drop them."""
    size = np.bincount(labels.ravel(), minlength=int(labels.max()) + 1)
    target = np.where(size >= least, np.arange(size.size), 0).astype(np.int32)
    best = np.zeros(size.size, dtype=np.int64)
    for a, b in _touching(reach).tolist():
        for small, big in ((a, b), (b, a)):
            if size[small] < least <= size[big] and size[big] > best[small]:
                best[small], target[small] = size[big], big
    return target[labels]


def _root(index: NDArray[np.int_], i: int) -> int:
    while index[i] != i:
        index[i] = index[index[i]]
        i = int(index[i])
    return i


def _numbered(labels: Labels) -> Labels:
    used = np.bincount(labels.ravel(), minlength=1) > 0
    used[0] = False
    return (np.cumsum(used) * used).astype(np.int32)[labels]
