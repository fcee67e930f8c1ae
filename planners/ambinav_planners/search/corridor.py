"""The part of a lattice between two places: motions on paths of little more than the least cost.

Most of a building lies on no such path. A* finds the cheapest path, goes on to the dearest one
wanted, and a search back from the goal, held against what it found, leaves the nodes on them (A*:
Hart, Nilsson and Raphael 1968). What comes after works on a small graph.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.runtime.array_types import Floats
from ambinav.runtime.kernels import kernel
from ambinav.service.service import AmbiguityService
from ambinav_planners.search.graph import MotionGraph, joined, walk_back
from ambinav_planners.search.labels import ROOM, drop_first, grown, push
from ambinav_planners.search.lattice_graph import LatticeGraph

# So far below the true one, as a share, the bound of a path's cost is set, against rounding.
BELOW = 1e-6
# By this factor the bound is too high in the search for a first path.
GREED = 5.0


def corridor(
    lattice: LatticeGraph,
    service: AmbiguityService,
    checker: CollisionChecker,
    ends: Floats,
    slack: float,
    on_path: Callable[[Floats], None] | None = None,
) -> tuple[MotionGraph, float] | None:
    """Return the motions on paths of little more than the least cost, and that; None: no path.

    Start and goal are the last two nodes.

    Args:
        lattice: The lattice.
        service: Its service, at the weight that counts.
        checker: The checker that it was built with.
        ends: Start and goal, shape (2, 3).
        slack: How much dearer than the cheapest path another may be, as a share.
        on_path: Called with the poses of a path that is found in a fraction of the time: A* with a
            bound that is too high (Pohl 1970), then with those of the cheapest.
    """
    graph, count = lattice.graph, len(lattice.graph.poses)
    ends_graph = lattice.end_motions(ends, checker)
    cost = ends_graph.cost(service.weight)
    from_start = np.arange(ends_graph.first[count], ends_graph.first[count + 1])
    seen = from_start[ends_graph.target[from_start] < count]
    last = np.flatnonzero(ends_graph.target == count + 1)
    source = ends_graph.source[last]
    to_goal = np.full(count, math.inf)
    to_goal[source[source < count]] = cost[last[source < count]]
    direct = cost[last[source == count]].min(initial=math.inf)
    costs = graph.fixed, graph.exposure, service.weight
    least = (1.0 - BELOW) * float(service.density.values.min())

    def searched(least: float, ratio: float) -> tuple[float, Floats]:
        best, node, come, before = _search_on(
            graph.first, graph.target, *costs, graph.poses, ends[1], least, ends_graph.target[seen],
            cost[seen], to_goal, direct, ratio,
        )  # fmt: skip
        if on_path is not None and math.isfinite(best):
            inner = [] if node < 0 else [graph.poses[walk_back(before, -1, node)[1:]]]
            on_path(graph.steering.oriented(np.concatenate([ends[:1], *inner, ends[1:]])))
        return best, come

    if on_path is not None:
        searched(GREED * least, 1.0)
    best, come = searched(least, 1.0 + slack)
    if not math.isfinite(best):
        return None
    is_within = _search_back(*lattice.into, *costs, come, to_goal, (1.0 + slack) * best)
    return joined(graph.part(is_within), ends_graph.part(np.append(is_within, [True, True]))), best


@kernel
def _search_on(
    first, target, fixed, exposure, weight, poses, goal, least, seeds, offers, to_goal, direct,
    ratio,
):  # fmt: skip
    """Search from the start, in the order of cost plus the least to go.

    Returns the least cost, the last node of its path (-1: it leads straight to the goal), the cost
    to each node, right for those on paths of up to `ratio` times as much, and the node before each
    (-1: the start).
    """
    count = first.size - 1
    come, before = np.full(count, math.inf), np.full(count, -1, dtype=np.int32)
    done = np.zeros(count, dtype=np.bool_)
    keys, items, size = np.empty(ROOM), np.empty(ROOM, dtype=np.int64), 0
    best, last = direct, -1
    node, begin, end = -1, 0, seeds.size
    while True:
        for e in range(begin, end):
            m = seeds[e] if node < 0 else target[e]
            offer = offers[e] if node < 0 else come[node] + fixed[e] + weight * exposure[e]
            if offer < come[m] and not done[m]:
                come[m], before[m] = offer, node
                if size == keys.size:
                    keys, items = grown(keys), grown(items)
                away = math.hypot(poses[m, 0] - goal[0], poses[m, 1] - goal[1])
                push(keys, items, size, offer + least * away, m)
                size += 1
        while size > 0 and done[items[0]]:
            drop_first(keys, items, size)
            size -= 1
        if size == 0 or keys[0] > ratio * best:
            return best, last, come, before
        node = items[0]
        done[node] = True
        begin, end = first[node], first[node + 1]
        if come[node] + to_goal[node] < best:
            best, last = come[node] + to_goal[node], node


@kernel
def _search_back(begin, source, motion, fixed, exposure, weight, come, to_goal, most):
    """Mark the nodes on paths of at most a cost, given the cost to each; see `_search_on`.

    Without numbers of motions each has its way back at the same place.
    """
    go, kept = to_goal.copy(), np.zeros(come.size, dtype=np.bool_)
    keys, items, size = np.empty(ROOM), np.empty(ROOM, dtype=np.int64), 0
    for n in range(come.size):
        if come[n] + go[n] <= most:
            if size == keys.size:
                keys, items = grown(keys), grown(items)
            push(keys, items, size, go[n], n)
            size += 1
    while size > 0:
        node = items[0]
        drop_first(keys, items, size)
        size -= 1
        if kept[node]:
            continue
        kept[node] = True
        for k in range(begin[node], begin[node + 1]):
            n, e = source[k], (motion[k] if motion.size else k)
            offer = go[node] + fixed[e] + weight * exposure[e]
            if offer < go[n] and come[n] + offer <= most:
                go[n] = offer
                if size == keys.size:
                    keys, items = grown(keys), grown(items)
                push(keys, items, size, offer, n)
                size += 1
    return kept
