"""Check that simplified rings keep the topology of the contours they were made from."""

from __future__ import annotations

from typing import Final

import numpy as np
import shapely

from ambinav.runtime.array_types import Bools, Floats, Ints

# Cells. Edges this near to each other touch: once they are turned and scaled they might cross.
TOUCH: Final = 1e-4


def crossing(edges: Floats, owner: Ints) -> Bools:
    """Return edges that cross or touch another edge, except at a shared end of neighbours.

    Args:
        edges: shape (N, 4), end points; the edges of a ring follow one another.
        owner: shape (N,), the ring of each edge, ascending.
    """
    n = len(edges)
    following = np.arange(1, n + 1)
    first = np.searchsorted(owner, owner)
    last = np.searchsorted(owner, owner, side="right") - 1
    following[last] = first[last]
    lines = shapely.linestrings(edges.reshape(n, 2, 2))
    tree = shapely.STRtree(lines)
    a, b = tree.query(lines, predicate="dwithin", distance=TOUCH)
    real = (a < b) & (following[a] != b) & (following[b] != a)
    bad = np.zeros(n, dtype=np.bool_)
    bad[a[real]] = bad[b[real]] = True
    # Neighbours share an end; they overlap if they run back on each other.
    run = edges[:, 2:] - edges[:, :2]
    after = run[following]
    turn = run[:, 0] * after[:, 1] - run[:, 1] * after[:, 0]
    along = (run * after).sum(axis=1)
    size = np.hypot(run[:, 0], run[:, 1]) * np.hypot(after[:, 0], after[:, 1])
    back = ((along < 0.0) & (np.abs(turn) <= 1e-9 * size)) | (size < 1e-9)
    bad[back] = bad[following[back]] = True
    return bad


def enclosures(rings: list[Floats]) -> set[tuple[int, int]]:
    """Return pairs (outer, inner) of rings where one encloses the first point of the other.

    Args:
        rings: Points of each ring, shape (n, 2), not closed by repetition.
    """
    tree = shapely.STRtree(shapely.points([ring[0] for ring in rings]))
    outer, inner = tree.query([shapely.Polygon(ring) for ring in rings], predicate="contains")
    return {(int(a), int(b)) for a, b in zip(outer, inner, strict=True) if a != b}
