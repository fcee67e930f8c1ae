"""Walls that only one of two maps has."""

from __future__ import annotations

from typing import Final

import numpy as np
import shapely

from ambinav.geometry.segments import Segments
from ambinav.runtime.array_types import Floats

CLOSE: Final = 0.1
"""Metres: walls this near to each other are one, where both maps are drawn."""
CELLS: Final = 2.0
"""The same in cells of an occupancy map: outlines are simplified to about so much."""


def tolerance(*resolutions: float | None) -> float:
    """Compute the distance up to which two walls count as the same, metres.

    Args:
        resolutions: Cell sizes of the maps, metres; None for a drawn one.
    """
    return max(CLOSE, *(CELLS * cell for cell in resolutions if cell is not None), CLOSE)


def missing_walls(walls: Segments, others: Segments, close: float) -> Floats:
    """Return stretches of walls farther than `close` from every wall of another map.

    Frontiers to unknown space are no walls. Stretches shorter than `close` are left out.

    Args:
        walls: Walls to search.
        others: Walls to compare with.
        close: Metres, above zero.

    Returns:
        End points, columns ax, ay, bx, by, metres, shape (N, 4).
    """
    ours, theirs = walls.xy[walls.walls], others.xy[others.walls]
    their_walls = {tuple(row) for row in np.round(theirs, 6).tolist()}
    fresh = [tuple(row) not in their_walls for row in np.round(ours, 6).tolist()]
    lines = shapely.linestrings(ours[np.array(fresh, dtype=np.bool_)].reshape(-1, 2, 2))
    if not len(lines):
        return np.empty((0, 4))
    if len(theirs):
        around = shapely.linestrings(theirs.reshape(-1, 2, 2))
        tree = shapely.STRtree(around)
        index, near = tree.query(lines, predicate="dwithin", distance=close)
        order = np.argsort(index, kind="stable")
        which, starts = np.unique(index[order], return_index=True)
        covers = shapely.buffer(around, close)
        # If nothing is near, there is still one empty part.
        for line, hits in zip(which.tolist(), np.split(near[order], starts[1:]), strict=False):
            lines[line] = shapely.difference(lines[line], shapely.union_all(covers[hits]))
    parts = shapely.get_parts(lines)
    parts = parts[shapely.length(parts) >= close]
    return np.array(
        [shapely.get_coordinates(part)[[0, -1]].ravel() for part in parts], dtype=np.float64
    ).reshape(-1, 4)


def total_length(stretches: Floats) -> float:
    """Sum the length of stretches as `missing_walls` returns them, metres."""
    return float(
        np.hypot(stretches[:, 2] - stretches[:, 0], stretches[:, 3] - stretches[:, 1]).sum()
    )
