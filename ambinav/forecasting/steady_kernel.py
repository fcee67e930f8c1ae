"""The filter of a forecast where all floor is alike: its error and lost share after many metres.

A robot that drives straight on for n updates over floor where every scan tells J has the covariance
of a Riccati recursion (before each scan)

    X' = F (X^-1 + J)^-1 F^T + Q

with F and Q of the odometry's model. 2^k steps of it take k doublings (Anderson 1978,
"Second-order convergent algorithms for the steady-state Riccati equation", International Journal of
Control 28): of A = F^T, G = J and H = Q,

    A' = A (I + G H)^-1 A
    G' = G + A (I + G H)^-1 G A^T
    H' = H + A^T H (I + G H)^-1 A

where H is X of a start that is known exactly. Of another start S it is H + A^T S (I + G S)^-1 A.

The lost share is that of `filter_kernel`: the whole Gaussian's share outside is that at the end,
and the Gaussian that is cut off at the limits settles after some updates, after which each of them
loses the same share.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.drive.noise import propagate_covariance
from ambinav.forecasting.filter_kernel import FAR, axes, between, cut_off, share_within, take_in
from ambinav.runtime.arrays import copy_into
from ambinav.runtime.kernels import kernel

# Relative change of the position's variance below which a doubling is the last.
CONVERGED = 1e-6
# The same of variances in an update, below which each further one loses the same share.
SETTLED = 1e-4


@kernel
def steady_rows(
    low, high, gained, headings, start, noise, settings, doublings, spread, lost
):  # fmt: skip
    """Drive over floor as at each of poses low to high.

    Args:
        low: The first.
        high: One past the last.
        gained: Information that an update gains there, shape (N, 3, 3).
        headings: Directions of driving, radians, shape (D,).
        start: Covariance at the beginning, shape (3, 3).
        noise: `OdometryNoise.packed`.
        settings: See `FilterSettings`.
        doublings: k; there are 2^k updates after the first one.
        spread: Written: covariance of the position, of all robots, the mean of before and after
            the last scan: xx, xy, yy, square metres, shape (N, D, 3).
        lost: Written: share lost up to there, before calibration, shape (N, D), or (N, 0) to leave
            it out.
    """
    scan, room, grown = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    X, cov = np.empty((3, 3)), np.empty((3, 3))
    A, G, H = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    work = np.empty((4, 3, 3))
    mean = np.empty(3)
    for p in range(low, high):
        copy_into(scan, gained[p])
        for d in range(len(headings)):
            theta = headings[d]
            x, y = settings.distance * math.cos(theta), settings.distance * math.sin(theta)
            grown[:] = 0.0
            mean[:] = 0.0
            mean[2] = theta
            propagate_covariance(mean, grown, 0.0, 0.0, theta, x, y, theta, noise)
            A[:] = 0.0
            A[0, 0] = A[1, 1] = A[2, 2] = 1.0
            A[2, 0], A[2, 1] = -y, x
            copy_into(G, scan)
            copy_into(H, grown)
            for _ in range(doublings):
                before = H[0, 0] + H[1, 1]
                double(A, G, H, work)
                if H[0, 0] + H[1, 1] - before <= CONVERGED * before:
                    break
            copy_into(cov, start)
            advance(cov, x, y, grown)
            copy_into(X, H)
            add_start(X, A, G, cov, work)
            spread[p, d, 0], spread[p, d, 1], spread[p, d, 2] = X[0, 0], X[0, 1], X[1, 1]
            copy_into(room, scan)
            take_in(X, room)
            spread[p, d, 0] = 0.5 * (spread[p, d, 0] + X[0, 0])
            spread[p, d, 1] = 0.5 * (spread[p, d, 1] + X[0, 1])
            spread[p, d, 2] = 0.5 * (spread[p, d, 2] + X[1, 1])
            if lost.shape[1] == 0:
                continue
            lost[p, d] = 0.0
            if not is_far(X, settings):
                outside = 1.0 - share_within(X, settings, theta)
                copy_into(cov, start)
                tracked = tracked_share(
                    cov, scan, x, y, theta, grown, settings, 1 + 2**doublings, room
                )
                lost[p, d] = between(outside, 1.0 - tracked)


@kernel(inline="always")
def advance(cov, x, y, grown):
    """Move a covariance by (x, y) metres straight on and add what the odometry errs, in place."""
    xt, yt, tt = cov[0, 2], cov[1, 2], cov[2, 2]
    cov[0, 0] += -2.0 * y * xt + y * y * tt + grown[0, 0]
    cov[1, 1] += 2.0 * x * yt + x * x * tt + grown[1, 1]
    cov[0, 1] += x * xt - y * yt - x * y * tt + grown[0, 1]
    cov[0, 2] = xt - y * tt + grown[0, 2]
    cov[1, 2] = yt + x * tt + grown[1, 2]
    cov[2, 2] = tt + grown[2, 2]
    cov[1, 0], cov[2, 0], cov[2, 1] = cov[0, 1], cov[0, 2], cov[1, 2]


@kernel
def double(A, G, H, work):
    """Replace A, G and H of n steps by those of 2 n, in place."""
    inverse, GH, WA, WG = work[0], work[1], work[2], work[3]
    multiply(G, H, GH)
    invert_plus_one(GH, inverse)
    multiply(inverse, A, WA)
    multiply(inverse, G, WG)
    # H first: it needs the old A.
    multiply(H, WA, GH)
    add_transposed(A, GH, H)
    multiply(A, WG, GH)
    for i in range(3):
        for j in range(3):
            G[i, j] += GH[i, 0] * A[j, 0] + GH[i, 1] * A[j, 1] + GH[i, 2] * A[j, 2]
    symmetrize(G)
    multiply(A, WA, GH)
    copy_into(A, GH)


@kernel
def add_start(X, A, G, start, work):
    """Add to X = H what a start S makes of it: A^T S (I + G S)^-1 A, in place."""
    inverse, GS, WA = work[0], work[1], work[2]
    multiply(G, start, GS)
    invert_plus_one(GS, inverse)
    multiply(inverse, A, WA)
    multiply(start, WA, GS)
    add_transposed(A, GS, X)


@kernel(inline="always")
def multiply(a, b, out):
    """Write the product of two 3 x 3 matrices."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@kernel(inline="always")
def add_transposed(a, b, out):
    """Add a^T b, which is symmetric, to `out`."""
    for i in range(3):
        for j in range(3):
            out[i, j] += a[0, i] * b[0, j] + a[1, i] * b[1, j] + a[2, i] * b[2, j]
    symmetrize(out)


@kernel(inline="always")
def symmetrize(a):
    """Remove rounding errors of a symmetric matrix, in place."""
    for i in range(3):
        for j in range(i):
            a[i, j] = a[j, i] = 0.5 * (a[i, j] + a[j, i])


@kernel
def invert_plus_one(a, out):
    """Write (I + a)^-1; a is a product of two matrices that are not negative."""
    m00, m11, m22 = a[0, 0] + 1.0, a[1, 1] + 1.0, a[2, 2] + 1.0
    out[0, 0] = m11 * m22 - a[1, 2] * a[2, 1]
    out[1, 0] = a[1, 2] * a[2, 0] - a[1, 0] * m22
    out[2, 0] = a[1, 0] * a[2, 1] - m11 * a[2, 0]
    factor = 1.0 / (m00 * out[0, 0] + a[0, 1] * out[1, 0] + a[0, 2] * out[2, 0])
    out[0, 1] = (a[0, 2] * a[2, 1] - a[0, 1] * m22) * factor
    out[1, 1] = (m00 * m22 - a[0, 2] * a[2, 0]) * factor
    out[2, 1] = (a[0, 1] * a[2, 0] - m00 * a[2, 1]) * factor
    out[0, 2] = (a[0, 1] * a[1, 2] - a[0, 2] * m11) * factor
    out[1, 2] = (a[0, 2] * a[1, 0] - m00 * a[1, 2]) * factor
    out[2, 2] = (m00 * m11 - a[0, 1] * a[1, 0]) * factor
    for i in range(3):
        out[i, 0] *= factor


@kernel(inline="always")
def is_far(cov, settings):
    """Return whether nobody gets lost: the limits are too many deviations away."""
    large, _, _, _ = axes(cov)
    square = FAR * FAR
    near = large * square <= min(settings.position_limit, settings.lateral_limit) ** 2
    return near and cov[2, 2] * square <= settings.heading_limit**2


@kernel
def tracked_share(cov, scan, x, y, theta, grown, settings, updates, room):
    """Return the share that is within the limits after each of so many updates; see `cut_off`.

    `cov` is the covariance at the beginning; it and `room` are overwritten.
    """
    tracked, done = 1.0, 0
    while done < updates:
        place, turn = cov[0, 0] + cov[1, 1], cov[2, 2]
        advance(cov, x, y, grown)
        copy_into(room, scan)
        take_in(cov, room)
        stay = cut_off(cov, settings, theta)
        tracked *= stay
        done += 1
        change = abs(cov[0, 0] + cov[1, 1] - place) + abs(cov[2, 2] - turn) * place / turn
        if change < SETTLED * place:
            tracked *= stay ** (updates - done)
            break
    return tracked
