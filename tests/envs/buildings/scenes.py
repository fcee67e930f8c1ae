"""Small buildings whose paths are known, and what the tests do with them."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import NDArray

import ambinav as an
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.localization.random import states
from ambinav_envs.buildings.free_space import FreeSpaceLattice
from ambinav_envs.buildings.tasks import spread_from

RADIUS = 0.22


def room(width: float = 8.0, depth: float = 6.0) -> an.Environment:
    """A room with nothing in it."""
    return an.environment_from_shapes([shapely.box(0.0, 0.0, width, depth)], name="room")


def two_rooms(door: float) -> an.Environment:
    """Two rooms of 4 x 4 m with a wall of 0.2 m between them and a door in its middle."""
    rooms = [shapely.box(0, 0, 4, 4), shapely.box(4.2, 0, 8.2, 4)]
    if door > 0.0:
        rooms.append(shapely.box(3.9, 2 - door / 2, 4.3, 2 + door / 2))
    return an.environment_from_shapes(rooms, name="two rooms")


def screen() -> an.Environment:
    """A room of 8 x 6 m with a wall without thickness from its lower side to y = 4, at x = 4."""
    return an.environment_from_shapes(
        [shapely.box(0, 0, 8, 6)], walls=[np.array([(4.0, 0.0), (4.0, 4.0)])], name="screen"
    )


def places_in(
    environment: an.Environment, radius: float = RADIUS, **options: float
) -> FreeSpaceLattice:
    """The places of a robot in a building."""
    checker = CollisionChecker(environment, Footprint.disc(radius), Steering("r2"))
    return FreeSpaceLattice.of(checker, **options)


def field_to(places: FreeSpaceLattice, x: float, y: float) -> NDArray[np.float32]:
    """Distances to a goal."""
    field = np.empty(places.room.shape, dtype=np.float32)
    assert spread_from(x, y, places.table, field) >= 0
    return field


def centres(places: FreeSpaceLattice) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """x and y of all cells, each of shape (rows, columns)."""
    rows, columns = places.room.shape
    x = places.origin[0] + places.spacing * np.arange(columns)
    y = places.origin[1] + places.spacing * np.arange(rows)
    gx, gy = np.meshgrid(x, y)
    return gx, gy


def state(seed: int) -> NDArray[np.uint64]:
    """A stream of random numbers."""
    return states(np.random.default_rng(seed), 1)[0]


def laser(beams: int = 16, max_range: float = 3.0) -> an.RangeScanner:
    """A scanner that looks all around."""
    sensor = an.RangeSensor(max_range=max_range, std=0.03, resolution=0.01)
    return an.RangeScanner.planar(sensor=sensor, beams=beams, aperture=math.tau)
