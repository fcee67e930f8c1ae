"""Free floor of a building, also where a map made for a robot of some size has no values."""

from __future__ import annotations

import json

import numpy as np

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Bools, Floats


def is_for_points(amap: AmbiguityMap) -> bool:
    """Return whether a map has values wherever a scan can be taken: its robot has no size."""
    return not json.loads(amap.dataset.attrs["parameters"]).get("robot_radius")


def free_cells(amap: AmbiguityMap, x: Floats, y: Floats) -> Bools:
    """Return where a scan can be taken, bool, shape (rows, columns).

    Args:
        amap: The map.
        x: Columns, metres: those of the map, or as many times finer.
        y: Rows.
    """
    free = np.asarray(amap.dataset["free"].values, dtype=np.bool_)
    parts = len(x) // free.shape[1]
    free = free.repeat(parts, axis=0).repeat(parts, axis=1)
    if is_for_points(amap):
        return free
    return np.asarray(free | amap.environment.is_free(*np.meshgrid(x, y)))


def clearances(amap: AmbiguityMap) -> Floats:
    """Return the distance to the nearest wall at the cells' centres, metres; 0 in walls."""
    if is_for_points(amap):
        return np.nan_to_num(amap.dataset["clearance"].values.astype(np.float64), nan=0.0)
    x, y = (amap.dataset[axis].values.astype(np.float64) for axis in "xy")
    away = amap.environment.clearance(*np.meshgrid(x, y))
    return np.where(free_cells(amap, x, y), away, 0.0)
