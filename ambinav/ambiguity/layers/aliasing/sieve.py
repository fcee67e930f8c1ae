"""The first two steps of the search for look-alikes: signature and count, for bundles of poses.

Arrays go with the number of a row instead of as a slice, for slices are counted references, and
two threads that count one array's references wait for each other.

`aliasing_signature` says what they rest on, and that they lose no look-alike.
"""

from __future__ import annotations

import numpy as np

from ambinav.ambiguity.kernel import U
from ambinav.kernels import kernel

CHECK = 12
"""Beams between two looks whether any turn is left."""


@kernel
def fewest(acc):
    """The least of the counts."""
    least = np.uint8(255)
    for i in range(U(acc.size)):
        least = min(least, acc[i])
    return least


@kernel
def count_odd(bottom, top, p, beams, lows, widths, block, offset, odd, acc):
    """Count in `acc` the beams outside the intervals of each lane; False: too many in all.

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
    """Whether a box may hold a signature between least[p] and most[p]."""
    for level in range(least.shape[1]):
        if (
            least[p, level] > high[box, level] + odd
            or most[p, level] + odd + blind < low[box, level]
        ):
            return False
    return True


@kernel
def strides(told, stride):
    """The beams that tell something, in strides, so that the first ones see to all sides."""
    order = np.arange(told.size) * stride % told.size
    return order[told[order]]


@kernel
def sift(
    poses, told, codes, above, blind, odd, stride, skip, first, last, node_low, node_high,
    block_low, block_high, lows, widths, offset, lanes, passed,
):  # fmt: skip
    """Write the blocks that may hold a look-alike of any of the poses; return how many."""
    bottom, least = codes[poses[:1]], above[poses[:1]]
    top, most = bottom.copy(), least.copy()
    dark, tells = blind[poses[0]], told[poses[0]].copy()
    for p in poses[1:]:
        for b in range(tells.size):
            bottom[0, b], top[0, b] = min(bottom[0, b], codes[p, b]), max(top[0, b], codes[p, b])
            tells[b] &= told[p, b]
        for level in range(least.shape[1]):
            least[0, level] = min(least[0, level], above[p, level])
            most[0, level] = max(most[0, level], above[p, level])
        dark = max(dark, blind[p])
    order = strides(tells, stride)
    acc = np.empty(lanes, dtype=np.uint8)
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
