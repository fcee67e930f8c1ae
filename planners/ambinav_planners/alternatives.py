"""Other paths that may be the cheapest once they are finished, and the best parts of several.

A lattice knows few directions, so that what a path costs on it is off by up to 1.3 %, and that of
the cheapest path on it may not be the side of a pillar on which the cheapest route of all goes.
So several paths are finished: after each search what lies near the path found is made dearer, by
a little more than the lattice may be off, and searched again (the penalty method for alternative
routes, Chen, Bell and Bogenberger 2007). The routes they lead to are joined where they come near
each other, and the cheapest one over all of them is taken.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from ambinav.geometry.collision import CollisionChecker
from ambinav.service.service import AmbiguityService
from ambinav_planners.graph import MotionGraph, walk_back

Floats = NDArray[np.float64]

# How many paths are found at most.
PATHS = 5
# What lies near a path found before is made dearer by this share: a little more than the lattice
# may be off.
DEARER = 0.03
# A path whose cost is above the least by more than this share is none to look at.
SLACK = 0.06
# An edge that costs nothing is none to scipy.
LEAST = 1e-12
# So near, metres, as a share of the robot's width: the sides of any obstacle are farther apart.
NEAR_SHARE = 0.5
# A path with less than this share of its points away from all others is none of its own.
OTHER_SHARE = 0.02
# Routes are joined where they come this near to each other, metres.
JOIN = 0.3


def alternative_paths(
    graph: MotionGraph, start: int, goal: int, weight: float, width: float
) -> list[NDArray[np.intp]]:
    """The cheapest path over a graph, and others that cost little more, the cheapest first.

    Args:
        graph: The motions.
        start: A node.
        goal: A node.
        weight: Of the cost.
        width: Of the robot, metres: paths that stay within half of it are one.

    Returns:
        Nodes of each path; none if no path leads there.
    """
    matrix = graph.matrix(np.maximum(graph.cost(weight), LEAST))
    come, before = dijkstra(matrix, indices=start, return_predecessors=True)
    if not np.isfinite(come[goal]):
        return []
    found = [walk_back(before, start, goal)]
    # What no path of little more cost leads over is left out: that is most of a building.
    go = dijkstra(matrix.T, indices=goal, limit=(1.0 + SLACK) * come[goal] + LEAST)
    kept = np.flatnonzero(come + go <= (1.0 + SLACK) * come[goal] + LEAST)
    matrix = matrix[kept][:, kept]
    first, last = np.searchsorted(kept, [start, goal])
    source = np.repeat(np.arange(len(kept)), np.diff(matrix.indptr))
    apart = NEAR_SHARE * width
    places = cKDTree(graph.poses[kept, :2])
    seen = np.zeros(len(kept), dtype=np.bool_)
    while len(found) < PATHS:
        corridor = np.zeros(len(kept), dtype=np.bool_)
        points = graph.steering.dense(graph.poses[found[-1]], apart)[0]
        for near in places.query_ball_point(points[:, :2], apart, return_sorted=False):
            corridor[near] = True
        seen |= corridor
        matrix.data[corridor[source] & corridor[matrix.indices]] *= 1.0 + DEARER
        _, before = dijkstra(matrix, indices=first, return_predecessors=True)
        nodes = walk_back(before, first, last)
        if not (~seen[nodes]).mean() > OTHER_SHARE:
            break
        found.append(kept[nodes])
    return found


def joined_routes(
    routes: list[Floats], service: AmbiguityService, checker: CollisionChecker
) -> MotionGraph:
    """Routes from the same start to the same goal as one graph; start and goal are its last nodes.

    Their vertices are its nodes. Those of different routes are joined where they see each other
    and are near; those of one route as they follow each other.

    Args:
        routes: Free routes, shape (N, 3) each, N at least 2.
        service: What a metre costs.
        checker: Where the robot fits and how it moves.
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
