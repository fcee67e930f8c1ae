"""Cost of the objective: states and motions per second, and the remaining iterations of RRT*.

RRT* is run with OMPL's built-in path length, with a path length of three lines of Python, and with
the ambiguity objective in turn: in our set-up, and in that of a stranger, who has a checker in
Python and leaves RRT* as it is.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from harness import arguments, interleave, option, report, spread, table
from ompl import base as ob
from ompl import geometric as og
from plan_case import pairs, service

from ambinav.geometry.motion.steering import Steering
from ambinav.service.service import AmbiguityService
from ambinav_planners import AmbiguityObjective, RoutePlanner
from ambinav_planners.ompl_setup import prepare
from ambinav_planners.registry import planner
from ambinav_planners.search.lattice_graph import lattice_of
from ambinav_planners.spaces import make_space, new_state

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
    runs: dict[str, Any] = {"states: `service.cost`": lambda: cost.cost(states[:, 0], states[:, 1])}
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


class ThreeLines(ob.PathLengthOptimizationObjective):  # type: ignore[misc]
    """Path length in Python, the least that any objective in Python can do."""

    def __init__(self, si: ob.SpaceInformation) -> None:
        super().__init__(si)

    def motionCost(self, a: Any, b: Any) -> ob.Cost:  # noqa: N802 (OMPL's name)
        """Return the length of a motion."""
        return ob.Cost(math.hypot(b[0] - a[0], b[1] - a[1]))


def ours(robot: RoutePlanner, start: Any, goal: Any) -> tuple[og.SimpleSetup, Any]:
    """Return the set-up and the RRT* of `RoutePlanner`."""
    setup = prepare(robot.problem(start, goal))
    make = planner("rrtstar").make
    assert make is not None
    return setup.simple, make(setup.si)


def strangers(robot: RoutePlanner, start: Any, goal: Any) -> tuple[og.SimpleSetup, Any]:
    """Return a set-up with a checker in Python over cells, and OMPL's RRT* as it is."""
    low, bottom, right, top = robot.checker.environment.bounds
    spacing = robot.service.map.spacing
    x, y = (float(robot.service.map.dataset[axis].values[0]) for axis in "xy")
    free = (lattice_of(robot.service, robot.checker).cell >= 0).tolist()
    rows, columns = len(free), len(free[0])

    def is_free(state: Any) -> bool:
        row, column = round((state[1] - y) / spacing), round((state[0] - x) / spacing)
        return bool(0 <= row < rows and 0 <= column < columns and free[row][column])

    simple = og.SimpleSetup(make_space(Steering(), (low, bottom, right, top)))
    simple.setStateValidityChecker(is_free)
    si = simple.getSpaceInformation()
    simple.setStartAndGoalStates(*(new_state(si, tuple(p), False) for p in (start, goal)))
    return simple, og.RRTstar(si)


SETUPS: dict[str, Callable[..., tuple[og.SimpleSetup, Any]]] = {
    "ours": ours, "a stranger's": strangers,
}  # fmt: skip
OBJECTIVES: dict[str, Callable[..., ob.OptimizationObjective]] = {
    "path length": lambda si, _: ob.PathLengthOptimizationObjective(si),
    "three lines": lambda si, _: ThreeLines(si),
    "ambiguity": AmbiguityObjective,
}


def ratio_rows(name: str, rounds: int, seconds: float) -> list[tuple[str, ...]]:
    """Return the iterations of RRT* with each objective in one environment, and their ratios."""
    robot = RoutePlanner(service(name), footprint=0.2)
    rows = []
    for how, make in SETUPS.items():
        counts: dict[str, list[int]] = {objective: [] for objective in OBJECTIVES}
        for start, goal in pairs(robot, rounds, seed=7):
            for objective, cost in OBJECTIVES.items():
                simple, rrt = make(robot, start, goal)
                si = simple.getSpaceInformation()
                simple.setOptimizationObjective(cost(si, robot.service))
                simple.setPlanner(rrt)
                stop = time.thread_time() + seconds
                simple.solve(
                    ob.PlannerTerminationCondition(lambda stop=stop: time.thread_time() > stop)
                )
                counts[objective].append(int(rrt.numIterations()))
        share = {
            peer: [a / b for a, b in zip(counts["ambiguity"], counts[peer], strict=True)]
            for peer in ("path length", "three lines")
        }
        rows.append(
            (name, how, *(spread(c, 0) for c in counts.values()), *map(spread, share.values()))
        )
    return rows


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
    header = (
        "environment", "set-up", *OBJECTIVES, "ambiguity / path length", "ambiguity / three lines",
    )  # fmt: skip
    body = "\n\n".join(
        [
            f"Cost field of {args.environments[0]}, 0.1 m, without headings.",
            batch_table(cost, robot, args.repeats),
            call_table(robot, start, goal, args.repeats),
            f"## Iterations of RRT* in {args.seconds:g} s of a processor",
            "OMPL's built-in path length, a path length of three lines of Python and the ambiguity "
            f"objective in turn, {args.rounds} pairs of places each: median (extremes). Our set-up "
            "has compiled checks and few neighbours; a stranger's has a checker in Python and "
            "OMPL's defaults.",
            table(header, rows, words=2),
        ]
    )
    report("The objective", LIBRARIES, body, args.out)


if __name__ == "__main__":
    main()
