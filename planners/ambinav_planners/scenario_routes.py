"""Routes of a comparison, planned for scenarios that ask for it."""

from __future__ import annotations

import math
from typing import Final

from ambinav.drive.noise import OdometryNoise
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.motion.steering import Steering
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners import RoutePlanner
from ambinav_planners.belief.model import BeliefModel
from ambinav_planners.planning import AUTO, planner_name_or_default
from ambinav_planners.problem import check_pose
from ambinav_planners.registry import planner

ITERATIONS: Final = 1000
"""Iterations of planners that sample, where a scenario gives none."""

Place = tuple[float, ...]


def check_planner(name: str) -> None:
    """Check the name of a planner, or `AUTO`.

    Raises:
        InputError: it is unknown.
    """
    if name != AUTO:
        planner(name)


def check_route(
    planner_name: str, start: Place, goal: Place, checker: CollisionChecker, iterations: int | None
) -> None:
    """Check a route's settings before it is planned.

    Args:
        planner_name: Name of the planner, or `AUTO`.
        start: x, y and perhaps heading, metres and radians.
        goal: The same.
        checker: Collision checker of the robot with its margin, in the space that it moves in.
        iterations: Number of iterations of the planner, if one is given.

    Raises:
        InputError: the planner is unknown or does not plan in the space, or an end is not free.
    """
    name = planner_name_or_default(planner_name, checker, iterations)
    chosen, space = planner(name), checker.steering.space
    if space not in chosen.spaces:
        raise InputError(
            f"planner {chosen.name!r} does not plan in {space}; it knows "
            f"{', '.join(chosen.spaces)}."
        )
    check_pose("start", start, checker)
    check_pose("goal", goal, checker)


def plan_route(
    service: AmbiguityService,
    start: Place,
    goal: Place,
    *,
    planner_name: str,
    footprint: float,
    steering: Steering,
    start_std: tuple[float, float, float],
    odometry: OdometryNoise,
    iterations: int | None,
    seed: int,
) -> Route:
    """Plan a route without a time limit, so that the result is deterministic.

    Args:
        service: The costs.
        start: x, y and perhaps heading, metres and radians.
        goal: The same.
        planner_name: Name of the planner, or `AUTO`.
        footprint: Radius that is kept free, metres.
        steering: Kind of motion.
        start_std: Deviations of x, y and heading at the start, for belief planners.
        odometry: Noise of the odometry, for them too.
        iterations: Number of iterations of the planner; None: `ITERATIONS`, if it samples.
        seed: Seed of the planner.

    Raises:
        InputError: no path is found, or the planner refuses an argument.
    """
    robot = RoutePlanner(
        service,
        footprint=footprint,
        space=steering.space,
        turning_radius=steering.radius,
        belief=BeliefModel(start_std=start_std),
        odometry=odometry,
    )
    return robot.plan(
        start,
        goal,
        planner_name=planner_name_or_default(planner_name, robot.checker, iterations),
        seconds=math.inf,
        iterations=iterations or ITERATIONS,
        seed=seed,
    )
