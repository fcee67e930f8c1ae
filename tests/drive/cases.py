"""Routes and scanners that the tests of drives share."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ambinav.geometry.motion.steering import Steering
from ambinav.maps.zones import ZONES
from ambinav.routes.route import Route
from ambinav.sensing import RangeScanner, RangeSensor


def route_through(poses: ArrayLike, steering: Steering | None = None) -> Route:
    """A route through poses (N, 3), or places (N, 2); no map is needed for it."""
    steering = Steering() if steering is None else steering
    rows = np.array(poses, dtype=np.float64)
    if rows.shape[1] == 2:
        rows = np.column_stack([rows, np.zeros(len(rows))])
    rows = steering.oriented(rows)
    none = np.zeros(len(rows))
    turn = np.abs((np.diff(rows[:, 2]) + math.pi) % (2 * math.pi) - math.pi).sum()
    figures: dict[str, Any] = {
        "planner": "test", "seed": None, "environment": "room", "scanner": "none",
        "layer": "level", "weight": 0.0, "power": 1.0, "clearance_weight": 0.0, "comfort": 0.5,
        "length": float(steering.lengths(rows[:-1], rows[1:]).sum()), "cost": 0.0,
        "exposure": 0.0, "zone_metres": dict.fromkeys(ZONES, 0.0),
        "unexplored_metres": 0.0,
        "longest_bad": 0.0, "longest_corridor": 0.0,
        "longest_open": 0.0, "turn": float(turn),
        "distance": none, "spent": none, "levels": none,
        "zones": none.astype(np.uint8), "seconds": 0.0, "first_seconds": None,
        "iterations": None, "curve": (), "covariances": None,
    }  # fmt: skip
    return Route(poses=rows, steering=steering, **figures)


def laser(max_range: float = 4.0, beams: int = 60, **fields: Any) -> RangeScanner:
    """A scanner that looks all around."""
    sensor = RangeSensor(max_range=max_range, std=0.03, resolution=0.001, **fields)
    return RangeScanner.planar(
        sensor=sensor, beams=beams, aperture=2 * math.pi, mount=(0.0, 0.0, 0.0)
    )


def from_polyline(points: ArrayLike, line: ArrayLike) -> Any:
    """Distance of points (N, 2) from the line through places (M, 2), shape (N,)."""
    import shapely

    path = shapely.LineString(np.asarray(line)[:, :2])
    return shapely.distance(path, shapely.points(np.asarray(points)))
