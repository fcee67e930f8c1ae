"""The part of a plan that lies in a box."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.geometry.border_cover import meeting
from ambinav.geometry.edit import ON_BORDER, polygons_of
from ambinav.geometry.segments import FRONTIER, Segments, edges_of
from ambinav.runtime.array_types import Bools, Bounds, Floats


class Windowed(NamedTuple):
    """Part of a plan that lies in a box.

    Attributes:
        segments: Those that meet it, whole, and its rim in the free space as frontier.
        free: The free space in it.
        thin: Which segments run through the free space (`off_border`), shape (S,).
    """

    segments: Segments
    free: BaseGeometry
    thin: Bools


def clipped(shape: BaseGeometry, bounds: Bounds) -> BaseGeometry:
    """Return the polygons of a shape in a box."""
    return polygons_of(shapely.intersection(shape, shapely.box(*bounds)))


def windowed(segments: Segments, free: BaseGeometry, bounds: Bounds) -> Windowed | None:
    """Return the part of a plan that lies in a box; None if no free space does."""
    part = clipped(free, bounds)
    if part.is_empty:
        return None
    near = meeting(segments.xy, bounds)
    xy, edges = segments.xy[near], edges_of(part)
    box = np.array(bounds)
    start, end = edges[:, [0, 1, 0, 1]], edges[:, [2, 3, 2, 3]]
    on_rim = (np.abs(start - box) < ON_BORDER) & (np.abs(end - box) < ON_BORDER)
    rim = edges[on_rim.any(axis=1)]
    kind = np.append(segments.kind[near], np.full(len(rim), FRONTIER, dtype=np.uint8))
    thin = np.append(off_border(xy, free), np.zeros(len(rim), dtype=np.bool_))
    return Windowed(Segments(np.concatenate([xy, rim]), kind), part, thin)


def off_border(rows: Floats, free: BaseGeometry) -> Bools:
    """Return the mask of segments, (N, 4), whose middle is in the free space, off its border."""
    middle = shapely.points((rows[:, :2] + rows[:, 2:]) / 2)
    edge = free.boundary
    shapely.prepare(edge)
    inside = ~np.asarray(shapely.dwithin(edge, middle, ON_BORDER), dtype=np.bool_)
    # Exclude walls whose middle is covered by an obstacle (`Environment.edited`).
    inside[inside] = shapely.contains(free, middle[inside])
    return inside
