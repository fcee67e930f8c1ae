"""The true building, which may deviate from its map."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np

from ambinav.drive.ageing import with_aged_walls, with_moved_furniture
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.motion.steering import Steering
from ambinav_envs.buildings.building import Building
from ambinav_envs.buildings.free_space import FreeSpaceLattice

# Purposes of random numbers; every building has a stream for each.
_WALLS, _FURNITURE = range(2)
# Room that moved furniture leaves beside what the robot needs to pass, metres.
_SPARE = 0.1


@dataclass(frozen=True, eq=False)
class World:
    """A building as it truly is.

    Attributes:
        environment: Its geometry.
        lattice: Where the robot fits, on the cells of the map's lattice.
    """

    environment: Environment
    lattice: FreeSpaceLattice

    @classmethod
    def of(cls, building: Building, walls_std: float, furniture_std: float) -> World:
        """Return the world of a building's map: one for each map, the same in every process.

        Args:
            building: The building as mapped.
            walls_std: See `with_aged_walls`, metres.
            furniture_std: See `with_moved_furniture`, metres.

        Raises:
            InputError: no room for the robot is left.
        """
        environment, number = building.environment, zlib.crc32(building.key.encode())
        if furniture_std > 0.0:
            passage = 2.0 * building.robot_radius + _SPARE
            rng = np.random.default_rng([number, _FURNITURE])
            environment = with_moved_furniture(environment, furniture_std, rng, passage)
        if walls_std > 0.0:
            rng = np.random.default_rng([number, _WALLS])
            environment = with_aged_walls(environment, walls_std, rng)
        if environment is building.environment:
            return cls(environment, building.lattice)
        checker = CollisionChecker(
            environment, building.checker.footprint, Steering("r2"), simulated=True
        )
        return cls(environment, building.lattice.like(checker))
