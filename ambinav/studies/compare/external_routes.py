"""External routes: read from files, or made by policies."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Protocol

import numpy as np

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plugins import called, load_callable
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.files import load_route
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.service.service import AmbiguityService
from ambinav.studies.compare.route_part import RoutePart
from ambinav.studies.compare.scenario_file import ScenarioBundle
from ambinav.studies.compare.scenario_schema import PairPart

SAME_PLACE = 0.05
"""A given route may begin and end so far from its pair's start and goal, metres."""


class RouteMaker(Protocol):
    """A callable that makes a route for a pair."""

    def __call__(
        self, environment: Environment, scanner: RangeScanner, amap: AmbiguityMap, pair: PairPart
    ) -> Route:
        """Return a route from `pair.start` to `pair.goal`: x, y, perhaps heading, in m and rad."""


def saved_route(loaded: ScenarioBundle, pair: PairPart, part: RoutePart) -> Route:
    """Read a route, and check that the robot can drive it from the pair's start to its goal.

    Raises:
        InputError: it cannot be read, does not fit the pair, or the robot does not fit on it.
    """
    assert part.file is not None  # the scenario has checked it
    path = Path(loaded.folder) / part.file
    route = load_route(path)
    check_drivable(loaded, pair, route, str(path))
    return route


def policy_route(
    loaded: ScenarioBundle, amap: AmbiguityMap, pair: PairPart, part: RoutePart
) -> Route:
    """Request a route from a policy and check it like a route from a file.

    Raises:
        InputError: the policy fails, or makes something else than a route that can be driven.
    """
    assert part.policy is not None  # the scenario has checked it
    maker: RouteMaker = load_callable(part.policy, loaded.folder)
    where = f"policy {part.policy}"
    route = called(maker, part.policy, loaded.environment, loaded.scanner, amap, pair)
    if not isinstance(route, Route):
        raise InputError(
            f"{where}: it returned a {type(route).__name__}; return an "
            "ambinav.routes.route.Route, such as evaluate_route makes."
        )
    check_drivable(loaded, pair, route, where)
    return route


def measured(loaded: ScenarioBundle, amap: AmbiguityMap, route: Route, where: str) -> Route:
    """Measure a given route on the scenario's map.

    Raises:
        InputError: a pose lies outside of the map.
    """
    service = AmbiguityService(amap, loaded.scenario.map.layer, route.weight)
    try:
        return evaluate_route(
            service,
            route.poses,
            route.steering,
            planner=route.planner,
            seed=route.seed,
            covariances=route.covariances,
        )
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def check_drivable(loaded: ScenarioBundle, pair: PairPart, route: Route, where: str) -> None:
    """Check that a robot can drive a route from a pair's start to its goal.

    Raises:
        InputError: it cannot; `where` names the route.
    """
    xmin, ymin, xmax, ymax = loaded.environment.bounds
    x, y = route.poses[:, 0], route.poses[:, 1]
    outside = (x < xmin) | (x > xmax) | (y < ymin) | (y > ymax)
    if outside.any():
        bad = int(np.argmax(outside))
        raise InputError(
            f"{where}: pose {bad} of the route, ({x[bad]:g}, {y[bad]:g}) m, is outside of the map; "
            "give a route in the map's frame."
        )
    for verb, end, index in (("starts", pair.start, 0), ("ends", pair.goal, -1)):
        if math.hypot(x[index] - end[0], y[index] - end[1]) > SAME_PLACE:
            raise InputError(
                f"{where}: it {verb} at ({x[index]:g}, {y[index]:g}) m and the pair at "
                f"({end[0]:g}, {end[1]:g}); give a route of this pair."
            )
    radius = loaded.scenario.robot.radius
    checker = CollisionChecker(loaded.environment, Footprint.disc(radius), route.steering)
    free = checker.poses_free(route.poses)
    free[1:] &= checker.motions_free(route.poses[:-1], route.poses[1:])
    if not free.all():
        bad = int(np.argmin(free))
        x0, y0, theta = route.poses[bad].tolist()
        why = checker.why_not(x0, y0, theta) or "reached through a wall"
        raise InputError(
            f"{where}: pose {bad} of the route, ({x0:g}, {y0:g}) m, is {why}; give a route that "
            f"leaves room for a robot of {radius:g} m."
        )
