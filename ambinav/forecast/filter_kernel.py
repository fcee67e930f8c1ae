"""Information filter along routes, with the robots taken out that get lost on the way.

The error of the estimate is a Gaussian (x, y, theta), as in a Kalman filter that is right about its
own errors (Thrun, Burgard & Fox 2005, "Probabilistic Robotics", chapter 3): the odometry adds its
variances, a scan the map's information about the pose where the robot is. The robot takes in a scan
every so many metres or radians, of whose information a localizer of its class gains a share; both
are spread evenly over a step, so that the length of steps does not matter.

Where the scan tells nothing the estimate slides on, further than the neighbourhood of which the
map's information is: then the localizer compares the scan with what would be seen where the robot
believes to be. So with the deviation sigma along the weak direction v of the error, that
information is looked up at p + sigma v and p - sigma v as well.

Lost is who is off by more than a limit b, for the first time (first passage), along either axis of
the position's error or in heading. With the variance V of those not lost and its growth q by
odometry, the share that leaves in a step and what that takes from the variance are

    h = q / V a phi(a) R,    R = exp(-2.58 V / b^2 + 49.6 V^2 / b^4),    a = b / sqrt(V),
    dV = -h (b^2 - V)

with phi of the standard normal. For a small V that is Kramers' rate for an Ornstein-Uhlenbeck
process (Gardiner 2009, "Stochastic Methods", section 5.5); R was fitted to the quasi-stationary
distributions of that process between absorbing ends, from strong information to none, within 6 %
(with none, V = 0.189 b^2 and h = pi^2 q / 8 b^2). dV is exact, for who leaves leaves at b.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ambinav.drive.noise import propagate_covariance
from ambinav.forecast.information_field import information_at
from ambinav.geometry.motion.circles import wrap
from ambinav.runtime.arrays import copy_into
from ambinav.runtime.kernels import kernel

# From so many deviations on nobody leaves: the share of a step is below 1e-7.
FAR = 6.0
# Of R in the module's formula.
RISE, BEND = -2.58, 49.6
# V / b^2 up to which R was fitted: no distribution between absorbing ends is wider.
WIDEST = 0.19
# Largest share of a variance that one step takes away.
MOST_TAKEN = 0.5
ROOT_2_PI = math.sqrt(2.0 * math.pi)


class FilterSettings(NamedTuple):
    """Localizer and limits for the kernels.

    Attributes:
        gain: Share of a scan's information that an update gains.
        turn_gain: Likewise, of the information about the heading, a factor beside `gain`.
        distance: Metres from update to update.
        angle: Radians, likewise.
        slide: Weight of the information where the robot believes to be, 0 to 1.
        position_limit: Metres off from which a robot is lost.
        heading_limit: Radians, likewise.
    """

    gain: float
    turn_gain: float
    distance: float
    angle: float
    slide: float
    position_limit: float
    heading_limit: float


@kernel
def forecast_rows(
    low, high, first, poses, start, fields, lattice, noise, settings, covariance, lost
):  # fmt: skip
    """Forecast routes low to high.

    Args:
        low: The first route.
        high: One past the last.
        first: Row of each route's first pose, and of the end of the last, int64, shape (K + 1,).
        poses: Poses along all routes, shape (M, 3), metres and radians, map frame.
        start: Covariance at the first pose of each, shape (3, 3).
        fields: See `InformationField`.
        lattice: See there.
        noise: `OdometryNoise.packed`.
        settings: See `FilterSettings`.
        covariance: Written: covariance of those not lost, shape (M, 3, 3).
        lost: Written: share lost up to each pose, shape (M,).
    """
    matrix, beside = start.copy(), start.copy()
    before, mean = poses[0].copy(), poses[0].copy()
    cov, previous = start.copy(), start.copy()
    for route in range(low, high):
        copy_into(cov, start)
        tracked = 1.0
        for k in range(first[route], first[route + 1]):
            if k > first[route]:
                copy_into(before, poses[k - 1])
                copy_into(mean, before)
                x, y, theta = poses[k, 0], poses[k, 1], poses[k, 2]
                copy_into(previous, cov)
                propagate_covariance(
                    mean, cov, before[0], before[1], before[2], x, y, theta, noise
                )  # fmt: skip
                metres = math.hypot(x - before[0], y - before[1])
                turn = abs(wrap(theta - before[2]))
                tracked *= first_passage(
                    cov, previous, settings.position_limit, settings.heading_limit
                )  # fmt: skip
                updates = max(metres / settings.distance, turn / settings.angle)
                if updates > 0.0:
                    scan_information(
                        x, y, theta, cov, fields, lattice, settings, updates, matrix, beside
                    )
                    take_in(cov, matrix)
            lost[k] = 1.0 - tracked
            copy_into(covariance[k], cov)


@kernel
def scan_information(x, y, theta, cov, fields, lattice, settings, updates, matrix, beside):
    """Write what `updates` scans tell to `matrix` (3, 3); `beside` is work space, (3, 3)."""
    left, low, inverse = lattice
    information_at(x, y, theta, fields, left, low, inverse, matrix)
    variance, _, c, s = axes(cov)
    sigma = math.sqrt(variance)
    share = settings.slide * min(sigma / settings.position_limit, 1.0)
    if share > 0.0:
        for i in range(3):
            for j in range(3):
                matrix[i, j] *= 1.0 - share
        for side in (-sigma, sigma):
            information_at(x + side * c, y + side * s, theta, fields, left, low, inverse, beside)
            for i in range(3):
                for j in range(3):
                    matrix[i, j] += 0.5 * share * beside[i, j]
    gain = settings.gain * updates
    turning = math.sqrt(settings.turn_gain)
    for i in range(3):
        for j in range(3):
            factor = (turning if i == 2 else 1.0) * (turning if j == 2 else 1.0)
            matrix[i, j] *= gain * factor


@kernel(inline="always")
def axes(cov):
    """Return the variance along the weak direction, across it, and the direction's unit vector."""
    half = 0.5 * (cov[0, 0] - cov[1, 1])
    middle, cross = 0.5 * (cov[0, 0] + cov[1, 1]), cov[0, 1]
    radius = math.hypot(half, cross)
    angle = 0.5 * math.atan2(cross, half)
    return middle + radius, max(middle - radius, 0.0), math.cos(angle), math.sin(angle)


@kernel
def take_in(cov, information):
    """Replace a covariance P by (P^-1 + J)^-1 = P (I + J P)^-1, in place; neither is inverted.

    J, which is overwritten, is split into scalar measurements (its L D L^T), which are taken in
    one after the other (Bierman 1977, "Factorization methods for discrete sequential estimation").
    """
    a = information
    for k in range(3):
        pivot = a[k, k]
        if not pivot > 0.0:
            continue
        # Row k of the remaining matrix, from its diagonal on: J = sum of h h^T / pivot.
        scalar_update(
            cov, a[k, 0] if k == 0 else 0.0, a[k, 1] if k <= 1 else 0.0, a[k, 2], pivot
        )  # fmt: skip
        for i in range(k + 1, 3):
            for j in range(k + 1, 3):
                a[i, j] -= a[i, k] * a[k, j] / pivot


@kernel(inline="always")
def scalar_update(cov, h0, h1, h2, pivot):
    """Take in h^T e = 0 with the variance of `pivot`: an information of h h^T / pivot."""
    g0 = cov[0, 0] * h0 + cov[0, 1] * h1 + cov[0, 2] * h2
    g1 = cov[1, 0] * h0 + cov[1, 1] * h1 + cov[1, 2] * h2
    g2 = cov[2, 0] * h0 + cov[2, 1] * h1 + cov[2, 2] * h2
    subtract_square(cov, g0, g1, g2, 1.0 / (pivot + h0 * g0 + h1 * g1 + h2 * g2))


@kernel(inline="always")
def subtract_square(cov, g0, g1, g2, factor):
    """Subtract factor g g^T from a covariance, in place."""
    cov[0, 0] -= factor * g0 * g0
    cov[1, 1] -= factor * g1 * g1
    cov[2, 2] -= factor * g2 * g2
    cov[0, 1] -= factor * g0 * g1
    cov[0, 2] -= factor * g0 * g2
    cov[1, 2] -= factor * g1 * g2
    cov[1, 0], cov[2, 0], cov[2, 1] = cov[0, 1], cov[0, 2], cov[1, 2]


@kernel
def first_passage(cov, before, position_limit, heading_limit):
    """Take out robots that leave the limits in a step, in place; return the share that stays.

    Args:
        cov: Covariance after the odometry of the step, written.
        before: Covariance before it.
        position_limit: Metres.
        heading_limit: Radians.
    """
    large, small, c, s = axes(cov)
    stay = leave_along(cov, before, c, s, 0.0, large, position_limit)
    stay *= leave_along(cov, before, -s, c, 0.0, small, position_limit)
    return stay * leave_along(cov, before, 0.0, 0.0, 1.0, cov[2, 2], heading_limit)


@kernel
def leave_along(cov, before, h0, h1, h2, variance, limit):
    """Take out errors that leave the limit along h, in place; return the share that stays."""
    square = limit * limit
    if square >= FAR * FAR * variance:
        return 1.0
    growth = variance - (
        h0 * h0 * before[0, 0] + h1 * h1 * before[1, 1] + h2 * h2 * before[2, 2]
        + 2.0 * (h0 * h1 * before[0, 1] + h0 * h2 * before[0, 2] + h1 * h2 * before[1, 2])
    )  # fmt: skip
    if not growth > 0.0:
        return 1.0
    # In the middle of the step, so that its length hardly matters.
    v = min((variance - 0.5 * growth) / square, WIDEST)
    density = math.exp(-0.5 / v + RISE * v + BEND * v * v) / ROOT_2_PI
    share = growth / (v * square) * density / math.sqrt(v)
    taken = min(max(share * (square - variance) / variance, 0.0), MOST_TAKEN)
    g0 = cov[0, 0] * h0 + cov[0, 1] * h1 + cov[0, 2] * h2
    g1 = cov[1, 0] * h0 + cov[1, 1] * h1 + cov[1, 2] * h2
    g2 = cov[2, 0] * h0 + cov[2, 1] * h1 + cov[2, 2] * h2
    subtract_square(cov, g0, g1, g2, taken / variance)
    return math.exp(-share)
