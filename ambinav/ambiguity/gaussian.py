"""Offset within a cell that best explains a scan, from sums over its beams."""

from __future__ import annotations

import numpy as np

from ambinav.ambiguity.indistinguishability import Z_MAX, Z_STEP
from ambinav.ambiguity.returns import TIE
from ambinav.runtime.kernels import kernel
from ambinav.runtime.lanes import LANES, exponential, lanes, least, load, most, narrow, root, wide

# With "afn" divisions and roots are estimated and refined once, to the last bit or two of float32.
FAST = {"reassoc", "nsz", "contract", "arcp", "nnan", "ninf", "afn"}

# Unsigned indices: numba then needs no test for negative ones.
U = np.uint64
# Rows of `Returns.data`.
D, X, Y, T, S = U(0), U(1), U(2), U(3), U(4)
F0 = np.float32(0.0)
F1 = np.float32(1.0)
QUARTER = np.float32(0.25)
PER_STEP = np.float32(1.0 / Z_STEP)
Z_TOP = np.float32(Z_MAX)
NEAR = np.float32(TIE)
# Bounds below and above any residual, metres.
NEVER, ALWAYS = np.float32(-1e30), np.float32(1e30)
# Minimum exponent of I, which float32 can represent.
LEAST_LOG = np.float32(-80.0)


@kernel(inline="always")
def invert(a, b, c, d, e, f):
    """Return inverse (upper triangle, row by row) and determinant of [[a,b,c],[b,d,e],[c,e,f]]."""
    i00, i01, i02 = d * f - e * e, c * e - b * f, b * e - c * d
    det = a * i00 + b * i01 + c * i02
    r = 1.0 / det
    i11, i12, i22 = a * f - c * c, b * c - a * e, a * d - b * b
    return i00 * r, i01 * r, i02 * r, i11 * r, i12 * r, i22 * r, det


@kernel(fastmath=FAST, inline="always")
def gaussian(sums, tau, c0, c2):
    """Return the best offset (3) for the sums of a step, its covariance (6), and det(C L)."""
    g0, g1, g2 = sums[0], sums[1], sums[2]
    s = 0.5 / tau
    p0, p2 = 1.0 / c0, 1.0 / c2
    i00, i01, i02, i11, i12, i22, det = invert(
        sums[3] * s + p0, sums[4] * s, sums[5] * s, sums[6] * s + p0, sums[7] * s,
        sums[8] * s + p2,
    )  # fmt: skip
    o0 = (i00 * g0 + i01 * g1 + i02 * g2) * s
    o1 = (i01 * g0 + i11 * g1 + i12 * g2) * s
    o2 = (i02 * g0 + i12 * g1 + i22 * g2) * s
    return o0, o1, o2, i00, i01, i02, i11, i12, i22, det * c0 * c0 * c2


@kernel(fastmath=FAST, inline="always")
def grown(sums, w, z, gx, gy, gt):
    """Add a beam of each lane to the sums of w z g (3) and of w g g^T (6)."""
    g0, g1, g2, a, b, c, d, e, f = sums
    wx, wy, wt = w * gx, w * gy, w * gt
    return (
        g0 + z * wx, g1 + z * wy, g2 + z * wt, a + wx * gx, b + wx * gy, c + wx * gt,
        d + wy * gy, e + wy * gt, f + wt * gt,
    )  # fmt: skip


@kernel(fastmath=FAST, inline="always")
def integral(sums, tau, c0, c2):
    """Return sixteen integrals over the cell, from sums of `second_step`, one a lane, (10, LANES).

    Returns:
        Wide lanes: I, best offset (x, y, theta), and its covariance (xx, xy, yy, tt).
    """
    rows = nine_rows(sums)
    o0, o1, o2, sxx, sxy, _, syy, _, stt, det = gaussian(rows, tau, c0, c2)
    gain = (rows[0] * o0 + rows[1] * o1 + rows[2] * o2) * (0.25 / tau)
    log = narrow(gain - wide(load(sums, (U(9), U(0)))) * (1.0 / tau))
    alike = wide(exponential(most(least(log, lanes(F0)), lanes(LEAST_LOG)))) / root(det)
    return alike, o0, o1, o2, sxx, sxy, syy, stt


@kernel(inline="always")
def nine_rows(sums):
    """Return the first nine rows, as float64."""
    return (
        wide(load(sums, (U(0), U(0)))), wide(load(sums, (U(1), U(0)))),
        wide(load(sums, (U(2), U(0)))), wide(load(sums, (U(3), U(0)))),
        wide(load(sums, (U(4), U(0)))), wide(load(sums, (U(5), U(0)))),
        wide(load(sums, (U(6), U(0)))), wide(load(sums, (U(7), U(0)))),
        wide(load(sums, (U(8), U(0)))),
    )  # fmt: skip


@kernel
def aligned(size):
    """Return float32 zeros aligned to a cache line; lanes across two lines take twice as long."""
    buffer = np.zeros(size + LANES, dtype=np.float32)
    begin = (-buffer.ctypes.data // 4) % LANES
    return buffer[begin : begin + size]
