"""Comparison of two scans: their likeness over a cell of poses.

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

from ambinav.ambiguity.gaussian import (
    ALWAYS,
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
    gaussian,
    grown,
)
from ambinav.runtime.kernels import kernel
from ambinav.runtime.lanes import (
    LANES,
    interpolated,
    lane,
    lanes,
    least,
    load,
    most,
    root,
    store,
    totals,
    where,
)


# The steps are inlined, for the arrays of a call alone are forty words; their callers need
# fastmath=FAST too.
@kernel(fastmath=FAST, inline="always")
def first_step(data, p, q, limit, icap, use, half0, half2, known):
    """Compute sums over beams for the offset at which two scans agree best.

    Args:
        data: See `Returns`, float32, (N, 5, P).
        p: The row of the one scan.
        q: The row of the other, whose pose the offset moves.
        limit: Maximum range of each beam, float32, (P,), metres.
        icap: Inverse cap of each beam, float32, (P,).
        use: 1 for a beam, 0 for padding, float32, (P,).
        half0: Half the variance of the offset in x and y, float32, square metres.
        half2: Half the variance of the offset in theta, float32, square radians.
        known: What `scan_known` has written of p, or None.

    Returns:
        Lanes: with weights w, residuals z and gradients g the sum of w z g (3), and of
        w g g^T (6).
    """
    size, p, q = U(limit.size), U(p), U(q)
    zero = lanes(F0)
    slide, turn = lanes(half0), lanes(half2)
    sums = (zero, zero, zero, zero, zero, zero, zero, zero, zero)
    for i in range(U(0), size, U(LANES)):
        gx, gy, gt = load(data, (q, X, i)), load(data, (q, Y, i)), load(data, (q, T, i))
        spread = load(data, (p, S, i)) + load(data, (q, S, i))
        seen, _, least_z, cap = seen_at(data, p, i, limit, icap, use, known)
        z = seen - load(data, (q, D, i))
        # With u = z^2 / 4 room the weight is 1 / spread / (1 + u / cap)^2; divisions are slow.
        room = spread + (gx * gx + gy * gy) * slide + gt * gt * turn
        capped = room + z * z * cap
        w = where(z < least_z, zero, room * room / (capped * capped * spread))
        sums = grown(sums, w, z, gx, gy, gt)
    return totals(sums)


@kernel(fastmath=FAST, inline="always")
def second_step(data, p, q, limit, icap, use, evidence, e0, e1, e2, known, weights):
    """Compute sums over beams for the cell's integral, at the offset (e0, e1, e2), float32.

    Args:
        data: As for `first_step`, like the next five.
        p: One scan.
        q: The other.
        limit: Maximum range.
        icap: Inverse cap.
        use: 1 for a beam.
        evidence: Table of evidence, float32, (P, Z), or None where bins are fine.
        e0: Along x, metres.
        e1: Along y, metres.
        e2: By theta, radians.
        known: As for `first_step`.
        weights: Worked in, float32, (P,), or None.

    Returns:
        As `first_step`, and then the evidence at the cell's centre of the quadratic that touches
        the capped evidence at the offset.
    """
    size, p, q = U(limit.size), U(p), U(q)
    zero, unit = lanes(F0), lanes(F1)
    e0, e1, e2 = lanes(e0), lanes(e1), lanes(e2)
    total = beyond = zero
    sums = (zero, zero, zero, zero, zero, zero, zero, zero, zero)
    for i in range(U(0), size, U(LANES)):
        gx, gy, gt = load(data, (q, X, i)), load(data, (q, Y, i)), load(data, (q, T, i))
        spread = load(data, (p, S, i)) + load(data, (q, S, i))
        # The residual at the cell's centre, and at the offset.
        seen, floor, _, cap = seen_at(data, p, i, limit, icap, use, known)
        full = seen - load(data, (q, D, i))
        z = full - (gx * e0 + gy * e1 + gt * e2)
        # Out of range at the offset: the reading there is no echo, and moving changes nothing.
        silent = z <= floor
        z = most(z, floor)
        square = z * z
        x = square * cap
        if evidence is not None:
            place = least(root(square / spread), lanes(Z_TOP)) * lanes(PER_STEP)
            slope = interpolated(evidence, i, place) / spread
            t = unit / root(unit + x * x * slope * slope)
            r = slope * t * load(use, i)
            w = r * (t * t)
        else:
            # With u = z^2 / 4 spread: u / sqrt(1 + (u / cap)^2) = z^2 r / 4.
            s2 = spread * spread
            r = load(use, i) / root(s2 + x * x)
            w = r * r * (s2 * r)
        w = where(silent, zero, w)
        total += square * r
        beyond += w * (full * full - square)
        if weights is None:
            sums = grown(sums, w, full, gx, gy, gt)
        else:
            store(weights, i, w)
    if weights is not None:
        # A separate loop: a beam's weight takes long to compute, and code that waits for it would
        # keep the processor from beginning the next beams.
        for i in range(U(0), size, U(LANES)):
            seen, _, _, _ = seen_at(data, p, i, limit, icap, use, known)
            sums = grown(
                sums, load(weights, i), seen - load(data, (q, D, i)), load(data, (q, X, i)),
                load(data, (q, Y, i)), load(data, (q, T, i)),
            )  # fmt: skip
    g0, g1, g2, a, b, c, d, e, f = sums
    return totals((g0, g1, g2, a, b, c, d, e, f, (total + beyond) * lanes(QUARTER)))


@kernel(fastmath=FAST, inline="always")
def seen_at(data, p, i, limit, icap, use, known):
    """Return beams i to i + 15 of the scan at p, with which others are compared.

    Returns:
        Lanes: the reading, at most the maximum range; the residual down to which an offset leaves
        the beam out of range; the residual below which it tells nothing; and a quarter of the
        inverse cap.
    """
    if known is not None:
        terms = (
            load(known, (U(0), i)), load(known, (U(1), i)), load(known, (U(2), i)),
            load(known, (U(3), i)),
        )  # fmt: skip
    else:
        zero, limits = lanes(F0), load(limit, i)
        seen = least(load(data, (p, D, i)), limits)
        floor = seen - limits
        # No echo at p: any range from the limit on agrees.
        least_z = where(zero <= floor, zero, lanes(NEVER))
        least_z = where(load(use, i) <= zero, lanes(ALWAYS), least_z)
        terms = seen, floor + lanes(NEAR), least_z, load(icap, i) * lanes(QUARTER)
    return terms


@kernel(fastmath=FAST)
def scan_known(data, p, limit, icap, use, known):
    """Write the results of `seen_at` for the scan at p, float32, shape (4, P)."""
    for i in range(U(0), U(limit.size), U(LANES)):
        seen, floor, least_z, cap = seen_at(data, U(p), i, limit, icap, use, None)
        store(known, (U(0), i), seen)
        store(known, (U(1), i), floor)
        store(known, (U(2), i), least_z)
        store(known, (U(3), i), cap)


@kernel(fastmath=FAST, inline="always")
def nine(v):
    """Return the first nine lanes."""
    return (
        lane(v, U(0)), lane(v, U(1)), lane(v, U(2)), lane(v, U(3)), lane(v, U(4)), lane(v, U(5)),
        lane(v, U(6)), lane(v, U(7)), lane(v, U(8)),
    )  # fmt: skip


@kernel(fastmath=FAST, inline="always")
def compare(data, p, q, limit, icap, use, evidence, tau, c0, c2):
    """Compute the indistinguishability of two scans over a cell, and the Gaussian of offsets.

    Args:
        data: As for `first_step`, like the next five.
        p: One scan.
        q: The other.
        limit: Maximum range.
        icap: Inverse cap.
        use: 1 for a beam.
        evidence: Table of evidence, float32, (P, Z), or None where bins are fine.
        tau: Beams per independent piece of evidence.
        c0: Variance of the offset in x and y, square metres.
        c2: Variance of the offset in theta, square radians.

    Returns:
        I, best offset (x, y, theta), and its covariance (xx, xy, yy, tt).
    """
    half0, half2 = np.float32(0.5 * c0), np.float32(0.5 * c2)
    step = nine(first_step(data, p, q, limit, icap, use, half0, half2, None))
    o0, o1, o2, _, _, _, _, _, _, _ = gaussian(step, tau, c0, c2)
    step = second_step(
        data, p, q, limit, icap, use, evidence, np.float32(o0), np.float32(o1), np.float32(o2),
        None, None,
    )  # fmt: skip
    total, step = lane(step, U(9)), nine(step)
    o0, o1, o2, i00, i01, _, i11, _, i22, det = gaussian(step, tau, c0, c2)
    gain = (step[0] * o0 + step[1] * o1 + step[2] * o2) * 0.25 / tau
    alike = math.exp(min(gain - total / tau, 0.0)) / math.sqrt(det)
    return alike, o0, o1, o2, i00, i01, i11, i22
