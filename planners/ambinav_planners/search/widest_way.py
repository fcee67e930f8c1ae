"""The widest way between two places: where a robot that does not get through is stopped."""

from __future__ import annotations

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
    """Return the narrowest place of the way whose narrowest place is widest.

    Ways are sought over a lattice of points; the discs up to the walls around two neighbours must
    touch, so a way over free floor joins them. Gaps narrower than about two spacings may be missed.

    Args:
        geometry: The walls.
        start: x, y, metres.
        goal: x, y, metres.
        spacing: Between the points, metres.

    Returns:
        None if there is no way even for a point, as far as the lattice shows.
    """
    path = _path(geometry, start, goal, geometry.bounds, spacing)
    if path is None:
        return None
    clearance = np.asarray(geometry.clearance(*path.T))
    k = int(clearance.argmin())
    # Look closer between places that are clearly wider: else an end, off the middle of the
    # passage, would be the narrowest place.
    wide = np.flatnonzero(clearance > clearance[k] + spacing)
    i, j = int(np.searchsorted(wide, k)), len(path) - 1
    ends = (int(wide[i - 1]) if i > 0 else 0), (int(wide[i]) if i < len(wide) else j)
    if np.prod(np.ptp(path[ends[0] : ends[1] + 1], axis=0) / spacing + 2 * AROUND) > MOST:
        ends = max(k - AROUND, 0), min(k + AROUND, j)
    some = path[ends[0] : ends[1] + 1]
    first, last = some[0], some[-1]
    reach = (AROUND + 1) * spacing
    (xmin, ymin), (xmax, ymax) = some.min(axis=0) - reach, some.max(axis=0) + reach
    near = _path(geometry, first, last, (xmin, ymin, xmax, ymax), spacing / FINER)
    path = path if near is None else near
    clearance = np.asarray(geometry.clearance(*path.T))
    k = int(clearance.argmin())
    return Narrowest(float(path[k, 0]), float(path[k, 1]), 2.0 * float(clearance[k]))


def _path(
    geometry: Environment,
    start: Floats,
    goal: Floats,
    box: tuple[float, float, float, float],
    spacing: float,
) -> Floats | None:
    """Return the points of the widest way within a box, (N, 2), ends included; None if none."""
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
    clearance = np.asarray(geometry.clearance(*points.T))
    joined = np.hypot(*(points[a] - points[b]).T) <= clearance[a] + clearance[b]
    a, b = a[joined], b[joined]
    # The tree of least weight holds, between any two nodes, the path whose worst edge is best.
    narrow = 1.0 / np.minimum(clearance[a], clearance[b]).clip(1e-9)
    tree = minimum_spanning_tree(coo_array((narrow, (a, b)), shape=(count, count)).tocsr())
    _, before = breadth_first_order(tree, count - 2, directed=False)
    if before[count - 1] < 0:
        return None
    return np.asarray(points[walk_back(before, count - 2, count - 1)])


def _neighbours(number: Ints) -> list[tuple[Ints, Ints]]:
    """Return pairs of neighbours among points of a lattice, numbered; -1 where there is none."""
    rows, columns = number.shape
    pairs = []
    for down, right in STEPS:
        here = number[: rows - down, max(-right, 0) : columns - max(right, 0)]
        there = number[down:, max(right, 0) : columns - max(-right, 0)]
        both = (here >= 0) & (there >= 0)
        pairs.append((here[both], there[both]))
    return pairs
