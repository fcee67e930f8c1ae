"""A building as seen by a robot with a scanner: geometry, ambiguity map and free space."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav_envs.buildings.free_space import FreeSpaceLattice

LAYERS: Final = ("fisher",)
"""Layers of a building's map beside those of every map."""


@dataclass(frozen=True, eq=False)
class Building:
    """A building and the data derived from it, each computed when it is first used.

    Made by `Building.of`.

    Attributes:
        key: Its unique name.
        environment: Its geometry.
        scanner: The robot's scanner.
        robot_radius: Radius of the robot's disc, metres.
        spacing: Spacing of the ambiguity map's lattice, metres.
        keep: Whether its map is kept in the user's store (`ambinav.store`).
        layers: Layers of its map beside `LAYERS`.
    """

    key: str
    environment: Environment
    scanner: RangeScanner
    robot_radius: float
    spacing: float
    keep: bool
    layers: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        environment: Environment,
        scanner: RangeScanner,
        robot_radius: float,
        spacing: float = 0.2,
        *,
        key: str | None = None,
        keep: bool = True,
        layers: tuple[str, ...] = (),
    ) -> Building:
        """Wrap a building; nothing is computed yet.

        Args:
            environment: Its geometry.
            scanner: The robot's scanner.
            robot_radius: Radius of the robot's disc, metres.
            spacing: Spacing of the ambiguity map's lattice, metres.
            key: Its name; None: the environment's name.
            keep: Whether its map is kept on disk.
            layers: Layers of its map beside `LAYERS`.

        Raises:
            InputError: a number makes no sense.
        """
        for name, value, least in (("robot_radius", robot_radius, 0.0), ("spacing", spacing, 0.01)):
            if not (math.isfinite(value) and value >= least):
                raise InputError(f"{name} is {value}; give metres from {least:g} on.")
        return cls(
            environment.name if key is None else key,
            environment, scanner, float(robot_radius), float(spacing), keep,
            layers,
        )  # fmt: skip

    @cached_property
    def amap(self) -> AmbiguityMap:
        """Ambiguity map with `LAYERS` and the building's own layers, opened if it is in the store.

        Raises:
            InputError: the scanner cannot have these layers, or $AMBINAV_CACHE is a file.
        """
        layers = LAYERS + tuple(name for name in self.layers if name not in LAYERS)
        return build_map(
            self.environment, self.scanner, self.spacing, layers=layers, store=self.keep
        )

    @cached_property
    def checker(self) -> CollisionChecker:
        """Collision checker of the simulation for the robot's disc and straight motions (r2)."""
        footprint = Footprint.disc(self.robot_radius)
        return CollisionChecker(self.environment, footprint, Steering("r2"), simulated=True)

    @cached_property
    def lattice(self) -> FreeSpaceLattice:
        """Lattice of the points where the robot fits, and the moves between them.

        Raises:
            InputError: there is no room for the robot.
        """
        return FreeSpaceLattice.of(self.checker)
