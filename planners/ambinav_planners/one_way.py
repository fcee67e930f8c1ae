"""One-way lanes: floor on which a robot may move in one direction only, or across."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from ambinav.config import as_number, as_positive
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError
from ambinav_planners.geojson import Feature, list_of, point_of, read_features
from ambinav_planners.search.graph import MotionGraph

# A motion is against a lane if it goes back by more than this share of its length, for longer than
# so many metres, and farther within than this from the lane's edge.
AGAINST, LONGER, EDGE = 1e-6, 1e-6, 1e-4
_NARROW = f"the lane is nowhere {2.0 * EDGE:g} m wide; draw its whole width, metres."


@dataclass(frozen=True, eq=False)
class OneWayLanes:
    """Polygons, each with the direction in which it may be driven.

    Attributes:
        polygons: The floor of each lane, map frame, metres, shape (K,).
        directions: Unit vectors, float64, shape (K, 2).
    """

    polygons: NDArray[np.object_]
    directions: Floats

    @classmethod
    def of(cls, polygons: list[BaseGeometry], degrees: ArrayLike) -> OneWayLanes:
        """Create lanes of polygons and their directions.

        Args:
            polygons: Map frame, metres.
            degrees: Direction of each, counter-clockwise from the map's x axis.

        Raises:
            InputError: a polygon is no polygon with an area.
        """
        for k, polygon in enumerate(polygons):
            sound = isinstance(polygon, shapely.Polygon | shapely.MultiPolygon) and polygon.is_valid
            if not sound or not polygon.area > 0.0:
                raise InputError(f"polygons[{k}] is not a valid polygon with an area; correct it.")
        try:
            angle = np.radians(np.asarray(degrees, dtype=np.float64))
        except (TypeError, ValueError):
            raise InputError(f"degrees is {degrees!r}; give a direction for each lane.") from None
        if angle.shape != (len(polygons),) or not np.isfinite(angle).all():
            raise InputError(f"degrees is {degrees!r}; give a finite direction for each lane.")
        inner = np.empty(len(polygons), dtype=np.object_)
        inner[:] = [shapely.buffer(polygon, -EDGE) for polygon in polygons]
        for k, lane in enumerate(inner):
            if lane.is_empty:
                raise InputError(f"polygons[{k}]: {_NARROW}")
        shapely.prepare(inner)
        return cls(inner, np.stack([np.cos(angle), np.sin(angle)], axis=-1))

    @classmethod
    def read(cls, path: str | Path) -> OneWayLanes:
        """Read lanes from a GeoJSON FeatureCollection in the map frame, metres.

        A Polygon has the property `direction`, degrees counter-clockwise from the map's x axis; a
        LineString is driven as it is drawn, and has the property `width`, metres.

        Raises:
            InputError: the file cannot be read, or holds no lane; the message names the feature,
                counted from 0, the field and the value.
        """
        path = Path(path)
        polygons: list[BaseGeometry] = []
        degrees: list[float] = []
        for feature in read_features(path, "one-way lanes"):
            for polygon, angle in _lanes(feature):
                if not polygon.is_valid or not polygon.area > 0.0:
                    raise InputError(f"{feature.label}: its outline crosses itself or is empty.")
                polygons.append(polygon)
                degrees.append(angle)
        if not polygons:
            raise InputError(
                f"{path}: there is no lane in it; give Polygons with direction, or LineStrings "
                "with width."
            )
        return cls.of(polygons, degrees)

    def allow(self, poses: Floats) -> bool:
        """Return whether a path of straight motions, shape (N, 3), goes against no lane."""
        return bool(self.allowed(poses[:-1], poses[1:]).all())

    def allowed(self, a: Floats, b: Floats) -> Bools:
        """Return whether straight motions from poses a to b, (N, 3) each, go against no lane."""
        out = np.ones(len(a), dtype=np.bool_)
        step = b[:, :2] - a[:, :2]
        length = np.hypot(*step.T)
        low, high = np.minimum(a, b), np.maximum(a, b)
        for lane, direction in zip(self.polygons, self.directions, strict=True):
            xmin, ymin, xmax, ymax = lane.bounds
            near = (low[:, 0] <= xmax) & (high[:, 0] >= xmin)
            near &= (low[:, 1] <= ymax) & (high[:, 1] >= ymin)
            back = np.flatnonzero(near & out & (step @ direction < -AGAINST * length))
            # Most are inside, and their middles are cheaper to look up than the whole motions.
            inside = shapely.contains_xy(lane, 0.5 * (a[back, :2] + b[back, :2]))
            out[back[inside]] = False
            back = back[~inside]
            lines = shapely.linestrings(np.stack([a[back, :2], b[back, :2]], axis=1))
            touched = shapely.intersects(lane, lines)
            back, lines = back[touched], lines[touched]
            out[back[shapely.length(shapely.intersection(lane, lines)) > LONGER]] = False
        return out


def legal_part(graph: MotionGraph, lanes: OneWayLanes) -> MotionGraph:
    """Return a graph of straight motions without those that go against a lane."""
    return graph.without(~lanes.allowed(graph.poses[graph.source], graph.poses[graph.target]))


def _lanes(feature: Feature) -> list[tuple[BaseGeometry, float]]:
    """Return the polygons of a feature and their directions, degrees."""
    label, properties, geometry = feature
    kind, coordinates = geometry["type"], geometry.get("coordinates")
    if kind == "Polygon":
        angle = as_number(properties.get("direction"), f"{label}: direction")
        rings = [
            [point_of(label, point) for point in list_of(label, ring)]
            for ring in list_of(label, coordinates)
        ]
        if not rings or any(len(ring) < 4 for ring in rings):
            raise InputError(f"{label}: a ring has fewer than 4 points; close it.")
        polygon = shapely.Polygon(rings[0], rings[1:])
        if polygon.is_valid and shapely.buffer(polygon, -EDGE).is_empty:
            raise InputError(f"{label}: {_NARROW}")
        return [(polygon, angle)]
    if kind == "LineString":
        width = as_positive(properties.get("width"), f"{label}: width", "metres")
        if width <= 2.0 * EDGE:
            raise InputError(f"{label}: {_NARROW}")
        points = [point_of(label, point) for point in list_of(label, coordinates)]
        return [
            (
                shapely.buffer(shapely.LineString([p, q]), 0.5 * width, cap_style="flat"),
                math.degrees(math.atan2(q[1] - p[1], q[0] - p[0])),
            )
            for p, q in itertools.pairwise(points)
            if math.dist(p, q) > 2.0 * EDGE  # of shorter pieces nothing is left within the edges
        ]
    raise InputError(f"{label}: type is {kind!r}; draw lanes as Polygons or LineStrings.")
