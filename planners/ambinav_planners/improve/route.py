"""Improvement of a route: the cost never rises, and the route stays free.

Planners leave routes that are rough: a lattice knows few directions, a tree few vertices. What is
done to them here follows the integral of the cost alone, so that a detour around a bad zone stays
where it pays, and a corner is cut where it does not.

1. Shortcuts: the cheapest chain of free motions between points of the route.
2. A band: the cheapest chain through candidates beside the route, all vertices at once, on a
   scale that goes from metres to millimetres. (Moved one by one, vertices that stand close creep.)
3. Rounding: corners between straight motions become cubic Bezier curves.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.motion.steering import FACING, STRAIGHT, checked_poses
from ambinav.runtime.array_types import Floats, Ints
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.improve.bezier import round_corners
from ambinav_planners.improve.kernel import (
    beside,
    cheapest_chain,
    headings,
    route_price,
    stations,
    travelled,
)

# Shortcuts are looked for between points this far apart, metres, ...
SHORTCUT_SPACING = 0.3
# ... up to this long, metres; and between vertices, this many of them apart.
SHORTCUT_REACH = 2.5
SHORTCUT_VERTICES = 8
# The scales of the band: metres between stations, and the step between candidates as a share of
# that. The last scale decides how fine the result is.
SCALES = ((2.0, 0.2), (0.6, 0.2), (0.3, 0.1), (0.3, 0.03))
SIDES = 2
# So many stations may be left out where motions cannot end everywhere.
SKIPPED = 4
# A scale is left when two rounds gain less than this share of the cost.
ENOUGH = 5e-4
# The same for curves, which need room to turn; headings stand apart by twice the share, radians.
CURVE_SCALES = ((4.0, 0.1), (2.0, 0.1), (2.0, 0.03))
CURVE_SKIPPED = 2
# Relative error of a cost, from adding up many motions.
ROUNDING = 1e-12
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
    """Reduce the cost of a route within the free space.

    The same route comes out every time: nothing is random. Curves (dubins, reeds-shepp) are not
    rounded.

    Args:
        poses: The route, shape (N, 3), N at least 2: x, y, theta in metres and radians.
        service: Service for the cost per metre.
        checker: What is free for the robot, and its kind of motion.
        smooth: Whether corners are rounded.
        rounds: How often each scale of the band is gone through at the most; 0: shortcuts only.

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
    work = _Workbench(service, checker)
    paid = work.price(route)
    if not (math.isfinite(paid) and checker.poses_free(route[:1])[0]):
        raise InputError(_what_is_not_free(route, checker))
    if paid == 0.0:  # it stays in one place
        return checker.steering.oriented(route)
    routes = [work.shortcut(route)]
    if checker.steering.turns:
        routes.append(work.steer(routes[-1], rounds))
    else:
        routes.append(work.descend(routes[-1], rounds))
        if smooth:
            routes.append(work.rounded(routes[-1]))
        if checker.steering.kind == STRAIGHT:
            routes.append(work.turned(routes[-1]))
    for better in reversed(routes):
        oriented = checker.steering.oriented(better)
        price = work.price(oriented)
        if price < paid * (1.0 - ROUNDING):
            return oriented
        # Such close costs depend on the order of summation: use the reported one.
        if price <= paid * (1.0 + ROUNDING) and (
            service.route_cost(oriented, checker.steering)
            <= service.route_cost(route, checker.steering)
        ):
            return oriented
    return checker.steering.oriented(route)


def _what_is_not_free(route: Floats, checker: CollisionChecker) -> str:
    if not checker.poses_free(route[:1])[0]:
        return "poses[0] is not free for the robot; only a free route can be improved."
    free = checker.motions_free(route[:-1], route[1:])
    index = int(np.flatnonzero(~free)[0])
    return (
        f"the motion from poses[{index}] to poses[{index + 1}] is not free for the robot; only a "
        "free route can be improved."
    )


class _Workbench:
    """The steps of the improvement, with their common data."""

    def __init__(self, service: AmbiguityService, checker: CollisionChecker) -> None:
        self.steering = checker.steering
        self.kind, self.radius = checker.steering.kind, checker.steering.kernel_radius
        values, _, left, low, inverse = service.density.arrays
        self.field = (values, left, low, inverse)
        self.least = float(values.min())
        self.has_headings = values.shape[2] > 1
        self.walls: tuple[Any, ...] = tuple(checker.arrays)
        # A polygon that turns on the spot between motions may pass where no motion can end.
        self.must_turn = checker.must_turn

    def price(self, route: Floats) -> float:
        """Return the cost of a route from a free start; inf if a motion is not free."""
        return float(route_price(self.kind, self.radius, route, math.inf, self.field, self.walls))

    def shortcut(self, route: Floats) -> Floats:
        """Find the cheapest chain of points of the route, then of the remaining vertices."""
        points = self.dense(route, SHORTCUT_SPACING)
        legs = np.diff(travelled(self.kind, self.radius, route))
        reach = SHORTCUT_REACH
        if self.steering.turns or self.must_turn:  # the route's motions must be among those tried
            reach = max(reach, float(legs.max()))
        along = travelled(self.kind, self.radius, points)
        first = np.searchsorted(along, along - reach * (1.0 + 1e-9))
        chain, count = self.chain(points[:, np.newaxis], first, route), len(points)
        while len(chain) < count:
            chain, count = self.thinned(chain), len(chain)
        return chain

    def dense(self, route: Floats, spacing: float) -> Floats:
        """Return points along the route at most `spacing` metres apart, its vertices included."""
        points, leg, _ = self.steering.dense(route, spacing)
        # Where a curve ends is computed; the vertex that it leads to is exact.
        points[np.searchsorted(leg, np.arange(len(route) - 1), side="right") - 1] = route[1:]
        return self.distinct(points)

    def thinned(self, route: Floats) -> Floats:
        """Find the cheapest chain between vertices of the route; drop those without benefit."""
        first = np.arange(len(route)) - SHORTCUT_VERTICES
        return self.chain(route[:, np.newaxis], first, route)

    def descend(self, route: Floats, rounds: int) -> Floats:
        """Move all vertices to the positions of least cost, scale by scale."""
        skip = SKIPPED if self.must_turn else 0
        for spacing, share in SCALES:
            paid = math.inf
            for turn in range(2 * rounds):
                points = stations(route, spacing)
                # All move equally far, so that what stands close can move together, and in turn
                # each as far as suits its motions.
                candidates = beside(points, share * spacing, share if turn % 2 else math.inf, SIDES)
                first = np.arange(len(points)) - 1 - skip
                route, cost = self.priced(candidates, first, route)
                route = self.thinned(route)
                if turn % 2:
                    if not cost < paid * (1.0 - ENOUGH):
                        break
                    paid = cost
        return route

    def steer(self, route: Floats, rounds: int) -> Floats:
        """Improve a curved route as `descend` does, moving positions and headings in turn."""
        for spacing, share in CURVE_SCALES:
            paid = math.inf
            for turn in range(2 * rounds):
                points = self.dense(route, spacing)
                candidates = (
                    headings(points, 2.0 * share, SIDES)
                    if turn % 2
                    else beside(points, share * spacing, math.inf, SIDES)
                )
                first = np.arange(len(points)) - CURVE_SKIPPED - 1
                route, cost = self.priced(candidates, first, route)
                if turn % 2:
                    if not cost < paid * (1.0 - ENOUGH):
                        break
                    paid = cost
        return route

    def rounded(self, route: Floats) -> Floats:
        """Round corners where that is free and costs no more."""
        return np.asarray(
            round_corners(self.kind, self.radius, self.distinct(route), self.field, self.walls)
        )

    def turned(self, route: Floats) -> Floats:
        """Set headings along the travel where that is free and not dearer."""
        for step in HEADING_STEPS if self.has_headings else (0.0,):
            candidates = headings(route, step, SIDES if self.has_headings else 0)
            route = self.chain(candidates, np.arange(len(route)) - 1, route)
        return route

    def chain(self, candidates: Floats, first: Ints, route: Floats) -> Floats:
        """Return the cheapest chain, or the route itself if no chain is free."""
        return self.priced(candidates, first, route)[0]

    def priced(self, candidates: Floats, first: Ints, route: Floats) -> tuple[Floats, float]:
        """Return the result of `chain` and its cost; inf if no chain is free."""
        chain, cost = cheapest_chain(
            self.kind, self.radius, np.ascontiguousarray(candidates),
            np.maximum(first, 0).astype(np.int64), self.least, self.field, self.walls,
        )  # fmt: skip
        return (chain, cost) if math.isfinite(cost) else (route, math.inf)

    def distinct(self, route: Floats) -> Floats:
        """Drop poses equal to the one before; in r2 headings are ignored."""
        axes = 2 if self.kind == FACING else 3
        keep = np.ones(len(route), dtype=np.bool_)
        keep[1:] = (np.diff(route[:, :axes], axis=0) != 0.0).any(axis=1)
        return route[keep]
