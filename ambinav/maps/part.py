"""Parts of maps, as `AmbiguityMap.open` reads them with `bounds`."""

from __future__ import annotations

import math

from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap


def is_part(amap: AmbiguityMap, environment: Environment | None = None) -> bool:
    """Return whether the lattice of a map ends before its building does.

    Args:
        amap: The map.
        environment: Building of the map, if available; None: that stored in the map.
    """
    building = amap.environment if environment is None else environment
    spacing = float(amap.parameters.get("spacing", amap.spacing))
    xmin, ymin, xmax, ymax = building.free.bounds
    for name, low, high in (("x", xmin, xmax), ("y", ymin, ymax)):
        first, last = (round(float(c) / spacing - 0.5) for c in amap.dataset[name].values[[0, -1]])
        # As in `Lattice.axes`.
        if math.floor(low / spacing) < first or math.floor(high / spacing) > last:
            return True
    return False
