"""Routes over occupied cells: planned on fitted segments, and on the collision geometry.

On every occupancy map of the data folder the reference plans the same pairs of places twice: with
the fitted segments alone ("before"), and with the collision geometry ("after"). Every route is
checked on the map's raw cells, by code that the planners do not use. Speeds are ratios, measured
in turn.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from harness import ROOT, add_out, interleave, report, spread, table
from numpy.typing import NDArray
from ompl import base as ob
from scipy import ndimage

from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.map_server import load_map_server
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.lattice import Lattice
from ambinav.geometry.motion.steering import Steering
from ambinav.map_building.build import build_map
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav_planners import RoutePlanner
from ambinav_planners.ompl_setup import prepare
from ambinav_planners.planning import NotFoundError
from ambinav_planners.registry import planner
from ambinav_planners.search.lattice_graph import lattice_of
from ambinav_planners.search.reachability import NoPathError

sys.path.insert(0, str(ROOT))
from tests.buildings.raw_intrusion import ROUNDING, route_intrusion

LIBRARIES = ("ambinav", "numba", "numpy", "ompl", "shapely")
FOLDERS = ("maps", "maps_from_logs", "maps_research_only", "planner_maps")
TIMED = ("willow_full_005", "stata_hallways_5cm", "aces", "ipa_office_h_furnitures", "f1_vegas")
RADIUS, SPACING, MOST_CELLS = 0.2, 0.1, 60_000
# Cells above this, metres, make doors that a lattice coarser than they are would miss.
COARSE = 0.3
WIDTH_STEP, WIDTH_CELLS, WIDEST = 0.1, 1_000_000, 2.0
MOTIONS = 60_000
Row = tuple[Any, ...]


def robots(environment: Environment, radius: float, cell: float) -> dict[str, RoutePlanner]:
    """Return two planners for a map: on the fitted segments, and on the collision geometry."""
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.01)
    scanner = RangeScanner.planar(sensor=sensor, beams=36, aperture=2.0 * math.pi)
    fair = max(SPACING, math.sqrt(environment.free.area / MOST_CELLS))
    step = cell if cell > COARSE else fair
    amap = build_map(environment, scanner, spacing=step, radius=2.0 * step, store=False)
    made = {name: RoutePlanner(amap, footprint=radius) for name in ("before", "after")}
    footprint = made["before"].checker.footprint
    made["before"].checker = CollisionChecker(
        environment, footprint, Steering("r2"), simulated=True
    )
    return made


def pairs(robot: RoutePlanner, count: int, rng: np.random.Generator) -> list[NDArray[Any]]:
    """Return pairs of points on the largest connected part of the floor."""
    graph = lattice_of(robot.service, robot.checker).graph
    parts = graph.components()
    places = graph.poses[parts == np.bincount(parts).argmax()]
    return [places[rng.integers(len(places), size=2)] for _ in range(count)]


def widest(environment: Environment, ends: list[NDArray[Any]], step: float) -> list[float]:
    """Return the radius of the largest disc that gets from start to goal over a lattice, metres."""
    lattice = Lattice.over(environment, step)
    room = np.zeros(lattice.free.shape)
    room[lattice.free] = lattice.clearance(WIDEST)
    radii = []
    for pair in ends:
        columns = np.rint((pair[:, 0] - lattice.x[0]) / step).astype(int)
        rows = np.rint((pair[:, 1] - lattice.y[0]) / step).astype(int)
        low, high = 0.0, WIDEST
        for _ in range(10):
            middle = 0.5 * (low + high)
            fits = room >= middle
            # Start and goal may stand nearer to a wall.
            for row, column in zip(rows, columns, strict=True):
                fits[row - 1 : row + 2, column - 1 : column + 2] = True
            label, _ = ndimage.label(fits, np.ones((3, 3)))
            joined = label[rows[0], columns[0]] == label[rows[1], columns[1]]
            low, high = (middle, high) if joined else (low, middle)
        radii.append(low)
    return radii


def map_rows(path: Path, count: int, seed: int) -> tuple[Row, dict[str, list[float]]]:
    """Return a map's line of the table, and the intrusions of its routes, metres."""
    grid = load_map_server(path)
    environment = environment_from_grid(grid)
    radius = RADIUS * max(1.0, 2.0 * grid.resolution)
    made = robots(environment, radius, grid.resolution)
    ends = pairs(made["before"], count, np.random.default_rng(seed))
    missing = {"no place": 0, "no path": 0, "no path over the lattice": 0}
    deep: dict[str, list[float]] = {}
    metres: dict[str, list[float]] = {}
    for name, robot in made.items():
        deep[name], metres[name] = [], []
        for start, goal in ends:
            try:
                route = robot.plan(start, goal, planner_name="reference")
            except InputError as error:
                metres[name].append(math.nan)
                if name == "after":
                    missing[reason(error)] += 1
                continue
            metres[name].append(route.length)
            deep[name].append(
                route_intrusion(grid, robot.checker.footprint, Steering("r2"), route.poses)
            )
    step = max(WIDTH_STEP, math.sqrt(environment.free.area / WIDTH_CELLS))
    narrower = np.subtract(
        widest(environment, ends, step), widest(environment.collision, ends, step)
    )
    longer = np.array(metres["after"]) / np.array(metres["before"]) - 1.0
    drivable = environment.collision.free.area
    row = (
        path.stem,
        count,
        *(f"{sum(d > ROUNDING for d in deep[name])} / {len(deep[name])}" for name in made),
        *(f"{100.0 * max(deep[name], default=0.0):.2f}" for name in made),
        ", ".join(f"{many} {why}" for why, many in missing.items() if many) or "-",
        f"{100.0 * np.median(narrower):.1f} ({100.0 * narrower.max():.1f})",
        "-" if np.isnan(longer).all() else f"{100.0 * np.nanmedian(longer):.2f}",
        f"{100.0 * (1.0 - drivable / environment.free.area):.2f}",
        f"{len(environment.segments)} / {len(environment.collision.segments)}",
    )
    return row, deep


def reason(error: InputError) -> str:
    """Return why there is no route: the robot does not fit at its ends, or there is no path."""
    if isinstance(error, NoPathError):
        return "no path"
    return "no path over the lattice" if isinstance(error, NotFoundError) else "no place"


def iterations(robot: RoutePlanner, start: Any, goal: Any, seconds: float) -> int:
    """Return the iterations of RRT* in a given time."""
    setup = prepare(robot.problem(start, goal))
    make = planner("rrtstar").make
    assert make is not None
    rrt = make(setup.si)
    setup.simple.setPlanner(rrt)
    end = time.perf_counter() + seconds
    setup.simple.solve(ob.PlannerTerminationCondition(lambda: time.perf_counter() > end))
    return int(rrt.numIterations())


def speed_row(path: Path, repeats: int, seconds: float) -> Row:
    """Return the speed ratios, after to before, of a map's checks and planners."""
    grid = load_map_server(path)
    environment = environment_from_grid(grid)
    made = robots(environment, RADIUS, grid.resolution)
    rng = np.random.default_rng(1)
    xmin, ymin, xmax, ymax = environment.bounds
    a = rng.uniform((xmin, ymin, 0), (xmax, ymax, 0), (MOTIONS, 3))
    a = a[made["after"].checker.poses_free(a)]
    b = a + rng.normal(0.0, (1.0, 1.0, 0.0), a.shape)
    motions = interleave(
        {name: lambda r=r: r.checker.motions_free(a, b) for name, r in made.items()}, repeats
    )
    build = interleave(
        {
            "before": lambda: CollisionChecker(
                _fresh(environment), Footprint.disc(RADIUS), Steering("r2"), simulated=True
            ),
            "after": lambda: CollisionChecker(
                _fresh(environment), Footprint.disc(RADIUS), Steering("r2")
            ),
        },
        repeats,
    )
    start, goal = pairs(made["after"], 1, rng)[0]
    plans = interleave(
        {
            name: lambda r=r: r.plan(start, goal, planner_name="reference")
            for name, r in made.items()
        },
        repeats,
    )
    counted: dict[str, list[int]] = {name: [] for name in made}
    for _ in range(repeats):
        for name, robot in made.items():
            counted[name].append(iterations(robot, start, goal, seconds))
    share = [x / y for x, y in zip(counted["after"], counted["before"], strict=True)]
    return (
        path.stem,
        f"{len(a) / motions['before'].median / 1e6:.2f}",
        motions["after"].ratio(motions["before"]),
        plans["after"].ratio(plans["before"]),
        spread(share),
        f"{build['before'].median:.2f} / {build['after'].median:.2f}",
    )


def _fresh(environment: Environment) -> Environment:
    """Return a copy of the environment without cached data."""
    return Environment(
        environment.segments, environment.free, name=environment.name, drivable=environment.drivable
    )


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=8, help="pairs of places on each map")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=1.0, help="of each run of RRT*")
    parser.add_argument("--maps", nargs="+", help="names; all that there are if not given")
    add_out(parser)
    args = parser.parse_args()
    folder = os.environ.get("AMBINAV_DATA")
    if not folder:
        print("bench_collision.py: set AMBINAV_DATA to the folder of maps.", file=sys.stderr)
        raise SystemExit(2)
    paths = [p for name in FOLDERS for p in sorted((Path(folder) / name).glob("*.yaml"))]
    paths = [p for p in paths if args.maps is None or p.stem in args.maps]
    rows, deep = [], {"before": [], "after": []}
    for path in paths:
        print(f"planning in {path.stem}", file=sys.stderr)
        row, intrusions = map_rows(path, args.pairs, args.seed)
        rows.append(row)
        for name, values in intrusions.items():
            deep[name] += values
    print("measuring speeds", file=sys.stderr)
    speeds = [speed_row(p, args.repeats, args.seconds) for p in paths if p.stem in TIMED]
    sums = [
        f"{sum(d > ROUNDING for d in deep[name])} of {len(deep[name])} routes {name} "
        f"(deepest {100.0 * max(deep[name], default=0.0):.2f} cm)"
        for name in deep
    ]
    body = "\n\n".join(
        [
            f"{len(paths)} maps, {args.pairs} pairs of places each, a disc of {RADIUS:g} m (0.4 m "
            "for each metre of cells above 0.5 m), planner `reference` at weight 5, cells of "
            f"{SPACING:g} m, or what makes {MOST_CELLS} of them, or the map's own above "
            f"{COARSE:g} m. Over occupied cells: {' and '.join(sums)}. Places are drawn where the "
            "robot fits before; missing after are the routes from or to a place where it covers an "
            "occupied cell (no place), those for which no path is left (no path), and those whose "
            "path is too narrow for the planner's lattice. Narrower: how much less the radius of "
            "the widest robot is that gets from start to goal, median (most).",
            table(
                (
                    "map", "pairs", "over cells before", "after", "deepest before cm", "after cm",
                    "missing after", "narrower cm", "longer %", "floor lost %",
                    "segments before / after",
                ),
                rows,
            ),
            "## Speed, after to before\n\nMedian (extremes) of runs in turn. Motions of about 1.2 "
            f"m; the reference with its lattice kept; iterations of RRT* in {args.seconds:g} s.",
            table(
                (
                    "map", "million motions / s before", "motions", "reference plans",
                    "RRT* iterations", "seconds to make a checker before / after",
                ),
                speeds,
            ),
        ]
    )  # fmt: skip
    report("Routes over occupied cells", LIBRARIES, body, args.out)


if __name__ == "__main__":
    main()
