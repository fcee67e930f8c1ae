"""One environment and scanner of `bench_claim.py`: pairs, routes, drives; one line of JSON a pair.

It runs in a process of its own, on one thread, so that two of them run at a time on two cores.
"""

from __future__ import annotations

import argparse
import json
from typing import Any

import numba
import numpy as np
from harness import environment_path
from plan_case import pairs

from ambinav.ambiguity.build import build_map
from ambinav.drive.drive import drive
from ambinav.drive.metrics import Metrics, metrics
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.robot import Robot
from ambinav.geometry.environment import load_environment
from ambinav.localization.parameters import ALPHAS, MclParameters
from ambinav.routes.route import Route
from ambinav.sensing.scanner import RangeScanner
from ambinav.service.service import AmbiguityService
from ambinav_planners import RoutePlanner

ROBOT = Robot(radius=0.105)
"""A TurtleBot3 Burger."""
MARGIN = 0.195
WEIGHTS = (1.0, 2.0, 5.0, 10.0, 20.0)
LONGEST = 1.1
"""An ambiguity-aware route may be so many times as long as the shortest one."""
NOISE = OdometryNoise()
TOLD = {name: getattr(NOISE, name) * NOISE.scale**2 for name in ALPHAS if name != "alpha5"}
TUNED = MclParameters(
    laser_model_type="likelihood_field_prob", importance_factor=0.3, sigma_hit=0.1, **TOLD
)
# The likelihood field takes a cone's echo to come from its axis, and walks off from walls that are
# seen aslant; and "no echo", which a sonar often reads, tells it nothing.
CONES = MclParameters(
    laser_model_type="beam",
    z_hit=0.7,
    z_max=0.2,
    z_short=0.05,
    z_rand=0.05,
    beam_table_resolution=0.1,
    **TOLD,
)
AMCL = MclParameters(**TOLD)
KEPT = (
    "arrived",
    "collided",
    "lost",
    "position_rmse",
    "position_p95",
    "position_max",
    "heading_p95",
)


def main() -> None:
    """Plan, drive, and print one line of JSON for each pair."""
    parser = argparse.ArgumentParser()
    parser.add_argument("environment")
    parser.add_argument("scanner")
    parser.add_argument("--localizer", choices=("tuned", "amcl"), default="tuned")
    parser.add_argument("--open-loop", action="store_true")
    parser.add_argument("--drawn", type=int, default=40)
    parser.add_argument("--kept", type=int, default=12)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--seed", type=int, default=11)
    args = parser.parse_args()
    environment = load_environment(environment_path(args.environment))
    scanner = RangeScanner.from_preset(args.scanner)
    amap = build_map(environment, scanner)
    numba.set_num_threads(1)
    localizer = AMCL
    if args.localizer == "tuned":
        localizer = CONES if any(sensor.aperture > 0.0 for sensor in scanner.sensors) else TUNED
    robot = RoutePlanner(AmbiguityService(amap, weight=5.0), footprint=ROBOT.radius + MARGIN)
    drawn = []
    for start, goal in pairs(robot, args.drawn, args.seed):
        route = robot.plan(start, goal, planner_name="reference", weight=0.0)
        drawn.append((route.bad_metres, len(drawn), start, goal, route))
    drawn.sort(key=lambda pair: (-pair[0], pair[1]))
    for _, number, start, goal, shortest in drawn[: args.kept]:
        aware = chosen(robot, start, goal, shortest)
        told: dict[str, Any] = {
            "environment": args.environment,
            "scanner": args.scanner,
            "pair": number,
            "start": start[:2].tolist(),
            "goal": goal[:2].tolist(),
            "localizer": args.localizer,
            "open_loop": args.open_loop,
        }
        for name, route in (("shortest", shortest), ("aware", aware)):
            drives = drive(
                environment,
                scanner,
                ROBOT,
                route,
                localizer,
                np.random.default_rng([args.seed, number]),
                args.runs,
                noise=NOISE,
                open_loop=args.open_loop,
            )
            told[name] = figures(route, metrics(drives, amap))
        print(json.dumps(told), flush=True)


def chosen(robot: RoutePlanner, start: Any, goal: Any, shortest: Route) -> Route:
    """The route with the least bad floor of all weights that is at most 10 % longer.

    The choice is made on the map alone; of equals the least exposed, then the shortest one.
    """
    routes = [shortest]
    for weight in WEIGHTS:
        route = robot.plan(start, goal, planner_name="reference", weight=weight)
        if route.length <= LONGEST * shortest.length:
            routes.append(route)
    return min(routes, key=lambda r: (round(r.bad_metres, 1), r.exposure, r.length))


def figures(route: Route, measured: Metrics) -> dict[str, Any]:
    """What is kept of a route and its drives."""
    return {
        "weight": route.weight,
        "length": route.length,
        "exposure": route.exposure,
        "bad": route.bad_metres,
        "longest_bad": route.longest_bad,
        **{name: np.round(getattr(measured, name).astype(float), 4).tolist() for name in KEPT},
    }


if __name__ == "__main__":
    main()
