"""The cheapest path with a limit on consecutive metres of bad localization.

Dead reckoning bridges a stretch of bad floor if it is short enough. Such a limit is no cost: what
counts is the longest stretch in a row, so the search keeps for every path to a node its cost and
the metres since the last good place, a shortest path problem with a resource that is used up and
filled up again (Desrochers & Soumis 1988, "A generalized permanent labelling algorithm for the
shortest path problem with time windows"). Which places are bad is our own choice: where a layer
of the map is above a level.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav_planners.search.costs_to_go import cost_to_go
from ambinav_planners.search.graph import MotionGraph
from ambinav_planners.search.labels import (
    ROOM,
    SearchPath,
    add_label,
    check_node,
    drop_first,
    grown,
    more_room,
    motions_back,
    no_labels,
    path_back,
)
from ambinav_planners.search.stretches import Stretches

# Sums of the same lengths in another order may differ by rounding.
ROUNDING = 1e-9


def limited_search(
    graph: MotionGraph, cost: Floats, stretches: Stretches, limit: float, start: int, goal: int
) -> SearchPath | None:
    """Find the cheapest path with at most `limit` consecutive metres on bad floor.

    The path may pass a node twice if that is what it takes. It starts with no bad metres behind
    it: the robot knows where it is.

    Args:
        graph: The motions.
        cost: Cost of each motion, at least 0, shape (E,), such as `graph.cost(weight)`.
        stretches: Bad stretches of the motions.
        limit: Metres, at least 0; inf for none.
        start: A node.
        goal: A node.

    Returns:
        The path, its cost exactly the least there is, or None if no path keeps to the limit.

    Raises:
        InputError: a negative limit or cost, or a node that is not there.
    """
    if not limit >= 0.0:
        raise InputError(f"limit is {limit} m in a row; give a number of at least 0.")
    if not (cost >= 0.0).all():
        raise InputError(f"cost holds {cost.min():g}; the search needs costs of at least 0.")
    start, goal = check_node(graph, "start", start), check_node(graph, "goal", goal)
    ahead = cost_to_go(graph, cost, goal)
    if not math.isfinite(ahead[start]):
        return None
    motions, total, labels = _search(
        graph.first, graph.target, graph.length, cost, stretches.head, stretches.tail,
        stretches.longest, stretches.all_bad, limit + ROUNDING, ahead, start, goal,
    )  # fmt: skip
    return path_back(graph, start, motions, total, labels) if labels >= 0 else None


@kernel
def _search(
    first, target, length, cost, head, tail, longest, all_bad, limit, ahead, start, goal
):  # fmt: skip
    """Return motions from goal to start, their cost, and the number of labels (-1: no path)."""
    nodes = first.size - 1
    least = np.full(nodes, math.inf)  # the shortest running stretch that a node was left with
    waiting_cost = np.full(nodes, math.inf)  # the cheapest label in the heap, and its stretch
    waiting_run = np.full(nodes, math.inf)
    labels = no_labels()
    add_label(labels, 0, 0, start, -1, -1, 0.0, ahead[start])
    run = np.empty(ROOM)
    run[0] = 0.0
    count, size, taken = 1, 1, 0
    while size > 0:
        label = labels.items[0]
        drop_first(labels.keys, labels.items, size)
        size -= 1
        node, so_far, behind = labels.at[label], labels.spent[label], run[label]
        if behind >= least[node]:
            continue
        least[node] = behind
        taken += 1
        if node == goal:
            return motions_back(label, labels.parent, labels.motion), so_far, taken
        for e in range(first[node], first[node + 1]):
            to = target[e]
            if behind + head[e] > limit or longest[e] > limit or ahead[to] == math.inf:
                continue
            stretch = behind + length[e] if all_bad[e] else tail[e]
            total = so_far + cost[e]
            if stretch >= least[to]:
                continue
            if total >= waiting_cost[to] and stretch >= waiting_run[to]:
                continue
            if total <= waiting_cost[to]:
                waiting_cost[to], waiting_run[to] = total, stretch
            if count == labels.at.size:
                labels, run = more_room(labels), grown(run)
            add_label(labels, count, size, to, label, e, total, total + ahead[to])
            run[count] = stretch
            count, size = count + 1, size + 1
    return np.empty(0, dtype=np.int64), math.inf, -1
