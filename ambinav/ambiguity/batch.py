"""Comparison of sixteen pairs of scans at once, one pair a lane.

The sums over beams are those of `ambinav.ambiguity.pair`, where sixteen beams of one pair go side
by side. Here nothing is left to be taken over lanes, and a turn of the scanner is another order of
columns. In return the scans must be turned first, so that each has a lane: worth it where a scan is
compared many times.
"""

from __future__ import annotations

import numpy as np

from ambinav.ambiguity.gaussian import (
    F0,
    F1,
    FAST,
    NEAR,
    NEVER,
    PER_STEP,
    QUARTER,
    Z_TOP,
    D,
    S,
    T,
    U,
    X,
    Y,
    aligned,
    gaussian,
    grown,
    integral,
    nine_rows,
)
from ambinav.runtime.kernels import kernel
from ambinav.runtime.lanes import (
    LANES,
    interpolated_in,
    lanes,
    least,
    load,
    most,
    narrow,
    root,
    store,
    transpose,
    where,
)

# Rows of what is known of the scans that others are compared with: the reading, at most the maximum
# range; half the squared deviation; residuals down to which an offset leaves the beam out of range;
# and residuals below which the beam tells nothing at the centre of the cell.
SEEN, SPREAD, FLOOR, SILENT = U(0), U(1), U(2), U(3)


@kernel(inline="always")
def mine_at(i, row):
    """Return where column i of a scan begins in a flat array of shape (P, 4, LANES)."""
    return (i * U(4) + row) * U(LANES)


@kernel(inline="always")
def theirs_at(i, row):
    """Return where column i of a scan begins in a flat array of shape (P, 5, LANES)."""
    return (i * U(5) + row) * U(LANES)


@kernel
def batch_arrays(columns):
    """Return work arrays of a batch, for scans of `columns` columns P, padding included.

    Returns:
        Scans that are compared with others (`seen_by`), flat float32, and the others
        (`lay_batch`); weights of beams; and sums over beams, shape (10, LANES).
    """
    return (
        aligned(columns * 4 * LANES),
        aligned(columns * 5 * LANES),
        aligned(columns * LANES),
        aligned(10 * LANES).reshape(10, LANES),
    )


@kernel(fastmath=FAST)
def lay_batch(data, scans, limit, mine, theirs):
    """Write sixteen scans, rows of `data` (see `Returns`), one a lane.

    Args:
        data: See `Returns`, float32, (N, 5, P).
        scans: Which, (LANES,).
        limit: Maximum range of each beam, float32, (P,), metres.
        mine: Written, flat, of shape (P, 4, LANES): as what others are compared with.
        theirs: Written, flat, of shape (P, 5, LANES).
    """
    zero, never, tie = lanes(F0), lanes(NEVER), lanes(NEAR)
    for i in range(U(0), U(limit.size), U(LANES)):
        for row in (D, X, Y, T, S):
            transpose(data, scans, U(0), row, i, theirs, theirs_at(i, row), theirs_at(U(1), U(0)))
    for i in range(U(limit.size)):
        seen = least(load(theirs, theirs_at(i, D)), lanes(limit[i]))
        floor = seen - lanes(limit[i])
        store(mine, mine_at(i, SEEN), seen)
        store(mine, mine_at(i, SPREAD), load(theirs, theirs_at(i, S)))
        store(mine, mine_at(i, FLOOR), floor + tie)
        store(mine, mine_at(i, SILENT), where(zero <= floor, zero, never))


@kernel(fastmath=FAST, inline="always")
def first_steps(mine, theirs, others, icap, half0, half2, sums):
    """Write sums over beams for the offsets at which the scans agree best.

    Args:
        mine: See `lay_batch`.
        theirs: See `lay_batch`; the offset moves these.
        others: The columns of `theirs` that those of `mine` are compared with, in order, unsigned,
            shape (B,).
        icap: Inverse cap of each column of `mine`, float32.
        half0: Half the variance of the offset in x and y, float32, square metres.
        half2: Half the variance of the offset in theta, float32, square radians.
        sums: Written, rows 0 to 8: see `pair.first_step`.
    """
    slide, turn, zero = lanes(half0), lanes(half2), lanes(F0)
    totals_so_far = (zero, zero, zero, zero, zero, zero, zero, zero, zero)
    for i in range(U(others.size)):
        j = others[i]
        gx, gy, gt = gradient(theirs, j)
        spread = load(mine, mine_at(i, SPREAD)) + load(theirs, theirs_at(j, S))
        z = load(mine, mine_at(i, SEEN)) - load(theirs, theirs_at(j, D))
        room = spread + (gx * gx + gy * gy) * slide + gt * gt * turn
        capped = room + z * z * lanes(icap[i] * QUARTER)
        w = where(
            z < load(mine, mine_at(i, SILENT)), zero, room * room / (capped * capped * spread)
        )
        totals_so_far = grown(totals_so_far, w, z, gx, gy, gt)
    written(sums, totals_so_far)


@kernel(inline="always")
def gradient(theirs, j):
    """Return the derivatives of column j by x, y and theta."""
    return (
        load(theirs, theirs_at(j, X)),
        load(theirs, theirs_at(j, Y)),
        load(theirs, theirs_at(j, T)),
    )


@kernel(inline="always")
def written(sums, values):
    """Store nine sums."""
    g0, g1, g2, a, b, c, d, e, f = values
    z = U(0)
    store(sums, (U(0), z), g0)
    store(sums, (U(1), z), g1)
    store(sums, (U(2), z), g2)
    store(sums, (U(3), z), a)
    store(sums, (U(4), z), b)
    store(sums, (U(5), z), c)
    store(sums, (U(6), z), d)
    store(sums, (U(7), z), e)
    store(sums, (U(8), z), f)


@kernel(fastmath=FAST, inline="always")
def second_steps(mine, theirs, others, icap, evidence, e0, e1, e2, weights, sums):
    """Write sums over beams for the integrals over the cell, at given offsets.

    Args:
        mine: As for `first_steps`, like the next three.
        theirs: The others.
        others: Columns of `theirs`.
        icap: Inverse cap.
        evidence: Table of evidence, float32, (P, Z), or None where bins are fine.
        e0: Along x, metres, lanes.
        e1: Along y, metres, lanes.
        e2: By theta, radians, lanes.
        weights: Worked in.
        sums: Written, rows 0 to 9: see `pair.second_step`.
    """
    zero, unit = lanes(F0), lanes(F1)
    total = beyond = zero
    for i in range(U(others.size)):
        j = others[i]
        gx, gy, gt = gradient(theirs, j)
        spread = load(mine, mine_at(i, SPREAD)) + load(theirs, theirs_at(j, S))
        full = load(mine, mine_at(i, SEEN)) - load(theirs, theirs_at(j, D))
        z = full - (gx * e0 + gy * e1 + gt * e2)
        floor = load(mine, mine_at(i, FLOOR))
        silent = z <= floor
        z = most(z, floor)
        square = z * z
        x = square * lanes(icap[i] * QUARTER)
        if evidence is not None:
            place = least(root(square / spread), lanes(Z_TOP)) * lanes(PER_STEP)
            slope = interpolated_in(evidence, i, place) / spread
            t = unit / root(unit + x * x * slope * slope)
            r = slope * t
            w = r * (t * t)
        else:
            s2 = spread * spread
            r = unit / root(s2 + x * x)
            w = r * r * (s2 * r)
        w = where(silent, zero, w)
        total += square * r
        beyond += w * (full * full - square)
        store(weights, i * U(LANES), w)
    store(sums, (U(9), U(0)), (total + beyond) * lanes(QUARTER))
    # Apart, as in `pair.second_step`.
    totals_so_far = (zero, zero, zero, zero, zero, zero, zero, zero, zero)
    for i in range(U(others.size)):
        j = others[i]
        gx, gy, gt = gradient(theirs, j)
        full = load(mine, mine_at(i, SEEN)) - load(theirs, theirs_at(j, D))
        totals_so_far = grown(totals_so_far, load(weights, i * U(LANES)), full, gx, gy, gt)
    written(sums, totals_so_far)


@kernel(fastmath=FAST)
def compare_batch(others, icap, evidence, tau, c0, c2, arrays):
    """Compare sixteen pairs of scans; see `pair.compare`.

    Args:
        others: See `first_steps`.
        icap: Inverse cap.
        evidence: See `second_steps`.
        tau: Beams per independent piece of evidence.
        c0: Variance of the offset in x and y, square metres.
        c2: Variance of the offset in theta, square radians.
        arrays: See `batch_arrays`; the first two are read.

    Returns:
        Wide lanes: I, best offset (x, y, theta), and its covariance (xx, xy, yy, tt).
    """
    mine, theirs, weights, sums = arrays
    half0, half2 = np.float32(0.5 * c0), np.float32(0.5 * c2)
    first_steps(mine, theirs, others, icap, half0, half2, sums)
    o0, o1, o2, _, _, _, _, _, _, _ = gaussian(nine_rows(sums), tau, c0, c2)
    second_steps(
        mine, theirs, others, icap, evidence, narrow(o0), narrow(o1), narrow(o2), weights, sums
    )
    return integral(sums, tau, c0, c2)
