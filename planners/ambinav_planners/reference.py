"""The yardstick: the cheapest way over the map's lattice, finished at any angle."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from ambinav_planners.graph import MotionGraph
from ambinav_planners.lattice_graph import lattice_of
from ambinav_planners.limited_search import limited_search
from ambinav_planners.problem import Problem
from ambinav_planners.registry import Budget, Found, Planner, register
from ambinav_planners.stretches import bad_stretches


def cheapest_within(graph: MotionGraph, problem: Problem) -> NDArray[np.intp] | None:
    """Nodes of the cheapest way that keeps the problem's limit on bad metres in a row.

    Start and goal are the graph's last two nodes.
    """
    limit = problem.limit
    if limit is None:
        raise ValueError("the problem has no limit")
    stretches = bad_stretches(graph, problem.service.ambiguity, limit.level)
    count = len(graph.poses)
    way = limited_search(
        graph, graph.cost(problem.service.weight), stretches, limit.metres, count - 2, count - 1
    )
    return None if way is None else way.nodes


def cheapest_on(graph: MotionGraph, problem: Problem) -> NDArray[np.float64] | None:
    """Way points of the cheapest way between the graph's last two nodes, shape (N, 3), or None.

    It keeps the problem's limit, if there is one.
    """
    count = len(graph.poses)
    nodes = (
        graph.cheapest(count - 2, count - 1, problem.service.weight)
        if problem.limit is None
        else cheapest_within(graph, problem)
    )
    return None if nodes is None else graph.steering.oriented(graph.poses[nodes])


def solve_reference(problem: Problem, budget: Budget) -> Found:
    """Dijkstra on the lattice, whatever time it takes."""
    started = time.perf_counter()
    lattice = lattice_of(problem.service, problem.checker)
    poses = cheapest_on(lattice.with_ends(problem.ends, problem.checker), problem)
    if poses is None:
        return Found(None)
    cost = problem.service.route_cost(poses, problem.steering)
    return Found(poses, ((time.perf_counter() - started, cost),))


register(
    Planner(
        "reference",
        solve_reference,
        "Dijkstra over the map's lattice in 32 directions, finished at any angle",
        spaces=("r2",),
        uses_ompl=False,
        keeps_limit=True,
    )
)
