"""Judged floor: cells of a map that every figure counts, and why others do not count.

It is a layer of the map, `judged`, made for one robot: the scanner's, unless the map was made for
another. Audit, page, exports, differences and designs all read it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
import xarray as xr
from numpy.typing import NDArray

from ambinav.geometry.collision.reach import FitsNowhereError, Reach, frontier_lines, reach_of
from ambinav.geometry.environment import Environment
from ambinav.geometry.even_odd import lattice_inside
from ambinav.maps.core_layers import CORE_LAYERS
from ambinav.maps.zones import NOT_FREE, UNEXPLORED
from ambinav.runtime.array_types import Bools, Bounds, Bytes, Floats
from ambinav.runtime.errors import InputError

LAYER: Final = "judged"
REASONS: Final = (
    "judged",
    "unexplored",
    "too close to walls",
    "not reachable",
    "outside of the building",
)
"""Reasons why a free cell counts or not; the position in the tuple is the code in the layer."""
JUDGED, UNEXPLORED_FLOOR, TOO_CLOSE, NOT_REACHABLE, OUTSIDE = range(len(REASONS))

ROBOT_RADIUS_ATTR: Final = "robot_radius"
ROBOT_START_ATTR: Final = "robot_start"


@dataclass(frozen=True, eq=False)
class JudgedFloor:
    """Cells of a map's free floor that count. Masks are bool, shape (ny, nx); no two overlap.

    Attributes:
        code: Position in `REASONS`, uint8, shape (ny, nx); `NOT_FREE` off the free floor.
        cell_area: Area of one cell, square metres.
        radius: Radius of the robot that the floor is judged for, metres.
        start: x and y that it sets out from, metres; None: in the piece of floor that `find_reach`
            chooses.
    """

    code: Bytes
    cell_area: float
    radius: float
    start: tuple[float, float] | None = None

    @classmethod
    def read(cls, layer: xr.DataArray, cell_area: float) -> JudgedFloor:
        """Read the floor from a map's layer; without attributes, the robot is a point."""
        start = json.loads(layer.attrs.get(ROBOT_START_ATTR, "null"))
        return cls(
            np.asarray(layer.values, dtype=np.uint8),
            cell_area,
            float(layer.attrs.get(ROBOT_RADIUS_ATTR, 0.0)),
            None if start is None else (float(start[0]), float(start[1])),
        )

    @property
    def layer(self) -> xr.Variable:
        """Variable of a map's dataset with this floor."""
        record = CORE_LAYERS[LAYER]
        attrs: dict[str, Any] = {
            "long_name": record.title,
            "units": record.unit,
            ROBOT_RADIUS_ATTR: self.radius,
            ROBOT_START_ATTR: json.dumps(self.start),
        }
        return xr.Variable(("y", "x"), self.code, attrs)

    @property
    def counted(self) -> Bools:
        """Mask: explored, in the building, and reachable by the robot's centre."""
        return self._of(JUDGED)

    @property
    def unexplored(self) -> Bools:
        """Mask: reached, but half of the beams or more end in unknown space within the map."""
        return self._of(UNEXPLORED_FLOOR)

    @property
    def beside_walls(self) -> Bools:
        """Mask: nearer to a wall than the robot's radius, where its centre cannot be."""
        return self._of(TOO_CLOSE)

    @property
    def cut_off(self) -> Bools:
        """Mask: in the building; the robot would fit there, but cannot reach it."""
        return self._of(NOT_REACHABLE)

    @property
    def outside(self) -> Bools:
        """Mask: the margin around a building, and floor unexplored because the map ends there."""
        return self._of(OUTSIDE)

    @property
    def reachable(self) -> Bools:
        """Bools of the cells that a robot's centre can reach, explored or not."""
        return self.counted | self.unexplored

    @property
    def unreachable(self) -> Bools:
        """Mask: free floor of the building that the robot's centre cannot reach."""
        return self.beside_walls | self.cut_off

    def _of(self, code: int) -> Bools:
        return np.asarray(self.code == code, dtype=np.bool_)

    def area(self, part: Bools) -> float:
        """Return the area of some cells, square metres."""
        return float(part.sum()) * self.cell_area

    def areas(self) -> dict[str, float]:
        """Return the floor that counts and, by reason, what does not, square metres."""
        parts = {
            "judged": self.counted, "unexplored": self.unexplored, "too_close": self.beside_walls,
            "not_reachable": self.cut_off, "outside": self.outside,
        }  # fmt: skip
        return {f"{name}_area_m2": self.area(part) for name, part in parts.items()}

    def check_reached(self, spacing: float) -> None:
        """Check that the robot reaches at least one cell.

        Raises:
            InputError: it reaches none of the map's.
        """
        if not (self.reachable | self.outside).any():
            raise InputError(
                f"spacing: none of the map's cells, {spacing:g} m apart, lies on floor that a "
                f"robot of radius {self.radius:g} m reaches; give a smaller spacing."
            )


@dataclass(frozen=True, eq=False)
class FloorJudge:
    """Judge that decides for any cell whether it counts.

    Attributes:
        reach: What the robot reaches; None: it fits nowhere.
        radius: Radius of the robot, metres.
        frontiers: Where floor ends at unknown space, lines, shape (F,).
        on_rim: Which of them lie on the rim of the map, shape (F,).
    """

    reach: Reach | None
    radius: float
    frontiers: NDArray[np.object_]
    on_rim: Bools

    @classmethod
    def of(cls, environment: Environment, reach: Reach) -> FloorJudge:
        """Judge the floor of a building by what a robot reaches."""
        return cls(reach, reach.radius, *frontier_lines(environment))

    @classmethod
    def for_robot(
        cls, environment: Environment, radius: float, start: tuple[float, float] | None = None
    ) -> FloorJudge:
        """Judge a building's floor for a robot of a radius, metres, that may fit nowhere.

        Raises:
            InputError: the robot does not fit at its start.
        """
        try:
            reach = reach_of(environment, radius, start)
        except FitsNowhereError:
            return cls(None, radius, *frontier_lines(environment))
        return cls.of(environment, reach)

    def changed(self, environment: Environment, boxes: Sequence[Bounds]) -> FloorJudge:
        """Judge the floor of a building that differs from the present one only in boxes.

        Args:
            environment: The building.
            boxes: (xmin, ymin, xmax, ymax), metres: around all that is another, by the robot's
                radius and `SLACK` or more.

        Raises:
            InputError: see `for_robot`.
        """
        if self.reach is None:
            return self.for_robot(environment, self.radius)
        try:
            before = self.reach.fits, boxes
            reach = reach_of(environment, self.radius, self.reach.start, before)
        except FitsNowhereError:
            return FloorJudge(None, self.radius, *frontier_lines(environment))
        return self.of(environment, reach)

    def floor(
        self,
        free: Bools,
        unknown: NDArray[np.floating[Any]] | None,
        x: Floats,
        y: Floats,
        cell_area: float,
    ) -> JudgedFloor:
        """Judge the floor of a lattice; arguments as for `codes`."""
        start = None if self.reach is None else self.reach.start
        return JudgedFloor(self.codes(free, unknown, x, y), cell_area, self.radius, start)

    def codes(
        self, free: Bools, unknown: NDArray[np.floating[Any]] | None, x: Floats, y: Floats
    ) -> Bytes:
        """Return the code of each cell of a lattice, or of some of its rows.

        Args:
            free: Cells of the free floor, shape (ny, nx).
            unknown: Share of the beams that end in unknown space, shape (ny, nx); None: 0.
            x: Centres of the columns, metres.
            y: Centres of the rows, metres.

        Returns:
            As `JudgedFloor.code`.
        """
        code = np.where(free, TOO_CLOSE, NOT_FREE).astype(np.uint8)
        if self.reach is None:
            return code
        code[free & lattice_inside(self.reach.fits, x, y)] = NOT_REACHABLE
        code[free & lattice_inside(self.reach.margins, x, y)] = OUTSIDE
        reached = free & lattice_inside(self.reach.floor, x, y)
        code[reached] = JUDGED
        if unknown is not None:
            row, column = np.nonzero(reached & (unknown >= UNEXPLORED))  # NaN is not
            at_rim = self._at_rim(x[column], y[row])
            code[row, column] = np.where(at_rim, OUTSIDE, UNEXPLORED_FLOOR)
        return code

    def _at_rim(self, x: Floats, y: Floats) -> Bools:
        """Return whether the nearest unknown space lies beyond the rim of the map."""
        if not self.on_rim.any():
            return np.zeros(len(x), dtype=np.bool_)
        nearest = shapely.STRtree(self.frontiers).nearest(shapely.points(x, y))
        return np.asarray(self.on_rim[nearest], dtype=np.bool_)


def unreachable_label(radius: float) -> str:
    """Return the label of floor that a robot of this radius, in metres, does not reach."""
    return f"not reachable by a robot of {radius:.2f} m"
