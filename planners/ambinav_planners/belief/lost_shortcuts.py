"""Shortcuts of a path that keep to a share of lost robots.

A path over a lattice goes in zigzags. Parts of it are replaced by straight lines, the longest parts
first, where the robot gets through and the forecast of the whole route stays within the share.
"""

from __future__ import annotations

import numpy as np

from ambinav.forecasting.forecast import Forecaster
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Floats
from ambinav.service.service import AmbiguityService

OVERLAP = 4
"""Parts of equal length are tried from every so-many-th of their length on."""
LEAST_GAIN = 1e-3
"""Metres that a shortcut saves at least."""


def shortened(
    points: Floats,
    checker: CollisionChecker,
    forecaster: Forecaster,
    max_lost: float,
    service: AmbiguityService | None = None,
) -> Floats:
    """Return a path with straight lines instead of its zigzags.

    Args:
        points: x, y, shape (N, 2), metres; every motion is free.
        checker: What is free, for a robot that faces along its path.
        forecaster: Forecaster of the map.
        max_lost: Largest share of robots forecast to get lost, which the path itself keeps to.
        service: Costs in metres, at a weight of 0; None: the length.

    Returns:
        The path, shape (M, 2), from the same start to the same goal.
    """
    span = len(points) - 1
    while span >= 2:
        points = _round(points, span, checker, forecaster, max_lost, service)
        span = min(span, len(points)) // 2
    return points


def _round(
    points: Floats,
    span: int,
    checker: CollisionChecker,
    forecaster: Forecaster,
    max_lost: float,
    service: AmbiguityService | None,
) -> Floats:
    """Replace parts of `span` motions, those that save most first."""
    begin = np.arange(0, len(points) - span, max(span // OVERLAP, 1))
    along = np.concatenate(
        [[0.0], np.cumsum(_metres(*_facing(points[:-1], points[1:]), checker, service))]
    )
    ends = _facing(points[begin], points[begin + span])
    saved = along[begin + span] - along[begin] - _metres(*ends, checker, service)
    saves = saved > LEAST_GAIN
    begin, saved = begin[saves], saved[saves]
    free = np.zeros(0, dtype=np.bool_)
    if len(begin):
        free = checker.motions_free(*(poses[saves] for poses in ends))
    begin, saved = begin[free], saved[free]
    alone = [_without(points, [at], span) for at in begin.tolist()]
    lost = forecaster.lost_probabilities([Route.through(path) for path in alone])
    chosen: list[int] = []
    for i in np.argsort(-saved, kind="stable").tolist():
        at = int(begin[i])
        if lost[i] > max_lost or any(abs(at - chosen_at) < span for chosen_at in chosen):
            continue
        path = _without(points, [*chosen, at], span)
        if not chosen or forecaster.lost_probabilities([Route.through(path)])[0] <= max_lost:
            chosen.append(at)
    return _without(points, chosen, span)


def _facing(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return poses at points a and b that face from a to b."""
    heading = np.arctan2(*(b - a).T[::-1])
    return np.column_stack([a, heading]), np.column_stack([b, heading])


def _metres(
    a: Floats, b: Floats, checker: CollisionChecker, service: AmbiguityService | None
) -> Floats:
    """Return the length of each motion, with the metres that the cost adds."""
    if service is None or service.plain is None:
        return np.asarray(np.hypot(*(b - a)[:, :2].T))
    return service.motion_costs(a, b, checker.steering)


def _without(points: Floats, begins: list[int], span: int) -> Floats:
    """Return the points but those inside of the parts that begin at some of them."""
    keeps = np.ones(len(points), dtype=np.bool_)
    for at in begins:
        keeps[at + 1 : at + span] = False
    return points[keeps]
