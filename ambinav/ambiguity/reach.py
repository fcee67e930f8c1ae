"""Poses of the disc around a pose that can be reached within it, cell by cell, across no wall."""

from __future__ import annotations

import numpy as np

from ambinav.runtime.array_types import Bytes, Ints, Ints32, UInts
from ambinav.runtime.kernels import kernel

# Bits of a word: a disc that is wider is searched cell by cell.
WORD = 64
U = np.uint64
ONE, WORD_BITS, LAST = U(1), U(6), U(63)
# Steps of `STEPS` that lead along a row or into the next one; the other four lead back.
EAST, NORTH_EAST, NORTH, NORTH_WEST = 0, 1, 2, 3


def link_planes(
    links: Bytes, rows_columns: Ints32, first: int, shape: tuple[int, int], offsets: Ints
) -> UInts:
    """Pack links to the east, north-east, north and north-west as bits, row by row of the lattice.

    Args:
        links: See `Lattice`; from pose `first` on, shape (H, N).
        rows_columns: See `Lattice`.
        first: Running number of the first pose in `links`.
        shape: Rows and columns of the lattice.
        offsets: Row and column steps of the disc, shape (K, 2).

    Returns:
        uint64, shape (H, 4, rows, words): the bit of a column stands `WORD` places after the first,
        so that there are words before and after each. Empty where the disc is wider than a word.
    """
    if 2 * np.abs(offsets).max() + 1 > WORD:
        return np.empty((len(links), 0, 0, 0), dtype=np.uint64)
    planes = np.zeros((len(links), 4, shape[0], shape[1] // WORD + 4), dtype=np.uint64)
    _lay(links, rows_columns, first, planes)
    return planes


@kernel
def _lay(links, rows_columns, first, planes):
    for h in range(links.shape[0]):
        for i in range(links.shape[1]):
            row, place = rows_columns[first + i, 0], U(rows_columns[first + i, 1] + WORD)
            for step in range(4):
                bit = U((links[h, i] >> step) & 1)
                planes[h, step, row, place >> WORD_BITS] |= bit << (place & LAST)


@kernel
def flood_arrays(offsets, side):
    """Return work arrays of `neighbours`: bits of the disc, reached cells, links; a queue."""
    bits = np.zeros(side, dtype=np.uint64)
    for o in range(offsets.shape[0]):
        bits[offsets[o, 0] + side // 2] |= ONE << U(offsets[o, 1] + side // 2)
    queue = np.empty(side * side if side > WORD else 0, dtype=np.int32)
    return bits, np.empty(side, dtype=np.uint64), np.empty((4, side), dtype=np.uint64), queue


@kernel
def neighbours(row, column, index, first, links, planes, offsets, side, steps, marks, scratch):
    """Mark with 2 the offsets in the disc reachable by lattice steps across no segment.

    Args:
        row: Row of the pose, like `column`.
        column: Column of the pose.
        index: See `Lattice`.
        first: Running number of the first pose in `links`.
        links: See `Lattice`.
        planes: The same, see `link_planes`.
        offsets: Row and column steps of the disc, (K, 2).
        side: Side of a square around it.
        steps: `STEPS`.
        marks: Written, uint8, (side * side,).
        scratch: See `flood_arrays`.
    """
    disc, reached, links_here, queue = scratch
    if side > WORD:
        reach(row, column, index, first, links, offsets, side, steps, marks, queue)
        return
    k = side // 2
    place = U(column - k + WORD)
    word, shift = place >> WORD_BITS, place & LAST
    for r in range(side):
        reached[r] = 0
        there = row - k + r
        for step in range(4):
            bits = U(0)
            if 0 <= there < planes.shape[1]:
                bits = planes[step, there, word] >> shift
                bits |= (planes[step, there, word + ONE] << ONE) << (LAST - shift)
            links_here[step, r] = bits
    reached[k] = ONE << U(k)
    flood(disc, links_here, reached)
    for o in range(offsets.shape[0]):
        r, c = offsets[o, 0] + k, offsets[o, 1] + k
        marks[r * side + c] = ((reached[r] >> U(c)) & ONE) << ONE


@kernel(inline="always")
def along(bits, disc, east):
    """Return bits of a row and the cells that they reach by links along it."""
    before = U(0)
    while bits != before:
        before = bits
        bits |= (((bits & east) << ONE) | ((bits >> ONE) & east)) & disc
    return bits


@kernel
def flood(disc, links, reached):
    """Grow `reached`, bits of each row, by links within the disc until nothing is new."""
    last = disc.size - 1
    grew = True
    while grew:
        grew = False
        for r in range(disc.size):
            bits = reached[r]
            if r > 0:
                low = reached[r - 1]
                bits |= low & links[NORTH, r - 1]
                bits |= (low & links[NORTH_EAST, r - 1]) << ONE
                bits |= (low & links[NORTH_WEST, r - 1]) >> ONE
            bits = along(bits & disc[r], disc[r], links[EAST, r])
            grew |= bits != reached[r]
            reached[r] = bits
        for back in range(last):
            r = last - 1 - back
            high = reached[r + 1]
            bits = reached[r] | (high & links[NORTH, r])
            bits |= (high >> ONE) & links[NORTH_EAST, r]
            bits |= (high << ONE) & links[NORTH_WEST, r]
            bits = along(bits & disc[r], disc[r], links[EAST, r])
            grew |= bits != reached[r]
            reached[r] = bits


@kernel(error_model="python")
def reach(row, column, index, first, links, offsets, side, steps, marks, queue):
    """Mark the same cells as `neighbours`, cell by cell, for a disc of any size."""
    k = side // 2
    marks[:] = 0
    for o in range(offsets.shape[0]):
        marks[(offsets[o, 0] + k) * side + offsets[o, 1] + k] = 1
    head, tail = 0, 1
    queue[0] = k * side + k
    marks[queue[0]] = 2
    while head < tail:
        cell = queue[head]
        head += 1
        r, c = cell // side - k, cell % side - k
        bits = links[index[row + r, column + c] - first]
        for s in range(8):
            if bits & (1 << s):
                nr, nc = r + steps[s, 1], c + steps[s, 0]
                if abs(nr) <= k and abs(nc) <= k:
                    to = (nr + k) * side + nc + k
                    if marks[to] == 1:
                        marks[to] = 2
                        queue[tail] = to
                        tail += 1
