"""Turn on the spot that the scans do not reveal, for scanners that look all around."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import cKDTree

from ambinav.ambiguity.batch import (
    SEEN,
    SPREAD,
    batch_arrays,
    compare_batch,
    gradient,
    lay_batch,
    mine_at,
    theirs_at,
)
from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.gaussian import F0, F1, FAST, S, T, U, aligned
from ambinav.ambiguity.returns import Returns
from ambinav.runtime.array_types import Floats, Floats32, Ints, UInts
from ambinav.runtime.kernels import kernel
from ambinav.runtime.lanes import LANES, lane, lanes, load, root, store, totals, where, wide
from ambinav.runtime.threads import run_rows
from ambinav.sensing.scanner import RangeScanner

# Turns whose scans are less alike than exp(-12) are left out: all of them together move the
# second moment by less than a hundredth of a radian.
NEGLIGIBLE_TURN = 12.0
FOUR = np.float32(4.0)
# Turns up to here to both sides are compared, radians: more than a tracked robot is off (beyond 30
# degrees it counts as lost, `drive.metrics.LOST_HEADING`), and far from 90 and 180 degrees, by
# which square rooms and corridors look the same. Such poses are a matter of the layer `aliasing`.
WINDOW = math.radians(45.0)
# How often the turns of up to a step of the scanner are halved. A beam along a wall reaches its cap
# within a hundredth of a step and decides nothing from there on: taken for linear over the step,
# such beams gave 2 times too much information in a corridor with 4 m of range, 6 times with 12 m.
HALVINGS = 6
# A turn a degree tells all: to compare each scan at 7200 turns would take days for a building.
MOST_TURNS, FEWEST_TURNS = 360, 60


def turns(scanner: RangeScanner) -> UInts:
    """Return where each beam goes, for each turn by 2 pi k / n that maps the beams to themselves.

    Returns:
        uint64, shape (n, B), n the scanner's rotation order, or of one beyond `MOST_TURNS` its
        largest part that is not: beam b of the robot turned by 2 pi k / n stands where beam
        turns[k, b] of the unturned robot does.
    """
    order = _turns_of(scanner.rotation_order)
    x, y, yaw = scanner.mounts.T
    labels = np.column_stack([scanner.upright, scanner.sensor_of_beam])
    tree = cKDTree(np.column_stack([x, y, np.cos(yaw), np.sin(yaw), labels]))
    targets = np.empty((order, scanner.beams), dtype=np.uint64)
    for k in range(order):
        angle = 2 * math.pi * k / order
        c, s = math.cos(angle), math.sin(angle)
        turned = np.column_stack(
            [c * x - s * y, s * x + c * y, np.cos(yaw + angle), np.sin(yaw + angle), labels]
        )
        targets[k] = tree.query(turned)[1]
    return targets


def _turns_of(order: int) -> int:
    """Return how many turns to check: all, or fewer for scanners with thousands of beams."""
    parts = [n for n in range(1, MOST_TURNS + 1) if order % n == 0]
    # An order without such a part, a prime number say, is taken as it is.
    return order if order <= MOST_TURNS or parts[-1] < FEWEST_TURNS else parts[-1]


def turn_cells(order: int) -> Floats:
    """Return the turns to compare, up to `WINDOW` to both sides, as Gaussians.

    Those by whole steps turn the beams and are half a step wide. Shorter ones turn the scan along
    its derivative, those to the left first, from the one by 0 outwards on both sides. A beam that
    jumps from one surface to another changes by one of the two slopes, so neither side stands for
    the other.

    Args:
        order: How many turns by a step map the beams to themselves.

    Returns:
        Shape (M, 5), a row each: how many steps, from 0 to order - 1; mean, radians; variance;
        weight; and how much farther than the row before it is turned by the derivative, radians.
    """
    step = 2.0 * math.pi / order
    within = WINDOW / step + 0.5
    # Of the last a part is in the window.
    cells = [
        (side * k % order, side * k * step, (step / 2.0) ** 2, step * min(within - k, 1.0), 0.0)
        for k in range(1, math.ceil(within))
        for side in (1, -1)
    ]
    height = math.sqrt(2.0 / math.pi)
    first, turned = step / 2.0**HALVINGS, 0.0
    cells.append((0, 0.0, first**2, height * 2.0 * first, 0.0))
    for side in (1, -1):
        for edge in first * 2.0 ** np.arange(HALVINGS):
            # From `edge` to twice that. Narrow, or the best offset would be back at the turn by 0.
            mean = side * 1.5 * edge
            weight = height * math.exp(-2.0 * (mean / step) ** 2) * edge
            cells.append((0, mean, (edge / 8.0) ** 2, weight, mean - turned))
            turned = mean
    return np.array(cells)


def turning_moments(
    returns: Returns,
    poses: Ints,
    beams: UInts,
    table: BeamTable,
    evidence: Floats32 | None,
    tau: float,
    spacing: float,
) -> Floats:
    """Compute the root of the second moment of turns that leave the scan alike, radians.

    Args:
        returns: What the beams return.
        poses: Which, rows of `returns`, int64, shape (M,).
        beams: See `turns`.
        table: Their limits and caps.
        evidence: See `neighbourhood_sums`.
        tau: Beams per independent piece of evidence.
        spacing: Spacing of the lattice, metres: the turned robot may stand about so far off, since
            a cell represents every pose in it and in its neighbours.

    Returns:
        float64, shape (M, 2): the root of the second moment, and what it would be if
        every turn looked alike.
    """
    cells = turn_cells(len(beams))
    out = np.empty((len(poses), 2))
    out[:, 1] = math.sqrt(np.average(cells[:, 1] ** 2 + cells[:, 2], weights=cells[:, 3]))
    run_rows(
        _turning, len(poses), returns.data, poses, table.turned(beams), cells, table.limit,
        table.inverse_cap, evidence, tau, spacing**2, table.beams / tau, out, least=LANES,
    )  # fmt: skip
    return out


@kernel(fastmath=FAST, inline="always")
def bound_terms(theirs, half_0, half_2, wide_spread):
    """Write four spreads with the margins of `least_evidence` for each beam, flat (P, LANES)."""
    for i in range(U(wide_spread.size // LANES)):
        gx, gy, gt = gradient(theirs, i)
        room = lanes(half_0) * (gx * gx + gy * gy) + lanes(half_2) * (gt * gt)
        store(wide_spread, i * U(LANES), lanes(FOUR) * load(theirs, theirs_at(i, S)) + room)


@kernel(fastmath=FAST, inline="always")
def least_evidence(mine, wide_spread, others, icap):
    """Return a lower bound of the evidence between turned and unturned scans, lanes.

    Args:
        mine: See `lay_batch`.
        wide_spread: See `bound_terms`.
        others: Where each beam goes, (B,).
        icap: Inverse cap of each beam.
    """
    total = lanes(F0)
    for i in range(U(others.size)):
        j = others[i]
        z = load(mine, mine_at(i, SEEN)) - load(mine, mine_at(j, SEEN))
        square = z * z
        # u / (1 + u / cap) with u = z^2 / 4 room.
        room = lanes(FOUR) * load(mine, mine_at(i, SPREAD)) + load(wide_spread, j * U(LANES))
        total += square / (room + lanes(icap[i]) * square)
    return total


@kernel(fastmath=FAST, inline="always")
def turn_along(mine, theirs, angle):
    """Turn scans along their derivatives, as what they are compared with turned by -angle."""
    for i in range(U(mine.size // (4 * LANES))):
        moved = load(theirs, theirs_at(i, T)) * lanes(angle)
        store(mine, mine_at(i, SEEN), load(mine, mine_at(i, SEEN)) - moved)


@kernel(fastmath=FAST)
def turning_moment(
    beams, cells, wide_spread, limit, icap, evidence, tau, c0, part, arrays, moments
):
    """Compare sixteen scans with themselves, turned.

    Args:
        beams: See `turns`.
        cells: See `turn_cells`.
        wide_spread: Worked in, flat, (P, LANES).
        limit: Maximum range of each beam.
        icap: Inverse cap of each beam.
        evidence: See `neighbourhood_sums`.
        tau: Beams per independent piece of evidence.
        c0: Variance of the offset in x and y, square metres.
        part: Ranges per independent piece of evidence. All beams share one offset: each may lay
            only its part of the cost of that to its room. Intensities lay none.
        arrays: See `batch_arrays`, with the scans in them; what is seen is overwritten.
        moments: Written, float64, (1, LANES): root of the second moment of each scan.
    """
    mine, theirs, _, _ = arrays
    # Twice, for the terms hold four times half of each variance.
    widest = cells[0, 2]
    bound_terms(theirs, np.float32(2.0 * c0 * part), np.float32(2.0 * widest * part), wide_spread)
    negligible = lanes(np.float32(NEGLIGIBLE_TURN * tau))
    zero, unity = lanes(F0), lanes(F1)
    weight = moment = wide(zero)
    for m in range(cells.shape[0]):
        k, c2 = U(cells[m, 0]), cells[m, 2]
        if cells[m, 4] != 0.0:
            turn_along(mine, theirs, np.float32(cells[m, 4]))
        kept = where(least_evidence(mine, wide_spread, beams[k], icap) <= negligible, unity, zero)
        if lane(totals((kept,)), U(0)) == F0:
            continue
        alike, _, _, turned, _, _, _, spread = compare_batch(
            beams[k], icap, evidence, tau, c0, c2, arrays
        )
        angle = turned + cells[m, 1]
        alike *= wide(kept) * cells[m, 3]
        weight += alike
        moment += alike * (angle * angle + spread)
    store(moments, (U(0), U(0)), root(moment / weight))


@kernel
def _turning(low, high, data, poses, beams, cells, limit, icap, evidence, tau, c0, part, out):
    arrays = batch_arrays(limit.size)
    wide_spread = aligned(limit.size * LANES)
    scans = np.empty(LANES, dtype=np.int64)
    moments = np.empty((1, LANES))
    for block in range(low, high, LANES):
        for j in range(LANES):
            scans[j] = poses[min(block + j, high - 1)]
        lay_batch(data, scans, limit, arrays[0], arrays[1])
        turning_moment(
            beams, cells, wide_spread, limit, icap, evidence, tau, c0, part, arrays, moments
        )
        for j in range(min(LANES, high - block)):
            out[block + j, 0] = moments[0, j]
