"""Improvement of a route: cheaper, never dearer, never through what is not free.

Planners leave routes that are rough: a lattice knows few directions, a tree few vertices. What is
done to them here follows the integral of the cost alone, so that a detour around a bad zone stays
where it pays, and a corner is cut where it does not.

1. Shortcuts: the cheapest chain of free motions between points of the route.
2. A band: the cheapest chain through candidates beside the route, all vertices at once, on a
   scale that goes from metres to millimetres. (Moved one by one, vertices that stand close creep.)
3. Rounding: corners become cubic Bezier curves.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambinav.errors import InputError
from ambinav.geometry.collision import CollisionChecker
from ambinav.geometry.steering import STRAIGHT, checked_poses
from ambinav.service.service import AmbiguityService
from ambinav_planners.bezier import round_corners
from ambinav_planners.improve_kernel import (
    beside,
    cheapest_chain,
    headings,
    route_price,
    stations,
    travelled,
)

Floats = NDArray[np.float64]

# Shortcuts are looked for between points this far apart, metres, ...
SHORTCUT_SPACING = 0.3
# ... up to this long, metres; and between vertices, this many of them apart.
SHORTCUT_REACH = 2.5
SHORTCUT_VERTICES = 8
# The scales of the band: metres between stations, and the step between candidates as a share of
# that. The last scale decides how fine the result is.
SCALES = ((2.0, 0.2), (1.0, 0.2), (0.5, 0.15), (0.3, 0.1), (0.3, 0.03))
SIDES = 3
# A scale is left when a round gains less than this share of the cost.
ENOUGH = 1e-4
# Headings that a cost with headings is tried at: steps in radians, from coarse to fine.
HEADING_STEPS = (0.4, 0.1)


def improve(
    poses: ArrayLike,
    service: AmbiguityService,
    checker: CollisionChecker,
    *,
    smooth: bool = True,
    rounds: int = 6,
) -> Floats:
    """Make a route cheaper, without leaving what is free.

    The same route comes out every time: nothing is random. Motions along curves (dubins,
    reeds-shepp) are only shortcut.

    Args:
        poses: The route, shape (N, 3), N at least 2: x, y, theta in metres and radians.
        service: What a metre costs.
        checker: What is free for the robot, and its kind of motion.
        smooth: Whether corners are rounded.
        rounds: How often each scale of the band is repeated at the most; 0: shortcuts only.

    Returns:
        The route, shape (M, 3). It starts and ends where `poses` does (in r2 the headings are
        those of the travel), every motion of it is free, and its `service.route_cost` is not
        higher. What cannot be improved is returned as it came.

    Raises:
        InputError: the poses are not usable, a motion of the route is not free, or rounds is
            negative.
    """
    route = checked_poses(poses, "poses")
    if len(route) < 2:
        raise InputError(f"poses has {len(route)} poses; a route needs at least 2.")
    if not rounds >= 0:
        raise InputError(f"rounds is {rounds}; give a whole number of at least 0.")
    _check_free(route, checker)
    work = _Workbench(service, checker)
    found = [work.shortcut(route)]
    if not checker.steering.turns:
        found.append(work.descend(found[-1], rounds))
        if smooth:
            found.append(work.rounded(found[-1]))
        if checker.steering.kind == STRAIGHT:
            found.append(work.turned(found[-1]))
    paid = work.price(route)
    for better in reversed(found):
        oriented = checker.steering.oriented(better)
        if work.price(oriented) <= paid:
            return oriented
    return checker.steering.oriented(route)


def _check_free(route: Floats, checker: CollisionChecker) -> None:
    if not checker.poses_free(route[:1])[0]:
        raise InputError("poses[0] is not free for the robot; give a route that starts free.")
    free = checker.motions_free(route[:-1], route[1:])
    if not free.all():
        index = int(np.flatnonzero(~free)[0])
        raise InputError(
            f"the motion from poses[{index}] to poses[{index + 1}] is not free for the robot; "
            "only a free route can be improved."
        )


class _Workbench:
    """The steps of the improvement, with what all of them need at hand."""

    def __init__(self, service: AmbiguityService, checker: CollisionChecker) -> None:
        self.steering = checker.steering
        self.kind, self.radius = checker.steering.kind, float(checker.steering.radius)
        values, _, left, low, inverse = service.density.arrays
        self.field = (values, left, low, inverse)
        self.least = float(values.min())
        self.has_headings = values.shape[2] > 1
        self.walls: tuple[Any, ...] = tuple(checker.arrays)

    def price(self, route: Floats) -> float:
        """What the whole route costs; inf if it is not free."""
        return float(
            route_price(self.kind, self.radius, route, math.inf, self.field, self.walls)
        )

    def shortcut(self, route: Floats) -> Floats:
        """The cheapest chain between points of the route, then between the vertices left."""
        points = _distinct(self.steering.dense(route, SHORTCUT_SPACING)[0])
        legs = np.diff(travelled(self.kind, self.radius, route))
        # Along curves the motions of the route itself must be among those tried.
        reach = max(SHORTCUT_REACH, float(legs.max())) if self.steering.turns else SHORTCUT_REACH
        along = travelled(self.kind, self.radius, points)
        first = np.searchsorted(along, along - reach * (1.0 + 1e-9))
        return self.thinned(self.chain(points[:, np.newaxis], first, route))

    def thinned(self, route: Floats) -> Floats:
        """The cheapest chain between vertices of the route: those that gain nothing go."""
        first = np.arange(len(route)) - SHORTCUT_VERTICES
        return self.chain(route[:, np.newaxis], first, route)

    def descend(self, route: Floats, rounds: int) -> Floats:
        """Move all vertices to where the chain costs least, scale by scale."""
        for spacing, share in SCALES:
            paid = math.inf
            for _ in range(rounds):
                points = stations(route, spacing)
                candidates = beside(points, share, spacing, SIDES)
                route, cost = self.priced(candidates, np.arange(len(points)) - 1, route)
                route = self.thinned(route)
                if not cost < paid * (1.0 - ENOUGH):
                    break
                paid = cost
        return route

    def rounded(self, route: Floats) -> Floats:
        """Corners rounded where that is free and costs no more."""
        return np.asarray(
            round_corners(self.kind, self.radius, _distinct(route), self.field, self.walls)
        )

    def turned(self, route: Floats) -> Floats:
        """Headings along the travel where that is free and not dearer."""
        for step in HEADING_STEPS if self.has_headings else (0.0,):
            candidates = headings(route, step, SIDES if self.has_headings else 0)
            route = self.chain(candidates, np.arange(len(route)) - 1, route)
        return route

    def chain(self, candidates: Floats, first: NDArray[np.int64], route: Floats) -> Floats:
        return self.priced(candidates, first, route)[0]

    def priced(
        self, candidates: Floats, first: NDArray[np.int64], route: Floats
    ) -> tuple[Floats, float]:
        """The cheapest chain and its cost; the route itself if no chain is free."""
        found, cost = cheapest_chain(
            self.kind, self.radius, np.ascontiguousarray(candidates),
            np.maximum(first, 0).astype(np.int64), self.least, self.field, self.walls,
        )  # fmt: skip
        return (found, cost) if math.isfinite(cost) else (route, math.inf)


def _distinct(poses: Floats) -> Floats:
    """The poses without those that repeat the place of the one before, ends kept."""
    keep = np.ones(len(poses), dtype=np.bool_)
    keep[1:] = (np.diff(poses, axis=0) != 0.0).any(axis=1)
    return poses[keep]
