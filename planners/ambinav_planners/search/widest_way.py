"""The widest way between two places: where a robot that does not get through is stopped."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from ambinav.geometry.environment import Environment
from ambinav.runtime.array_types import Floats, Ints
from ambinav_planners.search.graph import walk_back

# The narrowest place is looked at again on points so many times nearer to each other, within so
# many spacings.
FINER, AROUND = 10, 3
# Cells of which one looks closer, for the time that it takes.
MOST = 10_000
# Places that are looked at closer at most.
ROUNDS = 30
# Half of the steps to the eight neighbours of a point, rows and columns.
STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))


class Narrowest(NamedTuple):
    """Narrowest place of the widest way.

    Attributes:
        x: Metres, map frame.
        y: Metres.
        width: Metres between the walls there.
    """

    x: float
    y: float
    width: float


def widest_way(
    geometry: Environment, start: Floats, goal: Floats, spacing: float
) -> Narrowest | None:
    """Return the narrowest place of the path whose narrowest place is widest.

    Paths are searched over a lattice of points; the discs up to the walls around two neighbours
    must touch, so that a path over free floor joins them. A passage may be wider than at its
    lattice points, so it first counts with its largest possible width; the narrowest place of the
    best path is then refined on a finer lattice, until it is one already refined. Gaps narrower
    than about two spacings may be missed.

    Args:
        geometry: The walls.
        start: x, y, metres.
        goal: x, y, metres.
        spacing: Between the points, metres.

    Returns:
        None if there is no path even for a point, as far as the lattice shows.
    """
    lattice = _Lattice.within(geometry, start, goal, geometry.bounds, spacing)
    # Between four points the middle is so far from them at most, and no ends are wider.
    wide = lattice.clearance + math.sqrt(0.5) * spacing
    wide[-2:] = lattice.clearance[-2:]
    seen: dict[int, Narrowest] = {}
    narrowest = None
    for _ in range(ROUNDS):
        path = lattice.way(wide)
        if path is None:
            return None
        k = int(wide[path].argmin())
        if int(path[k]) in seen:
            return seen[int(path[k])]
        narrowest = _closer(geometry, lattice.points[path], k, spacing)
        half = 0.5 * narrowest.width
        away = np.hypot(*(lattice.points - (narrowest.x, narrowest.y)).T)
        nearby = (away <= max(half, spacing)) & (lattice.clearance <= half)
        nearby[path[k]] = True
        for point in np.flatnonzero(nearby & (wide > half)).tolist():
            wide[point] = max(half, lattice.clearance[point])
            seen[point] = narrowest
        if int(path[k]) not in seen:  # an end, or as narrow as it looked
            seen[int(path[k])] = narrowest
    return narrowest


def _closer(geometry: Environment, path: Floats, k: int, spacing: float) -> Narrowest:
    """Return the narrowest place of a path around its point k, on a finer lattice."""
    clearance = np.asarray(geometry.clearance(*path.T))
    # Look closer between places that are clearly wider: else an end, off the middle of the
    # passage, would be the narrowest place.
    wide = np.flatnonzero(clearance > clearance[k] + spacing)
    i, j = int(np.searchsorted(wide, k)), len(path) - 1
    ends = (int(wide[i - 1]) if i > 0 else 0), (int(wide[i]) if i < len(wide) else j)
    if np.prod(np.ptp(path[ends[0] : ends[1] + 1], axis=0) / spacing + 2 * AROUND) > MOST:
        ends = max(k - AROUND, 0), min(k + AROUND, j)
    points = path[ends[0] : ends[1] + 1]
    reach = (AROUND + 1) * spacing
    (xmin, ymin), (xmax, ymax) = points.min(axis=0) - reach, points.max(axis=0) + reach
    box = xmin, ymin, xmax, ymax
    fine = _Lattice.within(geometry, points[0], points[-1], box, spacing / FINER)
    widest = fine.way(fine.clearance)
    if widest is not None:
        points = fine.points[widest]
    clearance = np.asarray(geometry.clearance(*points.T))
    k = int(clearance.argmin())
    return Narrowest(float(points[k, 0]), float(points[k, 1]), 2.0 * float(clearance[k]))


class _Lattice(NamedTuple):
    """Free points of a lattice, start and goal the last of them, and pairs that a way joins.

    Attributes:
        points: Metres, (N, 2).
        clearance: Distance to the nearest wall, metres, (N,).
        a: First points of the pairs.
        b: Second points.
    """

    points: Floats
    clearance: Floats
    a: Ints
    b: Ints

    @classmethod
    def within(
        cls,
        geometry: Environment,
        start: Floats,
        goal: Floats,
        box: tuple[float, float, float, float],
        spacing: float,
    ) -> _Lattice:
        """Return the lattice within a box."""
        xmin, ymin, xmax, ymax = box
        x, y = np.meshgrid(np.arange(xmin, xmax, spacing), np.arange(ymin, ymax, spacing))
        number = np.full(x.shape, -1)
        free = np.asarray(geometry.is_free(x, y))
        number[free] = np.arange(free.sum())
        points = np.concatenate([np.column_stack([x[free], y[free]]), [start, goal]])
        a, b = (np.concatenate(ends) for ends in zip(*_neighbours(number), strict=True))
        count = len(points)
        for end in (count - 2, count - 1):
            away = np.hypot(*(points[:-2] - points[end]).T)
            near = np.flatnonzero(away <= 2.0 * spacing)
            a, b = np.append(a, near), np.append(b, np.full(len(near), end))
        clearance = np.asarray(geometry.clearance(*points.T), dtype=np.float64)
        joined = np.hypot(*(points[a] - points[b]).T) <= clearance[a] + clearance[b]
        return cls(points, clearance, a[joined], b[joined])

    def way(self, wide: Floats) -> Ints | None:
        """Return the points of the path whose narrowest one is widest, (M,); None: no path."""
        count = len(self.points)
        # The tree of least weight holds, between any two nodes, the path whose worst edge is best.
        narrow = 1.0 / np.minimum(wide[self.a], wide[self.b]).clip(1e-9)
        graph = coo_array((narrow, (self.a, self.b)), shape=(count, count)).tocsr()
        tree = minimum_spanning_tree(graph)
        _, before = breadth_first_order(tree, count - 2, directed=False)
        if before[count - 1] < 0:
            return None
        return np.asarray(walk_back(before, count - 2, count - 1), dtype=np.int64)


def _neighbours(number: Ints) -> list[tuple[Ints, Ints]]:
    """Return pairs of neighbours among points of a lattice, numbered; -1 where there is none."""
    rows, columns = number.shape
    pairs = []
    for down, right in STEPS:
        cell = number[: rows - down, max(-right, 0) : columns - max(right, 0)]
        neighbour = number[down:, max(right, 0) : columns - max(-right, 0)]
        is_pair = (cell >= 0) & (neighbour >= 0)
        pairs.append((cell[is_pair], neighbour[is_pair]))
    return pairs
