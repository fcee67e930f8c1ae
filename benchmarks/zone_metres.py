"""Metres of a route in corridor and in open zones, and the longest stretch of each."""

from __future__ import annotations

import numpy as np

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import CORRIDOR, OPEN
from ambinav.routes.evaluate import PER_CELL, zone_codes
from ambinav.routes.route import Route


def zone_figures(amap: AmbiguityMap, route: Route) -> dict[str, float]:
    """Metres in both zones and the longest stretches, by name."""
    dense, _, along = route.steering.dense(route.poses, amap.spacing / PER_CELL)
    metres = np.diff(along)
    middle = 0.5 * (dense[:-1] + dense[1:])
    turned = np.diff(dense[:, 2])
    middle[:, 2] = dense[:-1, 2] + 0.5 * ((turned + np.pi) % (2.0 * np.pi) - np.pi)
    codes = zone_codes(amap, middle)[metres > 0.0]
    metres = metres[metres > 0.0]
    found = {}
    for name, code in (("corridor", CORRIDOR), ("open", OPEN)):
        longest, stretch = 0.0, 0.0
        for here, step in zip(codes == code, metres, strict=True):
            stretch = stretch + step if here else 0.0
            longest = max(longest, stretch)
        found[name] = route.zone_metres[name]
        found[f"longest_{name}"] = float(longest)
    return found
