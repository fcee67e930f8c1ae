"""How far the robot can turn on the spot unseen, for scanners that look all around."""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from ambinav.ambiguity.kernel import F0, F1, FAST, QUARTER, D, S, T, compare
from ambinav.ambiguity.returns import BeamTable, Returns
from ambinav.sensing.scanner import RangeScanner

# Turning on the spot leaves no offset in x and y; the kernel wants a variance above zero.
NO_OFFSET = 1e-8
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

    Returns:
        float64, shape (end - begin, 2): the root of the second moment, and what it would be if
        every turn looked alike.
    """
    out = np.empty((end - begin, 2))
    _turning(
        returns.data, begin, end, beams, table.limit, table.inverse_cap, table.use, evidence, tau,
        out,
    )  # fmt: skip
    return out


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)
def least_evidence(data, p, beams, limit, icap, c2):
    """Evidence that tells a turned scan from the unturned one, at the least."""
    told = F0
    half = np.float32(0.5 * c2)
    for b in range(beams.size):
        o = beams[b]
        z = min(data[p, D, b], limit[b]) - min(data[p, D, o], limit[b])
        room = data[p, S, b] + data[p, S, o] + half * data[p, T, b] * data[p, T, b]
        u = QUARTER * z * z / room
        told += u / (F1 + u * icap[b])
    return told


@njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def _turning(data, begin, end, beams, limit, icap, use, evidence, tau, out):
    order, count = beams.shape
    step = 2.0 * math.pi / order
    c2 = step * step / 4.0
    # All beams share one turn: each may lay only its part of the cost of that to its room.
    shared = c2 * count / tau
    for p in prange(begin, end):
        pair = np.zeros((2, 5, limit.size), dtype=np.float32)
        pair[0] = data[p]
        pair[1] = data[p]
        weight, moment, free_weight, free_moment = 0.0, 0.0, 0.0, 0.0
        for k in range(order // 2 + 1):
            # A turn to the left looks like the turn to the right seen from there.
            times = 1.0 if k in (0, order - k) else 2.0
            free_weight += times
            free_moment += times * (k * k * step * step + c2)
            if least_evidence(data, p, beams[k], limit, icap, shared) > NEGLIGIBLE_TURN * tau:
                continue
            for row in range(5):
                for b in range(count):
                    pair[1, row, b] = data[p, row, beams[k, b]]
            alike, _, _, turned, _, _, _, spread = compare(
                pair, 0, 1, limit, icap, use, evidence, tau, NO_OFFSET, c2
            )
            angle = k * step + turned
            weight += times * alike
            moment += times * alike * (angle * angle + spread)
        out[p - begin, 0] = math.sqrt(moment / weight)
        out[p - begin, 1] = math.sqrt(free_moment / free_weight)
