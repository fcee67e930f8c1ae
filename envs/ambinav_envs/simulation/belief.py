"""The pose that a robot believes in, as numbers of its action, and its logarithmic score."""

from __future__ import annotations

import math
from typing import Final

from ambinav.localization.odometry import wrapped
from ambinav.runtime.kernels import kernel

NUMBERS: Final = 9
"""Three of the pose, three deviations, three partial correlations."""
REACH: Final = (10.0, 10.0, math.pi)
"""Offset from the estimate at 1, metres and radians."""
LEAST_STD: Final = (0.01, 0.01, 0.005)
"""Deviations at -1."""
MOST_STD: Final = (10.0, 10.0, 1.5)
"""Deviations at 1."""
MOST_CORRELATION: Final = 0.99
"""Partial correlation at 1."""
UNIFORM: Final = 0.01
"""Share of the belief that is spread evenly over the building, whatever a robot says."""
_LOG_TWO_PI: Final = math.log(2.0 * math.pi)


@kernel
def share_of(number):
    """Return a number of an action cut off at -1 and 1."""
    return min(max(number, -1.0), 1.0)


@kernel
def score(actions, i, first, mean, truth, bounds):
    """Return the logarithmic score of robot i's belief, in nats above knowing nothing.

    The belief is (1 - u) N + u U: the normal density that the action gives, wrapped in the heading,
    and with the share u = `UNIFORM` the density U that is even over the building's bounds and all
    headings. The score is ln(((1 - u) N + u U) / U) at the true pose, so 0 for U itself, never
    below ln u, and, as every logarithmic score, the highest on average for who gives what it
    believes (Gneiting & Raftery 2007, section 4.2).

    Args:
        actions: Shape (N, columns).
        i: Which robot.
        first: Column of the first of its `NUMBERS`, see `ambinav_envs.beliefs`.
        mean: Estimate from which the offset counts, shape (3,).
        truth: True pose, shape (3,).
        bounds: Left, lower, right and upper end of the building, metres.
    """
    turn = mean[2]
    co, si = math.cos(turn), math.sin(turn)
    dx, dy, dt = truth[0] - mean[0], truth[1] - mean[1], truth[2] - turn
    e0 = co * dx + si * dy - REACH[0] * share_of(actions[i, first])
    e1 = co * dy - si * dx - REACH[1] * share_of(actions[i, first + 1])
    e2 = wrapped(dt - REACH[2] * share_of(actions[i, first + 2]))
    s0 = deviation(actions[i, first + 3], 0)
    s1 = deviation(actions[i, first + 4], 1)
    s2 = deviation(actions[i, first + 5], 2)
    a = MOST_CORRELATION * share_of(actions[i, first + 6])
    b = MOST_CORRELATION * share_of(actions[i, first + 7])
    c = MOST_CORRELATION * share_of(actions[i, first + 8])
    ra, rb, rc = math.sqrt(1.0 - a * a), math.sqrt(1.0 - b * b), math.sqrt(1.0 - c * c)
    # Forward substitution in the Cholesky factor of the covariance.
    z0 = e0 / s0
    z1 = (e1 / s1 - a * z0) / ra
    wraps = 0.0
    for k in range(-1, 2):
        z2 = ((e2 + 2.0 * math.pi * k) / s2 - b * z0 - c * rb * z1) / (rb * rc)
        wraps += math.exp(-0.5 * z2 * z2)
    area = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
    log_scale = math.log(area / (s0 * s1 * s2 * ra * rb * rc)) - 0.5 * _LOG_TWO_PI
    ratio = wraps * math.exp(log_scale - 0.5 * (z0 * z0 + z1 * z1))
    return math.log((1.0 - UNIFORM) * ratio + UNIFORM)


@kernel
def deviation(number, k):
    """Return the deviation that number k of them stands for, metres or radians."""
    share = 0.5 * (share_of(number) + 1.0)
    return LEAST_STD[k] * (MOST_STD[k] / LEAST_STD[k]) ** share
