"""The cheapest path over a graph from start to goal, under the limit if there is one."""

from __future__ import annotations

from ambinav.runtime.array_types import Floats, Indices
from ambinav_planners.problem import Problem
from ambinav_planners.search.graph import MotionGraph
from ambinav_planners.search.limit import BadStretchLimit
from ambinav_planners.search.limited_search import limited_search
from ambinav_planners.search.stretches import bad_stretches


def cheapest_within(
    graph: MotionGraph, problem: Problem, limit: BadStretchLimit, cost: Floats | None = None
) -> Indices | None:
    """Return nodes of the cheapest path that keeps a limit on consecutive bad metres, or None.

    Start and goal are the graph's last two nodes. `cost` is what each motion costs, shape (E,);
    None for what the problem's service says.
    """
    if cost is None:
        cost = graph.cost(problem.service.weight)
    stretches = bad_stretches(graph, problem.service.ambiguity, limit.level)
    count = len(graph.poses)
    path = limited_search(graph, cost, stretches, limit.metres, count - 2, count - 1)
    return None if path is None else path.nodes


def cheapest_on(graph: MotionGraph, problem: Problem) -> Floats | None:
    """Return poses of the cheapest path between the last two nodes, shape (N, 3), or None.

    It keeps the problem's limit, if there is one.
    """
    count = len(graph.poses)
    nodes = (
        graph.cheapest(count - 2, count - 1, problem.service.weight)
        if problem.limit is None
        else cheapest_within(graph, problem, problem.limit)
    )
    return None if nodes is None else graph.steering.oriented(graph.poses[nodes])
