"""The ambiguity kernel: every pose's scan against those of its neighbours.

For poses p and q it integrates the indistinguishability of their scans over the offset within
q's cell (docs/model.md), in two steps. The first finds the offset that makes the scans
agree best, with each beam's residual seen through what the cell can move it. The second stands
at that offset: a beam that still disagrees there is capped, and cannot pull. Concave capping
makes the second step a lower bound on the integral that is tight at the best offset.

`ambinav.ambiguity.reference` says the same in plain NumPy.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.indistinguishability import Z_MAX, Z_STEP
from ambinav.ambiguity.returns import BeamTable, Returns
from ambinav.geometry.lattice import STEPS
from ambinav.kernels import kernel
from ambinav.threads import run_rows

FAST = {"reassoc", "nsz", "contract", "arcp", "nnan", "ninf"}
_Z_COUNT = round(Z_MAX / Z_STEP)
# Python hears of an interruption after so many beam comparisons, a second or two.
INTERRUPT_EVERY = 400_000_000

U = np.uint64
# Rows of `Returns.data`.
D, X, Y, T, S = U(0), U(1), U(2), U(3), U(4)
F0 = np.float32(0.0)
F1 = np.float32(1.0)
QUARTER = np.float32(0.25)
HALF = np.float32(0.5)
PER_STEP = np.float32(1.0 / Z_STEP)
Z_TOP = np.float32(Z_MAX)


@kernel(inline="always")
def invert(a, b, c, d, e, f):
    """Inverse (upper triangle, row by row) and determinant of [[a,b,c],[b,d,e],[c,e,f]]."""
    i00, i01, i02 = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * i00 + b * i01 + c * i02
    r = 1.0 / det
    i11, i12, i22 = a * f - c * c, b * c - a * e, a * d - b * b
    return i00 * r, i01 * r, i02 * r, i11 * r, i12 * r, i22 * r, det


# Inlined, for the arrays of a call alone are forty words; the caller needs fastmath=FAST too.
@kernel(fastmath=FAST, inline="always")
def compare(data, p, q, limit, icap, use, evidence, tau, c0, c2):
    """Indistinguishability of two scans over a cell, and the Gaussian of offsets in it.

    Args:
        data: See `Returns`, float32, (N, 5, P).
        p: The row of the one scan.
        q: The row of the other, whose pose the offset moves.
        limit: Maximum range of each beam, float32, (P,), metres.
        icap: Inverse cap of each beam, float32, (P,).
        use: 1 for a beam, 0 for padding, float32, (P,).
        evidence: Table of evidence, float32, (P, Z), or None where bins are fine.
        tau: Beams per independent piece of evidence.
        c0: Variance of the offset in x and y, square metres.
        c2: Variance of the offset in theta, square radians.

    Returns:
        I, best offset (x, y, theta), and its covariance (xx, xy, yy, tt).
    """
    # Unsigned indices: numba then needs no test for negative ones, and the loops vectorize.
    size, p, q = U(limit.size), U(p), U(q)
    f0, f2 = np.float32(0.5 * c0), np.float32(0.5 * c2)
    g0, g1, g2 = F0, F0, F0
    a, b, c, d, e, f = F0, F0, F0, F0, F0, F0
    for i in range(size):
        gx, gy, gt = data[q, X, i], data[q, Y, i], data[q, T, i]
        inverse = use[i] / (data[p, S, i] + data[q, S, i])
        seen = min(data[p, D, i], limit[i])
        z = seen - data[q, D, i]
        # No echo at p: any range from the limit on agrees.
        silent = (data[p, D, i] >= limit[i]) & (z < F0)
        z = F0 if silent else z
        room = (gx * gx + gy * gy) * f0 + gt * gt * f2
        u = z * z * inverse * QUARTER / (F1 + room * inverse)
        t = F1 / (F1 + u * icap[i])
        w = F0 if silent else inverse * t * t
        g0 += w * z * gx
        g1 += w * z * gy
        g2 += w * z * gt
        a += w * gx * gx
        b += w * gx * gy
        c += w * gx * gt
        d += w * gy * gy
        e += w * gy * gt
        f += w * gt * gt
    s = 0.5 / tau
    p0, p2 = 1.0 / c0, 1.0 / c2
    i00, i01, i02, i11, i12, i22, det = invert(
        a * s + p0, b * s, c * s, d * s + p0, e * s, f * s + p2
    )
    e0 = np.float32((i00 * g0 + i01 * g1 + i02 * g2) * s)
    e1 = np.float32((i01 * g0 + i11 * g1 + i12 * g2) * s)
    e2 = np.float32((i02 * g0 + i12 * g1 + i22 * g2) * s)

    g0, g1, g2 = F0, F0, F0
    a, b, c, d, e, f = F0, F0, F0, F0, F0, F0
    total = F0
    for i in range(size):
        gx, gy, gt = data[q, X, i], data[q, Y, i], data[q, T, i]
        inverse = use[i] / (data[p, S, i] + data[q, S, i])
        seen = min(data[p, D, i], limit[i])
        moved = gx * e0 + gy * e1 + gt * e2
        z = seen - data[q, D, i] - moved
        floor = seen - limit[i]
        # Out of range at the offset: the reading there is no echo, and moving changes nothing.
        silent = z <= floor
        z = max(z, floor)
        u = z * z * inverse * QUARTER
        slope = inverse
        if evidence is not None:
            place = min(math.sqrt(z * z * inverse), Z_TOP) * PER_STEP
            k = min(np.int32(place), np.int32(_Z_COUNT))
            share = place - np.float32(k)
            ratio = evidence[i, k] * (F1 - share) + evidence[i, k + 1] * share
            slope = inverse * ratio
            u *= ratio
        x = u * icap[i]
        t = F1 / np.float32(math.sqrt(F1 + x * x))
        w = F0 if silent else slope * t * t * t
        # The quadratic in the offset that touches the capped evidence here.
        full = z + moved
        total += u * t + QUARTER * w * (full * full - z * z)
        g0 += w * full * gx
        g1 += w * full * gy
        g2 += w * full * gt
        a += w * gx * gx
        b += w * gx * gy
        c += w * gx * gt
        d += w * gy * gy
        e += w * gy * gt
        f += w * gt * gt
    i00, i01, i02, i11, i12, i22, det = invert(
        a * s + p0, b * s, c * s, d * s + p0, e * s, f * s + p2
    )
    o0 = (i00 * g0 + i01 * g1 + i02 * g2) * s
    o1 = (i01 * g0 + i11 * g1 + i12 * g2) * s
    o2 = (i02 * g0 + i12 * g1 + i22 * g2) * s
    gain = (g0 * o0 + g1 * o1 + g2 * o2) * 0.25 / tau
    alike = math.exp(min(gain - total / tau, 0.0)) / math.sqrt(det * c0 * c0 * c2)
    return alike, o0, o1, o2, i00, i01, i11, i22


@kernel(error_model="python")
def reach(row, column, index, first, links, offsets, side, steps, marks, queue):
    """Mark the offsets in the disc that lattice steps lead to without crossing a segment."""
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


@kernel(fastmath=FAST)
def pose_sums(
    row, column, index, first, marks, offsets, spacing, data, limit, icap, use, evidence, tau,
    c0, c2, out,
):  # fmt: skip
    """Compare one pose with its marked neighbours; write what `neighbourhood_sums` says."""
    k = np.abs(offsets).max()
    side = 2 * k + 1
    p = index[row, column] - first
    weight, count = 0.0, 0
    mxx, mxy, myy, fxx, fxy, fyy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for o in range(offsets.shape[0]):
        if marks[(offsets[o, 0] + k) * side + offsets[o, 1] + k] != 2:
            continue
        q = index[row + offsets[o, 0], column + offsets[o, 1]] - first
        x, y = offsets[o, 1] * spacing, offsets[o, 0] * spacing
        count += 1
        fxx += x * x + c0
        fxy += x * y
        fyy += y * y + c0
        alike, ox, oy, _, sxx, sxy, syy, _ = compare(
            data, p, q, limit, icap, use, evidence, tau, c0, c2
        )
        x += ox
        y += oy
        weight += alike
        mxx += alike * (x * x + sxx)
        mxy += alike * (x * y + sxy)
        myy += alike * (y * y + syy)
    out[0] = weight / count
    out[1], out[2], out[3] = mxx / weight, mxy / weight, myy / weight
    out[4], out[5], out[6] = fxx / count, fxy / count, fyy / count


@kernel
def _sums(
    low, high, begin, first, rows_columns, index, links, steps, offsets, spacing,
    data, limit, icap, use, evidence, tau, c0, c2, sums,
):  # fmt: skip
    side = 2 * np.abs(offsets).max() + 1
    marks = np.empty(side * side, dtype=np.uint8)
    queue = np.empty(side * side, dtype=np.int32)
    for i in range(low, high):
        row, column = rows_columns[begin + i, 0], rows_columns[begin + i, 1]
        reach(row, column, index, first, links, offsets, side, steps, marks, queue)
        pose_sums(
            row, column, index, first, marks, offsets, spacing, data, limit, icap, use, evidence,
            tau, c0, c2, sums[i],
        )  # fmt: skip


def neighbourhood_sums(
    begin: int,
    end: int,
    first: int,
    rows_columns: NDArray[np.int32],
    index: NDArray[np.int32],
    links: NDArray[np.uint8],
    offsets: NDArray[np.int64],
    spacing: float,
    returns: Returns,
    beams: BeamTable,
    evidence: NDArray[np.float32] | None,
    tau: float,
    cell_variance: tuple[float, float],
) -> NDArray[np.float64]:
    """Ambiguity and second moments of the free poses begin to end - 1.

    Args:
        begin: Running number of the first pose to compute (see `Lattice.index`).
        end: One past the last.
        first: Running number of the first pose in `returns` and `links`, which hold the
            neighbours of all these poses too.
        rows_columns: See `Lattice`.
        index: See `Lattice`.
        links: See `Lattice`; from pose `first` on.
        offsets: Row and column steps of the disc, shape (K, 2).
        spacing: Of the lattice, metres.
        returns: What the beams return.
        beams: Their limits and caps.
        evidence: Table of evidence, shape (P, Z), or None where all bins are fine.
        tau: Beams per independent piece of evidence.
        cell_variance: Variance of the offset within a cell in x and y (square metres), and in
            theta (square radians).

    Returns:
        float64, shape (end - begin, 7): mean indistinguishability; second moments xx, xy, yy of
        the indistinguishable poses about the pose; the same of the free neighbourhood; square
        metres.
    """
    sums = np.empty((end - begin, 7))
    most = max(INTERRUPT_EVERY // (len(offsets) * len(beams.limit)), 1)
    for low in range(0, end - begin, most):
        part = sums[low : low + most]
        run_rows(
            _sums, len(part), begin + low, first, rows_columns, index, links, STEPS, offsets,
            spacing, returns.data, beams.limit, beams.inverse_cap, beams.use, evidence, tau,
            *cell_variance, part, least=8,
        )  # fmt: skip
    return sums
