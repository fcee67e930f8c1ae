"""Pairs of places in one building of `study_promise.py`: candidates, promise, and fresh drives.

Appends a line of JSON for each pair to FOLDER/BUILDING.jsonl; pairs that are there are left alone.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

import numba
import numpy as np
from harness import kept_or_made
from localizers import ROBOT
from lost_case import ODOMETRIES as STUDIED
from lost_case import START_STD, building, rng_of, routes_of
from truth_case import aged, scanner_of

from ambinav.drive import odometries
from ambinav.drive.drive import drive_route
from ambinav.drive.metrics import metrics
from ambinav.forecasting.ensemble import EnsembleRunner
from ambinav.forecasting.forecast import Forecaster
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.routes.route import Route
from ambinav.routes.sampled import path_length
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav_planners import RoutePlanner, pareto
from ambinav_planners.promise import WEIGHTS, PromiseError, route_within

SCANNERS = ("laser-4m", "laser-8m", "sonar-ring")
ODOMETRIES = {
    **{name: odometries.ODOMETRIES[name] for name in ("poor", "amcl-default")},
    "skid": STUDIED["skid"],
}
PAIRS = 3
"""Pairs of a start and a goal in a building: the longest of the sampled routes."""
DRIVEN = (0.0, 1.0, 5.0, 20.0, 80.0)
"""Weights whose routes are driven."""
MAX_LOST = 0.05
ROUTES = ("promised", "shortest")
"""Kinds of routes that are driven in closed loop."""
RUNS, CLOSED = 32, 16
"""Drives of a route, twice, so that one half may choose pairs; and those in closed loop."""


def main() -> None:
    """Do what is missing of a building."""
    parser = argparse.ArgumentParser()
    parser.add_argument("building")
    parser.add_argument("--folder", type=Path, default=Path("out/promise"))
    parser.add_argument("--pairs", type=int, default=PAIRS)
    args = parser.parse_args()
    numba.set_num_threads(1)
    args.folder.mkdir(parents=True, exist_ok=True)
    path = args.folder / f"{args.building}.jsonl"
    mapped = building(args.building)
    world = aged(mapped, rng_of(args.building, "aged"))
    routes = sorted(routes_of(mapped, args.building), key=path_length, reverse=True)
    for k, shortest in enumerate(routes[: args.pairs]):
        key = {"building": args.building, "pair": k}
        kept_or_made(
            path, key, lambda k=k, route=shortest: pair_of(mapped, world, route, args.building, k)
        )


def pair_of(
    mapped: Environment, world: Environment, shortest: Route, name: str, k: int
) -> dict[str, Any]:
    """Return what is known of a pair of places, as plain data."""
    number = int(name.rpartition("-")[2])
    scanner = scanner_of(SCANNERS[(number + k) % len(SCANNERS)])
    odometry = list(ODOMETRIES)[(number // len(SCANNERS) + k) % len(ODOMETRIES)]
    amap = build_map(mapped, scanner, spacing=0.1, store=False)
    forecaster = Forecaster(amap, ODOMETRIES[odometry], start_std=START_STD)
    runner = forecaster.runner(ROBOT)
    planner = RoutePlanner(amap, footprint=ROBOT.radius)
    ends = shortest.poses[0, :2].tolist(), shortest.poses[-1, :2].tolist()
    front = [point.route for point in pareto(planner, *ends, weights=WEIGHTS).points]
    forecasts = forecaster.lost_probabilities(front).tolist()
    candidates: list[dict[str, Any]] = []
    for weight, route, forecast in zip(WEIGHTS, front, forecasts, strict=True):
        lost = None
        if weight in DRIVEN:
            lost = halves(runner, route, rng_of(name, k, len(candidates)))
        candidates.append(
            {
                "weight": weight, "length": route.length, "forecast": forecast,
                "exposure": route.exposure, "lost": lost,
            }
        )  # fmt: skip
    is_kept, began = True, time.perf_counter()
    try:
        promise = route_within(
            planner, *ends, forecaster, MAX_LOST, runner=runner, rng=rng_of(name, k, "drives")
        )
    except PromiseError as error:
        is_kept, promise = False, error.best
    assert promise.driven is not None
    seconds = time.perf_counter() - began
    return {
        "scanner": scanner.name,
        "odometry": odometry,
        "area": mapped.free.area,
        "candidates": candidates,
        "kept": is_kept,
        "seconds": seconds,
        "length": promise.route.length,
        "weight": promise.route.weight,
        "found_by": promise.route.planner,
        "forecast": promise.forecast.lost_probability,
        "drives": len(promise.driven),
        "side": promise.driven.side,
        "fresh_lost": halves(runner, promise.route, rng_of(name, k, "fresh")),
        **{
            f"{which}_{where}": in_closed_loop(
                mapped, drive_map, route, scanner, forecaster, (name, k, which)
            )
            for which, route in zip(ROUTES, (promise.route, front[0]), strict=True)
            for where, drive_map in (("map", mapped), ("aged", world))
        },
    }


def halves(runner: EnsembleRunner, route: Route, rng: np.random.Generator) -> list[int]:
    """Return how many of `RUNS` robots get lost, twice."""
    return [int(runner.drive(route, rng, RUNS).lost.sum()) for _ in range(2)]


def in_closed_loop(
    mapped: Environment,
    world: Environment,
    route: Route,
    scanner: RangeScanner,
    forecaster: Forecaster,
    words: tuple[str | int, ...],
) -> int | None:
    """Return how many of `CLOSED` robots get lost; None where the start is not free."""
    localizer = forecaster.localizer.chosen(scanner, forecaster.odometry, ROBOT)
    try:
        drives = drive_route(
            mapped, scanner, ROBOT, route, localizer, rng_of(*words), CLOSED, world=world,
            noise=forecaster.odometry, start_std=START_STD, max_time=400.0,
        )  # fmt: skip
    except InputError:
        return None
    return int(np.isfinite(metrics(drives).lost_after).sum())


if __name__ == "__main__":
    main()
