"""Alternative paths that may be cheapest after improvement, and the best parts of several.

A lattice knows few directions, so that what a path costs on it is off by up to 1.3 %, and that of
the cheapest path on it may not be the side of a pillar on which the cheapest route of all goes.
So several paths are finished: after each search what lies near the path found is made dearer, by
a little more than the lattice may be off, and searched again (the penalty method for alternative
routes, Chen, Bell and Bogenberger 2007). The routes they lead to are joined where they come near
each other, and the cheapest one over all of them is taken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.runtime.array_types import Bools, Floats, Indices
from ambinav.service.service import AmbiguityService
from ambinav_planners.search.graph import MotionGraph, walk_back

# How many paths are found at most.
PATHS = 5
# What lies near a path found before is made dearer by this share: a little more than the lattice
# may be off.
DEARER = 0.03
# Paths above the least cost by more than this share are ignored.
SLACK = 0.06
# SciPy ignores edges of cost 0.
LEAST = 1e-12
# So near, metres, as a share of the robot's width: the sides of any obstacle are farther apart.
NEAR_SHARE = 0.5
# A path with less than this share of its points away from all others does not count.
OTHER_SHARE = 0.02
# Routes are joined where they come this near to each other, metres.
JOIN = 0.3


@dataclass(eq=False)
class Corridors:
    """The part of a graph near the paths found so far.

    Attributes:
        graph: The motions.
        apart: Distance within which a node is near a path, metres.
        seen: Nodes near any path, bool, shape (N,).
    """

    graph: MotionGraph
    apart: float
    seen: Bools
    _places: cKDTree

    @classmethod
    def of(cls, graph: MotionGraph, width: float) -> Corridors:
        """Create it without paths; paths within half of the robot's width, metres, count as one.

        Of a point robot, those within half of the median length of a motion.
        """
        width = width if width > 0.0 else float(np.median(graph.length))
        seen = np.zeros(len(graph.poses), dtype=np.bool_)
        return cls(graph, NEAR_SHARE * width, seen, cKDTree(graph.poses[:, :2]))

    def leads_elsewhere(self, nodes: Indices) -> bool:
        """Return whether a path leaves the surroundings of the others."""
        return bool((~self.seen[nodes]).mean() > OTHER_SHARE)

    def dearer(self, cost: Floats, nodes: Indices) -> Floats:
        """Add a path; return the costs of the motions, shape (E,), higher near that path."""
        near = np.zeros(len(self.seen), dtype=np.bool_)
        points = self.graph.steering.dense(self.graph.poses[nodes], self.apart)[0]
        for each in self._places.query_ball_point(points[:, :2], self.apart, return_sorted=False):
            near[each] = True
        self.seen |= near
        inside = near[self.graph.source] & near[self.graph.target]
        return np.where(inside, cost * (1.0 + DEARER), cost)


def within_cost(graph: MotionGraph, cost: Floats, max_cost: float) -> Bools:
    """Return nodes on paths of at most a cost from start to goal, the last two nodes."""
    matrix = graph.matrix(np.maximum(cost, LEAST))
    start, goal = len(graph.poses) - 2, len(graph.poses) - 1
    come = dijkstra(matrix, indices=start, limit=max_cost)
    go = dijkstra(matrix.T, indices=goal, limit=max_cost)
    return np.asarray(come + go <= max_cost)


def alternative_paths(graph: MotionGraph, weight: float, width: float) -> list[Floats]:
    """Find the cheapest path over a graph and others of little more cost, the cheapest first.

    Args:
        graph: The motions; start and goal are its last two nodes.
        weight: Weight of the cost.
        width: Width of the robot, metres: paths that stay within half of it are one.

    Returns:
        Poses of each path, shape (N, 3); none if no path leads there.
    """
    cost = np.maximum(graph.cost(weight), LEAST)
    start, goal = len(graph.poses) - 2, len(graph.poses) - 1
    come, before = dijkstra(graph.matrix(cost), indices=start, return_predecessors=True)
    if not np.isfinite(come[goal]):
        return []
    paths = [graph.poses[walk_back(before, start, goal)]]
    # Nodes on no path of nearly the least cost are left out: most of a building.
    max_cost = (1.0 + SLACK) * come[goal] + LEAST
    go = dijkstra(graph.matrix(cost).T, indices=goal, limit=max_cost)
    graph = graph.part(come + go <= max_cost)
    cost = graph.cost(weight)
    start, goal = len(graph.poses) - 2, len(graph.poses) - 1
    corridors = Corridors.of(graph, width)
    nodes = graph.cheapest_at(cost, start, goal)
    while nodes is not None and len(paths) < PATHS:
        cost = corridors.dearer(cost, nodes)
        nodes = graph.cheapest_at(cost, start, goal)
        if nodes is None or not corridors.leads_elsewhere(nodes):
            break
        paths.append(graph.poses[nodes])
    return [graph.steering.oriented(poses) for poses in paths]


def joined_routes(
    routes: list[Floats], service: AmbiguityService, checker: CollisionChecker
) -> MotionGraph:
    """Combine routes with equal start and goal into one graph; start and goal are its last nodes.

    Their vertices are its nodes. Those of different routes are joined where they see each other
    and are near; those of one route as they follow each other.

    Args:
        routes: Free routes, shape (N, 3) each, N at least 2.
        service: Service for the cost per metre.
        checker: Collision checker of the robot, with its kind of motion.
    """
    inner = [route[1:-1] for route in routes]
    poses = np.concatenate([*inner, routes[0][[0, -1]]])
    start, goal = len(poses) - 2, len(poses) - 1
    chains, low = [], 0
    for route in inner:
        nodes = np.array([start, *range(low, low + len(route)), goal])
        chains.append(np.stack([nodes[:-1], nodes[1:]], axis=-1))
        low += len(route)
    near = cKDTree(poses[:-2, :2]).query_pairs(JOIN, output_type="ndarray") if low else None
    pairs = np.concatenate([*chains, near]) if near is not None else np.concatenate(chains)
    pairs = np.unique(np.sort(pairs, axis=1), axis=0).astype(np.int32)
    return MotionGraph.of_motions(poses, pairs, service, checker)
