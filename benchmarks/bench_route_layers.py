"""Are robots lost less on routes that avoid `position` than on routes that avoid `level`?

The criterion, written before the first run:

- Scanners whose maps have headings: the ring of 8 sonars of 3 m, and these with a depth camera, as
  in `bench_truth.py`. Two drawn or simulated and three recorded buildings.
- Pairs of places drawn by a seed, whatever lies between them, and three routes each by the planner
  `reference`: the shortest, and for each layer the route with the least of that layer among the
  weights 2, 5 and 20, at most 10 % longer. So both layers have the same length to spend.
- Drives: open loop (the robot keeps to its route, whatever it believes, so no collision ends a
  run), 20 seeds, the same for all routes, odometry of 9 degrees and 11 cm in a metre, Monte Carlo
  localization with the beams multiplied.
- Reported for each scanner: robots lost (error above 0.5 m or 30 degrees for over a second), 95th
  percentile of the position's error, length; and the difference of `position` less `level`, with
  intervals of 95 % over the pairs. `position` is the layer to plan by if either of the first two is
  lower and its interval does not hold 0, and neither is shown to be higher.

Changed since: 30 seeds; and a Kalman filter on the ranges drives the same routes. The criterion is
judged for each localizer: what is met with one alone is claimed for that one alone.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from harness import (
    arguments,
    commits,
    in_all,
    joined_rows,
    kept_rows,
    option,
    report,
    run_script,
    table,
)
from localizers import LOCALIZERS, WHAT
from numpy.typing import NDArray
from route_layers_case import LAYERS, ROUTES, drives_path, routes_path
from truth_case import MIXED

from ambinav.drive.bootstrap import Interval, bootstrap, paired

ENVIRONMENTS = ("demo", "nav2_depot", "stata_hallways_5cm", "aces", "intel")
BOTH = ("product", "kalman")
ODOMETRY = "odometry of 9 degrees and 11 cm in a metre"
Case = tuple[str, str]
Row = dict[str, Any]
Floats = NDArray[np.float64]


def main() -> None:
    """Run the missing drives, then report."""
    args = arguments(
        __doc__,
        folder=option(Path("out/route-layers"), "keeps what has been driven"),
        jobs=2,
        pairs=12,
        runs=30,
        seeds=option([31], "each with its pairs"),
        localizers=option(BOTH, choices=LOCALIZERS),
        environments=ENVIRONMENTS,
        scanners=option(MIXED, choices=MIXED),
        report_only=option(False, "drive nothing more"),
    )
    cases = list(product(args.environments, args.scanners))
    if not args.report_only:
        with ThreadPoolExecutor(args.jobs) as pool:
            list(pool.map(lambda case: run_case(case, args), cases))
    rows = [row for case in cases for row in rows_of(case, args)]
    if not rows:
        raise SystemExit(f"{args.folder}: nothing has been driven; leave --report-only out.")
    report("Routes by two layers", ["numpy", "numba"], body(rows, args), args.out)


def run_case(case: Case, args: argparse.Namespace) -> None:
    """Run the missing drives of an environment and scanner."""
    how = ["--pairs", str(args.pairs), "--runs", str(args.runs), "--folder", str(args.folder)]
    for seed, name in product(args.seeds, args.localizers):
        words = ["--localizer", name, "--seed", str(seed), *how]
        run_script("route_layers_case.py", *case, *words)
        print(f"driven: {' '.join(case)} {name}", file=sys.stderr, flush=True)


def rows_of(case: Case, args: argparse.Namespace) -> list[Row]:
    """Return the pairs driven with all localizers, with routes and drives in one row."""
    pairs = []
    for seed in args.seeds:
        driven = {}
        for name in args.localizers:
            where = argparse.Namespace(**{**vars(args), "seed": seed, "localizer": name})
            rows = kept_rows(drives_path(args.folder, *case, where))
            driven[name] = [row for row in rows if row["pair"] < args.pairs]
        routes = kept_rows(routes_path(args.folder, *case, where))
        for name, drives in in_all(driven, args.localizers, ("pair",)).items():
            names = {"environment": case[0], "scanner": case[1], "localizer": name, "seed": seed}
            pairs += [{**row, **names} for row in joined_rows(routes, drives, ROUTES)]
    return pairs


def body(rows: list[Row], args: argparse.Namespace) -> str:
    """Return the report's tables."""
    parts = [str(__doc__).split("\n\n", 1)[1].strip(), "## What was driven"]
    parts.append("\n".join(f"- `{name}`: {WHAT[name]}" for name in args.localizers))
    parts.append(f"Open loop, {args.runs} seeds, {ODOMETRY}. Driven at: {commits(rows)}.")
    for scanner in args.scanners:
        here = [row for row in rows if row["scanner"] == scanner]
        groups = {e: [row for row in here if row["environment"] == e] for e in args.environments}
        groups = {name: pairs for name, pairs in groups.items() if pairs}
        if not here:
            continue
        parts += [f"## {scanner}", "Routes: the shortest, by `level`, by `position`; means."]
        lines = [
            [name, *route_cells(_once(pairs))] for name, pairs in {**groups, "all": here}.items()
        ]
        parts.append(table(ROUTE_HEADER, lines))
        lines = []
        for name, pairs in {**groups, "all": here}.items():
            for localizer in args.localizers:
                mine = [row for row in pairs if row["localizer"] == localizer]
                if mine:
                    lines.append([name, localizer, *drive_cells(mine)])
        parts.append(table(HEADER, lines, words=2))
        parts.append(in_words(here, scanner, list(groups), args.localizers))
    return "\n\n".join(parts)


def in_words(
    rows: Sequence[Row], scanner: str, environments: Sequence[str], localizers: Sequence[str]
) -> str:
    """Compare routes by `position` and by `level` in sentences with their conditions."""
    text_lines = []
    for name in localizers:
        mine = [row for row in rows if row["localizer"] == name]
        if not mine:
            continue
        rates = [100.0 * of(mine, route, "lost") for route in ROUTES]
        errors = [of(mine, route, "position_p95") for route in ROUTES]
        rng = np.random.default_rng(0)
        lost, error = (paired(values[2], values[1], rng) for values in (rates, errors))
        text_lines.append(
            f"- {scanner}, {ODOMETRY}, `{name}`, {len(mine)} pairs in {', '.join(environments)}: "
            f"lost on the shortest routes {rates[0].mean():.1f} %, by `level` "
            f"{rates[1].mean():.1f} %, by `position` {rates[2].mean():.1f} %; `position` less "
            f"`level` {span(lost, 1)} points, and {span(error, 3)} m of the 95 % error. The "
            f"criterion for `position` is {judged((lost, error))}."
        )
    return "\n".join(text_lines)


def judged(changes: Sequence[Interval]) -> str:
    """Return whether a difference is shown to be below 0, and none to be above."""
    lower, higher = any(c.high < 0.0 for c in changes), any(c.low > 0.0 for c in changes)
    return "met" if lower and not higher else "not met"


def _once(rows: Sequence[Row]) -> list[Row]:
    """Return each pair once, whatever it was driven with."""
    return list({(row["environment"], row["seed"], row["pair"]): row for row in rows}.values())


def of(rows: Sequence[Row], route: str, figure: str) -> Floats:
    """Return a figure of each pair, the mean over its runs."""
    return np.array([np.mean(row[route][figure]) for row in rows], dtype=np.float64)


ROUTE_HEADER = (
    "environment", "pairs", "longer by level", "position", "corridor, m", "longest", "open, m",
    "longest",
)  # fmt: skip


def route_cells(rows: Sequence[Row]) -> list[object]:
    """Return the lengths of the routes, and their metres in corridors and open zones."""
    if not rows:
        return [0, *[""] * 6]
    shortest = of(rows, "shortest", "length").sum()
    longer = [100.0 * (of(rows, layer, "length").sum() / shortest - 1.0) for layer in LAYERS]
    metres = [
        ", ".join(f"{of(rows, route, figure).mean():.1f}" for route in ROUTES)
        for figure in ("corridor", "longest_corridor", "open", "longest_open")
    ]
    return [len(rows), *[f"{longer_by:+.1f} %" for longer_by in longer], *metres]


HEADER = (
    "environment", "localizer", "pairs", "lost, shortest", "level", "position",
    "difference, points", "95 % error, shortest", "level", "position", "difference, m",
)  # fmt: skip


def drive_cells(rows: Sequence[Row]) -> list[object]:
    """Return the drives' results; the difference is `position` minus `level`."""
    rng = np.random.default_rng(0)
    cells: list[object] = [len(rows)]
    for figure, scale, digits, unit in (("lost", 100.0, 1, " %"), ("position_p95", 1.0, 3, " m")):
        values = {route: scale * of(rows, route, figure) for route in ROUTES}
        cells += [f"{bootstrap(values[r], rng).value:.{digits}f}{unit}" for r in ROUTES]
        cells.append(span(paired(values["position"], values["level"], rng), digits))
    return cells


def span(interval: Interval, digits: int) -> str:
    """Format a difference with its interval."""
    return (
        f"{interval.value:+.{digits}f} ({interval.low:+.{digits}f} to {interval.high:+.{digits}f})"
    )


if __name__ == "__main__":
    main()
