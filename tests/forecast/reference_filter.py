"""The filter of a forecast in plain NumPy, with matrices inverted as the formulas have them."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from ambinav.drive.noise import OdometryNoise
from ambinav.forecast.filter_kernel import FilterSettings
from ambinav.forecast.information_field import InformationField

Floats = NDArray[np.float64]


def reference(
    poses: Floats,
    start: Floats,
    field: InformationField,
    noise: OdometryNoise,
    settings: FilterSettings,
) -> tuple[Floats, Floats]:
    """Return covariances (n, 3, 3) and lost shares (n,), as `forecast_rows` writes them."""
    P, tracked = start.copy(), 1.0
    covariances, lost = [P], [0.0]
    for before, after in pairwise(poses):
        earlier = P
        P = noise.spread(before[None], P[None], before[None], after[None])[0]
        axes = np.linalg.eigh(P[:2, :2])[1]
        for limit, h in (
            (settings.position_limit, np.append(axes[:, 1], 0.0)),
            (settings.position_limit, np.append(axes[:, 0], 0.0)),
            (settings.heading_limit, np.array([0.0, 0.0, 1.0])),
        ):
            variance = float(h @ P @ h)
            growth = max(variance - float(h @ earlier @ h), 0.0)
            leaving = growth * rate(variance - growth / 2.0, limit)
            tracked *= math.exp(-leaving)
            taken = min(max(leaving * (limit**2 - variance), 0.0), variance / 2.0)
            P = P - np.outer(P @ h, P @ h) * taken / variance**2
        metres = math.dist(before[:2], after[:2])
        turn = abs((after[2] - before[2] + math.pi) % (2.0 * math.pi) - math.pi)
        updates = max(metres / settings.distance, turn / settings.angle)
        if updates > 0.0:
            J = _information(after, P, field, settings) * updates
            P = np.linalg.inv(np.linalg.inv(P) + J)
        covariances.append(P)
        lost.append(1.0 - tracked)
    return np.array(covariances), np.array(lost)


def rate(variance: float, limit: float) -> float:
    """Share that leaves the limit for each unit by which the variance grows."""
    v = min(variance / limit**2, 0.19)
    a = 1.0 / math.sqrt(v)
    return a * float(norm.pdf(a)) / (v * limit**2) * math.exp(-2.58 * v + 49.6 * v * v)


def _information(
    pose: Floats, P: Floats, field: InformationField, settings: FilterSettings
) -> Floats:
    variances, vectors = np.linalg.eigh(P[:2, :2])
    sigma = math.sqrt(variances[1])
    share = settings.slide * min(sigma / settings.position_limit, 1.0)
    aside = np.append(sigma * vectors[:, 1], 0.0)
    here, ahead, behind = field.at(np.array([pose, pose + aside, pose - aside]))
    J = (1.0 - share) * here + share * (ahead + behind) / 2.0
    scale = np.diag([1.0, 1.0, math.sqrt(settings.turn_gain)])
    return np.asarray(settings.gain * scale @ J @ scale)
