"""The free floor of a map in three parts: what counts, what is unexplored, what is not reached."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambinav.errors import InputError
from ambinav.geometry.collision.reach import Reach
from ambinav.maps.ambiguity_map import AmbiguityMap

Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class FloorParts:
    """Which cells of a map's free floor count. Masks are bool, shape (ny, nx); no two overlap.

    Attributes:
        counted: Explored, and a robot's centre can get there.
        unexplored: A robot's centre can get there, but half of the beams or more end in unknown
            space (`AmbiguityMap.unexplored`).
        beside_walls: Nearer to a wall than the robot's radius: its centre is never there.
        cut_off: A robot would fit, but cannot get there.
        cell_area: Of one cell, square metres.
        radius: Of the robot, metres; None: nobody asked what a robot reaches, all counts as
            reachable.
    """

    counted: Mask
    unexplored: Mask
    beside_walls: Mask
    cut_off: Mask
    cell_area: float
    radius: float | None = None

    @classmethod
    def of(cls, amap: AmbiguityMap, reach: Reach | None = None) -> FloorParts:
        """Part the floor of a map.

        Args:
            amap: The map.
            reach: What a robot reaches in the map's building; None: everything.
        """
        free = np.asarray(amap.dataset["free"].values, dtype=np.bool_)
        has_room, reachable = free.copy(), free.copy()
        if reach is not None:
            x, y = amap.dataset["x"].values, amap.dataset["y"].values
            rows, columns = np.nonzero(free)
            has_room[rows, columns] = reach.has_room(x[columns], y[rows])
            reachable[rows, columns] = reach.reaches(x[columns], y[rows])
        unexplored = amap.unexplored
        return cls(
            counted=reachable & ~unexplored,
            unexplored=reachable & unexplored,
            beside_walls=free & ~has_room,
            cut_off=has_room & ~reachable,
            cell_area=amap.cell_area,
            radius=None if reach is None else reach.radius,
        )

    @classmethod
    def reached(cls, amap: AmbiguityMap, reach: Reach) -> FloorParts:
        """As `of`, where a robot must reach some cell.

        Raises:
            InputError: it reaches none of the map's.
        """
        parts = cls.of(amap, reach)
        if not parts.reachable.any():
            raise InputError(
                f"spacing: none of the map's cells, {amap.spacing:g} m apart, lies on floor that a "
                f"robot of radius {reach.radius:g} m reaches; give a smaller spacing."
            )
        return parts

    @property
    def reachable(self) -> Mask:
        """Where a robot's centre can get to, explored or not."""
        return self.counted | self.unexplored

    @property
    def unreachable(self) -> Mask:
        """Free floor where a robot's centre cannot get to."""
        return self.beside_walls | self.cut_off

    def area(self, part: Mask) -> float:
        """Area of some cells, square metres."""
        return float(part.sum()) * self.cell_area


def unreachable_label(radius: float) -> str:
    """What tables call floor that a robot of this radius, in metres, does not reach."""
    return f"not reachable by a robot of {radius:.2f} m"
