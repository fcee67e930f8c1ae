"""Belief-aware planners in the registry: over position and deviation, and the belief roadmap."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from ambinav.forecasting.information_field import InformationField
from ambinav_planners.belief.lattice_search import Growth, belief_search
from ambinav_planners.belief.roadmap import BeliefRoadmap
from ambinav_planners.belief.roadmap_search import search_roadmap
from ambinav_planners.problem import Problem
from ambinav_planners.registry import Budget, Planner, PlannerResult
from ambinav_planners.search.lattice_graph import lattice_of

# A metre of deviation at the goal counts as so many metres at weight 1.
METRES_PER_METRE = 10.0
# Part of the time that goes into the roadmap; filter and search take about twice as long.
GROWING_SHARE = 1.0 / 3.0
# Paths to a node whose variances differ by less than this share count as one.
TOLERANCE = 0.02


def solve_belief(problem: Problem, budget: Budget) -> PlannerResult:
    """Search the lattice over position and standard deviation, without a time limit.

    What is least is the integral of 1 + weight * deviation / 0.5 m over the length.
    """
    if problem.belief.std > problem.belief.max_std:
        return PlannerResult(None)
    started = time.perf_counter()
    graph = lattice_of(problem.service, problem.checker).with_ends(problem.ends, problem.checker)
    model = replace(problem.belief, weight=problem.service.weight)
    growth = Growth.of(graph, InformationField.of(problem.service.map), model, problem.odometry)
    start, goal = len(graph.poses) - 2, len(graph.poses) - 1
    path = belief_search(graph, growth, model, start, goal, tolerance=TOLERANCE)
    if path is None:
        return PlannerResult(None)
    covariances = np.zeros((len(path.std), 3, 3))
    covariances[:, 0, 0] = covariances[:, 1, 1] = path.std**2
    poses = graph.steering.oriented(graph.poses[path.path.nodes])
    cost = problem.service.route_cost(poses, problem.steering)
    return PlannerResult(
        poses,
        ((time.perf_counter() - started, cost),),
        path.path.labels,
        covariances,
        finished=True,
    )


def solve_belief_roadmap(problem: Problem, budget: Budget) -> PlannerResult:
    """Grow a PRM* until the time is over, then search it for a short path that ends well known.

    What is least is the length plus 10 * weight times the deviation of the position at the goal, in
    its weak direction. Growing gets a third of the time; what the search takes is not limited.
    """
    if problem.belief.std > problem.belief.max_std:
        return PlannerResult(None)
    # Imported here because it needs OMPL, unlike the other planner.
    from ambinav_planners.roadmap import grown_graph

    started = time.perf_counter()
    graph = grown_graph(problem, replace(budget, seconds=GROWING_SHARE * budget.seconds))
    roadmap = BeliefRoadmap.of(
        graph,
        InformationField.of(problem.service.map),
        problem.odometry,
        scan_distance=problem.belief.scan_distance,
    )
    belief = problem.belief
    covariance = np.diag(np.square(belief.start_std))
    start, goal = len(graph.poses) - 2, len(graph.poses) - 1
    path = search_roadmap(
        roadmap,
        start,
        goal,
        covariance,
        weight=METRES_PER_METRE * problem.service.weight,
        max_std=belief.max_std,
        max_goal_std=belief.max_goal_std,
        tolerance=TOLERANCE,
    )
    if path is None:
        return PlannerResult(None)
    poses = graph.steering.oriented(graph.poses[path.path.nodes])
    cost = problem.service.route_cost(poses, problem.steering)
    return PlannerResult(
        poses,
        ((time.perf_counter() - started, cost),),
        len(graph.poses) - 2,
        path.covariances,
        finished=True,
    )


BELIEF = Planner(
    "belief",
    solve_belief,
    "least cost over position and its deviation (after Gonzalez and Stentz; Roy and Thrun)",
    iteration="labels",
    spaces=("r2",),
    uses_ompl=False,
    minimises_cost=False,
    uses_budget=False,
)
BELIEF_ROADMAP = Planner(
    "belief-roadmap",
    solve_belief_roadmap,
    "the path on a PRM* that ends best localized (after Prentice and Roy 2009)",
    iteration="milestones",
    minimises_cost=False,
)
