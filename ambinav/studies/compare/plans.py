"""The routes of a scenario: planned or given, all measured on the scenario's map."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Final

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.footprint import Footprint
from ambinav.layers.registry import check_known
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plugins import load_module
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.progress import Progress, silent
from ambinav.service.service import AmbiguityService
from ambinav.studies.compare.controllers import Driver, driven_route, driver_of, is_controller
from ambinav.studies.compare.external_routes import measured, policy_route, saved_route
from ambinav.studies.compare.route_part import GIVEN, RoutePart
from ambinav.studies.compare.scenario_file import ScenarioBundle
from ambinav.studies.compare.scenario_schema import PairPart

CHEAPEST: Final = ("shortest", "clearance", "ambiguity")
"""Kinds of routes that are planned for the least cost alone, by whatever planner."""
DEARER: Final = 0.02
"""They are named if they cost more than another of their pair by more than this share."""


@dataclass(frozen=True, eq=False)
class Plan:
    """A route of a pair.

    Attributes:
        pair: Name of the pair.
        name: Name of the route.
        route: The route; that of a policy which drives is the path that it takes where it knows
            its place.
        driver: The policy that drives; None: the route is followed.
    """

    pair: str
    name: str
    route: Route
    driver: Driver | None = None


def check_plans(loaded: ScenarioBundle) -> None:
    """Check the routes of a scenario as far as possible without a map, which takes long to build.

    Raises:
        InputError: a layer is unknown, a planner is unknown, needs OMPL where that is missing or
            does not plan in the space, a start or goal is not free, or a file's route or a policy
            is of no use.
    """
    for name in loaded.scenario.modules:
        try:
            load_module(name, loaded.folder)
        except InputError as error:
            raise InputError(f"modules: {error}.") from error
    layer = loaded.scenario.map.layer
    if layer is not None:
        try:
            check_known(layer)
        except InputError as error:
            raise InputError(f"map: {error}") from error
    checker = None
    if any(part.kind not in GIVEN for part in loaded.scenario.routes):
        robot, planning = loaded.scenario.robot, loaded.scenario.planning
        footprint = Footprint.disc(robot.radius + planning.margin)
        checker = CollisionChecker(loaded.environment, footprint, planning.steering)
        try:
            _import_planners().check_planner(planning.planner)
        except InputError as error:
            raise InputError(f"planning: {error}") from error
    for pair, part in _requested_routes(loaded):
        with _naming_route(pair, part):
            if part.kind == "file":
                saved_route(loaded, pair, part)
            elif part.kind == "policy":
                if is_controller(str(part.policy), loaded.folder, loaded.trust):
                    driver_of(loaded, pair, part)
            elif checker is not None:
                _check_planned(loaded, pair, part, checker)


def make_plans(
    loaded: ScenarioBundle, amap: AmbiguityMap, progress: Progress = silent
) -> tuple[Plan, ...]:
    """Return all routes, pair by pair.

    Args:
        loaded: The scenario.
        amap: The map of its building for its scanner.
        progress: Called with the share done.

    Raises:
        InputError: see `check_plans`; or a planner finds nothing, or a policy makes no route
            or does not get to the goal.
    """
    requests = _requested_routes(loaded)
    plans = []
    for done, (pair, part) in enumerate(requests):
        with _naming_route(pair, part):
            plans.append(_plan(loaded, amap, pair, part))
        progress((done + 1) / len(requests))
    for pair in loaded.scenario.pairs:
        _note_dearer(loaded, amap, pair, [plan for plan in plans if plan.pair == pair.name])
    return tuple(plans)


def _note_dearer(
    loaded: ScenarioBundle, amap: AmbiguityMap, pair: PairPart, plans: list[Plan]
) -> None:
    """Warn of planned routes that cost more, by their own cost, than another of the pair."""
    steering = loaded.scenario.planning.steering
    parts = {part.name: part for part in loaded.scenario.routes if part.kind not in GIVEN}
    planned = {plan.name: plan.route for plan in plans if plan.name in parts}
    remedy = ", or the planner reference" if steering.space == "r2" else ""
    for name in planned:
        if parts[name].kind not in CHEAPEST:
            continue
        service = _service(loaded, amap, parts[name])
        costs = {
            other: service.route_cost(route.poses, steering) for other, route in planned.items()
        }
        best = min(costs, key=lambda other: costs[other])
        if costs[name] > (1.0 + DEARER) * costs[best]:
            warnings.warn(
                f"pair {pair.name!r}, route {name!r}: it costs {costs[name]:.1f}, and the route "
                f"{best!r} only {costs[best]:.1f} by the same cost: {planned[name].planner} found "
                f"no better one; give it more iterations{remedy}.",
                InputWarning,
                stacklevel=3,
            )


def _requested_routes(loaded: ScenarioBundle) -> list[tuple[PairPart, RoutePart]]:
    return [
        (pair, part)
        for pair in loaded.scenario.pairs
        for part in loaded.scenario.routes
        if part.pair in (None, pair.name)
    ]


@contextlib.contextmanager
def _naming_route(pair: PairPart, part: RoutePart) -> Iterator[None]:
    """Add the name of the route to error messages."""
    try:
        yield
    except InputError as error:
        reason = str(error).rstrip(".")
        raise InputError(f"pair {pair.name!r}, route {part.name!r}: {reason}.") from error


def _plan(loaded: ScenarioBundle, amap: AmbiguityMap, pair: PairPart, part: RoutePart) -> Plan:
    driver = None
    if part.kind == "file":
        route = measured(loaded, amap, saved_route(loaded, pair, part), str(part.file))
    elif part.kind == "policy" and is_controller(str(part.policy), loaded.folder, loaded.trust):
        driver = driver_of(loaded, pair, part)
        route = driven_route(loaded, amap, driver)
    elif part.kind == "policy":
        route = policy_route(loaded, amap, pair, part)
        route = measured(loaded, amap, route, f"policy {part.policy}")
    else:
        route = _planned(loaded, amap, pair, part)
    scenario = loaded.scenario
    limits = scenario.robot.speed_limits(scenario.follower.desired_linear_vel)
    return Plan(pair.name, part.name, route.timed(limits), driver)


def _planner(loaded: ScenarioBundle, part: RoutePart) -> str:
    """Return the name of a route's planner, which may be "auto"."""
    common = loaded.scenario.planning
    if part.kind in ("belief", "belief-roadmap", "reference"):
        return str(part.kind)
    if part.kind == "shortest" and part.planner is None and common.space == "r2":
        return "reference"
    return part.planner or common.planner


def _iterations(loaded: ScenarioBundle, part: RoutePart) -> int | None:
    return part.iterations or loaded.scenario.planning.iterations


def _check_planned(
    loaded: ScenarioBundle, pair: PairPart, part: RoutePart, checker: CollisionChecker
) -> None:
    _import_planners().check_route(
        _planner(loaded, part), pair.start, pair.goal, checker, _iterations(loaded, part)
    )


def _planned(loaded: ScenarioBundle, amap: AmbiguityMap, pair: PairPart, part: RoutePart) -> Route:
    """Plan a route without a time limit, so that the result is reproducible."""
    common = loaded.scenario.planning
    route: Route = _import_planners().plan_route(
        _service(loaded, amap, part),
        pair.start,
        pair.goal,
        planner_name=_planner(loaded, part),
        footprint=loaded.scenario.robot.radius + common.margin,
        steering=common.steering,
        start_std=loaded.scenario.drive.start_deviations,
        odometry=loaded.scenario.odometry,
        iterations=_iterations(loaded, part),
        seed=common.seed if part.seed is None else part.seed,
    )
    return route


def _service(loaded: ScenarioBundle, amap: AmbiguityMap, part: RoutePart) -> AmbiguityService:
    """Return the service of the cost that a route is planned for."""
    return AmbiguityService(
        amap,
        loaded.scenario.map.layer,
        0.0 if part.kind in ("shortest", "clearance") else part.weight,
        clearance_weight=part.clearance_weight if part.kind == "clearance" else 0.0,
        comfort=part.comfort,
    )


def _import_planners() -> ModuleType:
    """Import the planners' module for scenario routes by its name."""
    return load_module("ambinav_planners.scenario_routes", Path())
