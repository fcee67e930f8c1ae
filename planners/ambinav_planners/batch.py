"""OMPL's FMT* and BFMT*, run with more and more samples until the time is over."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ompl import base as ob
from ompl import geometric as og

from ambinav_planners.ompl_setup import Watch, found_poses, prepare
from ambinav_planners.problem import Problem
from ambinav_planners.registry import SYMMETRIC_SPACES, Budget, Planner, PlannerResult

FIRST_SAMPLES = 500
# With twice as many, OMPL's neighbourhoods would fill the memory.
MOST_SAMPLES = 1_000_000


def _solver(
    make: Callable[[ob.SpaceInformation], Any],
) -> Callable[[Problem, Budget], PlannerResult]:
    def solve(problem: Problem, budget: Budget) -> PlannerResult:
        """Solve with 500 samples, then twice as many, and so on; keep the best path.

        A budget of iterations is the number of samples of one single run.
        """
        watch = Watch(budget)
        samples = FIRST_SAMPLES if budget.iterations is None else budget.iterations
        best, least, most = None, float("inf"), None
        while not watch.over:
            setup = prepare(problem)
            planner = make(setup.si)
            planner.setNumSamples(samples)
            # Otherwise it would continue sampling, and the number of samples would mean nothing.
            planner.setExtendedFMT(False)
            setup.simple.setPlanner(planner)
            setup.simple.solve(ob.PlannerTerminationCondition(lambda: watch.over))
            poses = found_poses(setup)
            if poses is not None:
                cost = problem.service.route_cost(poses, problem.steering)
                watch.note(cost)
                if cost < least:
                    best, least = poses, cost
            if not watch.over:
                most = samples
            if budget.iterations is not None or samples > MOST_SAMPLES:
                break
            samples *= 2
        return PlannerResult(best, tuple(watch.curve), most)

    return solve


def _fmt(name: str, make: Callable[[Any], Any], text: str) -> Planner:
    return Planner(name, _solver(make), text, "samples", SYMMETRIC_SPACES, one_way=False, make=make)


FMT = _fmt("fmt", og.FMT, "FMT*, with doubled numbers of samples (Janson et al. 2015)")
BFMT = _fmt(
    "bfmt", og.BFMT, "FMT* from both ends, with doubled numbers of samples (Starek et al. 2015)"
)
