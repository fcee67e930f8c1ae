"""Strokes along the weak direction: their positions and lengths on a floor."""

from __future__ import annotations

import math

import numpy as np
from scipy.ndimage import uniform_filter

from ambinav.runtime.array_types import Floats, Indices

PRONOUNCED = 0.3
"""Least strength of a direction that gets a stroke."""


def weak_strokes(
    x: Floats, y: Floats, direction: Floats, strength: Floats, depth: Floats
) -> Floats:
    """Return short strokes along the direction in which the robot can slide unobserved.

    One stroke for each patch of floor about 1/45 of the picture wide, where the direction is
    pronounced in most of the cells around; of the patch's cells the deepest, so that strokes run
    along a corridor's middle.

    Args:
        x: (nx,) cell centres, metres.
        y: (ny,) cell centres, metres.
        direction: (ny, nx) radians.
        strength: (ny, nx) how pronounced the direction is, in [0, 1]; NaN where none is wanted.
        depth: (ny, nx) metres to the nearest wall.

    Returns:
        Their ends, (N, 2, 2) metres.
    """
    pronounced = np.nan_to_num(strength) >= PRONOUNCED
    around, free = (
        uniform_filter(mask.astype(np.float32), 5, mode="constant")
        for mask in (pronounced, np.isfinite(strength))
    )
    rows, columns = np.nonzero(pronounced & (around >= 0.5 * free))
    if rows.size == 0:
        return np.empty((0, 2, 2))
    patch = float(max(np.ptp(x), np.ptp(y), 1.0)) / 45.0
    # Strongest claim first: deep in the free space, then pronounced.
    claim = np.nan_to_num(depth[rows, columns]) + 0.1 * patch * strength[rows, columns]
    order = np.argsort(-claim, kind="stable")
    rows, columns = rows[order], columns[order]
    first = _first_of_block(x[columns], y[rows], patch / 4.0)
    rows, columns = rows[first], columns[first]
    chosen = _spaced(x[columns], y[rows], patch)
    rows, columns = rows[chosen], columns[chosen]
    angle = direction[rows, columns]
    half = 0.4 * patch * strength[rows, columns]
    step = np.stack([half * np.cos(angle), half * np.sin(angle)], axis=-1)
    centre = np.stack([x[columns], y[rows]], axis=-1)
    return np.stack([centre - step, centre + step], axis=1)


def _first_of_block(x: Floats, y: Floats, side: float) -> Indices:
    """Return indices of the first point in each square block, in rising order."""
    column = np.floor((x - x.min()) / side).astype(np.int64)
    row = np.floor((y - y.min()) / side).astype(np.int64)
    _, first = np.unique(row * (column.max() + 1) + column, return_index=True)
    return np.sort(first)


def _spaced(x: Floats, y: Floats, distance: float) -> Indices:
    """Return indices of points at least `distance` apart, chosen greedily in the given order."""
    taken: dict[tuple[int, int], list[int]] = {}
    chosen: list[int] = []
    cells = np.stack([np.floor(x / distance), np.floor(y / distance)], axis=-1).astype(np.int64)
    for i, (a, b) in enumerate(cells.tolist()):
        near = (
            j for da in (-1, 0, 1) for db in (-1, 0, 1) for j in taken.get((a + da, b + db), ())
        )
        if all(math.hypot(x[i] - x[j], y[i] - y[j]) >= distance for j in near):
            taken.setdefault((a, b), []).append(i)
            chosen.append(i)
    return np.array(chosen, dtype=np.intp)
