"""Two scans against each other once more: the integral over a cell by expectation propagation.

The second step of `ambinav.ambiguity.pair` is a lower bound that is tight at one offset. Where
beams reach their cap within the cell, much of the integral lies away from that offset, and the
bound is too low by up to a factor of three. Here each beam's evidence is replaced by the Gaussian
factor that has the same mass, mean and variance over what all other beams leave of the cell (Minka,
Expectation propagation for approximate Bayesian inference, UAI 2001), once, from the first step on.

`ambinav.ambiguity.reference.refine` says the same in plain NumPy.
"""

from __future__ import annotations

import numpy as np

from ambinav.ambiguity.gaussian import (
    F0,
    F1,
    FAST,
    PER_STEP,
    Z_TOP,
    D,
    S,
    T,
    U,
    X,
    Y,
    gaussian,
    nine_rows,
)
from ambinav.ambiguity.pair import seen_at
from ambinav.kernels import kernel
from ambinav.lanes import (
    LANES,
    exponential,
    interpolated,
    lanes,
    least,
    load,
    logarithm,
    most,
    narrow,
    root,
    store,
    totals,
    where,
)

# All other beams leave at least this share of the precision with which a beam is predicted.
LEFT = 0.02
# A factor's mean lies no farther from the prediction than this many times the beam's residual: of a
# beam at its cap only the slope is known, and it must not be followed out of the cell.
FARTHEST = 2.0
# Added to the variance of a beam's prediction, square metres: one that the cell does not move.
STILL = 1e-12

_LEFT, _FARTHEST, _STILL = np.float32(LEFT), np.float32(FARTHEST), np.float32(STILL)
_QUARTER, _HALF = np.float32(0.25), np.float32(0.5)
_THREE, _FOUR, _PER_SIX_SQUARED = np.float32(3.0), np.float32(4.0), np.float32(1.0 / 36.0)
_GREATEST = np.float32(40.0)


@kernel(fastmath=FAST, inline="always")
def weighed(z, floor, cap, spread, squared, scale, evidence, i):
    """Return the capped evidence of residuals z of beams i to i + 15, by tau."""
    z = most(z, floor)
    square = z * z
    x = square * cap
    if evidence is not None:
        place = least(root(square / spread), lanes(Z_TOP)) * lanes(PER_STEP)
        slope = interpolated(evidence, i, place)
        x = x * slope
        return square * slope * scale / root(squared + x * x)
    return square * scale / root(squared + x * x)


@kernel(fastmath=FAST, inline="always")
def refined_step(
    data, p, q, limit, icap, use, evidence, half0, half2, tau, known, offsets, j, work
):  # fmt: skip
    """Sums over beams for the integral over the cell, of the factors of all beams.

    Args:
        data: As for `pair.first_step`, like the next five.
        p: One scan.
        q: The other.
        limit: Maximum range.
        icap: Inverse cap.
        use: 1 for a beam.
        evidence: Table of evidence, float32, (P, Z), or None where bins are fine.
        half0: Half the variance of the offset in x and y.
        half2: Half the variance of the offset in theta.
        tau: Beams per independent piece of evidence, float32.
        known: What `pair.scan_known` has written of p.
        offsets: See `write_offsets`.
        j: Column of `offsets`.
        work: Worked in, float32, (6, P).

    Returns:
        Lanes: as `pair.second_step`.
    """
    p, q = U(p), U(q)
    zero, unit = lanes(F0), lanes(F1)
    three, four = lanes(_THREE), lanes(_FOUR)
    slide, turn = lanes(half0), lanes(half2)
    o0, o1, o2 = lanes(offsets[0, j]), lanes(offsets[1, j]), lanes(offsets[2, j])
    l00, l10, l20 = lanes(offsets[3, j]), lanes(offsets[4, j]), lanes(offsets[5, j])
    l11, l21, l22 = lanes(offsets[6, j]), lanes(offsets[7, j]), lanes(offsets[8, j])
    share, per_tau = lanes(_HALF / tau), lanes(_QUARTER / tau)
    # In four short loops: in one long one the processor waits for each beam's way through it.
    for i in range(U(0), U(limit.size), U(LANES)):
        gx, gy, gt = load(data, (q, X, i)), load(data, (q, Y, i)), load(data, (q, T, i))
        spread = load(data, (p, S, i)) + load(data, (q, S, i))
        seen, _, least_z, cap = seen_at(data, p, i, limit, icap, use, known)
        full = seen - load(data, (q, D, i))
        # The residual as all beams of the first step predict it.
        v0, v1, v2 = gx * l00 + gy * l10 + gt * l20, gy * l11 + gt * l21, gt * l22
        v = v0 * v0 + v1 * v1 + v2 * v2 + lanes(_STILL)
        # Without this beam: its precision there was `own` by `whole`.
        room = spread + (gx * gx + gy * gy) * slide + gt * gt * turn
        capped = room + full * full * cap
        whole = capped * capped * spread
        own = where(full < least_z, zero, room * room * share)
        k = whole / most(whole - own * v, whole * lanes(_LEFT))
        m = (full - (gx * o0 + gy * o1 + gt * o2)) * k
        store(work, (U(0), i), m)
        store(work, (U(1), i), v * k)
        store(work, (U(2), i), full - m)
    for i in range(U(0), U(limit.size), U(LANES)):
        # The evidence at the three points of Gauss and Hermite.
        spread = load(data, (p, S, i)) + load(data, (q, S, i))
        _, floor, _, cap = seen_at(data, p, i, limit, icap, use, known)
        m, h = load(work, (U(0), i)), root(three * load(work, (U(1), i)))
        squared, scale = spread * spread, per_tau * load(use, i)
        middle = weighed(m, floor, cap, spread, squared, scale, evidence, i)
        low = weighed(m - h, floor, cap, spread, squared, scale, evidence, i)
        high = weighed(m + h, floor, cap, spread, squared, scale, evidence, i)
        store(work, (U(3), i), middle)
        store(work, (U(4), i), exponential(bounded(middle - low)))
        store(work, (U(5), i), exponential(bounded(middle - high)))
    total = zero
    for i in range(U(0), U(limit.size), U(LANES)):
        spread = load(data, (p, S, i)) + load(data, (q, S, i))
        m, v, z = load(work, (U(0), i)), load(work, (U(1), i)), load(work, (U(2), i))
        low, high = load(work, (U(4), i)), load(work, (U(5), i))
        # Mass, mean and variance, these two by the root of v and by v.
        mass, per_v = four + low + high, unit / v
        per = unit / mass
        lean = (high - low) * per
        left = three * ((high + low) * per - lean * lean)
        # A factor is no narrower than a reading, and never wider than all.
        per_left = least(unit / most(left, lanes(_STILL)), unit + v * share / spread)
        per_left = most(per_left, unit)
        # Of padding all is nothing, to the last bit.
        used = load(use, i)
        w = (per_left - unit) * per_v * used
        n = lean * root(three * per_v) * per_left
        far = lanes(_FARTHEST) * w * most(m, zero - m)
        n = most(least(n, far), zero - far)
        log = logarithm(mass * mass * per_left * lanes(_PER_SIX_SQUARED))
        log = log - n * n * v / per_left - w * z * z
        total += used * (lanes(_HALF) * log - load(work, (U(3), i)) + n * z)
        store(work, (U(0), i), w)
        store(work, (U(1), i), w * z - n)
    g0 = g1 = g2 = a = b = c = d = e = f = zero
    for i in range(U(0), U(limit.size), U(LANES)):
        gx, gy, gt = load(data, (q, X, i)), load(data, (q, Y, i)), load(data, (q, T, i))
        w, n = load(work, (U(0), i)), load(work, (U(1), i))
        wx, wy, wt = w * gx, w * gy, w * gt
        g0, g1, g2 = g0 + n * gx, g1 + n * gy, g2 + n * gt
        a, b, c = a + wx * gx, b + wx * gy, c + wx * gt
        d, e, f = d + wy * gy, e + wy * gt, f + wt * gt
    # In the units of the other steps: by 1 / (2 tau), and the evidence by tau.
    x = lanes(tau + tau)
    return totals(
        (
            g0 * x, g1 * x, g2 * x, a * x, b * x, c * x, d * x, e * x, f * x, total * lanes(-tau),
        )
    )  # fmt: skip


@kernel(inline="always")
def bounded(numbers):
    """Numbers whose exponential float32 holds, and its square."""
    return most(least(numbers, lanes(_GREATEST)), lanes(-_GREATEST))


@kernel(fastmath=FAST, inline="always")
def write_offsets(sums, tau, c0, c2, offsets):
    """Write the Gaussians of sixteen offsets, from the sums of a step, a lane each.

    Args:
        sums: Sums of a step, float32, (9 or more, LANES).
        tau: Beams per independent piece of evidence.
        c0: Variance of the offset in x and y, square metres.
        c2: Variance of the offset in theta, square radians.
        offsets: Written, float32, (9, LANES): means, and the columns of the lower triangle whose
            square is the covariance. A beam's variance is then a sum of squares: nothing cancels.
    """
    o0, o1, o2, xx, xy, xt, yy, yt, tt, _ = gaussian(nine_rows(sums), tau, c0, c2)
    l00 = root(xx)
    l10, l20 = xy / l00, xt / l00
    l11 = root(yy - l10 * l10)
    l21 = (yt - l20 * l10) / l11
    l22 = root(tt - l20 * l20 - l21 * l21)
    z = U(0)
    store(offsets, (U(0), z), narrow(o0))
    store(offsets, (U(1), z), narrow(o1))
    store(offsets, (U(2), z), narrow(o2))
    store(offsets, (U(3), z), narrow(l00))
    store(offsets, (U(4), z), narrow(l10))
    store(offsets, (U(5), z), narrow(l20))
    store(offsets, (U(6), z), narrow(l11))
    store(offsets, (U(7), z), narrow(l21))
    store(offsets, (U(8), z), narrow(l22))
