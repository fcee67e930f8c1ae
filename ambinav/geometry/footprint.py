"""Footprint of a robot: a disc, or a polygon in the robot's frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from ambinav.config import as_nonnegative
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

ROUNDING: Final = 1e-9
"""How much nearer to a wall a footprint may come than its size, metres; a point stays as far."""


@dataclass(frozen=True, eq=False)
class Footprint:
    """A disc around the robot's reference point, or a polygon around or beside it.

    Made by `Footprint.disc` and `Footprint.polygon`.

    Attributes:
        radius: Radius of the disc, metres; 0 for a polygon.
        corners: Corners of the polygon, float64, shape (N, 2), counter-clockwise, metres, robot
            frame (x forward, y left); shape (0, 2) for a disc.
    """

    radius: float
    corners: Floats

    def __eq__(self, other: object) -> bool:
        """Compare outlines: discs of one radius are equal, and polygons of the same corners."""
        return isinstance(other, Footprint) and self._outline == other._outline

    def __hash__(self) -> int:
        """Return a hash that equal footprints share."""
        return hash(self._outline)

    @property
    def _outline(self) -> tuple[float, bytes]:
        return float(self.radius), self.corners.tobytes()

    @classmethod
    def disc(cls, radius: float) -> Footprint:
        """Make a disc of `radius` metres; a radius of 0 is a point, which must not touch a wall.

        Raises:
            InputError: the radius is negative or not finite.
        """
        radius = as_nonnegative(radius, "footprint: radius", "metres")
        return cls(radius, np.empty((0, 2)))

    @classmethod
    def polygon(cls, points: ArrayLike) -> Footprint:
        """Make a polygon from its corners in order, shape (N, 2), metres, robot frame.

        It need not be convex; the first corner may stand at the end again.

        Raises:
            InputError: fewer than three corners, a corner that is not finite, no area, or edges
                that cross.
        """
        try:
            xy = np.array(points, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(
                "footprint: the corners are not numbers; give rows of x and y in metres."
            ) from error
        if xy.ndim != 2 or xy.shape[1] != 2:
            raise InputError(
                f"footprint: the corners have shape {xy.shape}; give rows of x and y in metres."
            )
        if not np.isfinite(xy).all():
            row = int(np.flatnonzero(~np.isfinite(xy).all(axis=1))[0])
            raise InputError(
                f"footprint: corner {row} is {xy[row].tolist()}; give finite numbers of metres."
            )
        if len(xy) > 1 and (xy[0] == xy[-1]).all():
            xy = xy[:-1]
        if len(xy) < 3:
            raise InputError(f"footprint: {len(xy)} corners make no polygon; give at least three.")
        ring = shapely.Polygon(xy)
        if not ring.is_valid or ring.area <= 0.0:
            reason = shapely.is_valid_reason(ring) if not ring.is_valid else "it has no area"
            raise InputError(
                f"footprint: the corners make no simple polygon ({reason}); list them in order "
                "around the robot."
            )
        if not ring.exterior.is_ccw:
            xy = xy[::-1]
        return cls(0.0, np.ascontiguousarray(xy))

    def __repr__(self) -> str:
        """Return kind and size as text."""
        if self.is_disc:
            return f"Footprint.disc({self.radius:g})"
        return f"Footprint.polygon({self.corners.tolist()})"

    @property
    def is_disc(self) -> bool:
        """True if it is a disc, so that the heading does not matter."""
        return len(self.corners) == 0

    @cached_property
    def is_symmetric(self) -> bool:
        """True if half a turn about the origin changes nothing, as for a disc."""
        if self.is_disc:
            return True
        turned = shapely.Polygon(-self.corners)
        return bool(shapely.hausdorff_distance(self.shape.exterior, turned.exterior) <= ROUNDING)

    @cached_property
    def inner(self) -> float:
        """Radius of the largest disc around the origin inside the footprint, metres; 0 if none."""
        if self.is_disc:
            return self.radius
        origin, shape = shapely.Point(0.0, 0.0), self.shape
        return float(shape.exterior.distance(origin)) if shape.contains(origin) else 0.0

    @cached_property
    def outer(self) -> float:
        """Radius in metres of the smallest disc around the origin that covers it."""
        if self.is_disc:
            return self.radius
        return float(np.hypot(self.corners[:, 0], self.corners[:, 1]).max())

    @cached_property
    def shape(self) -> BaseGeometry:
        """Shapely geometry in the robot's frame: a polygon, or a point for a disc of radius 0.

        A disc's outline has 128 corners.
        """
        if not self.is_disc:
            return shapely.Polygon(self.corners)
        origin = shapely.Point(0.0, 0.0)
        return origin.buffer(self.radius, quad_segs=32) if self.radius > 0.0 else origin

    def placed(self, poses: Floats) -> NDArray[np.object_]:
        """Return shapely geometries at poses, shape (N, 3): metres and radians, map frame."""
        c, s = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
        x, y = shapely.get_coordinates(self.shape).T
        moved = np.stack([c * x - s * y, s * x + c * y], axis=-1) + poses[:, None, :2]
        if moved.shape[1] == 1:
            return np.asarray(shapely.points(moved[:, 0]))
        return np.asarray(shapely.polygons(moved))
