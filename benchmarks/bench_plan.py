"""Planners against the reference: cost, length, exposure, time to the first path, iterations.

Ten pairs of places in each of six environments, weight 5, a disc of 0.2 m. The reference is the
lattice with its channels, the best of several paths finished at any angle; a gap is how much more a
route costs than that, and the least one says whether any was cheaper. Each
environment runs in a process of its own on one thread, two at a time. Routes are kept in a folder,
one by one, and those that are there are not planned again. Times are meant on a quiet machine.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from harness import (
    arguments,
    commits,
    environment_path,
    kept_rows,
    option,
    report,
    run_script,
    table,
)
from plan_case import plans_path

LIBRARIES = ("ambinav", "numba", "numpy", "ompl", "scipy")
ENVIRONMENTS = (
    "willow_full_005", "stata_hallways_5cm", "edmonton", "aces", "nav2_depot", "demo",
)  # fmt: skip
PLANNERS = ("prmstar", "rrtstar", "informed-rrtstar", "sorrtstar", "bitstar", "fmt", "bfmt")
Row = dict[str, Any]

# What counts as a path with less ambiguity worth taking: half of the bad metres for a tenth more.
LESS_BAD, MORE_LENGTH = 0.5, 1.1
# Pairs whose shortest path has fewer bad metres, in metres, have nothing to gain.
LEAST_BAD = 1.0


def run_case(environment: str, args: argparse.Namespace) -> list[Row]:
    """Run `plan_case.py` in a process of its own, and return its rows."""
    if not args.report_only:
        how = ["--pairs", str(args.pairs), "--front", "--planners", *args.planners]
        how += ["--seconds", *map(str, args.seconds), "--folder", str(args.folder)]
        run_script("plan_case.py", environment, *how, "--seed", str(args.seed))
        print(f"planned: {environment}", file=sys.stderr, flush=True)
    rows = []
    for row in kept_rows(plans_path(args.folder, environment, args)):
        row["environment"] = environment
        if row["pair"] < args.pairs:
            for route in row.pop("routes", [{}]):
                rows.append({**row, **route})
    return rows


def gaps(rows: list[Row], planner: str, budget: float) -> tuple[list[float], list[Row], int]:
    """Return per cent above the reference, the rows with a path, and how many have none."""
    best = {(r["environment"], r["pair"]): r for r in rows if r["planner"] == "reference"}
    mine = [r for r in rows if r["planner"] == planner and r["budget"] == budget]
    solved = [r for r in mine if r["cost"] is not None]
    shares = [100.0 * (r["cost"] / best[r["environment"], r["pair"]]["cost"] - 1.0) for r in solved]
    return shares, solved, len(mine) - len(solved)


def planner_table(rows: list[Row], planners: Sequence[str], budget: float) -> str:
    """Return one line for each planner at one time."""
    best = {(r["environment"], r["pair"]): r for r in rows if r["planner"] == "reference"}
    lines = []
    for name in planners:
        shares, solved, missing = gaps(rows, name, budget)
        if not solved:
            lines.append([name, f"0 / {missing}", *["-"] * 9])
            continue
        peers = [best[r["environment"], r["pair"]] for r in solved]
        length = [r["length"] / p["length"] for r, p in zip(solved, peers, strict=True)]
        exposure = [r["exposure"] / p["exposure"] for r, p in zip(solved, peers, strict=True)]
        first = [r["first"] for r in solved if r["first"] is not None]
        lines.append(
            [
                name,
                f"{len(solved)} / {len(solved) + missing}",
                f"{np.median(shares):.2f}",
                f"{np.percentile(shares, 90):.2f}",
                f"{max(shares):.2f}",
                f"{min(shares):.2f}",
                f"{np.median(length):.3f}",
                f"{np.median(exposure):.3f}",
                f"{np.median(first):.3f}",
                f"{np.median([r['iterations'] or 0 for r in solved]):.0f}",
                f"{np.median([r['seconds'] for r in solved]):.2f}",
            ]
        )
    header = (
        "planner", "found", "gap %: median", "90 %", "worst", "least", "length / reference's",
        "exposure / reference's", "first way s", "iterations", "took s",
    )  # fmt: skip
    return table(header, lines)


def environment_table(rows: list[Row], planners: Sequence[str], budget: float) -> str:
    """Return the planner with the least median gap in each environment, and its gaps."""
    lines = []
    for environment in dict.fromkeys(r["environment"] for r in rows):
        rows_here = [r for r in rows if r["environment"] == environment]
        tried = {name: gaps(rows_here, name, budget) for name in planners}
        complete = {n: g[0] for n, g in tried.items() if g[2] == 0 and g[0]}
        if not complete:
            lines.append([environment, "none found all", "-", "-"])
            continue
        name = min(complete, key=lambda n: float(np.median(complete[n])))
        shares = complete[name]
        lines.append([environment, name, f"{np.median(shares):.2f}", f"{max(shares):.2f}"])
    return table(("environment", "best planner", "gap %: median", "worst"), lines, words=2)


def trade_table(rows: list[Row]) -> str:
    """Return the benefit of the weight: bad metres saved, by zone, and the extra length."""
    lines = []
    for environment in dict.fromkeys(r["environment"] for r in rows):
        rows_here = [r for r in rows if r["environment"] == environment]
        counts = {"gain": 0, "halved": 0, "front": 0, "none": 0}
        bad, extra = [], []
        shorts = [r for r in rows_here if r["planner"] == "shortest"]
        awares = [r for r in rows_here if r["planner"] == "reference"]
        for pair in sorted({r["pair"] for r in shorts} & {r["pair"] for r in awares}):
            mine = [r for r in rows_here if r["pair"] == pair]
            short = next(r for r in mine if r["planner"] == "shortest")
            aware = next(r for r in mine if r["planner"] == "reference")
            if short["bad"] < LEAST_BAD:
                continue
            counts["gain"] += 1
            bad.append(aware["bad"] / short["bad"])
            extra.append(100.0 * (aware["length"] / short["length"] - 1.0))
            if _worth(aware, short):
                counts["halved"] += 1
            elif any(_worth(r, short) for r in mine if r["planner"] == "front"):
                counts["front"] += 1
            else:
                counts["none"] += 1
        middle = [f"{np.median(v):.2f}" if v else "-" for v in (bad, extra)]
        metres = [
            " to ".join(
                f"{np.mean([r[figure] for r in planned]):.1f}" for planned in (shorts, awares)
            )
            for figure in ("corridor", "longest_corridor", "open", "longest_open")
        ]
        lines.append([environment, *counts.values(), *middle, *metres])
    header = (
        "environment", f"pairs with {LEAST_BAD:g} m or more of bad floor", "halved at weight 5",
        "only at another weight", "no such way on the front", "bad metres / shortest's",
        "extra length %", "corridor, m: shortest to weight 5, all pairs", "longest", "open, m",
        "longest",
    )  # fmt: skip
    return table(header, lines)


def _worth(route: Row, short: Row) -> bool:
    return bool(
        route["bad"] <= LESS_BAD * short["bad"] and route["length"] <= MORE_LENGTH * short["length"]
    )


def main() -> None:
    """Run all cases and report."""
    args = arguments(
        __doc__,
        pairs=10,
        seconds=[1.0, 5.0],
        planners=list(PLANNERS),
        environments=list(ENVIRONMENTS),
        jobs=2,
        seed=7,
        folder=option(Path("out/plan"), "keeps what has been planned"),
        report_only=option(False, "plan nothing more"),
    )
    for name in args.environments:
        environment_path(name)
    os.environ["NUMBA_NUM_THREADS"] = "1"
    with ThreadPoolExecutor(args.jobs) as pool:
        cases = pool.map(lambda name: run_case(name, args), args.environments)
        rows = [row for case in cases for row in case]
    if not rows:
        raise SystemExit(f"{args.folder}: nothing has been planned; leave --report-only out.")
    sections = [
        f"{args.pairs} seeded pairs of places at least 8 m apart in each environment, weight 5, a "
        f"disc of 0.2 m, one thread for each run, {args.jobs} at a time. Times hold planning and "
        "improving. Gap: how much more a route costs than the reference's; below 0 it is cheaper. "
        f"Planned at: {commits(rows)}."
    ]
    for seconds in args.seconds:
        sections += [
            f"## In {seconds:g} s",
            planner_table(rows, args.planners, seconds),
            environment_table(rows, args.planners, seconds),
        ]
    sections += ["## What the weight buys", trade_table(rows)]
    report("Planners", LIBRARIES, "\n\n".join(sections), args.out)


if __name__ == "__main__":
    main()
