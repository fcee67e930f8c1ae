"""How far the robot can turn on the spot unseen, for scanners that look all around."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.kernel import F0, F1, FAST, QUARTER, D, S, T, X, Y, compare
from ambinav.ambiguity.returns import BeamTable, Returns
from ambinav.kernels import kernel
from ambinav.sensing.scanner import RangeScanner
from ambinav.threads import run_rows

# Turns whose scans are less alike than exp(-12) are left out: all of them together move the
# second moment by less than a hundredth of a radian.
NEGLIGIBLE_TURN = 12.0


def turns(scanner: RangeScanner) -> NDArray[np.uint64]:
    """For each turn by 2 pi k / n that maps the beams onto themselves, where each beam goes.

    Returns:
        uint64, shape (n, B), n the scanner's rotation order: beam b of the robot turned by
        2 pi k / n stands where beam turns[k, b] of the unturned robot does.
    """
    order = scanner.rotation_order
    x, y, yaw = scanner.mounts.T
    found = np.empty((order, scanner.beams), dtype=np.uint64)
    for k in range(order):
        angle = 2 * math.pi * k / order
        c, s = math.cos(angle), math.sin(angle)
        apart = (
            np.abs((c * x - s * y)[:, None] - x)
            + np.abs((s * x + c * y)[:, None] - y)
            + np.abs(np.exp(1j * (yaw + angle))[:, None] - np.exp(1j * yaw))
            + (scanner.sensor_of_beam[:, None] != scanner.sensor_of_beam)
        )
        found[k] = apart.argmin(axis=1)
    return found


def turning_moments(
    returns: Returns,
    begin: int,
    end: int,
    beams: NDArray[np.uint64],
    table: BeamTable,
    evidence: NDArray[np.float32] | None,
    tau: float,
    spacing: float,
) -> NDArray[np.float64]:
    """Root of the second moment of the turns that leave the scan alike, radians.

    Args:
        returns: What the beams return.
        begin: First pose, a row of `returns`.
        end: One past the last pose.
        beams: See `turns`.
        table: Their limits and caps.
        evidence: See `neighbourhood_sums`.
        tau: Beams per independent piece of evidence.
        spacing: Of the lattice, metres: the turned robot may stand about so far off, since a
            cell stands for every pose in it and in its neighbours.

    Returns:
        float64, shape (end - begin, 2): the root of the second moment, and what it would be if
        every turn looked alike.
    """
    out = np.empty((end - begin, 2))
    run_rows(
        _turning, end - begin, returns.data, begin, beams, table.limit, table.inverse_cap,
        table.use, evidence, tau, spacing**2, out, least=16,
    )  # fmt: skip
    return out


@kernel(fastmath=FAST)
def least_evidence(data, p, beams, limit, icap, c0, c2):
    """Evidence that tells a turned scan from the unturned one, at the least."""
    total = F0
    half_0, half_2 = np.float32(0.5 * c0), np.float32(0.5 * c2)
    for b in range(beams.size):
        o = beams[b]
        z = min(data[p, D, b], limit[b]) - min(data[p, D, o], limit[b])
        slide = data[p, X, o] * data[p, X, o] + data[p, Y, o] * data[p, Y, o]
        turn = data[p, T, o] * data[p, T, o]
        room = data[p, S, b] + data[p, S, o] + half_0 * slide + half_2 * turn
        u = QUARTER * z * z / room
        total += u / (F1 + u * icap[b])
    return total


@kernel(fastmath=FAST)
def turning_moment(data, p, beams, pair, limit, icap, use, evidence, tau, c0, out):
    """Compare the scan at p with itself, turned; write what `turning_moments` says."""
    order, count = beams.shape
    step = 2.0 * math.pi / order
    c2 = step * step / 4.0
    # All beams share one offset: each may lay only its part of the cost of that to its room.
    part = count / tau
    weight, moment, free_weight, free_moment = 0.0, 0.0, 0.0, 0.0
    for k in range(order // 2 + 1):
        # A turn to the left looks like the turn to the right seen from there.
        times = 1.0 if k in (0, order - k) else 2.0
        free_weight += times
        free_moment += times * (k * k * step * step + c2)
        least = least_evidence(data, p, beams[k], limit, icap, c0 * part, c2 * part)
        if least > NEGLIGIBLE_TURN * tau:
            continue
        for row in range(5):
            for b in range(count):
                pair[1, row, b] = data[p, row, beams[k, b]]
        alike, _, _, turned, _, _, _, spread = compare(
            pair, 0, 1, limit, icap, use, evidence, tau, c0, c2
        )
        angle = k * step + turned
        weight += times * alike
        moment += times * alike * (angle * angle + spread)
    out[0] = math.sqrt(moment / weight)
    out[1] = math.sqrt(free_moment / free_weight)


@kernel
def _turning(low, high, data, begin, beams, limit, icap, use, evidence, tau, c0, out):
    pair = np.empty((2, 5, limit.size), dtype=np.float32)
    for i in range(low, high):
        p = begin + i
        # Not as whole arrays: the message for shapes that differ takes seconds to compile.
        for k in range(5):
            for b in range(limit.size):
                pair[0, k, b] = pair[1, k, b] = data[p, k, b]
        turning_moment(data, p, beams, pair, limit, icap, use, evidence, tau, c0, out[i])
