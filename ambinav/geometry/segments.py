"""Wall segments: the geometry that all rays are cast against."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely import affinity
from shapely.geometry.base import BaseGeometry

from ambinav.runtime.array_types import Bools, Bytes, Floats

WALL: Final = 0
FRONTIER: Final = 1
# A wall like any other, save that what returns from it is stronger (`ambinav.sensing.intensity`).
REFLECTOR: Final = 2
# Treated as a wall; figures and callers can distinguish it from masonry.
GLASS: Final = 3


@dataclass(frozen=True, eq=False)
class Segments:
    """Straight pieces of wall, or of the frontier to unknown space, in the map frame.

    Attributes:
        xy: End points, float64, shape (N, 4), columns ax, ay, bx, by, metres.
        kind: uint8, shape (N,): `WALL`, `FRONTIER`, `REFLECTOR` or `GLASS`.
    """

    xy: Floats
    kind: Bytes

    def __post_init__(self) -> None:
        """Convert both arrays to their type and order, and drop segments of length 0."""
        xy = np.ascontiguousarray(self.xy, dtype=np.float64).reshape(-1, 4)
        kind = np.ascontiguousarray(self.kind, dtype=np.uint8).reshape(-1)
        if len(xy) != len(kind):
            raise ValueError(f"Segments: {len(xy)} segments but {len(kind)} kinds.")
        if not np.isfinite(xy).all():
            raise ValueError("Segments: an end point is not finite.")
        extended = (xy[:, 0] != xy[:, 2]) | (xy[:, 1] != xy[:, 3])
        object.__setattr__(self, "xy", np.ascontiguousarray(xy[extended]))
        object.__setattr__(self, "kind", np.ascontiguousarray(kind[extended]))

    def __len__(self) -> int:
        """Return the number of segments."""
        return len(self.xy)

    @cached_property
    def normals(self) -> Floats:
        """Unit normals, shape (N, 2), left of a to b."""
        along = self.xy[:, 2:] - self.xy[:, :2]
        normal = np.stack([-along[:, 1], along[:, 0]], axis=-1)
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        return normal

    def normals_of(self, index: ArrayLike) -> Floats:
        """Return the normals of segments by index, (..., 2); nan for -1."""
        which = np.asarray(index, dtype=np.int64)
        normal = self.normals[np.maximum(which, 0)]
        return np.where((which >= 0)[..., None], normal, np.nan)

    @property
    def walls(self) -> Bools:
        """Mask, shape (N,): True where the segment is a wall, reflectors and glass included."""
        return np.asarray(self.kind != FRONTIER)

    @property
    def reflectors(self) -> Bools:
        """Mask, shape (N,): True where the segment is a reflector."""
        return np.asarray(self.kind == REFLECTOR)

    @property
    def glass(self) -> Bools:
        """Mask, shape (N,): True where the segment is of glass."""
        return np.asarray(self.kind == GLASS)

    @property
    def lengths(self) -> Floats:
        """Length of each segment in metres, shape (N,)."""
        return np.hypot(self.xy[:, 2] - self.xy[:, 0], self.xy[:, 3] - self.xy[:, 1])

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax) in metres."""
        x, y = self.xy[:, 0::2], self.xy[:, 1::2]
        return float(x.min()), float(y.min()), float(x.max()), float(y.max())

    def same_as(self, other: Segments) -> bool:
        """Return whether all rows are equal, bit for bit and in the same order."""
        return np.array_equal(self.xy, other.xy) and np.array_equal(self.kind, other.kind)

    def transformed(self, angle: float, dx: float, dy: float) -> Segments:
        """Turn about the origin by `angle` (radians, counter-clockwise), then shift (metres)."""
        c, s = math.cos(angle), math.sin(angle)
        x, y = self.xy[:, 0::2], self.xy[:, 1::2]
        turned = np.empty_like(self.xy)
        turned[:, 0::2] = c * x - s * y + dx
        turned[:, 1::2] = s * x + c * y + dy
        return Segments(turned, self.kind)


def edges_of(shape: BaseGeometry) -> Floats:
    """End points ax, ay, bx, by of the edges of polygons, shape (N, 4), in their unit."""
    rings = shapely.get_rings(shapely.get_parts(shape))
    xy, ring = shapely.get_coordinates(rings, return_index=True)
    edges: Floats = np.hstack([xy[:-1], xy[1:]])[ring[:-1] == ring[1:]]
    return edges


def pieces_of(line: BaseGeometry) -> Floats:
    """Return the straight pieces of a line, ring or polygon without holes, shape (N, 4)."""
    points = shapely.get_coordinates(line)
    return np.hstack([points[:-1], points[1:]])


def moved(shape: BaseGeometry, angle: float, dx: float, dy: float) -> BaseGeometry:
    """Turn a shape about the origin by `angle` radians, then shift by (dx, dy) metres."""
    turned = affinity.rotate(shape, angle, origin=(0.0, 0.0), use_radians=True)
    return affinity.translate(turned, dx, dy)
