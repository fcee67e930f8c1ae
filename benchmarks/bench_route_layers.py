"""Are robots lost less on routes that avoid `position` than on routes that avoid `level`?

The criterion, written before the first run:

- Scanners whose maps have headings: the ring of 8 sonars of 3 m, and these with a depth camera, as
  in `bench_truth.py`. Two drawn or simulated and three recorded buildings.
- Pairs of places drawn by a seed, whatever lies between them, and three routes each by the planner
  `reference`: the shortest, and for each layer the route with the least of that layer among the
  weights 2, 5 and 20, at most 10 % longer. So both layers have the same length to spend.
- Drives: open loop (the robot keeps to its route, whatever it believes, so no collision ends a
  run), 20 seeds, the same for all routes, odometry of 9 degrees and 12 cm in a metre, Monte Carlo
  localization with the beams multiplied.
- Told for each scanner: robots lost (error above 0.5 m or 30 degrees for over a second), 95th
  percentile of the position's error, length; and the difference of `position` less `level`, with
  intervals of 95 % over the pairs. `position` is the layer to plan by if either of the first two is
  lower and its interval does not hold 0, and neither is shown to be higher.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

import numba
import numpy as np
from claim_case import LONGEST, MARGIN, ROBOT, WEIGHTS, localizer
from harness import add_out, environment_path, report, table
from numpy.typing import NDArray
from plan_case import pairs
from truth_case import MIXED, NOISE, scanner_of

from ambinav.ambiguity.build import build_map
from ambinav.drive.bootstrap import Interval, bootstrap, paired
from ambinav.drive.drive import drive
from ambinav.drive.metrics import metrics
from ambinav.geometry.environment import load_environment
from ambinav.routes.route import Route
from ambinav.service.service import AmbiguityService
from ambinav_planners import RoutePlanner

ENVIRONMENTS = ("demo", "nav2_depot", "stata_hallways_5cm", "aces", "intel")
LAYERS = ("level", "position")
ROUTES = ("shortest", *LAYERS)
Case = tuple[str, str]
Floats = NDArray[np.float64]


def main() -> None:
    """Drive what is not there yet, then report."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument(
        "--folder", type=Path, default=Path("out/route-layers"), help="keeps what has been driven"
    )
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--pairs", type=int, default=24)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seeds", type=int, nargs="+", default=[31], help="each with its pairs")
    parser.add_argument("--environments", nargs="+", default=ENVIRONMENTS)
    parser.add_argument("--scanners", nargs="+", default=MIXED, choices=MIXED)
    add_out(parser)
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    cases = list(product(args.environments, args.scanners))
    with ProcessPoolExecutor(args.jobs) as pool:
        found = dict(zip(cases, pool.map(driven, cases, [args] * len(cases)), strict=True))
    body = [str(__doc__).split("\n\n", 1)[1].strip()]
    for scanner in args.scanners:
        rows = [line(environment, found[environment, scanner]) for environment in args.environments]
        rows.append(line("all", [row for e in args.environments for row in found[e, scanner]]))
        body += [f"## {scanner}", table(HEADER, rows)]
    report("Routes by two layers", ["numpy", "numba"], "\n\n".join(body), args.out)


def driven(case: Case, args: argparse.Namespace) -> list[dict[str, Any]]:
    """The pairs of an environment and scanner with their drives, from now or from before."""
    found = []
    for seed in args.seeds:
        path = args.folder / f"{'_'.join(case)}_{args.pairs}_{args.runs}_{seed}.jsonl"
        if not path.is_file():
            numba.set_num_threads(1)
            lines = [json.dumps(told) for told in drives_of(case, seed, args)]
            path.write_text("\n".join(lines), encoding="utf-8")
        found += [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return found


def drives_of(case: Case, seed: int, args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """What became of the robots between each pair of places, on each route."""
    environment = load_environment(environment_path(case[0]))
    scanner = scanner_of(case[1])
    amap = build_map(environment, scanner, layers="position")
    footprint = ROBOT.radius + MARGIN
    robots = {
        name: RoutePlanner(AmbiguityService(amap, name), footprint=footprint) for name in LAYERS
    }
    guide = localizer("product", scanner, NOISE)
    for number, (start, goal) in enumerate(pairs(robots["level"], args.pairs, seed)):
        told: dict[str, Any] = {"pair": number}
        for name, route in routes(robots, start, goal).items():
            rng = np.random.default_rng([seed, number])
            runs = drive(
                environment, scanner, ROBOT, route, guide, rng, args.runs, noise=NOISE,
                open_loop=True,
            )  # fmt: skip
            measured = metrics(runs, amap)
            told[name] = {
                "length": route.length,
                "lost": float(measured.lost.mean()),
                "error": float(measured.position_p95.mean()),
            }
        yield told


def routes(robots: dict[str, RoutePlanner], start: Any, goal: Any) -> dict[str, Route]:
    """The shortest way, and for each layer the one with the least of it that is not too long."""
    shortest = robots["level"].plan(start, goal, planner_name="reference", weight=0.0)
    found = {"shortest": shortest}
    for name, robot in robots.items():
        ways = [
            robot.plan(start, goal, planner_name="reference", weight=weight)
            for weight in (0.0, *WEIGHTS)
        ]
        allowed = [way for way in ways if way.length <= LONGEST * shortest.length]
        found[name] = min(allowed, key=lambda way: (way.exposure, way.length))
    return found


HEADER = (
    "environment", "pairs", "longer by level", "position", "lost, shortest", "level", "position",
    "difference, points", "95 % error, shortest", "level", "position", "difference, m",
)  # fmt: skip


def line(name: str, told: list[dict[str, Any]]) -> list[object]:
    """A row of the report."""

    def of(route: str, figure: str) -> Floats:
        return np.array([pair[route][figure] for pair in told])

    rng = np.random.default_rng(0)
    longer = [100.0 * (of(layer, "length").sum() / of("shortest", "length").sum() - 1.0)
              for layer in LAYERS]  # fmt: skip
    cells: list[object] = [name, len(told), *[f"{more:+.1f} %" for more in longer]]
    for figure, scale, digits, unit in (("lost", 100.0, 1, " %"), ("error", 1.0, 3, " m")):
        values = {route: scale * of(route, figure) for route in ROUTES}
        cells += [f"{bootstrap(values[r], rng).value:.{digits}f}{unit}" for r in ROUTES]
        cells.append(span(paired(values["position"], values["level"], rng), digits))
    return cells


def span(found: Interval, digits: int) -> str:
    """A difference with its interval."""
    return f"{found.value:+.{digits}f} ({found.low:+.{digits}f} to {found.high:+.{digits}f})"


if __name__ == "__main__":
    main()
