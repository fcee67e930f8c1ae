"""Certificates of routes: proofs that no route costs less than a bound."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

from ambinav.config import as_number, as_positive, check_kind
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav.service.volume_service import VolumeService
from ambinav_planners.flight_route import FlightRoute
from ambinav_planners.improve.finishing import is_free
from ambinav_planners.planning import RoutePlanner
from ambinav_planners.search.lower_bound import lower_bound
from ambinav_planners.search.lower_bound_in_space import lower_bound_in_space

if TYPE_CHECKING:  # it needs OMPL
    from ambinav_planners.flight import FlightPlanner

GAP = 0.005
MOST_CELLS = 50_000


@dataclass(frozen=True)
class Certificate:
    """Proof of by how much a route may cost more than the cheapest one.

    Attributes:
        cost: Cost of the route, metres-equivalent.
        bound: Lower bound of the cost of all routes from its start to its goal.
        cell: Edge of the finest cells on which the bound was proved, metres; 0: without any.
        seconds: Time that the proof took.
    """

    cost: float
    bound: float
    cell: float
    seconds: float

    @property
    def gap(self) -> float:
        """Share of the cost that a route could save at most."""
        return (self.cost - self.bound) / self.cost if self.cost > 0.0 else 0.0

    @property
    def sentence(self) -> str:
        """The gap in words: how far the cost is above the bound, as a share of the bound."""
        proved = f"certified: no route costs less than {self.bound:.2f}"
        if self.cost > 0.0 >= self.bound:
            return f"{proved}; nothing is proved of how far this one, {self.cost:.2f}, is above it"
        above = max(100.0 * (self.cost / self.bound - 1.0), 0.0) if self.cost > 0.0 else 0.0
        share = f"{above:.0f}" if above >= 10.0 else f"{above:.2g}"
        return f"{proved}, so this one, {self.cost:.2f}, is at most {share} % above the cheapest"


@overload
def certify(
    robot: RoutePlanner, route: Route, *, gap: float = ..., cells: int = ...
) -> Certificate: ...


@overload
def certify(
    robot: FlightPlanner, route: FlightRoute, *, gap: float = ..., cells: int = ...
) -> Certificate: ...


def certify(
    robot: RoutePlanner | FlightPlanner,
    route: Route | FlightRoute,
    *,
    gap: float = GAP,
    cells: int = MOST_CELLS,
) -> Certificate:
    """Prove how far at most a route is from the cheapest one between its ends.

    The bound holds for all paths of the robot in its space, whatever the planner: it is found on
    grids by functions whose slope is nowhere above the cost per metre (docs/planning.md). Limits on
    bad metres and one-way lanes only make routes dearer, so it holds with them too; but then the
    gap contains what they cost. Of a flight, paths stay between the heights of the volume.

    Args:
        robot: The robot, and the cost service that the route was planned with.
        route: The route, from any planner or file; its weight is taken.
        gap: The proof ends where the gap is below this share.
        cells: The proof ends before a grid with more cells than this; more take longer, and bring
            the bound nearer. Of a flight the first grid may have eight times as many.

    Raises:
        InputError: the route's cost is of another layer, or it touches a wall; or a number is out
            of its range.
    """
    check_kind(route, (Route, FlightRoute), "route", "give one that a planner or a file gave")
    service_type = AmbiguityService if isinstance(route, Route) else VolumeService
    if not isinstance(getattr(robot, "service", None), service_type):
        name = "RoutePlanner" if isinstance(route, Route) else "FlightPlanner"
        raise InputError(f"robot is {robot!r}; give the {name} of the route's robot.")
    if not 0.0 < as_number(gap, "gap") < 1.0:
        raise InputError(f"gap is {gap!r}; give a share between 0 and 1, such as {GAP:g}.")
    as_positive(cells, "cells")
    layer = route.layer if isinstance(route, Route) else route.service.layer
    if layer != robot.service.layer:
        raise InputError(
            f"the route's cost is of layer {layer!r} and the robot's of {robot.service.layer!r}; "
            "give the robot that it was planned for."
        )
    started = time.perf_counter()
    if isinstance(route, Route):
        cost, bound, cell = _bounded(robot, route, gap, cells)
    else:
        cost, bound, cell = _bounded_in_space(robot, route, gap, cells)
    return Certificate(cost, bound, cell, time.perf_counter() - started)


def _bounded(robot: Any, route: Route, gap: float, cells: int) -> tuple[float, float, float]:
    """Return cost, bound and the edge of the finest cells."""
    problem = robot.problem(route.start, route.goal, route.weight)
    if route.steering != problem.steering or not is_free(route.poses, problem):
        raise InputError(
            "this robot cannot drive the route: it touches a wall, or moves in another space; give "
            "the robot that it was planned for."
        )
    cost = problem.service.route_cost(route.poses, problem.steering)
    return cost, *(lower_bound(problem, cost, gap, cells) if cost > 0.0 else (0.0, 0.0))


def _bounded_in_space(
    robot: Any, route: FlightRoute, gap: float, cells: int
) -> tuple[float, float, float]:
    service, points = robot.service, route.points
    if service.weight != route.service.weight:
        service = VolumeService(service.volume, service.layer, route.service.weight)
    cost = service.route_cost(points)
    if not robot.checker.motions_free(points[:-1], points[1:]).all():
        raise InputError(
            "this robot cannot fly the route: it touches a surface; give the robot that it was "
            "planned for."
        )
    if cost == 0.0:
        return 0.0, 0.0, 0.0
    ends = tuple(points[0].tolist()), tuple(points[-1].tolist())
    return cost, *lower_bound_in_space(service, robot.checker, *ends, cost, gap, cells)
