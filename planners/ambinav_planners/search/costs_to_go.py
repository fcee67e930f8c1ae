"""Costs to go over a graph of motions, kept right while the costs of motions change.

After a change only nodes whose cheapest way led over a dearer motion, and nodes that a cheaper one
serves, are looked at again (the batch form of Ramalingam and Reps 1996, "An incremental algorithm
for a generalization of the shortest-path problem"); and of these only those that may serve a robot
where it is, in the order of A* from the goal to it, as D* Lite does (Koenig and Likhachev 2002).
The others wait until a robot needs them.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.array_types import Floats, Indices
from ambinav.runtime.kernels import kernel
from ambinav_planners.search.graph import MotionGraph
from ambinav_planners.search.labels import ROOM, drop_first, grown, push, reversed_graph


class CostsToGo:
    """Costs to go to a node; right for a place only after `settle` for it.

    Args:
        graph: The motions.
        cost: Cost of each motion, at least 0, inf where it is blocked, shape (E,); kept.
        goal: The node.

    Attributes:
        to_go: Cost of the cheapest path from each node, shape (N,); inf where there is none. Of
            nodes that no robot has needed yet, at least that.
        onward: First motion of that path, int64, shape (N,); -1 at the goal and where none leads.
    """

    def __init__(self, graph: MotionGraph, cost: Floats, goal: int) -> None:
        self._graph, self._cost = graph, cost
        self._source = graph.source
        self._into = reversed_graph(graph.first, graph.target)
        self.to_go = np.full(len(graph.poses), math.inf)
        self.onward = np.full(len(graph.poses), -1, dtype=np.int64)
        self.to_go[goal] = 0.0
        # Nodes whose costs have fallen, and those that may profit by it do not know it yet.
        self._waiting = np.array([goal])

    def change(self, motions: Indices, cost: Floats) -> None:
        """Change the costs of motions, shape (K,) each."""
        graph = self._graph
        dearer = motions[cost > self._cost[motions]]
        self._cost[motions] = cost
        broken = dearer[self.onward[self._source[dearer]] == dearer]
        seeds = _uproot(
            self.to_go, self.onward, self._source[broken], *self._into, graph.first, graph.target,
            self._cost,
        )  # fmt: skip
        offered = self._cost[motions] + self.to_go[graph.target[motions]]
        cheaper = motions[offered < self.to_go[self._source[motions]]]
        for motion in cheaper.tolist():
            node = self._source[motion]
            offer = self._cost[motion] + self.to_go[graph.target[motion]]
            if offer < self.to_go[node]:
                self.to_go[node], self.onward[node] = offer, motion
        fallen = np.concatenate([self._waiting, seeds, self._source[cheaper]])
        self._waiting = np.unique(fallen).astype(np.int64)

    def settle(
        self,
        near: Indices | None = None,
        cost: Floats | None = None,
        place: tuple[float, float] = (0.0, 0.0),
        least: float = 0.0,
    ) -> None:
        """Make the costs right from a place, or from everywhere.

        Args:
            near: Nodes that a robot at the place may drive to first; None: everywhere.
            cost: Cost to drive to each, shape (K,).
            place: x, y of the place, metres.
            least: Lower bound of the cost per metre.
        """
        if near is None or cost is None:
            near, cost = np.empty(0, dtype=np.intp), np.empty(0)
        graph = self._graph
        self._waiting = _spread(
            self.to_go, self.onward, self._waiting, *self._into, graph.target, self._cost,
            graph.poses, place, least, near, cost,
        )  # fmt: skip

    def path(self, node: int) -> Indices:
        """Return the nodes of the cheapest path from a node that leads to the goal, both ends."""
        nodes = [node]
        while self.onward[nodes[-1]] >= 0:
            nodes.append(int(self._graph.target[self.onward[nodes[-1]]]))
        return np.array(nodes, dtype=np.intp)


def cost_to_go(graph: MotionGraph, cost: NDArray[np.floating[Any]], goal: int) -> Floats:
    """Return the cost of the cheapest path from every node to the goal, shape (N,); inf without.

    Args:
        graph: The motions.
        cost: Cost of each motion, at least 0, shape (E,).
        goal: A node.
    """
    costs = CostsToGo(graph, cost.astype(np.float64), goal)
    costs.settle()
    return costs.to_go


@kernel
def _uproot(to_go, onward, roots, begin, source, motion, first, target, cost):
    """Forget the paths over roots, and give their nodes the best offer of the others.

    Returns the nodes that have an offer.
    """
    lost = np.empty(to_go.size, dtype=np.int64)
    count = 0
    for root in roots:
        if to_go[root] < math.inf:
            to_go[root], onward[root] = math.inf, -1
            lost[count] = root
            count += 1
    k = 0
    while k < count:
        node = lost[k]
        k += 1
        for e in range(begin[node], begin[node + 1]):
            before = source[e]
            if onward[before] == motion[e]:
                to_go[before], onward[before] = math.inf, -1
                lost[count] = before
                count += 1
    # Offers of nodes that keep their paths: those of others come when they have one again.
    offer = np.empty(count)
    offered = np.empty(count, dtype=np.int64)
    for k in range(count):
        offer[k], offered[k] = math.inf, -1
        for e in range(first[lost[k]], first[lost[k] + 1]):
            value = cost[e] + to_go[target[e]]
            if value < offer[k]:
                offer[k], offered[k] = value, e
    for k in range(count):
        to_go[lost[k]], onward[lost[k]] = offer[k], offered[k]
    return lost[:count]


@kernel
def _spread(
    to_go, onward, waiting, begin, source, motion, target, cost, poses, place, least, near, drive
):  # fmt: skip
    """Lower the costs of all nodes from which waiting ones are reached for less.

    It ends where none of them can serve the place; returns those that are still waiting.
    """
    keys, items = np.empty(ROOM), np.empty(ROOM, dtype=np.int64)
    is_near = np.full(to_go.size, math.inf)
    best = math.inf
    for k in range(near.size):
        is_near[near[k]] = drive[k]
        best = min(best, drive[k] + to_go[near[k]])
    size = 0
    for node in waiting:
        if to_go[node] < math.inf:
            if size == keys.size:
                keys, items = grown(keys), grown(items)
            away = math.hypot(poses[node, 0] - place[0], poses[node, 1] - place[1])
            push(keys, items, size, to_go[node] + least * away, node)
            size += 1
    while size > 0 and keys[0] < best:
        key, node = keys[0], items[0]
        drop_first(keys, items, size)
        size -= 1
        away = math.hypot(poses[node, 0] - place[0], poses[node, 1] - place[1])
        if key > to_go[node] + least * away:
            continue
        for e in range(begin[node], begin[node + 1]):
            before = source[e]
            value = to_go[node] + cost[motion[e]]
            if value < to_go[before]:
                to_go[before], onward[before] = value, motion[e]
                best = min(best, value + is_near[before])
                if size == keys.size:
                    keys, items = grown(keys), grown(items)
                away = math.hypot(poses[before, 0] - place[0], poses[before, 1] - place[1])
                push(keys, items, size, value + least * away, before)
                size += 1
    return items[:size].copy()
