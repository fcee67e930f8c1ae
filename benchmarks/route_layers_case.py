"""One environment and scanner of `bench_route_layers.py`: pairs, routes by two layers, drives.

As `claim_case.py`: routes are kept in one file, drives in another for each localizer, a line of
JSON a pair; what is there is not done again.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numba
from claim_case import LONGEST, MARGIN, WEIGHTS, Row, RowWriter, driven, figures
from harness import appended, environment_of, kept_rows
from localizers import LOCALIZERS, ROBOT
from plan_case import pairs
from truth_case import MIXED, NOISE, scanner_of

from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.routes.route import Route
from ambinav.sensing.scanner import RangeScanner
from ambinav.service.service import AmbiguityService
from ambinav_planners import RoutePlanner

LAYERS = ("level", "position")
ROUTES = ("shortest", *LAYERS)


def main() -> None:
    """Plan the missing routes, run the missing drives."""
    parser = argparse.ArgumentParser()
    parser.add_argument("environment")
    parser.add_argument("scanner", choices=MIXED)
    parser.add_argument("--localizer", choices=LOCALIZERS, default="product")
    parser.add_argument("--pairs", type=int, default=12)
    parser.add_argument("--runs", type=int, default=30)
    parser.add_argument("--seed", type=int, default=31)
    parser.add_argument("--folder", type=Path, default=Path("out/route-layers"))
    args = parser.parse_args()
    numba.set_num_threads(1)
    environment = environment_of(args.environment)
    scanner = scanner_of(args.scanner)
    planned = routes_path(args.folder, args.environment, args.scanner, args)
    if len(kept_rows(planned)) < args.pairs:
        with appended(planned) as append:
            plan(args, environment, scanner, len(kept_rows(planned)), append)
    path = drives_path(args.folder, args.environment, args.scanner, args)
    with appended(path) as append:
        rows = kept_rows(planned)[: args.pairs]
        drive_all(args, environment, scanner, rows, kept_rows(path), append)


def routes_path(folder: Path, environment: str, scanner: str, args: argparse.Namespace) -> Path:
    """Return the file of a case's routes; further pairs are appended to it."""
    return folder / f"{environment}_{scanner}_seed-{args.seed}_routes.jsonl"


def drives_path(folder: Path, environment: str, scanner: str, args: argparse.Namespace) -> Path:
    """Return the file of a case's drives."""
    words = [environment, scanner, args.localizer, f"{args.runs}-runs"]
    return folder / "_".join([*words, f"seed-{args.seed}_drives.jsonl"])


def plan(
    args: argparse.Namespace,
    environment: Environment,
    scanner: RangeScanner,
    done: int,
    append: RowWriter,
) -> None:
    """Plan between the pairs from number `done` on, and append the routes of each to the file."""
    amap = build_map(environment, scanner, layers="position", store=False)
    footprint = ROBOT.radius + MARGIN
    robots = {
        name: RoutePlanner(AmbiguityService(amap, name), footprint=footprint) for name in LAYERS
    }
    drawn = pairs(robots["level"], args.pairs, args.seed)
    for number, (start, goal) in enumerate(drawn[done:], start=done):
        record = {name: figures(route) for name, route in routes(robots, start, goal).items()}
        append({"pair": number, **record})


def routes(robots: dict[str, RoutePlanner], start: Any, goal: Any) -> dict[str, Route]:
    """Return the shortest route, and each layer's best route that is not too long."""
    shortest = robots["level"].plan(start, goal, planner_name="reference", weight=0.0)
    chosen_routes = {"shortest": shortest}
    for name, robot in robots.items():
        offers = [
            robot.plan(start, goal, planner_name="reference", weight=weight)
            for weight in (0.0, *WEIGHTS)
        ]
        allowed = [route for route in offers if route.length <= LONGEST * shortest.length]
        chosen_routes[name] = min(allowed, key=lambda route: (route.exposure, route.length))
    return chosen_routes


def drive_all(
    args: argparse.Namespace,
    environment: Environment,
    scanner: RangeScanner,
    planned: list[Row],
    kept: list[Row],
    append: RowWriter,
) -> None:
    """Run the missing drives of the pairs."""
    finished = {row["pair"] for row in kept}
    pending = [row for row in planned if row["pair"] not in finished]
    if not pending:
        return
    service = AmbiguityService(
        build_map(environment, scanner_of("laser-4m"), spacing=0.5, store=False)
    )
    for row in pending:
        record: Row = {"pair": row["pair"]}
        for name in ROUTES:
            record[name] = driven(
                environment, scanner, service, row[name]["poses"], args.localizer, NOISE,
                [args.seed, row["pair"]], args.runs, open_loop=True,
            )  # fmt: skip
        append(record)


if __name__ == "__main__":
    main()
