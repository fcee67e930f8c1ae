"""The filter of a forecast in plain NumPy, with matrices inverted as the formulas have them."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit
from scipy.stats import norm, truncnorm

from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.filter_kernel import FIELD_ROUNDING, FilterSettings
from ambinav.forecasting.information_field import ECHOES, InformationField

Floats = NDArray[np.float64]


def reference(
    poses: Floats,
    start: Floats,
    field: InformationField,
    noise: OdometryNoise,
    settings: FilterSettings,
) -> tuple[Floats, Floats]:
    """Return covariances (n, 3, 3) and lost shares (n,), as `forecast_rows` writes them."""
    P, whole, tracked, outside = start, start, 1.0, 0.0
    covariances, lost = [P], [0.0]
    turning = np.diag([1.0, 1.0, math.sqrt(settings.turn_gain)])
    for before, after in pairwise(poses):
        both = np.array([P, whole])
        twice = [np.array([pose, pose]) for pose in (before, before, after)]
        both = noise.spread(twice[0], both, twice[1], twice[2])
        earlier = both[0]
        metres = math.dist(before[:2], after[:2])
        turn = abs((after[2] - before[2] + math.pi) % (2.0 * math.pi) - math.pi)
        updates = max(metres / settings.distance, turn / settings.angle)
        if updates > 0.0:
            J = settings.gain * updates * turning @ field.at(after[None])[0] @ turning
            if field.has_echoes and settings.echo_gain < math.inf:
                echoes = replace(field, entries=field.entries[:, ECHOES:])
                C = settings.echo_gain * updates * echoes.at(after[None])[0]
                C = C + FIELD_ROUNDING * np.diag(np.diag(J + C))
                J = J @ np.linalg.pinv(J + C, hermitian=True) @ C
            both = np.linalg.inv(np.linalg.inv(both) + J)
        P, whole = both
        if updates > 0.0:
            of_place, _ = _cut_off(whole, _place_limits(whole, settings, after[2]))
            of_heading, _ = _cut_off(whole, _heading_limit(settings))
            outside = max(outside, 1.0 - of_place * of_heading)
            limits = [*_place_limits(P, settings, after[2]), *_heading_limit(settings)]
            stay, P = _cut_off(P, limits)
            tracked *= stay
        covariances.append((earlier + P) / 2.0)
        lost.append(float(expit((logit(outside) + logit(1.0 - tracked)) / 2.0)))
    return np.array(covariances), np.array(lost)


Limits = list[tuple[float, Floats]]
"""Limits, and the directions (x, y, theta) of the errors that they are of."""


def _place_limits(P: Floats, settings: FilterSettings, theta: float) -> Limits:
    (small, large), limit = np.linalg.eigh(P[:2, :2])[1].T, settings.position_limit
    if math.isinf(settings.lateral_limit):
        return [(limit, np.append(large, 0.0)), (limit, np.append(small, 0.0))]
    c, s = math.cos(theta), math.sin(theta)
    return [(limit, np.array([c, s, 0.0])), (settings.lateral_limit, np.array([-s, c, 0.0]))]


def _heading_limit(settings: FilterSettings) -> Limits:
    return [(settings.heading_limit, np.array([0.0, 0.0, 1.0]))]


def _cut_off(P: Floats, limits: Limits) -> tuple[float, Floats]:
    """Return the share within limits, one after the other, and the Gaussian that is cut off."""
    stay = 1.0
    for limit, h in limits:
        std = math.sqrt(h @ P @ h)
        stay *= 1.0 - 2.0 * float(norm.sf(limit / std))
        cut = truncnorm.var(-limit / std, limit / std, scale=std)
        P = P - np.outer(P @ h, P @ h) * (std**2 - cut) / std**4
    return stay, P
