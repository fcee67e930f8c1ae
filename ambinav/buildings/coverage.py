"""Coverage of an input: which of its floor, doors and rooms the environment contains."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputWarning

NOTED: Final = 1.0
"""Square metres; less floor that is left out for one reason is not worth a word,"""
NOTED_SHARE: Final = 0.005
"""nor is less as a share of the floor."""
WARNED_SHARE: Final = 0.05
"""From this share of the floor on, and of doors or walls, what is missing is a warning."""
BARE_WALLS: Final = 0.1
"""Walls along which there is no floor are noted from this share of all of them on."""
# Metres. Floor is looked for from here, beyond a wall, to there on both sides of a door, along the
# middle part of it.
_NEAREST, _FURTHEST, _MIDDLE = 0.45, 0.9, 0.6
# Minimum share of that strip that must be floor.
_ENOUGH: Final = 0.1
# Metres. A door without a wall within this distance behind it leads outdoors.
_OUTDOORS: Final = 15.0
# Metres. A room's text stands so far from its floor at most: it may be written over furniture.
_TEXT: Final = 1.0
# Share of a room that has to be floor.
_HELD: Final = 0.1
# Metres. A wall as near to floor borders on it.
_BORDERS: Final = 0.05
# Rooms that are named in one sentence.
_NAMED: Final = 8


@dataclass
class Coverage:
    """Contents of a file beside its floor, to compare with the floor that was found.

    Attributes:
        where: The file.
        left_out: Areas that could be floor and are not, in square metres, each with the number of
            pieces and why, which ends a sentence.
        expected: Those of `left_out`, by why, that are never warned about: hollows in walls.
        doors: Each a line where it shuts, metres.
        rooms: Their names, and the polygons that they fill or points in them.
        walls: Polygons and lines.
    """

    where: str
    left_out: list[tuple[float, int, str]] = field(default_factory=list)
    expected: Sequence[str] = ()
    doors: Sequence[BaseGeometry] = ()
    rooms: list[tuple[str, BaseGeometry]] = field(default_factory=list)
    walls: Sequence[BaseGeometry] = ()

    def leave_out(self, pieces: Sequence[BaseGeometry], why: str) -> None:
        """Count polygons that are no floor; `why` ends the sentence that reports them."""
        areas = [piece.area for piece in pieces if piece.area > 0.0]
        if areas:
            self.left_out.append((sum(areas), len(areas), why))

    def notes(self, free: BaseGeometry, stacklevel: int = 3) -> list[str]:
        """List what is missing from the floor, one sentence each; warn about substantial losses.

        Args:
            free: The floor, polygons.
            stacklevel: Stack level of the warnings; see `warnings.warn`.

        Warns:
            InputWarning: much is missing.
        """
        shapely.prepare(free)
        noted = [
            *self._of_areas(free.area), *self._of_doors(free), *self._of_rooms(free),
            *self._of_walls(free),
        ]  # fmt: skip
        for text, is_grave in noted:
            if is_grave:
                warnings.warn(text, InputWarning, stacklevel=stacklevel)
        return [text for text, _ in noted]

    def _of_areas(self, floor: float) -> list[tuple[str, bool]]:
        return [
            (
                f"{self.where}: {area:.3g} m² in {count} piece{'s'[: count > 1]} "
                f"{'are' if count > 1 else 'is'} not taken for floor: {why}.",
                why not in self.expected and area >= WARNED_SHARE * floor,
            )
            for area, count, why in self.left_out
            if area >= max(NOTED, NOTED_SHARE * floor)
        ]

    def _of_doors(self, free: BaseGeometry) -> list[tuple[str, bool]]:
        doors = [door for door in self.doors if door.length > 0.0]
        if not doors:
            return []
        standing = shapely.union_all(list(self.walls))
        shapely.prepare(standing)
        nowhere = [door for door in doors if _bare_sides(door, free, standing)]
        if not nowhere:
            return []
        x, y = shapely.get_coordinates(
            shapely.line_interpolate_point(nowhere[0], 0.5, normalized=True)
        )[0]
        text = (
            f"{self.where}: {len(nowhere)} of {len(doors)} doors open onto nothing that is taken "
            f"for floor, the first at ({x:.2f}, {y:.2f})."
        )
        return [(text, len(nowhere) > 1 and len(nowhere) >= WARNED_SHARE * len(doors))]

    def _of_rooms(self, free: BaseGeometry) -> list[tuple[str, bool]]:
        empty = [name for name, shape in self.rooms if not _holds_floor(shape, free)]
        if not empty:
            return []
        named = ", ".join(empty[:_NAMED])
        more = f" and {len(empty) - _NAMED} more" if len(empty) > _NAMED else ""
        text = (
            f"{self.where}: no floor is found in {len(empty)} of {len(self.rooms)} named rooms: "
            f"{named}{more}."
        )
        return [(text, True)]

    def _of_walls(self, free: BaseGeometry) -> list[tuple[str, bool]]:
        if not self.walls:
            return []
        walls = np.array(list(self.walls))
        length = _lengths(walls)
        bare = ~shapely.dwithin(free, walls, _BORDERS)
        missing, total = float(length[bare].sum()), float(length.sum())
        if missing < BARE_WALLS * total:
            return []
        text = (
            f"{self.where}: along {missing:.3g} of {total:.3g} m of walls there is no floor; what "
            "they enclose is not closed, or no building."
        )
        return [(text, True)]


def _lengths(walls: NDArray[np.object_]) -> Floats:
    """Return the lengths of lines, and of polygons as walls with two sides."""
    length: Floats = shapely.length(walls)
    return np.where(shapely.get_dimensions(walls) == 2, 0.5 * length, length)


def _holds_floor(shape: BaseGeometry, free: BaseGeometry) -> bool:
    if shape.area > 0.0:
        return bool(shapely.intersection(shape, free).area >= _HELD * shape.area)
    return bool(shapely.dwithin(free, shape, _TEXT))


def _bare_sides(door: BaseGeometry, free: BaseGeometry, standing: BaseGeometry) -> bool:
    """Return whether a door lacks floor on an indoor side, or on both sides."""
    a, b = shapely.get_coordinates(door)[[0, -1]]
    along = (b - a) / np.hypot(*(b - a))
    middle, half = (a + b) / 2.0, 0.5 * _MIDDLE * float(np.hypot(*(b - a))) * along
    bare = []
    for normal in (np.array([-along[1], along[0]]), np.array([along[1], -along[0]])):
        near, far = middle + _NEAREST * normal, middle + _FURTHEST * normal
        strip = shapely.Polygon([near - half, near + half, far + half, far - half])
        if shapely.intersection(strip, free).area < _ENOUGH * strip.area:
            view = shapely.LineString([far, middle + _OUTDOORS * normal])
            bare.append(shapely.intersects(standing, view))
    return len(bare) == 2 or any(bare)
