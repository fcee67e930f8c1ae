"""Information filter along routes, and the share of robots that it gets lost.

The error of the estimate is a Gaussian (x, y, theta), as in a Kalman filter that is right about its
own errors (Thrun, Burgard & Fox 2005, "Probabilistic Robotics", chapter 3): the odometry adds its
variances, and every so many metres or radians a scan adds a share of the map's information about
the pose (`InformationField`). That has no ceiling: where a scan tells nothing, the error grows on
beyond the neighbourhood that the map's ambiguity is of. A localizer that learns from echoes alone
gains a part of that share J: with what the echoes of the scan tell at most, C = echo_gain E,

    (J^-1 + C^-1)^-1,

the information of a position that errs by what the scan leaves open, and beside that by what the
echoes do (the parallel sum: Anderson & Duffin 1969, "Series and parallel addition of matrices").

Lost is who is off by more than a limit after a scan, for the first time (first passage). Two shares
enclose it:

- the largest share, so far, of the whole Gaussian outside of the limits: a lower bound, for robots
  that were lost earlier and are back do not count;
- that of a Gaussian that is cut off at the limits after every scan, along both axes of the
  position's error (or along and across the robot's heading) and for the heading: what lies outside
  counts as lost, and the rest is a Gaussian again, of the same second moment. Of a variance s^2 cut
  off at +-b, with a = b / s and phi, Phi of the standard normal,

      lost share = 2 Phi(-a),    variance = s^2 (1 - 2 a phi(a) / (1 - 2 Phi(-a)))

  (Johnson, Kotz & Balakrishnan 1994, "Continuous Univariate Distributions", volume 1, section
  13.10). Its tails grow back with each scan, so robots whose error changes slowly count twice.

The lost share has the mean of both log odds. How it is enclosed is our own; docs/forecast.md has
how it compares with robots that were driven.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ambinav.drive.noise import propagate_covariance
from ambinav.forecasting.information_field import ECHOES, information_at, matrix_at
from ambinav.geometry.motion.circles import wrap
from ambinav.runtime.array_types import Floats
from ambinav.runtime.arrays import copy_into
from ambinav.runtime.kernels import kernel

# From so many deviations on nothing is cut off: 2 Phi(-6) is 2e-9.
FAR = 6.0
# Least variance of a cut-off Gaussian as a share of what it was.
LEAST_SHARE = 1e-6
# Shares below this count as this: the log odds are finite.
LEAST_LOST = 1e-9
# Information along an axis below this share of the whole is left out: rounding.
LEAST_PIVOT = 1e-14
# One over a smaller number may be infinite.
LEAST_NORMAL = 1e-300
# Rounding of updates.
ROUNDING = 1e-9
# Of a diagonal of the field, whose entries are float32, this share may be rounding.
FIELD_ROUNDING = 1e-6


class FilterSettings(NamedTuple):
    """Localizer and limits for the kernels.

    Attributes:
        gain: Factor on a scan's information in an update.
        turn_gain: Factor on that about the heading, beside `gain`.
        distance: Metres from update to update.
        angle: Radians, likewise.
        position_limit: Metres off from which a robot is lost: in any direction, or along its
            heading.
        lateral_limit: Metres across the heading, likewise; inf: the position's limit holds in any
            direction.
        heading_limit: Radians, likewise.
        echo_gain: Factor on what the echoes of a scan tell, 1/m^2; where the field has none, or at
            inf, they are no limit.
    """

    gain: float
    turn_gain: float
    distance: float
    angle: float
    position_limit: float
    lateral_limit: float
    heading_limit: float
    echo_gain: float = math.inf


class Room(NamedTuple):
    """Arrays that a step of the filter overwrites: matrices (3, 3) and a pose (3,)."""

    information: Floats
    gained: Floats
    echoes: Floats
    mean: Floats


@kernel
def filter_room():
    """Return arrays for `filter_step`."""
    return Room(np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3))


@kernel
def updates_apart(poses, along, distance, angle):
    """Return rows of poses (n, 3) an update apart: the first and the last, and those between.

    Args:
        poses: Along a route, close to each other, metres and radians.
        along: Metres up to each, shape (n,).
        distance: Metres from update to update.
        angle: Radians, likewise; a turn on the spot is one step, however far it is.
    """
    kept = np.empty(len(poses), dtype=np.int64)
    count, updates = 0, 1.0
    for k in range(len(poses)):
        if k > 0:
            turn = abs(wrap(poses[k, 2] - poses[k - 1, 2]))
            updates += max((along[k] - along[k - 1]) / distance, turn / angle)
        if updates >= 1.0 - ROUNDING or k == len(poses) - 1:
            kept[count] = k
            count += 1
            updates = 0.0
    return kept[:count]


@kernel
def forecast_rows(
    low, high, first, poses, start, fields, lattice, noise, settings, covariance, lost
):  # fmt: skip
    """Forecast routes low to high.

    Args:
        low: The first route.
        high: One past the last.
        first: Row of each route's first pose, and of the end of the last, int64, shape (K + 1,).
        poses: Poses along all routes, an update apart, (M, 3), metres and radians, map frame.
        start: Covariance at the first pose of each, shape (3, 3).
        fields: See `InformationField`.
        lattice: See there.
        noise: `OdometryNoise.packed`.
        settings: See `FilterSettings`.
        covariance: Written: covariance of those not lost, mean of before and after the scan at
            each pose, shape (M, 3, 3).
        lost: Written: share lost up to each pose, shape (M,).
    """
    room = filter_room()
    cov, whole = start.copy(), start.copy()
    for route in range(low, high):
        begin = first[route]
        copy_into(covariance[begin], start)
        copy_into(cov, start)
        copy_into(whole, start)
        lost[begin], outside, tracked = 0.0, 0.0, 1.0
        for k in range(begin + 1, first[route + 1]):
            outside, tracked = filter_step(
                poses[k - 1], poses[k], cov, whole, outside, tracked, fields, lattice, noise,
                settings, covariance[k], room,
            )  # fmt: skip
            for i in range(3):
                for j in range(3):
                    covariance[k, i, j] = 0.5 * (covariance[k, i, j] + cov[i, j])
            lost[k] = between(outside, 1.0 - tracked)


@kernel(inline="always")
def filter_step(
    before, after, cov, whole, outside, tracked, fields, lattice, noise, settings, predicted, room
):  # fmt: skip
    """Take both Gaussians from a pose to the next, in place; return what is lost then.

    Args:
        before: Pose, (3,), metres and radians, map frame.
        after: The next pose.
        cov: The cut-off Gaussian, shape (3, 3), written.
        whole: The whole one, likewise.
        outside: Largest share of the whole one outside of the limits so far.
        tracked: Share that has stayed in the cut-off one.
        fields: See `InformationField`.
        lattice: See there.
        noise: `OdometryNoise.packed`.
        settings: See `FilterSettings`.
        predicted: Written: the cut-off Gaussian before the scan, shape (3, 3).
        room: Overwritten.

    Returns:
        The new `outside` and `tracked`.
    """
    for matrix in (cov, whole):
        copy_into(room.mean, before)
        propagate_covariance(
            room.mean, matrix, before[0], before[1], before[2], after[0], after[1], after[2], noise
        )
    copy_into(predicted, cov)
    metres = math.hypot(after[0] - before[0], after[1] - before[1])
    turn = abs(wrap(after[2] - before[2]))
    updates = max(metres / settings.distance, turn / settings.angle)
    if updates > 0.0:
        gained_at(after, updates, fields, lattice, settings, room)
        for matrix in (cov, whole):
            copy_into(room.gained, room.information)
            take_in(matrix, room.gained)
        outside = max(outside, 1.0 - share_within(whole, settings, after[2]))
        tracked *= cut_off(cov, settings, after[2])
    return outside, tracked


@kernel(inline="always")
def between(a, b):
    """Return the share whose log odds are the mean of those of two shares."""
    if b <= LEAST_LOST:
        return 0.0
    a, b = max(a, LEAST_LOST), min(b, 1.0 - LEAST_LOST)
    odds = math.sqrt(a / (1.0 - min(a, 1.0 - LEAST_LOST)) * b / (1.0 - b))
    return odds / (1.0 + odds)


@kernel
def gained_at(pose, updates, fields, lattice, settings, room):
    """Write what so many updates at a pose, (3,), gain to `room.information`."""
    _, entries = fields
    information_at(pose[0], pose[1], pose[2], fields, *lattice, room.information)
    scale(room.information, settings.gain * updates, math.sqrt(settings.turn_gain))
    if entries.shape[1] > ECHOES and settings.echo_gain < math.inf:
        matrix_at(pose[0], pose[1], pose[2], fields, *lattice, ECHOES, room.echoes)
        scale(room.echoes, settings.echo_gain * updates, 1.0)
        limit(room.information, room.echoes, room.gained)


@kernel
def gained_rows(low, high, poses, fields, lattice, settings, out):
    """Write what an update gains at poses low to high, (N, 3), to `out`, (N, 3, 3)."""
    room = filter_room()
    for p in range(low, high):
        gained_at(poses[p], 1.0, fields, lattice, settings, room)
        copy_into(out[p], room.information)


@kernel
def limit(information, most, work):
    """Replace an information J by (J^-1 + C^-1)^-1 = J - J (J + C)^-1 J, in place.

    Args:
        information: J, shape (3, 3).
        most: C, likewise; overwritten.
        work: Overwritten, shape (3, 3).
    """
    # The Schur complement of J + C in [[J + C, J], [J, J]], a pivot after the other. Where J has no
    # information but rounding, a little more of C keeps the pivots away from 0.
    for i in range(3):
        for j in range(3):
            most[i, j] += information[i, j]
            work[i, j] = information[i, j]
        most[i, i] *= 1.0 + FIELD_ROUNDING
    for k in range(3):
        pivot = most[k, k]
        if not pivot > 0.0:
            continue
        subtract_square(information, work[k, 0], work[k, 1], work[k, 2], 1.0 / pivot)
        for i in range(k + 1, 3):
            factor = most[i, k] / pivot
            for j in range(3):
                most[i, j] -= factor * most[k, j]
                work[i, j] -= factor * work[k, j]


@kernel(inline="always")
def scale(information, gain, turning):
    """Multiply by a gain, and what is of the heading by `turning` for each of its two sides."""
    for i in range(3):
        for j in range(3):
            information[i, j] *= gain
        information[i, 2] *= turning
        information[2, i] *= turning


@kernel
def take_in(cov, information):
    """Replace a covariance P by (P^-1 + J)^-1, in place.

    J, which is overwritten, is split into scalar measurements (its L D L^T), which are taken in
    one after the other (Bierman 1977, "Factorization methods for discrete sequential estimation").
    """
    a = information
    # Rounding may have left less than nothing of an information that `limit` took away.
    least = max(LEAST_PIVOT * (a[0, 0] + a[1, 1] + a[2, 2]), LEAST_NORMAL)
    for k in range(3):
        pivot = a[k, k]
        if not pivot > least:
            continue
        # Row k of the remaining matrix, from its diagonal on: J = sum of h h^T / pivot.
        h0, h1, h2 = a[k, 0] if k == 0 else 0.0, a[k, 1] if k <= 1 else 0.0, a[k, 2]
        g0 = cov[0, 0] * h0 + cov[0, 1] * h1 + cov[0, 2] * h2
        g1 = cov[1, 0] * h0 + cov[1, 1] * h1 + cov[1, 2] * h2
        g2 = cov[2, 0] * h0 + cov[2, 1] * h1 + cov[2, 2] * h2
        subtract_square(cov, g0, g1, g2, 1.0 / (pivot + h0 * g0 + h1 * g1 + h2 * g2))
        for i in range(k + 1, 3):
            for j in range(k + 1, 3):
                a[i, j] -= a[i, k] * a[k, j] / pivot


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


@kernel(inline="always")
def axes(cov):
    """Return the position's variance along the weak axis and across, and the axis (unit vector)."""
    half = 0.5 * (cov[0, 0] - cov[1, 1])
    middle, cross = 0.5 * (cov[0, 0] + cov[1, 1]), cov[0, 1]
    radius = math.hypot(half, cross)
    angle = 0.5 * math.atan2(cross, half)
    return middle + radius, max(middle - radius, 0.0), math.cos(angle), math.sin(angle)


@kernel
def share_within(cov, settings, theta):
    """Return the share of errors within the limits of a robot with heading `theta`, radians."""
    large, small, _, _ = axes(cov)
    b, turn = settings.position_limit, within(settings.heading_limit, cov[2, 2])
    if settings.lateral_limit == math.inf:
        return within(b, large) * within(b, small) * turn
    c, s = math.cos(theta), math.sin(theta)
    along, across, both = variances(cov, c, s)
    stay = within(b, along)
    # The errors across of those within the limit along, which the two may share.
    across -= (1.0 - kept_share(b, along, stay)) * both * both / along
    return stay * within(settings.lateral_limit, across) * turn


@kernel(inline="always")
def variances(cov, c, s):
    """Return the position's variances along (c, s) and across, and their covariance."""
    along = c * c * cov[0, 0] + 2.0 * c * s * cov[0, 1] + s * s * cov[1, 1]
    across = s * s * cov[0, 0] - 2.0 * c * s * cov[0, 1] + c * c * cov[1, 1]
    return along, across, c * s * (cov[1, 1] - cov[0, 0]) + (c * c - s * s) * cov[0, 1]


@kernel(inline="always")
def within(limit, variance):
    """Return the probability that a normal deviate is within +-limit."""
    if limit * limit >= FAR * FAR * variance:
        return 1.0
    return math.erf(limit / math.sqrt(2.0 * variance))


@kernel
def cut_off(cov, settings, theta):
    """Cut the Gaussian off at the limits of a robot with heading `theta`, radians, in place.

    Returns:
        The share that stays.
    """
    large, small, c, s = axes(cov)
    b, lateral = settings.position_limit, settings.lateral_limit
    if lateral == math.inf:
        stay = cut_along(cov, c, s, 0.0, large, b) * cut_along(cov, -s, c, 0.0, small, b)
    else:
        c, s = math.cos(theta), math.sin(theta)
        stay = cut_along(cov, c, s, 0.0, variances(cov, c, s)[0], b)
        stay *= cut_along(cov, -s, c, 0.0, variances(cov, c, s)[1], lateral)
    return stay * cut_along(cov, 0.0, 0.0, 1.0, cov[2, 2], settings.heading_limit)


@kernel(inline="always")
def kept_share(limit, variance, stay):
    """Return the variance of a normal deviate cut off at +-limit as a share of the whole one's."""
    a = limit / math.sqrt(variance)
    return max(1.0 - math.sqrt(2.0 / math.pi) * a * math.exp(-0.5 * a * a) / stay, LEAST_SHARE)


@kernel
def cut_along(cov, h0, h1, h2, variance, limit):
    """Cut off where |h^T e| is above a limit, in place; return the share that stays."""
    stay = within(limit, variance)
    if stay == 1.0:
        return stay
    share = kept_share(limit, variance, stay)
    g0 = cov[0, 0] * h0 + cov[0, 1] * h1 + cov[0, 2] * h2
    g1 = cov[1, 0] * h0 + cov[1, 1] * h1 + cov[1, 2] * h2
    g2 = cov[2, 0] * h0 + cov[2, 1] * h1 + cov[2, 2] * h2
    subtract_square(cov, g0, g1, g2, (1.0 - share) / variance)
    return stay
