"""Obstacles on a building's floor: walls, panels, posts, reflectors."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, Self

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from ambinav.config import as_array, as_nonnegative, as_number, as_positive
from ambinav.runtime.errors import InputError

FURTHEST: Final = 1e8
"""Metres; coordinates beyond are not those of a building."""
# How far the sides of a post's polygon may lie within its circle, metres.
ROUNDNESS: Final = 1e-3
FEWEST_SIDES: Final = 16
MOST_SIDES: Final = 128


@dataclass(frozen=True)
class Obstacle:
    """Opaque object on the floor, which neither rays nor robots pass.

    Attributes:
        outline: A LineString is a wall without thickness, a Polygon is cut out of the floor; map
            frame, metres.
        reflective: Whether its faces are `ambinav.geometry.segments.REFLECTOR` and not `WALL`. A
            reflective line along a wall is a tag on it.
        bottom: Height of its lower edge above the floor in a building in space, metres. A plan has
            no heights, and a robot passes neither under it nor over it.
        top: Height of its upper edge likewise; None: as high as the building.

    Raises:
        InputError: the outline is of another type, crosses itself, has no extent, or a coordinate
            is not finite; or the heights are not ascending from 0 on.
    """

    outline: BaseGeometry
    reflective: bool = False
    bottom: float = 0.0
    top: float | None = None

    def __post_init__(self) -> None:
        """Check the outline and the heights."""
        outline = self.outline
        if not isinstance(outline, shapely.LineString | shapely.Polygon):
            kind = getattr(outline, "geom_type", type(outline).__name__)
            raise InputError(
                f"obstacle: its outline is a {kind}; give a LineString for a wall without "
                "thickness, or a Polygon."
            )
        outline = checked_outline(outline, "obstacle")
        if not (outline.area if isinstance(outline, shapely.Polygon) else outline.length) > 0.0:
            raise InputError(
                f"obstacle: its outline around {_place(outline)} has no extent; give a wall two "
                "different ends, or a polygon three corners that are not in line."
            )
        object.__setattr__(self, "outline", outline)
        bottom = as_nonnegative(self.bottom, "obstacle: bottom", "metres")
        if self.top is not None and not bottom < (top := as_number(self.top, "obstacle: top")):
            raise InputError(
                f"obstacle: top is {top:g}; give a height above its bottom of {bottom:g} metres, "
                "or none for the height of the building."
            )

    def between(self, bottom: float, top: float | None) -> Obstacle:
        """Return the obstacle with other heights above the floor, metres; see the class."""
        return replace(self, bottom=bottom, top=top)

    @property
    def solid(self) -> bool:
        """True if the obstacle has an area, which is not floor."""
        return isinstance(self.outline, shapely.Polygon)

    @classmethod
    def post(cls, x: float, y: float, radius: float, *, reflective: bool = False) -> Self:
        """Make a round post at (x, y), a polygon with corners on its circle; metres, map frame.

        Raises:
            InputError: the radius is not above 0, or a number is not finite.
        """
        radius = as_positive(radius, "post: radius", "metres")
        _finite("post", x=x, y=y)
        sides = math.ceil(math.pi / math.acos(max(1.0 - ROUNDNESS / radius, 0.0)) / 4) * 4
        sides = min(max(sides, FEWEST_SIDES), MOST_SIDES)
        angle = 2.0 * math.pi * (np.arange(sides) + 0.5) / sides
        ring = np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])
        return cls(shapely.Polygon(ring), reflective)

    @classmethod
    def panel(
        cls,
        x0: float,
        y0: float,
        x1: float,
        y1: float,
        thickness: float = 0.0,
        *,
        reflective: bool = False,
    ) -> Self:
        """Make a straight panel from (x0, y0) to (x1, y1); metres, map frame.

        Args:
            x0: One end.
            y0: One end.
            x1: The other.
            y1: The other.
            thickness: Metres, half on each side of the line; 0: none, so that it is a line.
            reflective: Whether it is a reflector.

        Raises:
            InputError: the ends are the same, the thickness is negative, or a number is not finite.
        """
        _finite("panel", x0=x0, y0=y0, x1=x1, y1=y1)
        return cls.wall([(x0, y0), (x1, y1)], thickness, reflective=reflective)

    @classmethod
    def wall(cls, points: ArrayLike, thickness: float = 0.0, *, reflective: bool = False) -> Self:
        """Make a wall along points, shape (n, 2), n at least 2; metres, map frame.

        Args:
            points: Its course.
            thickness: Metres, half on each side, with flat ends; 0: none.
            reflective: Whether it is a reflector.

        Raises:
            InputError: there are fewer than two different points, the thickness is negative, or a
                number is not finite.
        """
        course = as_array(points, "wall: points", "(n, 2) with n at least 2")
        if course.ndim != 2 or course.shape[1] != 2 or len(course) < 2:
            raise InputError(
                f"wall: points have the shape {course.shape}; give (n, 2) with n at least 2."
            )
        thickness = as_nonnegative(thickness, "wall: thickness", "metres")
        line = cls(shapely.LineString(course), reflective)
        if thickness == 0.0:
            return line
        thick = shapely.buffer(line.outline, thickness / 2, cap_style="flat", join_style="mitre")
        return cls(thick, reflective)


def checked_outline(outline: BaseGeometry, name: str) -> BaseGeometry:
    """Return a shape without heights.

    Raises:
        InputError: it is empty, a coordinate is not finite, or a polygon crosses itself.
    """
    outline = shapely.force_2d(outline)
    points = shapely.get_coordinates(outline)
    if len(points) == 0:
        raise InputError(f"{name}: its outline is empty; give it points.")
    if not (np.abs(points) <= FURTHEST).all():
        raise InputError(
            f"{name}: a coordinate is not finite, or beyond any building; give metres in the map "
            "frame."
        )
    if outline.geom_type.endswith("Polygon") and not outline.is_valid:
        raise InputError(
            f"{name}: its outline is not a simple polygon ({shapely.is_valid_reason(outline)}); "
            "give edges that do not cross."
        )
    return outline


def _finite(label: str, **values: float) -> None:
    for name, value in values.items():
        if not math.isfinite(value):
            raise InputError(f"{label}: {name} is {value}; give a finite number of metres.")


def _place(outline: BaseGeometry) -> str:
    x, y = shapely.get_coordinates(outline)[0].tolist()
    return f"({x:g}, {y:g})"
