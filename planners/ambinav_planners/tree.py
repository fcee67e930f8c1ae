"""OMPL's anytime tree planners: RRT*, Informed RRT*, SORRT*, BIT*."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ompl import base as ob
from ompl import geometric as og

from ambinav_planners.ompl_setup import GOAL_TOLERANCE, Watch, found_poses, prepare
from ambinav_planners.problem import Problem
from ambinav_planners.registry import SYMMETRIC_SPACES, Budget, Planner, PlannerResult

# Neighbours that RRT* tries are rewire_factor 2^(d+1) e (1 + 1/d) log n in OMPL, some 300 in the
# plane, and each is a call from C++ into Python. This makes them e (1 + 1/d) log n, just above the
# bound of Karaman and Frazzoli (2011), theorem 38: with it the tree grows five times as fast.
ABOVE_THE_BOUND = 1.001


def _rrt(make: Callable[[ob.SpaceInformation], Any]) -> Callable[[ob.SpaceInformation], Any]:
    def configured(si: ob.SpaceInformation) -> Any:
        planner = make(si)
        planner.setRewireFactor(ABOVE_THE_BOUND / 2.0 ** (si.getStateDimension() + 1))
        return planner

    return configured


def _solver(
    make: Callable[[ob.SpaceInformation], Any],
    make_without_ellipse: Callable[[ob.SpaceInformation], Any] | None = None,
) -> Callable[[Problem, Budget], PlannerResult]:
    def solve(problem: Problem, budget: Budget) -> PlannerResult:
        watch = Watch(budget)
        setup = prepare(problem)
        chosen = make
        # OMPL's informed samplers raise where start and goal are one place, at other headings.
        if make_without_ellipse is not None and math.dist(*problem.ends[:, :2]) <= GOAL_TOLERANCE:
            chosen = make_without_ellipse
        planner = chosen(setup.si)
        setup.simple.setPlanner(planner)
        setup.simple.solve(watch.condition(planner.bestCost, planner.numIterations))
        watch.note(planner.bestCost().value())
        return PlannerResult(found_poses(setup), tuple(watch.curve), int(planner.numIterations()))

    return solve


def _rrt_star(name: str, make: Callable[[Any], Any], text: str) -> Planner:
    """Return a kind of RRT*; OMPL's rewiring assumes that the reverse path has the same cost."""
    make = _rrt(make)
    solve = _solver(make, _rrt(og.RRTstar))
    return Planner(name, solve, text, "samples", SYMMETRIC_SPACES, one_way=False, make=make)


RRTSTAR = _rrt_star("rrtstar", og.RRTstar, "RRT* (Karaman and Frazzoli 2011)")
INFORMED_RRTSTAR = _rrt_star(
    "informed-rrtstar",
    og.InformedRRTstar,
    "Informed RRT*: samples only what can still be better (Gammell et al. 2014)",
)
SORRTSTAR = _rrt_star(
    "sorrtstar",
    og.SORRTstar,
    "Informed RRT* with samples sorted by what they promise (Gammell et al. 2015)",
)
BITSTAR = Planner(
    "bitstar",
    _solver(og.BITstar),
    "BIT*: batches of samples searched in order of promise (Gammell et al. 2015)",
    iteration="edges",
    make=og.BITstar,
)
