"""One environment and scanner of `bench_claim.py`: pairs, routes, drives.

Routes are planned once, a line of JSON a pair of places, and drives appended to a file for each
localizer, a line for each pair and odometry. What is there is not done again, so it can be stopped
at any time and goes on where it was. A route's poses are kept too, so that it can be measured
anew without planning.

It runs in a process of its own, on one thread, so that two of them run at a time on two cores.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numba
import numpy as np
from harness import appended, environment_of, kept_rows
from localizers import LOCALIZERS, ROBOT, localizer_of
from numpy.typing import ArrayLike
from plan_case import figures as plan_figures
from plan_case import pairs

from ambinav.drive.drive import drive_route
from ambinav.drive.metrics import metrics
from ambinav.drive.noise import OdometryNoise
from ambinav.geometry.environment import Environment
from ambinav.geometry.motion.steering import Steering
from ambinav.map_building.build import build_map
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.route import Route
from ambinav.sensing.scanner import RangeScanner
from ambinav.service.service import AmbiguityService
from ambinav_planners import RoutePlanner

MARGIN = 0.195
WEIGHTS = (2.0, 5.0, 20.0)
LONGEST = 1.1
"""An ambiguity-aware route may be so many times as long as the shortest one."""
LEAST_BAD = 2.0
"""Less bad floor than this on the shortest path, metres, and there is nothing to avoid."""
HALF = 0.5
"""Share of the bad floor that an offered route leaves at most."""
ROUTES = ("shortest", "aware")
KEPT = (
    "arrived",
    "collided",
    "lost",
    "position_rmse",
    "position_p95",
    "position_max",
    "heading_p95",
)
Row = dict[str, Any]
RowWriter = Callable[[Row], None]


def main() -> None:
    """Plan the missing routes, run the missing drives."""
    parser = argparse.ArgumentParser()
    parser.add_argument("environment")
    parser.add_argument("scanner")
    parser.add_argument("--localizer", choices=LOCALIZERS, default="product")
    parser.add_argument("--open-loop", action="store_true")
    parser.add_argument("--odometry", type=float, nargs="+", default=[0.5, 0.25])
    parser.add_argument("--drawn", type=int, default=60)
    parser.add_argument("--offered", type=int, default=8)
    parser.add_argument("--others", type=int, default=4)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--folder", type=Path, default=Path("out/claim"))
    parser.add_argument("--routes-only", action="store_true", help="plan, and drive nothing")
    args = parser.parse_args()
    numba.set_num_threads(1)
    environment = environment_of(args.environment)
    scanner = RangeScanner.from_preset(args.scanner)
    planned = routes_path(args.folder, args.environment, args.scanner, args)
    if len(kept_rows(planned)) < args.drawn:
        with appended(planned) as append:
            plan(args, environment, scanner, len(kept_rows(planned)), append)
    if args.routes_only:
        return
    path = drives_path(args.folder, args.environment, args.scanner, args)
    with appended(path) as append:
        drive_all(args, environment, scanner, kept_rows(planned), kept_rows(path), append)


def routes_path(folder: Path, environment: str, scanner: str, args: argparse.Namespace) -> Path:
    """Return the file of a case's routes."""
    return folder / f"{environment}_{scanner}_{args.drawn}-pairs_seed-{args.seed}_routes.jsonl"


def drives_path(folder: Path, environment: str, scanner: str, args: argparse.Namespace) -> Path:
    """Return the file of a case's drives."""
    loop = "open-loop" if args.open_loop else "closed-loop"
    words = [environment, scanner, args.localizer, loop, f"{args.runs}-runs"]
    return folder / "_".join([*words, f"{args.drawn}-pairs_seed-{args.seed}_drives.jsonl"])


def plan(
    args: argparse.Namespace,
    environment: Environment,
    scanner: RangeScanner,
    done: int,
    append: RowWriter,
) -> None:
    """Plan between the pairs from number `done` on, and append both routes of each to the file."""
    service = AmbiguityService(build_map(environment, scanner, store=False), weight=5.0)
    robot = RoutePlanner(service, footprint=ROBOT.radius + MARGIN)
    drawn = pairs(robot, args.drawn, args.seed)
    for number, (start, goal) in enumerate(drawn[done:], start=done):
        shortest = robot.plan(start, goal, planner_name="reference", weight=0.0)
        aware = ambiguity_aware(robot, start, goal, shortest)
        routes = {"shortest": figures(shortest), "aware": figures(aware)}
        append({"pair": number, **routes})


def figures(route: Route) -> Row:
    """Return the stored data of a route: its figures, and its poses to the millimetre."""
    return {**plan_figures(route), "poses": np.round(route.poses, 3).tolist()}


def chosen(planned: list[Row], offered: int, others: int) -> list[Row]:
    """Return the pairs to drive, chosen on the map alone.

    Those where most bad floor is saved among the offered, and those with most of it among the
    others; where a map has no bad floor at all, the first ones drawn.
    """
    offers, not_offered = [], []
    for row in planned:
        bad, difference = (row[name]["bad"] for name in ROUTES)
        if is_offered(row):
            offers.append((difference - bad, row["pair"], row))
        else:
            not_offered.append((-bad, row["pair"], row))
    offers.sort(key=lambda pair: pair[:2])
    not_offered.sort(key=lambda pair: pair[:2])
    return [pair[2] for pair in offers[:offered] + not_offered[:others]]


def is_offered(row: Row) -> bool:
    """Return whether the map offers a route with at most half of the bad floor."""
    bad = row["shortest"]["bad"]
    return bool(bad >= LEAST_BAD and row["aware"]["bad"] <= HALF * bad)


def drive_all(
    args: argparse.Namespace,
    environment: Environment,
    scanner: RangeScanner,
    planned: list[Row],
    kept: list[Row],
    append: RowWriter,
) -> None:
    """Run the missing drives of the chosen pairs, with each odometry."""
    finished = {(row["pair"], row["odometry"]) for row in kept}
    pending = [
        (row, scale)
        for scale in args.odometry
        for row in chosen(planned, args.offered, args.others)
        if (row["pair"], scale) not in finished
    ]
    if not pending:
        return
    service = AmbiguityService(build_map(environment, scanner, spacing=0.5, store=False))
    for row, scale in pending:
        noise = OdometryNoise(scale=scale)
        record: Row = {"pair": row["pair"], "odometry": scale}
        for name in ROUTES:
            record[name] = driven(
                environment, scanner, service, row[name]["poses"], args.localizer, noise,
                [args.seed, row["pair"]], args.runs, open_loop=args.open_loop,
            )  # fmt: skip
        append(record)


def ambiguity_aware(robot: RoutePlanner, start: Any, goal: Any, shortest: Route) -> Route:
    """Return the route with the least bad floor of all weights that is at most 10 % longer.

    Of equals the least exposed, then the shortest one.
    """
    routes = [shortest]
    if shortest.bad_metres >= LEAST_BAD:
        for weight in WEIGHTS:
            route = robot.plan(start, goal, planner_name="reference", weight=weight)
            if route.length <= LONGEST * shortest.length:
                routes.append(route)
    return min(routes, key=lambda r: (round(r.bad_metres, 1), r.exposure, r.length))


def driven(
    environment: Environment,
    scanner: RangeScanner,
    service: AmbiguityService,
    poses: ArrayLike,
    localizer: str,
    noise: OdometryNoise,
    seed: int | Sequence[int],
    runs: int,
    *,
    open_loop: bool = False,
) -> Row:
    """Drive along poses; return the stored figures, one value for each run.

    A drive does not need the map: `service` may be of a coarse one, since the route's new figures
    on it are not used.
    """
    route = evaluate_route(service, poses, Steering(), planner="driven")
    guide = localizer_of(localizer, environment, scanner, noise, runs)
    rng = np.random.default_rng(seed)
    drives = drive_route(
        environment, scanner, ROBOT, route, guide, rng, runs, noise=noise, open_loop=open_loop
    )
    measured = metrics(drives)
    return {name: np.round(getattr(measured, name).astype(float), 4).tolist() for name in KEPT}


if __name__ == "__main__":
    main()
