"""Improvement of a route that must keep a limit on consecutive bad metres.

Made cheaper by the cost alone, a route may cut through bad floor for longer than it may. So bad
metres are given a price of their own, as much as it takes (Lagrangian relaxation, Handler and
Zang 1980): the least price at which the improved route keeps the limit is bracketed and halved.
"""

from __future__ import annotations

import itertools
from copy import copy
from dataclasses import replace

import numpy as np

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.runtime.array_types import Floats
from ambinav.service.service import AmbiguityService
from ambinav_planners.improve.route import improve
from ambinav_planners.search.limit import BadStretchLimit

# Prices of a bad metre, in metres-equivalent, relative to the dearest metre; and how often the
# bracket between the last one that was too low and the first one that was not is halved.
PRICES = (0.1, 0.3, 1.0, 3.0, 10.0)
HALVINGS = 2
# Good places on a route are looked for so many spacings apart.
DENSE = 0.5


def improve_within(
    poses: Floats, service: AmbiguityService, checker: CollisionChecker, limit: BadStretchLimit
) -> Floats | None:
    """Improve a route under a limit; return None if no attempt keeps it.

    It costs no more than `poses` if that keeps the limit.

    Args:
        poses: A free route, shape (N, 3), N at least 2. It need not keep the limit itself.
        service: Service for the cost per metre.
        checker: Collision checker of the robot, with its kind of motion.
        limit: Limit that the result keeps.

    Raises:
        InputError: see `improve`.
    """
    improved = _cheaper(poses, _at_a_price(poses, service, checker, limit), service, checker, limit)
    if checker.steering.turns:
        return improved
    parts = _in_pieces(poses if improved is None else improved, service, checker, limit)
    return parts if improved is None else _cheaper(improved, parts, service, checker, limit)


def _cheaper(
    poses: Floats,
    second: Floats | None,
    service: AmbiguityService,
    checker: CollisionChecker,
    limit: BadStretchLimit,
) -> Floats | None:
    """Return the cheaper of two routes; the first counts only if it keeps the limit."""
    steering = checker.steering
    if not limit.kept_by(poses, service, steering):
        return second
    if second is None:
        return poses
    return min((second, poses), key=lambda route: service.route_cost(route, steering))


def _at_a_price(
    poses: Floats, service: AmbiguityService, checker: CollisionChecker, limit: BadStretchLimit
) -> Floats | None:
    """Improve the route at the least price of bad metres for which it keeps the limit."""

    def at(price: float) -> Floats | None:
        improved = improve(poses, priced(service, limit.level, price), checker)
        return improved if limit.kept_by(improved, service, checker.steering) else None

    best = at(0.0)
    if best is not None:
        return best
    dearest = float(service.density.values.max())
    low, high = 0.0, 0.0
    for share in PRICES:
        high = share * dearest
        best = at(high)
        if best is not None:
            break
        low = high
    if best is None:
        return None
    candidates = [best]
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        route = at(middle)
        if route is None:
            low = middle
        else:
            high = middle
            candidates.append(route)
    return min(candidates, key=lambda route: service.route_cost(route, checker.steering))


def _in_pieces(
    poses: Floats, service: AmbiguityService, checker: CollisionChecker, limit: BadStretchLimit
) -> Floats | None:
    """Improve the route between good places, which stay fixed.

    One price does not suit every bad stretch of a route that looks in at good places for a moment.
    """
    steering = checker.steering
    points = steering.dense(poses, DENSE * service.map.spacing)[0]
    points = points[np.r_[True, np.diff(points[:, :2], axis=0).any(axis=1)]]
    level = service.ambiguity.at(*np.ascontiguousarray(points.T))
    good = np.flatnonzero(level <= limit.level)
    if not len(good):
        return None
    runs = np.split(good, np.flatnonzero(np.diff(good) > 1) + 1)
    best = [int(run[level[run].argmin()]) for run in runs]
    cuts = sorted({0, *best, len(points) - 1})
    pieces = []
    for low, high in itertools.pairwise(cuts):
        piece = points[low : high + 1]
        better = _cheaper(
            piece, _at_a_price(piece, service, checker, limit), service, checker, limit
        )
        pieces.append((piece if better is None else better)[:-1])
    route = steering.oriented(np.concatenate([*pieces, points[-1:]]))
    return route if limit.kept_by(route, service, steering) else None


def priced(service: AmbiguityService, level: float, price: float) -> AmbiguityService:
    """Return the service with an extra cost of `price` per metre above a level of the layer."""
    if price == 0.0:
        return service
    bad = (service.ambiguity.values > level).astype(np.float32)
    copied = copy(service)
    copied.density = replace(service.density, values=service.density.values + price * bad)
    return copied
