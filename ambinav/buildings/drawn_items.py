"""Geometries of GeoJSON and WKT files, with what their properties say of them."""

from __future__ import annotations

import difflib
import json
import math
import reprlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.plan_levels import levels_of
from ambinav.buildings.plan_units import check_frame
from ambinav.buildings.shapes import checked
from ambinav.config import read_text
from ambinav.runtime.errors import InputError
from ambinav.runtime.input_suggestions import PLAN, kind_of, refuse

KINDS: Final = ("room", "obstacle", "wall", "opening", "reflector")
LINES: Final = ("LineString", "MultiLineString")
POLYGONS: Final = ("Polygon", "MultiPolygon")
POINTS: Final = ("Point", "MultiPoint")
# How deep the lists of a geometry's coordinates are nested.
DEPTH: Final = {
    "Point": 1,
    "MultiPoint": 2,
    "LineString": 2,
    "MultiLineString": 3,
    "Polygon": 3,
    "MultiPolygon": 4,
}


class Tags(NamedTuple):
    """Properties of a feature that describe its geometry.

    Attributes:
        kind: One of `KINDS`, if given.
        thickness: Thickness of a wall, in the unit of the coordinates; 0 if it does not say.
        levels: The floors that it belongs to; none: every one.
        name: What it is called.
    """

    kind: str | None = None
    thickness: float = 0.0
    levels: tuple[str, ...] = ()
    name: str = ""


@dataclass(frozen=True, eq=False)
class DrawnItem:
    """Geometry of a file, with the file's properties of it."""

    label: str
    geometry: BaseGeometry
    tags: Tags


def load_region(path: str | Path) -> BaseGeometry:
    """Read the area of all polygons of a `.geojson`, `.json` or `.wkt` file, map frame, metres.

    It is their union: unlike in a plan, one that lies in another takes nothing away. Holes do.
    Properties of features are not read.

    Raises:
        InputError: the file cannot be read, or holds no polygon or anything else.
    """
    path = Path(path)
    polygons = []
    for item in _items(path):
        kind = item.geometry.geom_type
        if kind not in POLYGONS:
            raise InputError(f"{item.label}: it is a {kind}; give polygons, which have an area.")
        polygons.append(shapely.make_valid(item.geometry))
    if not polygons:
        raise InputError(f"{path}: it holds no polygon; draw one, in metres of the map frame.")
    return shapely.union_all(polygons)


def load_points(path: str | Path) -> tuple[tuple[float, ...], ...]:
    """Read the points of a `.geojson`, `.json` or `.wkt` file, map frame, metres.

    Returns:
        x, y and, if all points have one, z of each; at least one point.

    Raises:
        InputError: the file cannot be read, or holds no point or anything else.
    """
    path = Path(path)
    points: list[tuple[float, ...]] = []
    for item in _items(path):
        kind = item.geometry.geom_type
        if kind not in POINTS:
            raise InputError(f"{item.label}: it is a {kind}; give points.")
        points += map(tuple, shapely.get_coordinates(item.geometry, include_z=True).tolist())
    if not points:
        raise InputError(f"{path}: it holds no point; draw one, in metres of the map frame.")
    have_z = [math.isfinite(point[2]) for point in points]
    return tuple(points) if all(have_z) else tuple(point[:2] for point in points)


def _items(path: Path) -> Iterator[DrawnItem]:
    """Yield the geometries of a file, of whose features no property is read."""
    text = read_text(path)
    if path.suffix.lower() == ".wkt":
        return wkt_items(path, text)
    document = geojson_document(path, text)
    check_frame(str(path), document.get("crs"), None, [])
    return geojson_items(f"{path}", document, None)


def geojson_document(path: Path, text: str) -> dict[str, Any]:
    """Return the object of a GeoJSON file, refused if it is a document of another kind."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        where = f" in line {error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise InputError(f"{path}: this is not valid JSON{where}; correct the file.") from error
    if not isinstance(document, dict):
        raise InputError(f"{path}: this is JSON but not GeoJSON; its top must be an object.")
    refuse(f"{path}", kind_of(document), "a floor plan", PLAN)
    return document


def is_number(value: object) -> bool:
    """Return whether a value of a JSON file is a finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond any float
        return False


def geojson_items(label: str, node: object, tags: Tags | None) -> Iterator[DrawnItem]:
    """Yield all geometries below a GeoJSON object; without tags no properties are read."""
    if not isinstance(node, dict):
        raise InputError(f"{label} is {reprlib.repr(node)}; it must be a GeoJSON object.")
    kind = node.get("type")
    if kind in ("FeatureCollection", "GeometryCollection"):
        key, child = ("features", "feature") if kind[0] == "F" else ("geometries", "geometry")
        members = node.get(key)
        if not isinstance(members, list):
            raise InputError(f"{label}: {key} is {reprlib.repr(members)}; it must be a list.")
        for k, member in enumerate(members):
            yield from geojson_items(f"{label}: {child} {k + 1}", member, tags)
    elif kind == "Feature":
        properties = node.get("properties") or {}
        if not isinstance(properties, dict):
            raise InputError(f"{label}: properties must be an object or null.")
        tags = None if tags is None else _properties(label, properties)
        if node.get("geometry") is None:
            raise InputError(f"{label} has no geometry; give it one or remove it.")
        yield from geojson_items(label, node["geometry"], tags)
    elif isinstance(kind, str) and kind in DEPTH:
        _check_coordinates(label, node.get("coordinates"), DEPTH[kind])
        try:
            geometry = shapely.geometry.shape({"type": kind, "coordinates": node["coordinates"]})
        except (shapely.errors.ShapelyError, ValueError, TypeError, IndexError) as error:
            reason = str(error).partition("\n")[0].rstrip(".")
            if "inhomogeneous" in reason:
                reason = "some positions have a height and others none"
            raise InputError(
                f"{label}: the coordinates make no {kind} ({reason}); correct them."
            ) from error
        yield DrawnItem(label, checked(label, geometry), tags or Tags())
    else:
        raise InputError(
            f"{label}: type is {reprlib.repr(kind)}; it must be a FeatureCollection, a Feature or "
            "a geometry of GeoJSON."
        )


def _properties(label: str, properties: dict[str, Any]) -> Tags:
    """Read the properties that describe the geometry of a feature."""
    kind = properties.get("kind")
    if kind is not None and kind not in KINDS:
        near = difflib.get_close_matches(str(kind), KINDS, n=2, cutoff=0.3) or KINDS
        raise InputError(
            f"{label}: kind is {reprlib.repr(kind)}; did you mean {' or '.join(near)}?"
        )
    # Programs of geographic information give every feature every column.
    thickness = properties.get("thickness")
    if thickness is None:
        thickness = 0.0
    if not is_number(thickness) or thickness < 0.0:
        raise InputError(
            f"{label}: thickness is {reprlib.repr(thickness)}; it must be at least 0 m."
        )
    name = properties.get("name")
    levels = levels_of(label, properties.get("level"))
    return Tags(kind, float(thickness), levels, name if isinstance(name, str) else "")


def _check_coordinates(label: str, node: object, depth: int) -> None:
    """Check nested lists of this depth with at least two finite numbers at the bottom."""
    if not isinstance(node, list):
        raise InputError(
            f"{label}: coordinates hold {reprlib.repr(node)} where a list must be; correct them."
        )
    if depth > 1:
        for child in node:
            _check_coordinates(label, child, depth - 1)
    elif len(node) < 2 or not all(is_number(v) for v in node):
        raise InputError(
            f"{label}: {reprlib.repr(node)} is not a point; it must be two finite numbers x, y."
        )


def wkt_items(path: Path, text: str) -> Iterator[DrawnItem]:
    """Yield all geometries of a WKT text: one in all, or one a line."""
    lines = [line.strip() for line in text.splitlines()]
    numbered = [(k, line) for k, line in enumerate(lines, 1) if line and line[0] != "#"]
    if not numbered:
        raise InputError(f"{path}: the file is empty; write one WKT geometry on each line.")
    try:
        parsed = _wkt(" ".join(line for _, line in numbered))
    except shapely.errors.ShapelyError:
        for k, line in numbered:
            try:
                geometry = _wkt(line)
            except shapely.errors.ShapelyError as error:
                raise InputError(
                    f"{path}: line {k} is not WKT ({reprlib.repr(line)}); correct it."
                ) from error
            yield from _leaves(f"{path}: line {k}", geometry)
    else:
        yield from _leaves(f"{path}", parsed)


def _wkt(text: str) -> BaseGeometry:
    if "\0" in text:  # the parser would take it for the end
        raise shapely.errors.ShapelyError("null byte")
    try:
        with np.errstate(invalid="ignore"):
            return shapely.from_wkt(text)
    except NotImplementedError as error:
        raise shapely.errors.ShapelyError("curve") from error


def _leaves(label: str, geometry: BaseGeometry) -> Iterator[DrawnItem]:
    if geometry.geom_type == "GeometryCollection" and not geometry.is_empty:
        for k, part in enumerate(geometry.geoms):
            yield from _leaves(f"{label}: geometry {k + 1}", part)
    elif geometry.geom_type in DEPTH:
        yield DrawnItem(label, checked(label, geometry), Tags())
    elif geometry.is_empty:
        raise InputError(f"{label} is empty; give it points or remove it.")
    else:
        raise InputError(f"{label} is a {geometry.geom_type}; draw polygons and lines.")
