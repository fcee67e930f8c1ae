"""Cost of the objective: states and motions per second, and the remaining iterations of RRT*.

RRT* is run with OMPL's built-in path length and with the ambiguity objective in turn, both with
our motion validator and the same number of neighbours.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from harness import arguments, interleave, option, report, spread, table
from ompl import base as ob
from plan_case import pairs, service

from ambinav.geometry.motion.steering import Steering
from ambinav.service.service import AmbiguityService
from ambinav_planners import RoutePlanner
from ambinav_planners.ompl_setup import Setup, prepare
from ambinav_planners.registry import planner
from ambinav_planners.spaces import new_state

LIBRARIES = ("ambinav", "numba", "numpy", "ompl")
STATES, MOTIONS, CALLS = 4_000_000, 200_000, 100_000
REACH = 2.0
SPACES = (
    Steering("r2"), Steering("se2"), Steering("dubins", 0.5), Steering("reeds-shepp", 0.5),
)  # fmt: skip


def poses_of(robot: RoutePlanner, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draw random poses over the building."""
    xmin, ymin, xmax, ymax = robot.checker.environment.bounds
    low, high = (xmin, ymin, -np.pi), (xmax, ymax, np.pi)
    return rng.uniform(low, high, size=(count, 3))


def batch_table(cost: AmbiguityService, robot: RoutePlanner, repeats: int) -> str:
    """Return millions of states and motions per second, on all cores."""
    rng = np.random.default_rng(1)
    states = poses_of(robot, STATES, rng)
    a = poses_of(robot, MOTIONS, rng)
    b = a + rng.normal(0.0, REACH / 2.0, size=a.shape)
    runs: dict[str, Any] = {
        "states: `service.cost`": lambda: cost.cost(states[:, 0], states[:, 1]),
    }
    runs |= {
        f"motions of about {REACH:g} m, {s.space}: `service.motion_costs`": (
            lambda s=s: cost.motion_costs(a, b, s)
        )
        for s in SPACES
    }
    timings = interleave(runs, repeats)
    rows = [
        (name, timing.rate(STATES if name.startswith("states") else MOTIONS))
        for name, timing in timings.items()
    ]
    return table(("in batch", "million a second: median (extremes)"), rows)


def call_table(robot: RoutePlanner, start: Any, goal: Any, repeats: int) -> str:
    """Return thousands of calls per second of the functions that OMPL calls, from Python."""
    setup = prepare(robot.problem(start, goal))
    a = new_state(setup.si, tuple(start), False)
    b = new_state(setup.si, (start[0] + 0.7, start[1] + 0.3, 0.0), False)
    validator = setup.si.getMotionValidator()
    runs = {
        "`motionCost`, 0.8 m": lambda: _repeat(setup.objective.motionCost, a, b),
        "`checkMotion`, 0.8 m": lambda: _repeat(validator.checkMotion, a, b),
    }
    timings = interleave(runs, repeats)
    rows = [(name, timing.rate(CALLS)) for name, timing in timings.items()]
    return table(("one call at a time, r2", "million a second: median (extremes)"), rows)


def _repeat(function: Any, *arguments: Any) -> None:
    for _ in range(CALLS):
        function(*arguments)


def iterations(setup: Setup, seconds: float) -> int:
    """Return the iterations of RRT* in a given time."""
    make = planner("rrtstar").make
    assert make is not None
    rrt = make(setup.si)
    setup.simple.setPlanner(rrt)
    end = time.perf_counter() + seconds
    setup.simple.solve(ob.PlannerTerminationCondition(lambda: time.perf_counter() > end))
    return int(rrt.numIterations())


def ratio_rows(name: str, rounds: int, seconds: float) -> list[tuple[str, ...]]:
    """Return the iterations with each objective in one environment, and their ratio."""
    robot = RoutePlanner(service(name), footprint=0.2)
    ours, built_in = [], []
    for start, goal in pairs(robot, rounds, seed=7):
        setup = prepare(robot.problem(start, goal))
        ours.append(iterations(setup, seconds))
        setup = prepare(robot.problem(start, goal))
        setup.simple.setOptimizationObjective(ob.PathLengthOptimizationObjective(setup.si))
        built_in.append(iterations(setup, seconds))
    share = [a / b for a, b in zip(ours, built_in, strict=True)]
    return [(name, spread(built_in, 0), spread(ours, 0), spread(share))]


def main() -> None:
    """Measure and report."""
    args = arguments(
        __doc__,
        repeats=7,
        rounds=option(5, "pairs of places for RRT*"),
        seconds=option(2.0, "of each run of RRT*"),
        environments=["willow_full_005", "aces", "demo"],
    )
    cost = service(args.environments[0])
    robot = RoutePlanner(cost, footprint=0.2)
    start, goal = pairs(robot, 1, seed=7)[0]
    rows = [
        row for name in args.environments for row in ratio_rows(name, args.rounds, args.seconds)
    ]
    header = ("environment", "path length", "ambiguity", "ambiguity / path length")
    body = "\n\n".join(
        [
            f"Cost field of {args.environments[0]}, 0.1 m, without headings.",
            batch_table(cost, robot, args.repeats),
            call_table(robot, start, goal, args.repeats),
            f"## Iterations of RRT* in {args.seconds:g} s\n\nOMPL's built-in path length and the "
            f"ambiguity objective in turn, {args.rounds} pairs of places each, the same validator "
            "and number of neighbours: median (extremes).",
            table(header, rows),
        ]
    )
    report("The objective", LIBRARIES, body, args.out)


if __name__ == "__main__":
    main()
