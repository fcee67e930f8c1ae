"""One environment of `bench_plan.py`: pairs of places, planners, times; rows of JSON.

It runs in a process of its own, on one thread, so that two environments run at a time on two cores.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from typing import Any

import numpy as np
from harness import environment_path

from ambinav.ambiguity.build import build_map
from ambinav.errors import InputError
from ambinav.geometry.environment import load_environment
from ambinav.routes.route import Route
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav.service.service import AmbiguityService
from ambinav_planners import RoutePlanner, pareto
from ambinav_planners.lattice_graph import lattice_of

RADIUS = 0.2
WEIGHT = 5.0
LEAST_APART = 8.0
"""Metres between start and goal, as the crow flies."""
FRONT = (0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 40.0)


def main() -> None:
    """Plan and print one line of JSON for each route."""
    parser = argparse.ArgumentParser()
    parser.add_argument("environment")
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--seconds", type=float, nargs="*", default=[1.0, 5.0])
    parser.add_argument("--planners", nargs="+", required=True)
    parser.add_argument("--front", action="store_true", help="the trade for each pair as well")
    args = parser.parse_args()
    robot = RoutePlanner(service(args.environment), footprint=RADIUS)
    for number, (start, goal) in enumerate(pairs(robot, args.pairs, args.seed)):
        told = {"environment": args.environment, "pair": number}
        best = robot.plan(start, goal, planner_name="reference")
        tell(told, best, planner="reference", budget=0.0)
        zero = robot.plan(start, goal, planner_name="reference", weight=0.0)
        tell(told, zero, planner="shortest", budget=0.0)
        if args.front:
            for point in pareto(robot, start, goal, weights=FRONT).points:
                tell(told, point.route, planner="front", budget=0.0)
        for seconds in args.seconds:
            for name in args.planners:
                try:
                    route = robot.plan(start, goal, planner_name=name, seconds=seconds)
                except InputError:
                    print(json.dumps(told | {"planner": name, "budget": seconds, "cost": None}))
                    continue
                tell(told, route, planner=name, budget=seconds)


def service(name: str) -> AmbiguityService:
    """The cost of the environment for 60 beams of 4 m, every 0.1 m."""
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    scanner = RangeScanner.planar(sensor=sensor, beams=60, aperture=2.0 * math.pi)
    amap = build_map(load_environment(environment_path(name)), scanner)
    return AmbiguityService(amap, weight=WEIGHT)


def pairs(robot: RoutePlanner, count: int, seed: int) -> list[tuple[Any, Any]]:
    """Starts and goals: cells of the largest connected part, explored, and some way apart."""
    lattice = lattice_of(robot.service, robot.checker)
    parts = lattice.graph.components()
    largest = np.bincount(parts).argmax()
    rows, columns = np.nonzero((lattice.cell >= 0) & ~robot.service.map.unexplored)
    nodes = lattice.cell[rows, columns]
    places = lattice.graph.poses[nodes[parts[nodes] == largest]]
    rng = np.random.default_rng(seed)
    chosen: list[tuple[Any, Any]] = []
    while len(chosen) < count:
        start, goal = places[rng.integers(len(places), size=2)]
        if np.hypot(*(goal - start)[:2]) >= LEAST_APART:
            chosen.append((start, goal))
    return chosen


def tell(told: dict[str, Any], route: Route, *, planner: str, budget: float) -> None:
    """Print a route's figures."""
    figures = {
        "planner": planner,
        "budget": budget,
        "weight": route.weight,
        "cost": route.cost,
        "length": route.length,
        "exposure": route.exposure,
        "bad": route.bad_metres,
        "seconds": route.seconds,
        "first": route.first_seconds,
        "iterations": route.iterations,
    }
    print(json.dumps(told | figures))
    sys.stdout.flush()


if __name__ == "__main__":
    main()
