"""First two steps of the search for aliased poses: signature and count, for bundles of poses.

Arrays go with the number of a row instead of as a slice, for slices are counted references, and
two threads that count one array's references wait for each other.

`signature` beside this says what they rest on, and that they lose no aliased pose.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.gaussian import U
from ambinav.layers.aliasing.signature import Signatures
from ambinav.layers.aliasing.tree import Tree
from ambinav.runtime.array_types import Bytes, Indices, Ints, Ints32
from ambinav.runtime.kernels import kernel

CHECK = 12
"""Beams between two looks whether any turn is left."""


class SignatureArrays(NamedTuple):
    """Arrays of `Signatures` for the kernels, and the stride in which beams are counted."""

    code: Bytes
    above: NDArray[np.int16]
    blind: NDArray[np.int16]
    odd: int
    stride: int

    @classmethod
    def of(cls, signatures: Signatures, stride: int) -> SignatureArrays:
        """Arrange signatures for the kernels."""
        return cls(signatures.code, signatures.above, signatures.blind, signatures.odd, stride)


class TreeArrays(NamedTuple):
    """Arrays of a `Tree` for the kernels.

    Attributes:
        skip: See `Tree`, as are first and last.
        low: `Tree.node_low`.
        high: `Tree.node_high`.
        block_low: See `Tree`, as is block_high.
        lows: `Tree.low`.
        widths: `Tree.width`.
        offset: See `Tree`.
        owner: `Tree.pose`.
        filled: How many lanes of each block are no padding, shape (G,).
        turn: See `Tree`.
    """

    skip: Ints32
    first: Ints32
    last: Ints32
    low: NDArray[np.int16]
    high: NDArray[np.int16]
    block_low: NDArray[np.int16]
    block_high: NDArray[np.int16]
    lows: Bytes
    widths: Bytes
    offset: Ints
    owner: Ints32
    filled: Indices
    turn: Ints32

    @classmethod
    def of(cls, tree: Tree) -> TreeArrays:
        """Arrange a tree for the kernels."""
        filled = (tree.pose >= 0).sum(axis=1)
        return cls(
            tree.skip, tree.first, tree.last, tree.node_low, tree.node_high, tree.block_low,
            tree.block_high, tree.low, tree.width, tree.offset, tree.pose, filled, tree.turn,
        )  # fmt: skip


@kernel
def fewest(acc):
    """Return the smallest of the counts."""
    least = np.uint8(255)
    for i in range(U(acc.size)):
        least = min(least, acc[i])
    return least


@kernel
def count_odd(bottom, top, p, beams, lows, widths, block, offset, odd, acc):
    """Count in `acc` each lane's beams outside of the intervals; return False if all exceed `odd`.

    A beam, in whole numbers from bottom[p, b] to top[p, b], is outside if all of these are. Below
    its beginning a whole number less the beginning wraps round to a large one, so one comparison
    tells both sides. Four beams at a time keep `acc` in registers.
    """
    lanes, count, p, g = U(acc.size), beams.size, U(p), U(block)
    acc[:] = 0
    fours = count - count % 4
    for done in range(0, fours, 4):
        b0, b1, b2, b3 = beams[done], beams[done + 1], beams[done + 2], beams[done + 3]
        v0, v1, v2, v3 = top[p, b0], top[p, b1], top[p, b2], top[p, b3]
        s0, s1 = np.uint8(v0 - bottom[p, b0]), np.uint8(v1 - bottom[p, b1])
        s2, s3 = np.uint8(v2 - bottom[p, b2]), np.uint8(v3 - bottom[p, b3])
        o0, o1, o2, o3 = U(offset[b0]), U(offset[b1]), U(offset[b2]), U(offset[b3])
        for i in range(lanes):
            d0, d1 = np.uint8(v0 - lows[g, o0 + i]), np.uint8(v1 - lows[g, o1 + i])
            d2, d3 = np.uint8(v2 - lows[g, o2 + i]), np.uint8(v3 - lows[g, o3 + i])
            acc[i] = np.uint8(
                acc[i]
                + np.uint8(np.uint8(max(d0, s0) - s0) > widths[g, o0 + i])
                + np.uint8(np.uint8(max(d1, s1) - s1) > widths[g, o1 + i])
                + np.uint8(np.uint8(max(d2, s2) - s2) > widths[g, o2 + i])
                + np.uint8(np.uint8(max(d3, s3) - s3) > widths[g, o3 + i])
            )
        if done % CHECK == CHECK - 4 and fewest(acc) > odd:
            return False
    for done in range(fours, count):
        b = beams[done]
        v, s, o = top[p, b], np.uint8(top[p, b] - bottom[p, b]), U(offset[b])
        for i in range(lanes):
            d = np.uint8(v - lows[g, o + i])
            acc[i] = np.uint8(acc[i] + np.uint8(np.uint8(max(d, s) - s) > widths[g, o + i]))
    return fewest(acc) <= odd


@kernel
def holds(low, high, box, least, most, p, blind, odd):
    """Return whether a box may hold a signature between least[p] and most[p]."""
    for level in range(least.shape[1]):
        if (
            least[p, level] > high[box, level] + odd
            or most[p, level] + odd + blind < low[box, level]
        ):
            return False
    return True


@kernel
def strides(known, stride):
    """Return the beams with information, in strides, so that the first ones look to all sides."""
    order = np.arange(known.size) * stride % known.size
    return order[known[order]]


@kernel
def sift(poses, known, signatures, tree, passed):
    """Write the blocks that may hold an aliased pose of any of the poses; return their number.

    Args:
        poses: A bundle, shape (M,).
        known: See `Scans`.
        signatures: `SignatureArrays` of all scans.
        tree: `TreeArrays` of the poses that are looked among.
        passed: Written, int32, room for all blocks.
    """
    codes, above, blind, odd, stride = signatures
    skip, first, last, node_low, node_high = tree.skip, tree.first, tree.last, tree.low, tree.high
    block_low, block_high, lows, widths = tree.block_low, tree.block_high, tree.lows, tree.widths
    offset = tree.offset
    bottom, least = codes[poses[:1]], above[poses[:1]]
    top, most = bottom.copy(), least.copy()
    dark, both_known = blind[poses[0]], known[poses[0]].copy()
    for p in poses[1:]:
        for b in range(both_known.size):
            bottom[0, b], top[0, b] = min(bottom[0, b], codes[p, b]), max(top[0, b], codes[p, b])
            both_known[b] &= known[p, b]
        for level in range(least.shape[1]):
            least[0, level] = min(least[0, level], above[p, level])
            most[0, level] = max(most[0, level], above[p, level])
        dark = max(dark, blind[p])
    order = strides(both_known, stride)
    acc = np.empty(tree.owner.shape[1], dtype=np.uint8)
    count, node = 0, 0
    while node < skip.size:
        if not holds(node_low, node_high, node, least, most, 0, dark, odd):
            node = skip[node]
            continue
        for block in range(first[node], last[node]):
            if holds(block_low, block_high, block, least, most, 0, dark, odd) and count_odd(
                bottom, top, 0, order, lows, widths, block, offset, odd, acc
            ):
                passed[count] = block
                count += 1
        node += 1
    return count
