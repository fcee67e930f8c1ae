"""The trade between length and ambiguity: one route for every weight, on the same samples."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ambinav.config import check_kind
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.pareto import ParetoFront, ParetoPoint
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav_planners.improve.finishing import finish
from ambinav_planners.planning import RoutePlanner, not_found_error, planner_name_or_default
from ambinav_planners.problem import Problem
from ambinav_planners.reference import found_on, reference_graph
from ambinav_planners.registry import Budget, Planner, PlannerResult, check_suits, planner
from ambinav_planners.search.cheapest import cheapest_on
from ambinav_planners.search.graph import MotionGraph
from ambinav_planners.search.reachability import check_reachable
from ambinav_planners.seeded import call_seeded

WEIGHTS = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0)
"""Weights of a front if none are given."""

# A route of another weight is taken if it is cheaper by more than this share: above rounding.
CLEARLY = 1e-9


def pareto(
    robot: RoutePlanner,
    start: Sequence[float],
    goal: Sequence[float],
    *,
    weights: Sequence[float] = WEIGHTS,
    planner_name: str | None = None,
    seconds: float = 1.0,
    iterations: int | None = None,
    seed: int | None = None,
    improved: bool = True,
) -> ParetoFront:
    """Find the cheapest route for each weight.

    With the planners reference and prmstar all weights are searched on one graph, so the routes
    differ only by their weight. Other planners plan again for every weight. If the route of one
    weight is cheaper at another weight than the route found for that, it replaces it, so length
    does not decrease and exposure does not increase with the weight.

    Args:
        robot: The robot and its cost service.
        start: x, y and, if it matters, theta.
        goal: As `start`.
        weights: At least two weights, 0 or more.
        planner_name: See `RoutePlanner.plan`.
        seconds: Time for the graph, or for each weight.
        iterations: As in `RoutePlanner.plan`.
        seed: As in `RoutePlanner.plan`.
        improved: As in `RoutePlanner.plan`.

    Raises:
        InputError: fewer than two weights, or what `RoutePlanner.plan` refuses.
    """
    check_kind(robot, RoutePlanner, "robot")
    if robot.priced_graph is not None:
        raise InputError("a front is of routes over all free floor; leave route_graph out.")
    ordered = sorted(set(weights))
    if len(ordered) < 2:
        raise InputError(f"weights are {list(weights)}; a front needs at least two different ones.")
    planner_name = planner_name_or_default(
        planner_name, robot.checker, iterations, keeps_lanes=robot.one_way is not None
    )
    chosen = planner(planner_name)
    budget = Budget(seconds, iterations, seed)
    problems = [robot.problem(start, goal, weight) for weight in ordered]
    check_suits(chosen, problems[0], budget)
    if planner_name in ("reference", "prmstar"):
        graph = _graph(planner_name, problems[0], budget)
        routes = [_cheapest_route(graph, problem, chosen, budget, improved) for problem in problems]
    else:
        routes = [
            robot.plan(
                start,
                goal,
                planner_name=planner_name,
                weight=weight,
                seconds=seconds,
                iterations=iterations,
                seed=seed,
                improved=improved,
            )
            for weight in ordered
        ]
    return ParetoFront(
        tuple(
            ParetoPoint(
                problem.service.weight,
                _cheapest_of(routes, planned, problem) if chosen.minimises_cost else planned,
            )
            for planned, problem in zip(routes, problems, strict=True)
        )
    )


def _cheapest_route(
    graph: MotionGraph, problem: Problem, chosen: Planner, budget: Budget, improved: bool
) -> Route:
    """Return the cheapest route over a graph between its last two nodes."""
    started = time.perf_counter()
    result = (
        found_on(graph, problem, started)
        if chosen.name == "reference"
        else _found_on(graph, problem, started)
    )
    if result.poses is None:
        check_reachable(problem)
        raise not_found_error(chosen, problem, budget)
    result = replace(result, seconds=time.perf_counter() - started)
    return finish(chosen, problem, result, budget.seed, improved=improved)


def _found_on(graph: MotionGraph, problem: Problem, started: float) -> PlannerResult:
    """Return the cheapest path over a roadmap as a planner's result."""
    poses = cheapest_on(graph, problem)
    if poses is None:
        return PlannerResult(None)
    cost = problem.service.route_cost(poses, problem.steering)
    return PlannerResult(poses, ((time.perf_counter() - started, cost),))


def _cheapest_of(routes: list[Route], planned: Route, problem: Problem) -> Route:
    """Return the cheapest route at a problem's weight; its own if none is clearly cheaper."""
    costs = [problem.service.route_cost(route.poses, problem.steering) for route in routes]
    best = int(np.argmin(costs))
    if not costs[best] < planned.cost * (1.0 - CLEARLY):
        return planned
    cheapest = routes[best]
    return evaluate_route(
        problem.service,
        cheapest.poses,
        problem.steering,
        planner=cheapest.planner,
        seed=cheapest.seed,
        seconds=planned.seconds,
        first_seconds=planned.first_seconds,
        iterations=planned.iterations,
        curve=(*planned.curve, (planned.seconds, costs[best])),
        covariances=cheapest.covariances,
    )


def _graph(name: str, problem: Problem, budget: Budget) -> MotionGraph:
    if name == "reference":
        return reference_graph(problem)
    from ambinav_planners.roadmap import grown_graph

    return call_seeded(budget.seed, grown_graph, problem, budget)
