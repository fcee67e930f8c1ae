"""Drawn buildings whose floor is of every kind, with the scanner that they are judged for."""

from __future__ import annotations

import math

import numpy as np
import shapely

import ambinav as an
from ambinav.buildings.boundary import environment_from_grid
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, OccupancyGrid

LASER = an.RangeScanner.planar(
    sensor=an.RangeSensor(max_range=3.0, std=0.02, resolution=0.01),
    beams=36, aperture=math.tau, name="laser of 3 m",
)  # fmt: skip


def seen_in_part() -> an.Environment:
    """A hall whose far half was never seen: rays that end there end in unknown space."""
    hall = shapely.box(0.0, 0.0, 14.0, 4.0)
    rims = [shapely.LineString([(7.0, y), (14.0, y)]) for y in (0.0, 4.0)]
    rims.append(shapely.LineString([(14.0, 0.0), (14.0, 4.0)]))
    return an.environment_from_shapes([hall], openings=rims, name="seen in part")


def on_a_page() -> an.Environment:
    """A hall and a corridor in the middle of a page, and a room that is cut off from them."""
    state = np.full((160, 260), FREE, dtype=np.uint8)
    state[40:120, 40:220] = OCCUPIED
    state[44:116, 44:124] = FREE  # a hall of 8 x 7.2 m
    state[70:86, 124:190] = FREE  # a corridor, 1.6 m wide
    state[50:66, 140:180] = FREE  # a closed room
    return environment_from_grid(OccupancyGrid(state, 0.1))
