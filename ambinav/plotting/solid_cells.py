"""Solid cells of a map, with a margin around them: what pictures draw below the floor."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy import ndimage

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Bools

THICK: Final = 5
"""Cells across something solid from which it is a block, not a wall."""


def padded_solid(
    amap: AmbiguityMap, padding: int, rows: tuple[int, int], columns: tuple[int, int]
) -> Bools:
    """Return a part of the mask of solid cells, padded by a margin on each side.

    Blocks of an occupancy map go on beyond the outermost cells, walls do not. A drawn plan ends at
    its outline, and an obstacle that stands there ends with it.

    Args:
        amap: The map.
        padding: Cells of the margin.
        rows: The first row of the part, and one past the last; row 0 is the lowest of the margin.
        columns: The same of the columns.
    """
    spans = [np.arange(*span) - padding for span in (rows, columns)]
    nearest, inside, cut = [], [], []
    for span, size in zip(spans, amap.solid.shape, strict=True):
        clipped = np.clip(span, 0, size - 1)
        # Whether a cell is of a block depends on those around it.
        first = max(int(clipped[0]) - THICK, 0)
        cut.append(slice(first, int(clipped[-1]) + THICK + 1))
        nearest.append(clipped - first)
        inside.append(clipped == span)
    part = amap.solid[cut[0], cut[1]]
    here = np.asarray(part[np.ix_(*nearest)] & np.logical_and.outer(*inside))
    if amap.dataset.attrs.get("environment_resolution", "null") == "null":
        return here
    blocks = ndimage.binary_opening(part, np.ones((THICK, THICK)))
    return np.asarray(here | blocks[np.ix_(*nearest)])
