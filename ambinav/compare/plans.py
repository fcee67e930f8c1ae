"""The routes of a scenario: planned, or read from files, all measured on the scenario's map."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ambinav.compare.scenario import PairPart, RoutePart
from ambinav.compare.scenario_file import Loaded
from ambinav.errors import InputError
from ambinav.geometry.collision import CollisionChecker
from ambinav.geometry.footprint import Footprint
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.files import load_route
from ambinav.routes.route import Route
from ambinav.service.service import AmbiguityService

SAME_PLACE = 0.05
"""A saved route may begin and end so far from its pair's start and goal, metres."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A route of a pair.

    Attributes:
        pair: Name of the pair.
        name: Of the route.
        route: The route.
    """

    pair: str
    name: str
    route: Route


def make_plans(
    loaded: Loaded, amap: AmbiguityMap, progress: Callable[[float], None] | None = None
) -> tuple[Plan, ...]:
    """All routes, pair by pair.

    Args:
        loaded: The scenario.
        amap: The map of its building for its scanner.
        progress: Called with the share done.

    Raises:
        InputError: OMPL is missing, a planner refuses or finds nothing, or a file's route does
            not fit.
    """
    wanted = [
        (pair, part)
        for pair in loaded.scenario.pairs
        for part in loaded.scenario.routes
        if part.pair in (None, pair.name)
    ]
    plans = []
    for done, (pair, part) in enumerate(wanted):
        try:
            if part.kind == "file":
                route = _saved(loaded, amap, pair, part)
            else:
                route = _planned(loaded, amap, pair, part)
        except InputError as error:
            raise InputError(f"pair {pair.name!r}, route {part.name!r}: {error}") from error
        plans.append(Plan(pair.name, part.name, route))
        if progress is not None:
            progress((done + 1) / len(wanted))
    return tuple(plans)


def _planned(loaded: Loaded, amap: AmbiguityMap, pair: PairPart, part: RoutePart) -> Route:
    """Plan a route; without a limit of time, so that it is the same every time."""
    from importlib.util import find_spec

    if find_spec("ompl") is None:
        raise InputError('planning needs OMPL; run: pip install "ambinav[planners]"')
    from ambinav_planners import RoutePlanner

    common = loaded.scenario.planning
    kind = part.kind
    service = AmbiguityService(
        amap,
        loaded.scenario.map.layer,
        0.0 if kind in ("shortest", "clearance") else part.weight,
        clearance_weight=part.clearance_weight if kind == "clearance" else 0.0,
        comfort=part.comfort,
    )
    chosen = part.planner or common.planner
    if kind in ("belief", "belief-roadmap", "reference"):
        chosen = str(kind)
    elif kind == "shortest" and part.planner is None:
        chosen = "reference"
    robot = RoutePlanner(service, footprint=loaded.scenario.robot.radius + common.margin)
    return robot.plan(
        pair.start,
        pair.goal,
        planner_name=chosen,
        seconds=math.inf,
        iterations=part.iterations or common.iterations,
        seed=part.seed or common.seed,
    )


def _saved(loaded: Loaded, amap: AmbiguityMap, pair: PairPart, part: RoutePart) -> Route:
    """Read a route, and check that the robot can drive it from the pair's start to its goal."""
    assert part.file is not None  # the scenario has checked it
    path = Path(loaded.folder) / part.file
    saved = load_route(path)
    service = AmbiguityService(amap, loaded.scenario.map.layer, saved.weight)
    try:
        route = evaluate_route(
            service,
            saved.poses,
            saved.steering,
            planner=saved.planner,
            seed=saved.seed,
            covariances=saved.covariances,
        )
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    for what, wanted, at in (("starts", pair.start, 0), ("ends", pair.goal, -1)):
        x, y = route.poses[at, :2].tolist()
        if math.hypot(x - wanted[0], y - wanted[1]) > SAME_PLACE:
            raise InputError(
                f"{path}: it {what} at ({x:g}, {y:g}) m and the pair at ({wanted[0]:g}, "
                f"{wanted[1]:g}); give a route of this pair."
            )
    checker = CollisionChecker(
        loaded.environment, Footprint.disc(loaded.scenario.robot.radius), route.steering
    )
    free = checker.poses_free(route.poses)
    free[1:] &= checker.motions_free(route.poses[:-1], route.poses[1:])
    if not free.all():
        bad = int(np.argmin(free))
        x, y, theta = route.poses[bad].tolist()
        why = checker.why_not(x, y, theta) or "reached through a wall"
        raise InputError(
            f"{path}: pose {bad} of the route, ({x:g}, {y:g}) m, is {why}; give a route that "
            f"leaves room for a robot of {loaded.scenario.robot.radius:g} m."
        )
    return route
