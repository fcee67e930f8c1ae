"""Shortcuts of a flight: the cheapest polyline through points along a path in space.

Its points are then moved to the best place around them, from decimetres to a centimetre, and left
out where that costs nothing.
"""

from __future__ import annotations

import itertools
import math
from typing import Final

import numpy as np

from ambinav.geometry.collision.sphere import SphereChecker, sphere_free
from ambinav.runtime.array_types import Floats
from ambinav.service.motion import integral_in_space
from ambinav.service.volume_service import VolumeService
from ambinav_planners.improve.moves import settled

STEP: Final = 0.5
"""Distance between points along a path that shortcuts lead from and to, at most, metres."""
ROUNDS: Final = 4
"""Each goes on from what the one before it found."""


def shortened(points: Floats, service: VolumeService, checker: SphereChecker) -> Floats:
    """Return a path that costs less, or the same.

    Args:
        points: x, y, z, shape (N, 3), metres; a free path.
        service: Service for the cost per metre.
        checker: Checker of the robot's body.

    Returns:
        Points from the same start to the same goal.
    """
    for _ in range(ROUNDS):
        points = _cheapest(_dense(points), service, checker)
    volume = service.volume
    ends = np.array([[volume.dataset[name].values[k] for name in "xyz"] for k in (0, -1)])
    # A start or goal may be half a cell beside the outermost cells.
    low, high = np.minimum(ends[0], points.min(axis=0)), np.maximum(ends[1], points.max(axis=0))
    moved = settled(_dense(points), low, high, service.kernel_arrays, checker.arrays)
    return moved if service.route_cost(moved) < service.route_cost(points) else points


def _dense(points: Floats) -> Floats:
    """Return a path with points at most `STEP` apart."""
    parts = [points[:1]]
    for a, b in itertools.pairwise(points):
        count = max(math.ceil(math.dist(a, b) / STEP), 1)
        parts.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, np.newaxis])
    return np.concatenate(parts)


def _cheapest(points: Floats, service: VolumeService, checker: SphereChecker) -> Floats:
    """Return those points through which the cheapest free polyline leads."""
    arrays, least = service.kernel_arrays, float(service.density.min())
    legs = [integral_in_space(*a, *b, *arrays) for a, b in itertools.pairwise(points)]
    cost, before = np.concatenate([[0.0], np.cumsum(legs)]), np.arange(-1, len(points) - 1)
    for i in range(len(points) - 1):
        if cost[i] + legs[i] < cost[i + 1]:
            cost[i + 1], before[i + 1] = cost[i] + legs[i], i
        away = np.linalg.norm(points - points[i], axis=1)
        for j in range(i + 2, len(points)):
            if cost[i] + least * away[j] >= cost[j]:
                continue
            offer = cost[i] + integral_in_space(*points[i], *points[j], *arrays)
            if offer < cost[j] and sphere_free(*points[i], *points[j], *checker.arrays):
                cost[j], before[j] = offer, i
    nodes = [len(points) - 1]
    while nodes[-1] > 0:
        nodes.append(int(before[nodes[-1]]))
    return points[nodes[::-1]]
