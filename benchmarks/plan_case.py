"""One environment of `bench_plan.py`: pairs of points, planners, times.

A line of JSON for each route, appended to a file; what is there is not planned again, so it can be
stopped at any time and goes on where it was. It runs in a process of its own, on one thread, so
that two environments run at a time on two cores.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from harness import appended, environment_of, kept_rows
from lasers import laser

from ambinav.map_building.build import build_map
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners import RoutePlanner, pareto
from ambinav_planners.search.lattice_graph import lattice_of

RADIUS = 0.2
WEIGHT = 5.0
LEAST_APART = 8.0
"""Metres between start and goal, as the crow flies; in small places half of their diagonal."""
FRONT = (0.0, 0.25, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, 40.0)


def main() -> None:
    """Plan the missing routes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("environment")
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--seconds", type=float, nargs="*", default=[1.0, 5.0])
    parser.add_argument("--planners", nargs="+", required=True)
    parser.add_argument("--front", action="store_true", help="the trade for each pair as well")
    parser.add_argument("--folder", type=Path, default=Path("out/plan"))
    args = parser.parse_args()
    path = plans_path(args.folder, args.environment, args)
    with appended(path) as append:
        finished = {(row["pair"], row["planner"], row["budget"]) for row in kept_rows(path)}
        pending = [job for job in jobs(args) if job not in finished]
        if not pending:
            return
        robot = RoutePlanner(service(args.environment), footprint=RADIUS)
        places = pairs(robot, args.pairs, args.seed)
        for pair, planner, budget in pending:
            row = {"pair": pair, "planner": planner, "budget": budget}
            append({**row, **planned(robot, *places[pair], planner, budget)})


def plans_path(folder: Path, environment: str, args: argparse.Namespace) -> Path:
    """Return the file of an environment's routes; further ones are appended to it."""
    return folder / f"{environment}_seed-{args.seed}_plans.jsonl"


def jobs(args: argparse.Namespace) -> list[tuple[int, str, float]]:
    """Return all plans to make: pair, planner and seconds (0 without a time limit)."""
    first = ["reference", "shortest", *["front"] * args.front]
    todo = []
    for pair in range(args.pairs):
        todo += [(pair, name, 0.0) for name in first]
        todo += [(pair, name, seconds) for seconds in args.seconds for name in args.planners]
    return todo


def planned(
    robot: RoutePlanner, start: Any, goal: Any, planner: str, budget: float
) -> dict[str, Any]:
    """Return the figures of a route, or the list of them for a front."""
    if planner == "front":
        points = pareto(robot, start, goal, weights=FRONT).points
        return {"routes": [figures(point.route) for point in points]}
    if planner in ("reference", "shortest"):
        weight = WEIGHT if planner == "reference" else 0.0
        return figures(robot.plan(start, goal, planner_name="reference", weight=weight))
    try:
        return figures(robot.plan(start, goal, planner_name=planner, seconds=budget))
    except InputError:
        return {"cost": None}


def service(name: str) -> AmbiguityService:
    """Return the cost of the environment for 60 beams of 4 m, every 0.1 m."""
    amap = build_map(environment_of(name), laser(), store=False)
    return AmbiguityService(amap, weight=WEIGHT)


def pairs(robot: RoutePlanner, count: int, seed: int) -> list[tuple[Any, Any]]:
    """Return starts and goals: explored cells of the largest connected part, some way apart."""
    lattice = lattice_of(robot.service, robot.checker)
    parts = lattice.graph.components()
    largest = np.bincount(parts).argmax()
    rows, columns = np.nonzero((lattice.cell >= 0) & ~robot.service.map.unexplored)
    nodes = lattice.cell[rows, columns]
    places = lattice.graph.poses[nodes[parts[nodes] == largest]]
    min_distance = min(LEAST_APART, 0.5 * float(np.hypot(*np.ptp(places[:, :2], axis=0))))
    rng = np.random.default_rng(seed)
    chosen: list[tuple[Any, Any]] = []
    while len(chosen) < count:
        start, goal = places[rng.integers(len(places), size=2)]
        if np.hypot(*(goal - start)[:2]) >= min_distance:
            chosen.append((start, goal))
    return chosen


def figures(route: Route) -> dict[str, Any]:
    """Return a route's figures."""
    return {
        "weight": route.weight,
        "cost": route.cost,
        "length": route.length,
        "exposure": route.exposure,
        "bad": route.bad_metres,
        "longest_bad": route.longest_bad,
        "corridor": route.corridor_metres,
        "longest_corridor": route.longest_corridor,
        "open": route.open_metres,
        "longest_open": route.longest_open,
        "seconds": route.seconds,
        "first": route.first_seconds,
        "iterations": route.iterations,
    }


if __name__ == "__main__":
    main()
