"""Obstacles to add to a building, as GeoJSON: posts, panels, walls and reflectors.

A FeatureCollection; coordinates are metres in the map's frame. The property `kind` of a Feature:

    kind        geometry      properties
    post        Point         radius, metres
    panel       LineString    thickness, metres, 0 if it is left out
    wall        LineString    thickness
    reflector   either        the same; it reflects: a post of a radius, or a strip

Any of them may have `bottom` and `top`, metres above the floor, which count in a building in space:
left out they are 0 and the height of the building.

Other properties say nothing here. `ambinav design place` writes such files, and the page of
`ambinav serve` writes and reads them.
"""

from __future__ import annotations

import itertools
import math
import reprlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

from ambinav.buildings.drawn_items import is_number
from ambinav.buildings.shapes import SHORTEST
from ambinav.geometry.map_frame import MAP_FRAME
from ambinav.geometry.obstacle import Obstacle
from ambinav.runtime.errors import InputError

KINDS: Final = ("post", "panel", "wall", "reflector")
THINNEST: Final = 0.005
"""Metres: no post has a smaller radius."""
THICKEST: Final = 20.0
"""Metres: of no obstacle the radius or the thickness is larger."""
HIGHEST: Final = 1000.0
"""Metres above the floor: no obstacle is higher."""


@dataclass(frozen=True)
class DrawnObstacle:
    """Obstacle as drawn.

    Attributes:
        kind: One of `KINDS`.
        points: x and y, metres: the middle of a round one, or a line's corners.
        radius: Radius of a round one, metres; else 0.
        thickness: Thickness of a line, metres; 0: it has none.
        bottom: See `Obstacle`, metres, like the next.
        top: See `Obstacle`; None: the height of the building.
    """

    kind: str
    points: tuple[tuple[float, float], ...]
    radius: float = 0.0
    thickness: float = 0.0
    bottom: float = 0.0
    top: float | None = None

    @property
    def obstacle(self) -> Obstacle:
        """Obstacle of a building that the drawing represents."""
        reflective = self.kind == "reflector"
        if len(self.points) == 1:
            made = Obstacle.post(*self.points[0], self.radius, reflective=reflective)
        else:
            made = Obstacle.wall(self.points, self.thickness, reflective=reflective)
        return made.between(self.bottom, self.top)

    @property
    def feature(self) -> dict[str, Any]:
        """GeoJSON Feature of the obstacle."""
        properties: dict[str, Any] = {"kind": self.kind}
        if len(self.points) == 1:
            geometry = {"type": "Point", "coordinates": list(self.points[0])}
            properties["radius"] = self.radius
        else:
            geometry = {"type": "LineString", "coordinates": [list(point) for point in self.points]}
            properties["thickness"] = self.thickness
        if self.bottom or self.top is not None:
            properties |= {"bottom": self.bottom, "top": self.top}
        return {"type": "Feature", "properties": properties, "geometry": geometry}


def collection(obstacles: Iterable[DrawnObstacle]) -> dict[str, Any]:
    """Return obstacles as a GeoJSON FeatureCollection."""
    features = [obstacle.feature for obstacle in obstacles]
    return {"type": "FeatureCollection", **MAP_FRAME, "features": features}


def obstacles_of(document: Any, label: str) -> tuple[DrawnObstacle, ...]:
    """Return the obstacles of a FeatureCollection.

    Args:
        document: Parsed JSON.
        label: What messages call it.

    Raises:
        InputError: it is no such collection, or an obstacle is none.
    """
    features = document.get("features") if isinstance(document, dict) else None
    if not isinstance(features, list) or document.get("type") != "FeatureCollection":
        raise InputError(
            f"{label}: this is not a FeatureCollection of GeoJSON; give one of obstacles."
        )
    return tuple(_drawn(f"{label}: obstacle {k}", feature) for k, feature in enumerate(features, 1))


def _drawn(label: str, feature: Any) -> DrawnObstacle:
    members: dict[str, Any] = feature if isinstance(feature, dict) else {}
    properties, geometry = members.get("properties"), members.get("geometry")
    if not isinstance(properties, dict) or not isinstance(geometry, dict):
        raise InputError(f"{label} is not a Feature with properties and a geometry; correct it.")
    kind, shape = properties.get("kind"), geometry.get("type")
    if kind not in KINDS:
        raise InputError(f"{label}: kind is {reprlib.repr(kind)}; give {', '.join(KINDS)}.")
    heights = [properties.get(name) for name in ("bottom", "top")]
    bottom, top = (
        value if value is None else _length(label, name, value, 0.0, HIGHEST)
        for name, value in zip(("bottom", "top"), heights, strict=True)
    )
    bottom = bottom or 0.0
    if top is not None and not top > bottom:
        raise InputError(
            f"{label}: top is {top:g} and bottom {bottom:g}; give a top above it, in metres."
        )
    round_, straight = kind in ("post", "reflector"), kind != "post"
    coordinates = geometry.get("coordinates")
    if round_ and shape == "Point":
        radius = _length(label, "radius", properties.get("radius"), THINNEST)
        return DrawnObstacle(kind, (_point(label, coordinates),), radius, bottom=bottom, top=top)
    if straight and shape == "LineString" and isinstance(coordinates, list):
        points = tuple(_point(label, point) for point in coordinates)
        thickness = _length(label, "thickness", properties.get("thickness") or 0.0, 0.0)
        length = sum(math.dist(a, b) for a, b in itertools.pairwise(points))
        if not length >= SHORTEST:
            raise InputError(f"{label} is {length:.3g} m long; draw at least {SHORTEST:g} m.")
        return DrawnObstacle(kind, points, thickness=thickness, bottom=bottom, top=top)
    drawn = " or a ".join(["Point"] * round_ + ["LineString"] * straight)
    raise InputError(f"{label} ({kind}) is a {reprlib.repr(shape)}; draw it as a {drawn}.")


def _point(label: str, node: Any) -> tuple[float, float]:
    if not isinstance(node, list | tuple) or len(node) < 2 or not all(map(is_number, node[:2])):
        raise InputError(f"{label}: {reprlib.repr(node)} is not a point; give x and y in metres.")
    return float(node[0]), float(node[1])


def _length(label: str, name: str, value: Any, least: float, most: float = THICKEST) -> float:
    if not is_number(value) or not least <= value <= most:
        raise InputError(
            f"{label}: {name} is {reprlib.repr(value)}; give {least:g} to {most:g} metres."
        )
    return float(value)
