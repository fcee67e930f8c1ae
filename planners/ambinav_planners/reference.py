"""The yardstick: the cheapest paths over the map's lattice, finished at any angle."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ambinav_planners.alternatives import alternative_paths
from ambinav_planners.cheapest import cheapest_within
from ambinav_planners.graph import MotionGraph
from ambinav_planners.lattice_graph import lattice_of
from ambinav_planners.limited_improve import improve_within
from ambinav_planners.problem import Problem
from ambinav_planners.registry import Budget, Found, Planner, register

# A path over the lattice is longer than the route that it becomes, by up to this share and so many
# spacings at its ends: its stretches on bad floor may be longer than the limit by as much.
LONGER, ENDS = 0.02, 2.0


def solve_reference(problem: Problem, budget: Budget) -> Found:
    """Search the lattice for paths, whatever time it takes."""
    started = time.perf_counter()
    lattice = lattice_of(problem.service, problem.checker)
    return found_on(lattice.with_ends(problem.ends, problem.checker), problem, started)


def found_on(graph: MotionGraph, problem: Problem, started: float) -> Found:
    """The cheapest path over a lattice and those that may become cheaper, start and goal last.

    Args:
        graph: The lattice with start and goal as its last two nodes.
        problem: What is planned.
        started: When the clock was started, of `time.perf_counter`.
    """
    paths = _alternatives(graph, problem) if problem.limit is None else _within(graph, problem)
    if not paths:
        return Found(None)
    cost = problem.service.route_cost(paths[0], problem.steering)
    return Found(paths[0], ((time.perf_counter() - started, cost),), alternatives=tuple(paths[1:]))


def _alternatives(graph: MotionGraph, problem: Problem) -> list[NDArray[np.float64]]:
    count, weight = len(graph.poses), problem.service.weight
    width = 2.0 * problem.checker.footprint.outer
    found = alternative_paths(graph, count - 2, count - 1, weight, width)
    return [graph.steering.oriented(graph.poses[nodes]) for nodes in found]


def _within(graph: MotionGraph, problem: Problem) -> list[NDArray[np.float64]]:
    """Paths that keep the limit: on the lattice, and finished from one that nearly keeps it."""
    limit, service, steering = problem.limit, problem.service, problem.steering
    if limit is None:
        raise ValueError("the problem has no limit")
    metres = limit.metres * (1.0 + LONGER) + ENDS * service.map.spacing
    nodes = cheapest_within(graph, problem, replace(limit, metres=metres))
    if nodes is None:
        return []
    path = steering.oriented(graph.poses[nodes])
    if limit.kept_by(path, service, steering):
        return [path]
    paths = [improve_within(path, service, problem.checker, limit)]
    nodes = cheapest_within(graph, problem, limit)
    if nodes is not None:
        paths.append(steering.oriented(graph.poses[nodes]))
    return [path for path in paths if path is not None]


register(
    Planner(
        "reference",
        solve_reference,
        "Dijkstra over the map's lattice and its channels, finished at any angle",
        spaces=("r2",),
        uses_ompl=False,
        keeps_limit=True,
    )
)
