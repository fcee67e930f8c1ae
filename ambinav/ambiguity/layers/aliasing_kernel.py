"""The search for look-alikes: signature, count, gap, and then the scans themselves.

`aliasing_signature` says what each step rests on, and that it loses no look-alike.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from ambinav.ambiguity.indistinguishability import Z_MAX, Z_STEP
from ambinav.ambiguity.kernel import (
    F0,
    F1,
    FAST,
    PER_STEP,
    QUARTER,
    Z_TOP,
    D,
    S,
    T,
    U,
    X,
    Y,
    compare,
)
from ambinav.ambiguity.layers.aliasing_scans import Scans
from ambinav.ambiguity.layers.aliasing_signature import SLACK, Signatures, slides
from ambinav.ambiguity.layers.aliasing_tree import Tree
from ambinav.ambiguity.returns import LANES

_Z_COUNT = round(Z_MAX / Z_STEP)
RINGS = 4
"""Rings that the offsets are divided into; with more, fewer pairs are compared in vain."""
CHECK = 12
"""Beams between two looks whether any turn is left."""
# float32 sums may be off by this share of the threshold; what is nearer to it is compared.
ROUNDING = 1e-3


@njit(cache=True, nogil=True, error_model="numpy")
def turned(data, q, k, turns, beams, out):
    """Copy scan q into `out`, shape (5, padded), its orbits shifted by k."""
    left, shift = U(turns - k), U(k)
    for row in range(5):
        for j in range(0, beams, turns):
            here, there, to = data[q, row], out[row], U(j)
            for i in range(left):
                there[to + i] = here[to + i + shift]
            for i in range(shift):
                there[to + left + i] = here[to + i]


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def gap_evidence(here, there, k, limit, icap, softness, reach):
    """Evidence that is left, at the least, if the offset may slide each beam by reach * slide.

    Args:
        here: Range, half the variance and slide of p's beams, shape (3, orbits, 2 n and more):
            each orbit twice in a row, so that a turn needs no copy.
        there: The same of q's.
        k: How often q is turned.
        limit: Shape (orbits, n, padded), as the next two.
        icap: See `Scans`.
        softness: See `Scans`; 0 for padding.
        reach: r.
    """
    total = F0
    slack, shift, n = np.float32(SLACK), U(k), U(limit.shape[1])
    for j in range(limit.shape[0]):
        for i in range(n):
            d = min(here[0, j, i], limit[j, i])
            room = reach * there[2, j, i + shift]
            low = min(there[0, j, i + shift] - room, limit[j, i])
            high = min(there[0, j, i + shift] + room, limit[j, i])
            gap = max(max(low - d, d - high) - slack, F0)
            u = softness[j, i] * QUARTER * gap * gap / (here[1, j, i] + there[1, j, i + shift])
            x = u * icap[j, i]
            total += u / np.float32(math.sqrt(F1 + x * x))
    return total


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def evidence_at(pair, limit, icap, use, evidence, ox, oy, ot):
    """Capped evidence against the two scans being one, the second one's pose moved by (o)."""
    total = F0
    for b in range(limit.size):
        moved = pair[1, X, b] * ox + pair[1, Y, b] * oy + pair[1, T, b] * ot
        z = min(pair[0, D, b], limit[b]) - min(pair[1, D, b] + moved, limit[b])
        inverse = use[b] / (pair[0, S, b] + pair[1, S, b])
        u = z * z * inverse * QUARTER
        if evidence is not None:
            place = min(math.sqrt(z * z * inverse), Z_TOP) * PER_STEP
            k = min(np.int32(place), np.int32(_Z_COUNT))
            share = place - np.float32(k)
            u *= evidence[b, k] * (F1 - share) + evidence[b, k + 1] * share
        x = u * icap[b]
        total += u / np.float32(math.sqrt(F1 + x * x))
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def possible(here, there, k, limit, icap, softness, tau, threshold):
    """Whether any ring of offsets leaves so little evidence that the scans may be alike."""
    share = threshold / RINGS
    allowed = threshold * (1.0 + ROUNDING)
    reach = np.float32(math.sqrt(2.0 * threshold))
    # Within a smaller reach even more is left.
    least = gap_evidence(here, there, k, limit, icap, softness, reach)
    if least > tau * allowed:
        return False
    if least <= tau * (allowed - threshold + share):
        return True
    for ring in range(RINGS - 1, 0, -1):
        left = tau * (allowed - share * (ring - 1))
        if least <= left:
            reach = np.float32(math.sqrt(2.0 * share * ring))
            least = gap_evidence(here, there, k, limit, icap, softness, reach)
            if least <= left:
                return True
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def count_odd(codes, beams, low, width, offset, odd, acc):
    """Count in `acc` the beams of p outside the intervals of each lane; False: too many in all.

    Below its beginning a whole number less the beginning wraps round to a large one, so one
    comparison with the width tells both sides. Four beams at a time keep `acc` in registers.
    """
    lanes, count = U(acc.size), beams.size
    acc[:] = 0
    fours = count - count % 4
    for done in range(0, fours, 4):
        b0, b1, b2, b3 = beams[done], beams[done + 1], beams[done + 2], beams[done + 3]
        v0, v1, v2, v3 = codes[b0], codes[b1], codes[b2], codes[b3]
        o0, o1, o2, o3 = U(offset[b0]), U(offset[b1]), U(offset[b2]), U(offset[b3])
        for i in range(lanes):
            acc[i] = np.uint8(
                acc[i]
                + np.uint8(np.uint8(v0 - low[o0 + i]) > width[o0 + i])
                + np.uint8(np.uint8(v1 - low[o1 + i]) > width[o1 + i])
                + np.uint8(np.uint8(v2 - low[o2 + i]) > width[o2 + i])
                + np.uint8(np.uint8(v3 - low[o3 + i]) > width[o3 + i])
            )
        if done % CHECK == 8 and fewest(acc) > odd:
            return False
    for done in range(fours, count):
        v, o = codes[beams[done]], U(offset[beams[done]])
        for i in range(lanes):
            acc[i] = np.uint8(acc[i] + np.uint8(np.uint8(v - low[o + i]) > width[o + i]))
    return fewest(acc) <= odd


@njit(cache=True, nogil=True, error_model="numpy")
def fewest(acc):
    """The least of the counts."""
    least = np.uint8(255)
    for i in range(U(acc.size)):
        least = min(least, acc[i])
    return least


@njit(cache=True, nogil=True, error_model="numpy")
def holds(low, high, above, blind, odd):
    """Whether a signature may lie in a box."""
    for level in range(above.size):
        if above[level] > high[level] + odd or above[level] + odd + blind < low[level]:
            return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def keep_best(near, like, where, count, best):
    """Write the places of the most alike, at least `near` apart, into `best`; -1 for none."""
    best[:] = -1
    alive = np.ones(count, dtype=np.bool_)
    for rank in range(best.size):
        top = -1
        for i in range(count):
            if alive[i] and (top < 0 or like[i] > like[top]):
                top = i
        if top < 0:
            return
        best[rank] = top
        for i in range(count):
            dx, dy = where[i, 0] - where[top, 0], where[i, 1] - where[top, 1]
            if dx * dx + dy * dy <= near * near:
                alive[i] = False


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def compare_fully(pair, limit, icap, use, evidence, tau, c0, c2):
    """I of the pair, the best offset, the evidence there per tau, and Phi."""
    alike, ox, oy, ot, _, _, _, _ = compare(pair, 0, 1, limit, icap, use, evidence, tau, c0, c2)
    x, y, t = np.float32(ox), np.float32(oy), np.float32(ot)
    apart = evidence_at(pair, limit, icap, use, evidence, x, y, t) / tau
    return alike, ox, oy, ot, apart, apart + 0.5 * ((ox * ox + oy * oy) / c0 + ot * ot / c2)


@njit(cache=True, nogil=True, error_model="numpy")
def search_one(
    p, data, wide, orbits, limit, icap, use, evidence, told, x, y, heading, place,
    turns, tau, c0, c2, codes, above, blind, odd, stride, skip, first, last, node_low, node_high,
    block_low, block_high, lows, widths, offset, owner, turn_of_lane, threshold, radius, mass,
    found,
):  # fmt: skip
    """Look for what looks like pose p; write its mass and `found`, return how many compared."""
    beams, lanes = codes.shape[1], owner.shape[1]
    # In strides, so that the first beams see to all sides.
    order = np.arange(beams) * stride % beams
    order = order[told[p][order]]
    pair = np.zeros((2, 5, limit.size), dtype=np.float32)
    pair[:, 4] = 1.0
    pair[0] = data[p]
    acc = np.empty(lanes, dtype=np.uint8)
    like = np.empty(64)
    where = np.empty((64, 3))
    count, latest, compared, node = 0, -1, 0, 0
    while node < skip.size:
        if not holds(node_low[node], node_high[node], above[p], blind[p], odd):
            node = skip[node]
            continue
        for block in range(first[node], last[node]):
            if not holds(block_low[block], block_high[block], above[p], blind[p], odd):
                continue
            if not count_odd(codes[p], order, lows[block], widths[block], offset, odd, acc):
                continue
            for lane in range(lanes):
                q, k = owner[block, lane], turn_of_lane[lane]
                if acc[lane] > odd or q < 0:
                    continue
                if not possible(wide[p], wide[q], k, *orbits, tau, threshold):
                    continue
                turned(data, q, k, turns, beams, pair[1])
                compared += 1
                alike, ox, oy, ot, apart, phi = compare_fully(
                    pair, limit, icap, use, evidence, tau, c0, c2
                )
                if phi > threshold:
                    continue
                dx, dy = x[q] - x[p], y[q] - y[p]
                if dx * dx + dy * dy <= radius * radius * (1.0 + 1e-9):
                    mass[0] += alike
                    continue
                mass[1] += alike
                if place[q] > 0 and place[q] == place[p]:
                    continue
                # One entry a pose q: the lanes of a pose follow each other.
                if latest != q:
                    if count == like.size:
                        like = np.concatenate((like, np.empty(count)))
                        where = np.concatenate((where, np.empty((count, 3))))
                    like[count] = -1.0
                    count += 1
                    latest = q
                if math.exp(-apart) > like[count - 1]:
                    like[count - 1] = math.exp(-apart)
                    where[count - 1, 0] = x[q] + ox
                    where[count - 1, 1] = y[q] + oy
                    turn = 2.0 * math.pi * k / turns + ot
                    where[count - 1, 2] = heading[q] - heading[p] + turn
        node += 1
    best = np.empty(found.shape[0], dtype=np.int64)
    keep_best(radius, like, where, count, best)
    for rank in range(best.size):
        if best[rank] >= 0:
            found[rank, :3] = where[best[rank]]
            found[rank, 3] = like[best[rank]]
    return compared


@njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def _search(
    poses, data, wide, orbits, limit, icap, use, evidence, told, x, y, heading, place,
    turns, tau, c0, c2, codes, above, blind, odd, stride, skip, first, last, node_low, node_high,
    block_low, block_high, lows, widths, offset, owner, turn_of_lane, threshold, radius,
    mass, found, compared,
):  # fmt: skip
    for i in prange(poses.size):
        compared[i] = search_one(
            poses[i], data, wide, orbits, limit, icap, use, evidence, told, x, y, heading, place,
            turns, tau, c0, c2, codes, above, blind, odd, stride, skip, first, last, node_low,
            node_high, block_low, block_high, lows, widths, offset, owner, turn_of_lane, threshold,
            radius, mass[i], found[i],
        )  # fmt: skip


def search(
    poses: NDArray[np.int32],
    scans: Scans,
    signatures: Signatures,
    tree: Tree,
    place: NDArray[np.int32],
    radius: float,
    threshold: float,
    count: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Find what looks like the scans of some poses.

    Args:
        poses: Which, shape (M,).
        scans: All scans.
        signatures: Of all scans.
        tree: The poses that are looked among.
        place: Number of the place that each pose lies in, shape (N,); two poses of one place
            above 0 are not listed as look-alikes of each other.
        radius: R, metres.
        threshold: T, see `aliasing_signature`.
        count: Most look-alikes to list of each pose.

    Returns:
        Mass within and beyond R, shape (M, 2): sums of I over poses and turns. Look-alikes, shape
        (M, count, 4): x, y (metres), turn from p's heading to theirs (radians), and likeness; NaN
        where there are no more. Number of scans compared in full, shape (M,).
    """
    mass = np.zeros((len(poses), 2))
    found = np.full((len(poses), count, 4), np.nan)
    compared = np.zeros(len(poses), dtype=np.int64)
    _search(
        poses, scans.data, *orbit_rows(scans), scans.limit, scans.inverse_cap, scans.use,
        scans.evidence, scans.told, scans.x, scans.y, scans.heading, place,
        scans.turns, scans.tau, *scans.cell_variance, signatures.code, signatures.above,
        signatures.blind, signatures.odd, _stride(scans.beams), tree.skip, tree.first, tree.last,
        tree.node_low, tree.node_high, tree.block_low, tree.block_high, tree.low, tree.width,
        tree.offset, tree.pose, tree.turn, threshold, radius, mass, found, compared,
    )  # fmt: skip
    return mass, found, compared


def orbit_rows(
    scans: Scans,
) -> tuple[NDArray[np.float32], tuple[NDArray[np.float32], ...]]:
    """What `gap_evidence` reads: scans, float32, (N, 3, orbits, 2 n + padding), and beams.

    Where no turn is a shift, all beams are one orbit. The beams' limit, inverse cap and softness
    are padded to a multiple of `LANES`, so that the loop fills the vector registers.
    """
    n = scans.turns if scans.turns > 1 else scans.beams
    more = ((0, 0), (0, -n % LANES))
    rows = np.stack([scans.data[:, 0], scans.data[:, 4], slides(scans)], axis=1)
    orbits = rows[:, :, : scans.beams].reshape(len(rows), 3, -1, n)
    twice = np.concatenate([orbits, orbits], axis=3)
    padded = np.pad(twice, ((0, 0), (0, 0), *more), constant_values=1.0)
    limit, cap, soft = (
        np.pad(row[: scans.beams].reshape(-1, n), more)
        for row in (scans.limit, scans.inverse_cap, scans.softness)
    )
    return padded, (limit, cap, soft)


def _stride(beams: int) -> int:
    """A step that leads to every beam, and soon to all sides."""
    return next(
        (step for step in (7, 11, 13, 17) if step < beams and math.gcd(step, beams) == 1), 1
    )
