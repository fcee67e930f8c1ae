"""Search for aliased poses in steps: signature, count, gap, then the full scans.

`signature` beside this says what each step rests on, and that it loses no aliased pose.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ambinav.ambiguity.gaussian import F0, F1, FAST, PER_STEP, QUARTER, Z_TOP, D, S, T, U, X, Y
from ambinav.ambiguity.indistinguishability import Z_MAX, Z_STEP
from ambinav.ambiguity.pair import compare
from ambinav.layers.aliasing.scans import Scans
from ambinav.layers.aliasing.sieve import (
    SignatureArrays,
    TreeArrays,
    count_odd,
    holds,
    sift,
    strides,
)
from ambinav.layers.aliasing.signature import SLACK, Signatures, slides
from ambinav.layers.aliasing.tree import Tree
from ambinav.runtime.array_types import Bools, Floats, Floats32, Indices, Ints, Ints32
from ambinav.runtime.kernels import kernel
from ambinav.runtime.lanes import LANES
from ambinav.runtime.threads import run_rows

# Row of the slides, beside those of `Returns.data`.
SLIDE = U(5)
_Z_COUNT = round(Z_MAX / Z_STEP)
RINGS = 4
"""Rings that the offsets are divided into; with more, fewer pairs are compared in vain."""
SIFTED, COUNTED, COMPARED, ALIKE = range(4)
ENOUGH = 0.5
"""Share of the threshold up to which evidence left at the full reach is not divided into rings."""
Rows = tuple[Floats32, tuple[Floats32, ...]]
# float32 sums may be off by this share of the threshold; what is nearer to it is compared.
ROUNDING = 1e-3


@kernel
def turned(wide, q, k, turns, out, to):
    """Copy scan q, turned by k, into out[to]; `wide` of `orbit_rows`, out of shape (2, 5, P)."""
    q, shift, n, to = U(q), U(k), U(turns), U(to)
    for row in (D, X, Y, T, S):
        for j in range(U(wide.shape[2])):
            begin = j * n
            for i in range(n):
                out[to, row, begin + i] = wide[q, row, j, i + shift]


@kernel(fastmath=FAST)
def gap_evidence(wide, p, q, k, limit, icap, softness, reach):
    """Return a lower bound of the evidence if the offset slides each beam by reach * slide.

    Args:
        wide: Rows of `Returns.data` and slide of all beams, shape (N, 6, orbits, 2 n and more):
            each orbit twice in a row, so that a turn needs no copy.
        p: Row of the one scan.
        q: Row of the other.
        k: How often q is turned.
        limit: Shape (orbits, n, padded), as the next two.
        icap: See `Scans`.
        softness: See `Scans`; 0 for padding.
        reach: r.
    """
    total = F0
    slack, p, q = np.float32(SLACK), U(p), U(q)
    shift, n = U(k), U(limit.shape[1])
    for j in range(U(limit.shape[0])):
        for i in range(n):
            d = min(wide[p, D, j, i], limit[j, i])
            room = reach * wide[q, SLIDE, j, i + shift]
            low = min(wide[q, D, j, i + shift] - room, limit[j, i])
            high = min(wide[q, D, j, i + shift] + room, limit[j, i])
            gap = max(max(low - d, d - high) - slack, F0)
            u = softness[j, i] * QUARTER * gap * gap / (wide[p, S, j, i] + wide[q, S, j, i + shift])
            x = u * icap[j, i]
            total += u / np.float32(math.sqrt(F1 + x * x))
    return total


@kernel(fastmath=FAST)
def evidence_at(pair, limit, icap, use, evidence, ox, oy, ot):
    """Return the capped evidence against two scans being one, the second pose moved by (o)."""
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


@kernel
def possible(wide, p, q, k, limit, icap, softness, tau, threshold):
    """Return whether, on some ring of offsets, the evidence is low enough for an aliased pair."""
    share = threshold / RINGS
    allowed = threshold * (1.0 + ROUNDING)
    reach = np.float32(math.sqrt(2.0 * threshold))
    # A smaller reach leaves even more evidence.
    least = gap_evidence(wide, p, q, k, limit, icap, softness, reach)
    if least > tau * allowed:
        return False
    if least <= tau * ENOUGH * threshold:
        return True
    for ring in range(RINGS - 1, 0, -1):
        left = tau * (allowed - share * (ring - 1))
        if least <= left:
            reach = np.float32(math.sqrt(2.0 * share * ring))
            least = gap_evidence(wide, p, q, k, limit, icap, softness, reach)
            if least <= left:
                return True
    return False


@kernel
def keep_best(near, like, where, count, best):
    """Write the most similar of `count` poses, more than `near` apart, to `best`; -1 for none."""
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


@kernel(fastmath=FAST)
def compare_fully(pair, limit, icap, use, evidence, tau, c0, c2):
    """Return I of the pair, the best offset, the evidence there per tau, and Phi."""
    alike, ox, oy, ot, _, _, _, _ = compare(pair, 0, 1, limit, icap, use, evidence, tau, c0, c2)
    x, y, t = np.float32(ox), np.float32(oy), np.float32(ot)
    apart = evidence_at(pair, limit, icap, use, evidence, x, y, t) / tau
    return alike, ox, oy, ot, apart, apart + 0.5 * ((ox * ox + oy * oy) / c0 + ot * ot / c2)


@kernel
def approach(
    begin, end, first, cell, second, excess, limit, icap, use, evidence, tau, c0, c2, apart, moved
):  # fmt: skip
    """Compute evidence per tau between scans and their aliased poses, and the best offsets.

    Args:
        begin: First row.
        end: One past the last.
        first: Scans, shape (P, 5, padded).
        cell: Which of them is compared, shape (M,).
        second: Scans of the aliased poses, shape (M, 5, padded).
        excess: Radians by which each aliased heading exceeds the one it was cast at, shape (M,).
        limit: See `Scans`, in the beams' own order, as the next three.
        icap: See `Scans`.
        use: See `Scans`.
        evidence: See `Scans`.
        tau: See `Scans`.
        c0: See `compare`.
        c2: See `compare`.
        apart: Written, shape (M,).
        moved: Written: best offset from where `second` was cast, shape (M, 3).
    """
    pair = np.empty((2, 5, limit.size), dtype=np.float32)
    for i in range(begin, end):
        pair[0], pair[1] = first[cell[i]], second[i]
        turn = np.float32(excess[i])
        apart[i] = evidence_at(pair, limit, icap, use, evidence, F0, F0, turn) / tau
        _, x, y, t, _, _ = compare_fully(pair, limit, icap, use, evidence, tau, c0, c2)
        moved[i, 0], moved[i, 1], moved[i, 2] = x, y, t


class ScanArrays(NamedTuple):
    """Scans and the poses where they were taken, as arrays for the search.

    Attributes:
        wide: See `orbit_rows`.
        orbits: Limit, inverse cap and softness of the beams in orbits; see `orbit_rows`.
        beams: Limit, inverse cap, use and evidence of the beams; see `Scans`.
        known: See `Scans`.
        x: See `Scans`, as are y and heading.
        region: Number of the region that each pose lies in, shape (N,); see `search`.
        turns: Beams of an orbit.
        tau: See `Scans`.
        cell_variance: See `Scans`.
    """

    wide: Floats32
    orbits: tuple[Floats32, ...]
    beams: tuple[Floats32 | None, ...]
    known: Bools
    x: Floats
    y: Floats
    heading: Floats
    region: Ints32
    turns: int
    tau: float
    cell_variance: tuple[float, float]


@kernel
def search_one(p, blocks, scans, signatures, tree, threshold, radius, mass, aliased, left):
    """Search for poses aliased with pose p; write mass, `aliased` and how many each step left."""
    wide, orbits, (limit, icap, use, evidence), known, x, y, heading, place, turns, tau, _ = scans
    c0, c2 = scans.cell_variance
    codes, above, blind, odd, stride = signatures
    block_low, block_high, lows, widths = tree.block_low, tree.block_high, tree.lows, tree.widths
    offset, owner, filled, turn_of_lane = tree.offset, tree.owner, tree.filled, tree.turn
    lanes = owner.shape[1]
    order = strides(known[p], stride)
    pair = np.zeros((2, 5, limit.size), dtype=np.float32)
    pair[:, 4] = 1.0
    turned(wide, p, 0, turns, pair, 0)
    acc = np.empty(lanes, dtype=np.uint8)
    like = np.empty(64)
    where = np.empty((64, 3))
    count, latest = 0, -1
    for block in blocks:
        left[SIFTED] += filled[block]
        if not holds(block_low, block_high, block, above, above, p, blind[p], odd):
            continue
        if not count_odd(codes, codes, p, order, lows, widths, block, offset, odd, acc):
            continue
        for lane in range(lanes):
            q, k = owner[block, lane], turn_of_lane[lane]
            if acc[lane] > odd or q < 0:
                continue
            left[COUNTED] += 1
            if not possible(wide, p, q, k, *orbits, tau, threshold):
                continue
            turned(wide, q, k, turns, pair, 1)
            left[COMPARED] += 1
            alike, ox, oy, ot, apart, phi = compare_fully(
                pair, limit, icap, use, evidence, tau, c0, c2
            )
            if phi > threshold:
                continue
            left[ALIKE] += 1
            dx, dy = x[q] - x[p], y[q] - y[p]
            if dx * dx + dy * dy <= radius * radius * (1.0 + 1e-9):
                mass[0] += alike
                continue
            mass[1] += alike
            if place[q] > 0 and place[q] == place[p]:
                continue
            # Where it is most alike may be nearer than its cell's centre.
            dx, dy = dx + ox, dy + oy
            if dx * dx + dy * dy <= radius * radius:
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
    best = np.empty(aliased.shape[0], dtype=np.int64)
    keep_best(radius, like, where, count, best)
    for rank in range(best.size):
        if best[rank] >= 0:
            aliased[rank, :3] = where[best[rank]]
            aliased[rank, 3] = like[best[rank]]


@kernel
def _search(
    low, high, bundles, poses, scans, signatures, tree, threshold, radius, mass, aliased, left
):  # fmt: skip
    passed = np.empty(len(tree.owner), dtype=np.int32)
    for g in range(low, high):
        begin, end = bundles[g], bundles[g + 1]
        blocks = passed[: sift(poses[begin:end], scans.known, signatures, tree, passed)]
        for i in range(begin, end):
            search_one(
                poses[i], blocks, scans, signatures, tree, threshold, radius,
                mass[i], aliased[i], left[i],
            )  # fmt: skip


def search(
    poses: Ints32,
    bundles: Indices,
    scans: Scans,
    rows: Rows,
    signatures: Signatures,
    tree: Tree,
    place: Ints32,
    radius: float,
    threshold: float,
    count: int,
) -> tuple[Floats, Floats, Ints]:
    """Search for the poses aliased with some poses.

    Args:
        poses: Which, shape (M,), bundle after bundle.
        bundles: Where each of G bundles begins in `poses`, and M, shape (G + 1,).
        scans: All scans.
        rows: What `orbit_rows` makes of them.
        signatures: Signatures of all scans.
        tree: The poses that are looked among.
        place: Number of the place that each pose lies in, shape (N,); two poses of one place
            above 0 are not listed as aliased with each other.
        radius: R, metres.
        threshold: T, see `signature` beside this.
        count: Most aliased poses to list of each pose.

    Returns:
        Mass within and beyond R, shape (M, 2): sums of I over poses and turns. Aliased poses, shape
        (M, count, 4): x, y (metres), turn from p's heading to theirs (radians), and likeness; NaN
        where there are no more. How many pairs and turns each
        step left, shape (M, 4): `SIFTED` for the bundle, `COUNTED`, `COMPARED` in full, `ALIKE`.
    """
    mass = np.zeros((len(poses), 2))
    aliased = np.full((len(poses), count, 4), np.nan)
    step_counts = np.zeros((len(poses), 4), dtype=np.int64)
    beams = scans.limit, scans.inverse_cap, scans.use, scans.evidence
    arrays = ScanArrays(
        *rows, beams, scans.known, scans.x, scans.y, scans.heading, place, _orbit(scans), scans.tau,
        scans.cell_variance,
    )  # fmt: skip
    run_rows(
        _search, len(bundles) - 1, bundles, poses, arrays,
        SignatureArrays.of(signatures, _stride(scans.beams)), TreeArrays.of(tree), threshold,
        radius, mass, aliased, step_counts,
    )  # fmt: skip
    return mass, aliased, step_counts


def orbit_rows(scans: Scans) -> Rows:
    """Return the kernel's input: scans, float32, (N, 6, orbits, 2 n + padding), and beams.

    Where no turn is a shift, all beams are one orbit. The beams' limit, inverse cap and softness
    are padded to a multiple of `LANES`, so that the loop fills the vector registers.
    """
    n = _orbit(scans)
    padding = ((0, 0), (0, -n % LANES))
    count = scans.beams // n
    padded = np.ones((len(scans.x), 6, count, 2 * n + padding[1][1]), dtype=np.float32)
    orbits = scans.data[:, :, : scans.beams].reshape(-1, 5, count, n)
    slid = slides(scans)[:, : scans.beams].reshape(-1, count, n)
    for at in (0, n):
        padded[:, :5, :, at : at + n] = orbits
        padded[:, 5, :, at : at + n] = slid
    limit, cap, soft = (
        np.pad(row[: scans.beams].reshape(-1, n), padding)
        for row in (scans.limit, scans.inverse_cap, scans.softness)
    )
    return padded, (limit, cap, soft)


def _orbit(scans: Scans) -> int:
    """Return the number of beams in an orbit: all beams where no turn is a shift."""
    return scans.turns if scans.turns > 1 else scans.beams


def _stride(beams: int) -> int:
    """Return a step that visits every beam, and soon looks to all sides."""
    return next(
        (step for step in (7, 11, 13, 17) if step < beams and math.gcd(step, beams) == 1), 1
    )
