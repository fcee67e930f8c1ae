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
WEIGHTS = (2.0, 5.0, 20.0)
LONGEST = 1.1
"""An ambiguity-aware route may be so many times as long as the shortest one."""
LEAST_BAD = 2.0
"""Less bad floor than this on the shortest way, metres, and there is nothing to avoid."""
HALF = 0.5
"""Share of the bad floor that an offered way leaves at most."""
TUNED = {
    "laser_model_type": "likelihood_field_prob", "importance_factor": 0.3, "sigma_hit": 0.1,
}  # fmt: skip
# The likelihood field takes a cone's echo to come from its axis, and walks off from walls that are
# seen aslant; and "no echo", which a sonar often reads, tells it nothing.
CONES = {
    "laser_model_type": "beam", "z_hit": 0.7, "z_max": 0.2, "z_short": 0.05, "z_rand": 0.05,
    "beam_table_resolution": 0.1,
}  # fmt: skip
# The same with the beams multiplied, as the book has it. It came after the claim was driven, and is
# what the study of truth uses.
PRODUCT = {
    **CONES, "laser_model_type": "beam_prob", "importance_factor": 0.3, "sigma_hit": 0.1,
}  # fmt: skip
LOCALIZERS = ("tuned", "amcl", "product")
"""Tuned; as AMCL has it; tuned, with the product for cones."""
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
    parser.add_argument("--localizer", choices=LOCALIZERS, default="tuned")
    parser.add_argument("--open-loop", action="store_true")
    parser.add_argument("--odometry", type=float, nargs="+", default=[0.25, 0.5])
    parser.add_argument("--drawn", type=int, default=60)
    parser.add_argument("--offered", type=int, default=8)
    parser.add_argument("--others", type=int, default=4)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--seed", type=int, default=11)
    args = parser.parse_args()
    environment = load_environment(environment_path(args.environment))
    scanner = RangeScanner.from_preset(args.scanner)
    amap = build_map(environment, scanner)
    numba.set_num_threads(1)
    robot = RoutePlanner(AmbiguityService(amap, weight=5.0), footprint=ROBOT.radius + MARGIN)
    for number, shortest, aware in chosen(robot, args):
        for scale in args.odometry:
            noise = OdometryNoise(scale=scale)
            told: dict[str, Any] = {
                "environment": args.environment,
                "scanner": args.scanner,
                "pair": number,
                "start": shortest.poses[0, :2].tolist(),
                "goal": shortest.poses[-1, :2].tolist(),
                "odometry": scale,
                "localizer": args.localizer,
                "open_loop": args.open_loop,
            }
            for name, route in (("shortest", shortest), ("aware", aware)):
                drives = drive(
                    environment,
                    scanner,
                    ROBOT,
                    route,
                    localizer(args.localizer, scanner, noise),
                    np.random.default_rng([args.seed, number]),
                    args.runs,
                    noise=noise,
                    open_loop=args.open_loop,
                )
                told[name] = figures(route, metrics(drives, amap))
            print(json.dumps(told), flush=True)


def localizer(name: str, scanner: RangeScanner, noise: OdometryNoise) -> MclParameters:
    """Monte Carlo localization that is told how odometry errs; else one of `LOCALIZERS`."""
    told = {key: getattr(noise.modelled, key) for key in ALPHAS if key != "alpha5"}
    if name == "amcl":
        return MclParameters.from_dict(told)
    cones = any(sensor.aperture > 0.0 for sensor in scanner.sensors)
    for_cones = PRODUCT if name == "product" else CONES
    return MclParameters.from_dict({**(for_cones if cones else TUNED), **told})


def chosen(robot: RoutePlanner, args: argparse.Namespace) -> list[tuple[int, Route, Route]]:
    """Pairs to drive, chosen on the map alone: number, shortest route, ambiguity-aware route.

    Those where most bad floor is saved among the offered, and those with most of it among the
    others; where a map has no bad floor at all, the first ones drawn.
    """
    offers, others = [], []
    for number, (start, goal) in enumerate(pairs(robot, args.drawn, args.seed)):
        shortest = robot.plan(start, goal, planner_name="reference", weight=0.0)
        aware = ambiguity_aware(robot, start, goal, shortest)
        bad, left = shortest.bad_metres, aware.bad_metres
        if bad >= LEAST_BAD and left <= HALF * bad:
            offers.append((left - bad, number, shortest, aware))
        else:
            others.append((-bad, number, shortest, aware))
    offers.sort(key=lambda pair: pair[:2])
    others.sort(key=lambda pair: pair[:2])
    return [pair[1:] for pair in offers[: args.offered] + others[: args.others]]


def ambiguity_aware(robot: RoutePlanner, start: Any, goal: Any, shortest: Route) -> Route:
    """The route with the least bad floor of all weights that is at most 10 % longer.

    Of equals the least exposed, then the shortest one.
    """
    routes = [shortest]
    if shortest.bad_metres >= LEAST_BAD:
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
