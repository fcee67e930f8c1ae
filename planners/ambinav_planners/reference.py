"""The reference planner: cheapest paths over the map's lattice, then improved at any angle."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np

from ambinav.runtime.array_types import Floats, Indices
from ambinav_planners.improve.limited import improve_within
from ambinav_planners.one_way import legal_part
from ambinav_planners.problem import Problem
from ambinav_planners.registry import Budget, Planner, PlannerResult
from ambinav_planners.search.alternatives import SLACK, Corridors, alternative_paths, within_cost
from ambinav_planners.search.cheapest import cheapest_within
from ambinav_planners.search.corridor import corridor
from ambinav_planners.search.graph import MotionGraph
from ambinav_planners.search.lattice_graph import LatticeGraph, lattice_of
from ambinav_planners.search.limit import BadStretchLimit

# A path over the lattice is longer than the route that it becomes, by up to this share and so many
# spacings at its ends: its stretches on bad floor may be longer than the limit by as much.
LONGER, ENDS = 0.02, 2.0
# A limit on bad metres is at least so many cells long: or else cells are divided, into so many
# parts at most, and for as long as there are no more cells than this.
LIMIT_CELLS, MOST_PARTS, MOST_CELLS = 10, 4, 150_000
# A path under a limit is first looked for among those dearer than the cheapest by up to this share.
LIMITED_SLACK = 0.15
# Largest number of paths searched under a limit, which is slower than without.
LIMITED_PATHS = 3


def solve_reference(problem: Problem, budget: Budget) -> PlannerResult:
    """Search the lattice for paths, without a time limit."""
    started = time.perf_counter()
    if problem.one_way is not None:
        return found_on(reference_graph(problem), problem, started)
    # Under a limit the cheapest path may be much dearer; without one its paths are routes already.
    unlimited = problem.limit is None
    slack, on_path = (SLACK, budget.on_path) if unlimited else (LIMITED_SLACK, None)
    lattice = _lattice(problem)
    searched = corridor(lattice, problem.service, problem.checker, problem.ends, slack, on_path)
    if searched is None:
        return PlannerResult(None)
    graph, least = searched
    result = found_on(graph, problem, started)
    # The paths of little more cost than the one found must lie in the corridor too.
    dearest = (1.0 + SLACK) * result.curve[0][1] if result.curve else math.inf
    if unlimited or dearest <= (1.0 + slack) * least:
        return result
    return found_on(reference_graph(problem), problem, started)


def reference_graph(problem: Problem) -> MotionGraph:
    """Return the lattice to search, with start and goal as its last two nodes.

    It is the map's, divided where a limit on bad metres in a row is only a few cells long.
    """
    graph = _lattice(problem).with_ends(problem.ends, problem.checker)
    return graph if problem.one_way is None else legal_part(graph, problem.one_way)


def _lattice(problem: Problem) -> LatticeGraph:
    """Return the map's lattice, divided where a limit is only a few of its cells long."""
    amap, parts = problem.service.map, 1
    if problem.limit is not None:
        cells = max(int(np.count_nonzero(amap.dataset["free"].values)), 1)
        parts_for_limit = math.ceil(LIMIT_CELLS * amap.spacing / problem.limit.metres)
        parts = max(1, min(parts_for_limit, MOST_PARTS, int(math.sqrt(MOST_CELLS / cells))))
    return lattice_of(problem.service, problem.checker, parts)


def found_on(graph: MotionGraph, problem: Problem, started: float) -> PlannerResult:
    """Return a lattice's cheapest path, and those that may become cheaper, as a planner's result.

    Start and goal are the last two nodes of the lattice.

    Args:
        graph: The lattice with start and goal as its last two nodes.
        problem: The planning problem.
        started: When the clock was started, of `time.perf_counter`.
    """
    weight, width = problem.service.weight, 2.0 * problem.checker.footprint.outer
    paths = (
        alternative_paths(graph, weight, width)
        if problem.limit is None
        else _within(graph, problem, problem.limit, width)
    )
    if not paths:
        return PlannerResult(None)
    cost = problem.service.route_cost(paths[0], problem.steering)
    return PlannerResult(
        paths[0], ((time.perf_counter() - started, cost),), alternatives=tuple(paths[1:])
    )


def _within(
    graph: MotionGraph, problem: Problem, limit: BadStretchLimit, width: float
) -> list[Floats]:
    """Return paths that keep the limit: on the lattice, or repaired if they nearly keep it."""
    service = problem.service
    metres = limit.metres * (1.0 + LONGER) + ENDS * service.map.spacing
    looser = replace(limit, metres=metres)
    nodes = cheapest_within(graph, problem, looser)
    if nodes is None:
        return []
    paths = [_finished(graph, nodes, problem, limit)]
    # Paths dearer than a known route are left out.
    max_cost = math.inf
    if paths[0] is not None:
        max_cost = (1.0 + SLACK) * service.route_cost(paths[0], problem.steering)
    is_within = within_cost(graph, graph.cost(service.weight), max_cost)
    part, number = graph.part(is_within), np.cumsum(is_within) - 1
    strict = cheapest_within(part, problem, limit)
    if strict is not None:
        paths.append(_finished(part, strict, problem, limit))
    cost, corridors = part.cost(service.weight), Corridors.of(part, width)
    if is_within[nodes].all():
        cost = corridors.dearer(cost, number[nodes])
    for _ in range(LIMITED_PATHS - 1):
        alternative = cheapest_within(part, problem, looser, cost)
        if alternative is None or not corridors.leads_elsewhere(alternative):
            break
        paths.append(_finished(part, alternative, problem, limit))
        cost = corridors.dearer(cost, alternative)
    legal = [path for path in paths if path is not None]
    return sorted(legal, key=lambda path: service.route_cost(path, problem.steering))


def _finished(
    graph: MotionGraph, nodes: Indices, problem: Problem, limit: BadStretchLimit
) -> Floats | None:
    """Return a path if it keeps the limit, else the path repaired to keep it; None on failure."""
    path = problem.steering.oriented(graph.poses[nodes])
    if limit.kept_by(path, problem.service, problem.steering):
        return path
    return improve_within(path, problem.service, problem.checker, limit)


REFERENCE = Planner(
    "reference",
    solve_reference,
    "Dijkstra over the map's lattice and its channels, finished at any angle",
    spaces=("r2",),
    uses_ompl=False,
    keeps_limit=True,
    uses_budget=False,
)
