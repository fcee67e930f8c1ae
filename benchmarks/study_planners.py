"""Which planner for which map, space and limit: all planners in all spaces over twenty maps.

Paired queries: on each map the same seeded starts and goals for all planners. Each plan gets one
second, improving included, in one process. A gap is how much more a route costs than the cheapest
one that any of the planners found for the query; no bound of the optimum stands behind it. Found:
of the queries that any planner solved in the setting; times and memory are of plans that found a
route. Memory is how far the resident set rose above that before the plan, at its highest. Rows are
kept in a file, one by one, and those that are there are not planned again.
"""

from __future__ import annotations

import ctypes
import gc
import sys
import time
from collections.abc import Iterable
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from harness import (
    ENVIRONMENTS,
    LEVELS,
    appended,
    arguments,
    commits,
    data_file,
    environment_path,
    kept_rows,
    option,
    report,
    table,
)  # fmt: skip
from lasers import laser
from plan_case import RADIUS, WEIGHT, pairs

import ambinav as an
from ambinav.runtime.errors import InputError
from ambinav_planners import RoutePlanner
from ambinav_planners.registry import SYMMETRIC_SPACES
from ambinav_planners.search.lattice_graph import lattice_of
from ambinav_planners.search.limit import longest_bad

LIBRARIES = ("ambinav", "numba", "numpy", "ompl", "scipy")
TURNING_RADIUS = 0.5
PLANNERS = ("reference", "prmstar", "rrtstar", "informed-rrtstar", "bitstar", "fmt")
SPACES = ("r2", "se2", "dubins", "reeds-shepp")
LIMITED = "r2, bad metres limited"
# A limit is this share of the shortest route's longest bad stretch, if that has so many metres.
SHARE, BAD_LEVEL, LEAST_BAD = 0.8, 0.4, 0.5
# Lattice spacing, metres, of the environments that are not in buildings of usual size.
SPACINGS = {
    "maps/f1_berlin.yaml": 0.1, "planner_maps/barn_world_50.yaml": 0.05,
    "planner_maps/barn_world_250.yaml": 0.05, "planner_maps/movingai_32room_000.yaml": 0.5,
    "planner_maps/movingai_maze512-32-0.yaml": 0.5,
}  # fmt: skip
TOO_LARGE = ("infinite-corridor",)
# Free cells of the lattice up to which a map counts as small, and as of middle size.
SIZES = {"small": 20_000, "middle": 60_000, "large": sys.maxsize}
# Gaps within so many per cent are taken for equal: the accuracy of the reference.
SAME = 0.1
COLUMNS = (
    "found", "gap %: median", "90 %", "worst", "first path s", "took s: median (extremes)",
    "MB: median (most)",
)  # fmt: skip
Row = dict[str, Any]


def map_files() -> dict[str, Path]:
    """Return the maps by name."""
    files = {name: environment_path(name) for name in ENVIRONMENTS if name not in TOO_LARGE}
    return files | {Path(name).stem: data_file(name) for name in SPACINGS}


def settings() -> dict[str, tuple[str, ...]]:
    """Return the planners that suit each setting."""
    able = {
        space: tuple(
            name for name in PLANNERS
            if (name != "reference" or space == "r2")
            and (space in SYMMETRIC_SPACES or name in ("prmstar", "bitstar"))
        )
        for space in SPACES
    }  # fmt: skip
    return {**able, LIMITED: ("reference", "prmstar")}


def robot_in(setting: str, cost: an.AmbiguityService, **limits: Any) -> RoutePlanner:
    """Return the robot of a setting: a disc, with a turning radius where it is a car."""
    space = setting.partition(",")[0]
    radius = TURNING_RADIUS if space in ("dubins", "reeds-shepp") else 0.0
    return RoutePlanner(cost, footprint=RADIUS, space=space, turning_radius=radius, **limits)


def measured(
    robot: RoutePlanner, start: Any, goal: Any, planner: str, seconds: float
) -> dict[str, Any]:
    """Plan once; return cost, seconds, seconds to the first path, and megabytes at the highest."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # resets the highest
    before = _kilobytes("VmRSS")
    begun = time.perf_counter()
    try:
        route = robot.plan(start, goal, planner_name=planner, seconds=seconds)
        figures = {"cost": route.cost, "first": route.first_seconds}
    except InputError:
        figures = {"cost": None, "first": None}
    took = time.perf_counter() - begun
    return {**figures, "seconds": took, "memory": (_kilobytes("VmHWM") - before) / 1024.0}


def _kilobytes(field: str) -> int:
    lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return int(next(line for line in lines if line.startswith(field)).split()[1])


def plan_all(path: Path, count: int, seconds: float, seed: int) -> None:
    """Plan what is missing in the file of rows."""
    finished = {(row["map"], row["setting"], row["pair"]) for row in kept_rows(path)}
    warm: set[str] = set()
    with appended(path) as append:
        for name, file in map_files().items():
            missing = [
                (setting, pair)
                for setting in settings()
                for pair in range(count)
                if (name, setting, pair) not in finished
            ]
            if not missing:
                continue
            spacing = SPACINGS.get(str(file.relative_to(file.parents[1])), 0.1)
            environment = an.load_environment(file, level=LEVELS.get(name))
            amap = an.build_map(environment, laser(), spacing=spacing, store=False)
            cost = an.AmbiguityService(amap, weight=WEIGHT)
            # Another robot, if only by a nanometre: equal ones share their lattice.
            plain = RoutePlanner(cost, footprint=RADIUS + 1e-9)
            begun = time.perf_counter()
            nodes = len(lattice_of(cost, plain.checker).graph.poses)
            about = {"map": name, "cells": nodes, "lattice": time.perf_counter() - begun}
            ends = np.array(pairs(plain, count, seed))
            ends[:, :, 2] = np.random.default_rng(seed).uniform(-np.pi, np.pi, ends.shape[:2])
            for setting, pair in missing:
                start, goal = ends[pair]
                robot = robot_in(setting, cost)
                if setting not in warm:  # compiles
                    for planner in settings()[setting]:
                        measured(robot, start, goal, planner, 0.2)
                    warm.add(setting)
                if setting == LIMITED:
                    short = plain.plan(start, goal, planner_name="reference", weight=0.0)
                    bad = longest_bad(short.poses, cost, plain.checker.steering, BAD_LEVEL)
                    if bad < LEAST_BAD:
                        continue
                    limit = {"max_bad_metres": SHARE * bad, "bad_level": BAD_LEVEL}
                    robot = robot_in(setting, cost, **limit)
                rows = []
                for planner in settings()[setting]:
                    row = {**about, "setting": setting, "pair": pair, "planner": planner}
                    rows.append(row | measured(robot, start, goal, planner, seconds))
                for row in rows:
                    append(row)
            print(name, nodes, file=sys.stderr, flush=True)


def with_gaps(rows: list[Row]) -> list[Row]:
    """Return the rows of the queries that any planner solved, with their gaps in per cent."""
    best: dict[Any, float] = {}
    for row in rows:
        if row["cost"] is not None:
            query = row["map"], row["setting"], row["pair"]
            best[query] = min(best.get(query, np.inf), row["cost"])
    solved = [row for row in rows if (row["map"], row["setting"], row["pair"]) in best]
    for row in solved:
        least = best[row["map"], row["setting"], row["pair"]]
        row["gap"] = None if row["cost"] is None else 100.0 * (row["cost"] / least - 1.0)
    return solved


def line(rows: list[Row]) -> tuple[str, ...]:
    """Return the figures of one planner's rows."""
    gaps = [row["gap"] for row in rows if row["gap"] is not None]
    found_text = f"{len(gaps)} / {len(rows)}"
    if not gaps:
        return found_text, *["-"] * 6
    solved = [row for row in rows if row["gap"] is not None]
    first = [row["first"] for row in solved if row["first"] is not None]
    took, memory = ([row[key] for row in solved] for key in ("seconds", "memory"))
    return (
        found_text, f"{np.median(gaps):.2f}", f"{np.percentile(gaps, 90):.2f}", f"{max(gaps):.2f}",
        f"{np.median(first):.2f}" if first else "-",
        f"{np.median(took):.2f} ({min(took):.2f} to {max(took):.2f})",
        f"{np.median(memory):.0f} ({max(memory):.0f})",
    )  # fmt: skip


def against(rows: list[Row], planner: str, auto: str) -> str:
    """Return in how many queries a planner's route is cheaper, and dearer, than that of `auto`."""
    costs: dict[Any, dict[str, float]] = {}
    for row in rows:
        cost = np.inf if row["cost"] is None else row["cost"]
        costs.setdefault((row["map"], row["pair"]), {})[row["planner"]] = cost
    cheaper_share = 1.0 - SAME / 100.0
    cheaper = sum(query[planner] < cheaper_share * query[auto] for query in costs.values())
    dearer = sum(query[auto] < cheaper_share * query[planner] for query in costs.values())
    return "-" if planner == auto else f"{cheaper}, {dearer}"


def best_planner(rows: list[Row]) -> str:
    """Return the planner that found most; of those the one with the least gap, then the fastest.

    Gaps are compared by their 90th percentile, in steps of `SAME`.
    """

    def key(name: str) -> tuple[float, ...]:
        mine = [row for row in rows if row["planner"] == name]
        gaps = [row["gap"] for row in mine if row["gap"] is not None]
        if not gaps:
            return 0.0, np.inf, np.inf
        seconds = float(np.median([row["seconds"] for row in mine]))
        return -len(gaps), round(float(np.percentile(gaps, 90)) / SAME), seconds

    return min(dict.fromkeys(str(row["planner"]) for row in rows), key=key)


def of(rows: Iterable[Row], **values: Any) -> list[Row]:
    """Return the rows with these values."""
    return [row for row in rows if all(row[key] == value for key, value in values.items())]


def table_by_planner(rows: list[Row]) -> list[tuple[Any, ...]]:
    """Return the table's rows of all planners in all settings."""
    autos = {name: "reference" if name.startswith("r2") else "prmstar" for name in settings()}
    return [
        (
            setting,
            planner,
            *line(of(rows, setting=setting, planner=planner)),
            against(of(rows, setting=setting), planner, autos[setting]),
        )
        for setting, planners in settings().items()
        for planner in planners
    ]


def table_by_size(rows: list[Row]) -> list[tuple[Any, ...]]:
    """Return the table's rows of the best planner by size of map."""
    lines = []
    for setting, size in product(settings(), SIZES):
        size_rows = of(rows, setting=setting, size=size)
        if size_rows:
            name = best_planner(size_rows)
            maps = len({row["map"] for row in size_rows})
            lines.append((setting, size, name, maps, *line(of(size_rows, planner=name))))
    return lines


def table_by_map(rows: list[Row], planned_rows: list[Row]) -> list[tuple[Any, ...]]:
    """Return the table's rows of the best planners on each map."""
    lines = []
    for name in dict.fromkeys(row["map"] for row in planned_rows):
        cells, lattice = (of(planned_rows, map=name)[0][key] for key in ("cells", "lattice"))
        planned = [of(rows, map=name, setting=setting) for setting in settings()]
        best = (best_planner(part) if part else "-" for part in planned)
        lines.append((name, *best, cells, f"{lattice:.2f}"))
    return lines


def main() -> None:
    """Plan and report."""
    args = arguments(
        __doc__,
        pairs=2,
        seconds=option(1.0, "of each plan"),
        seed=7,
        rows=option(Path("out/planners.jsonl"), "keeps what has been planned"),
        report_only=option(False, "plan nothing more"),
    )
    if not args.report_only:
        plan_all(args.rows, args.pairs, args.seconds, args.seed)
    planned_rows = kept_rows(args.rows)
    rows = with_gaps(planned_rows)
    for row in rows:
        row["size"] = next(name for name, max_cells in SIZES.items() if row["cells"] <= max_cells)
    by_map = table_by_map(rows, planned_rows)
    by_planner = ("setting", "planner", *COLUMNS, "cheaper, dearer than auto")
    body = "\n\n".join(
        [
            str(__doc__).split("\n\n", 1)[1].strip(),
            f"Queries on each of {len(by_map)} maps: {args.pairs}. {args.seconds:g} s a plan, "
            f"weight {WEIGHT:g}, a disc of {RADIUS} m, turning radius {TURNING_RADIUS} m. [plan.md]"
            f"(plan.md) has SORRT* and BFMT* too. Planned at: {commits(planned_rows)}.",
            "## All maps",
            "The last column counts the queries whose route is cheaper, and dearer, by more than "
            f"{SAME} % than that of `auto`; finding none is the dearest.",
            table(by_planner, table_by_planner(rows), words=2),
            "## The best by size of map",
            "By cells of the lattice: small up to 20 000, middle up to 60 000. The best found most "
            f"routes; of those that did, it has the least 90th percentile of gaps, in steps of "
            f"{SAME} %; of those, it is the fastest.",
            table(("setting", "map", "planner", "maps", *COLUMNS), table_by_size(rows), words=3),
            "## The best on each map",
            table(
                ("map", *settings(), "cells", "lattice built in s"),
                by_map,
                words=1 + len(settings()),
            ),
        ]
    )
    report("The chosen planner", LIBRARIES, body, args.out)


if __name__ == "__main__":
    main()
