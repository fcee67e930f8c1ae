"""Trips through a building: the bad floor on the shortest paths and on paths that avoid it.

A trip is a shortest path over a lattice between two places of the judged floor, drawn evenly. It is
compared with the path of least cost, where a metre at level 1 counts as several metres more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.regions import passable
from ambinav.maps.zones import BAD
from ambinav.routes.sampled import neighbour_pairs
from ambinav.runtime.array_types import Floats, Ints, Ints32

WEIGHT: Final = 5.0
"""Metres that a metre at level 1 counts for in addition: what `ambinav plan` takes by default."""
STARTS: Final = 6
GOALS: Final = 30
"""Number of places from which, and of places to which, trips go."""
MOST_NODES: Final = 60_000
"""Most nodes; of more cells only every second, fourth ... is a node."""


@dataclass(frozen=True, eq=False)
class Trips:
    """Sampled trips through a building.

    Attributes:
        count: Number of trips.
        length: Mean length of the shortest, metres.
        bad: Mean of it on bad floor, metres.
        aware_length: Mean length where bad floor is weighed against the detour.
        aware_bad: Mean of that on bad floor.
        paths: The shortest, x and y, metres, each of shape (n, 2).
    """

    count: int
    length: float
    bad: float
    aware_length: float
    aware_bad: float
    paths: tuple[Floats, ...]


def find_trips(amap: AmbiguityMap, rng: np.random.Generator) -> Trips | None:
    """Sample trips over the judged floor of a map and find both paths of each.

    Args:
        amap: The map.
        rng: Draws the places.

    Returns:
        None where no two places are connected over the lattice.
    """
    floor = amap.judged.reachable
    stride = 1
    while floor[::stride, ::stride].sum() > MOST_NODES:
        stride *= 2
    step = stride * amap.spacing
    rows, columns = slice(None, None, stride), slice(None, None, stride)
    clearance = amap.dataset["clearance"].values[rows, columns]
    # No wall runs between two neighbours, including diagonal ones.
    free = passable(floor[rows, columns], clearance, math.sqrt(2.0) * step)
    level = np.nan_to_num(amap.floor("level").values[rows, columns].astype(np.float64))
    zone = amap.floor("zone").values[rows, columns]
    bad = np.isin(zone, BAD) & amap.judged.counted[rows, columns]
    node = np.full(free.shape, -1)
    node[free] = np.arange(int(free.sum()))
    places = np.flatnonzero(amap.judged.counted[rows, columns][free])
    if len(places) < 2:
        return None
    starts = rng.choice(places, min(STARTS, len(places)), replace=False)
    goals = rng.choice(places, min(GOALS, len(places)), replace=False)
    row, column = np.nonzero(free)
    first, second = neighbour_pairs(node).T
    length = step * np.tile(np.hypot(row[first] - row[second], column[first] - column[second]), 2)
    ends = np.concatenate([first, second]), np.concatenate([second, first])
    at_node, is_bad = level[free], bad[free].astype(np.float64)
    costs = length * (1.0 + WEIGHT * 0.5 * (at_node[ends[0]] + at_node[ends[1]]))
    exposed = length * 0.5 * (is_bad[ends[0]] + is_bad[ends[1]])
    xs, ys = (amap.dataset[axis].values[::stride] for axis in ("x", "y"))
    points = np.column_stack([xs[column], ys[row]])
    shape = (int(free.sum()),) * 2
    edge_numbers = csr_array((np.arange(1, len(length) + 1), ends), shape=shape)
    sums, paths = [], []
    for weights in (length, costs):
        graph = csr_array((weights, ends), shape=shape)
        _, before = dijkstra(graph, indices=starts, return_predecessors=True)
        driven = [
            _path(int(goal), tree)
            for tree, start in zip(before, starts, strict=True)
            for goal in goals
            if goal != start and tree[goal] >= 0
        ]
        if not driven:
            return None
        edges = [np.asarray(edge_numbers[path[:-1], path[1:]]).ravel() - 1 for path in driven]
        sums.append([(length[at].sum(), exposed[at].sum()) for at in edges])
        paths.append([points[path] for path in driven])
    (short, short_bad), (aware, aware_bad) = (np.mean(values, axis=0) for values in sums)
    count = len(sums[0])
    return Trips(
        count, float(short), float(short_bad), float(aware), float(aware_bad), tuple(paths[0])
    )


def _path(goal: int, before: Ints32) -> Ints:
    """Return the nodes of a path from a start to a goal."""
    nodes = [goal]
    while before[nodes[-1]] >= 0:
        nodes.append(int(before[nodes[-1]]))
    return np.array(nodes[::-1])
