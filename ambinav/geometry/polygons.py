"""Floor plans drawn as GeoJSON or WKT."""

from __future__ import annotations

import difflib
import json
import math
import reprlib
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.errors import InputError, InputWarning
from ambinav.files import sha256
from ambinav.geometry.environment import Environment
from ambinav.geometry.shapes import checked, environment_from_shapes, sound_polygon

__all__ = ["environment_from_shapes", "load_polygons"]

KINDS: Final = ("room", "obstacle", "wall", "opening")
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


@dataclass(frozen=True, eq=False)
class _Item:
    """One geometry of a file, with what the file says about it."""

    label: str
    geometry: BaseGeometry
    kind: str | None = None
    thickness: float = 0.0


def load_polygons(path: str | Path) -> Environment:
    """Read a floor plan: `.geojson` and `.json` as GeoJSON, `.wkt` as WKT.

    Coordinates are x, y in metres in the map frame, not degrees. GeoJSON may hold a
    FeatureCollection, a Feature or a bare geometry; WKT one geometry for each line (lines that
    begin with # are remarks) or one for the whole file. The property `kind` of a feature says
    what its geometry is:

    - "room": Polygon of free space; its holes are solid;
    - "obstacle": Polygon that is not free;
    - "wall": LineString; with the property `thickness` (metres) it has two sides and flat ends;
    - "opening": LineString along the edge of a room that makes it a frontier there.

    Without `kind`, lines are walls, a polygon is an obstacle if it lies in another one and else
    a room. Without any room, the member `bbox` (else the bounds of everything) is the room and
    its edge a frontier. Points are left out.

    Raises:
        InputError: The file cannot be read, is not GeoJSON or WKT, or `environment_from_shapes`
            cannot use what is in it.

    Warns:
        InputWarning: A polygon was repaired, points were left out, or the file says that its
            coordinates are not in metres.
    """
    path = Path(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InputError(
            f"{path}: the floor plan cannot be read ({reason}); name a GeoJSON or WKT file."
        ) from error
    notes: list[str] = []
    bbox = None
    if path.suffix.lower() == ".wkt":
        items = list(_from_wkt(path, text))
    else:
        document = _json(path, text)
        bbox = document.get("bbox")
        _check_frame(path, document, notes)
        items = list(_from_geojson(f"{path}", document, None, 0.0))
    items = _without_points(path, items, notes)
    shapes: dict[str, list[BaseGeometry]] = {kind: [] for kind in KINDS}
    for item in _tagged(items, notes):
        shapes[item.kind or "wall"].append(item.geometry)
    return environment_from_shapes(
        shapes["room"],
        shapes["obstacle"],
        shapes["wall"],
        shapes["opening"],
        _box(path, bbox),
        path.stem,
        source=path,
        checksum=sha256(path),
        notes=notes,
    )


def _json(path: Path, text: str) -> dict[str, Any]:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        where = f" in line {error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise InputError(f"{path}: this is not valid JSON{where}; correct the file.") from error
    if not isinstance(document, dict):
        raise InputError(f"{path}: this is JSON but not GeoJSON; its top must be an object.")
    return document


def _check_frame(path: Path, document: dict[str, Any], notes: list[str]) -> None:
    """Say so if the file names a coordinate reference system: its numbers count as metres."""
    if document.get("crs") is not None:
        note = (
            f"{path}: crs {reprlib.repr(document['crs'])} is not used; coordinates count as "
            "metres in the map frame."
        )
        warnings.warn(note, InputWarning, stacklevel=3)
        notes.append(note)


def _box(path: Path, bbox: object) -> list[float] | None:
    """The member bbox of a GeoJSON file, without its heights if it has six numbers."""
    if bbox is None:
        return None
    if isinstance(bbox, list) and len(bbox) == 6:
        bbox = [bbox[0], bbox[1], bbox[3], bbox[4]]
    if not isinstance(bbox, list) or len(bbox) != 4 or not all(_is_number(v) for v in bbox):
        raise InputError(
            f"{path}: bbox is {reprlib.repr(bbox)}; it must be [xmin, ymin, xmax, ymax] in metres."
        )
    return [float(v) for v in bbox]


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond any float
        return False


def _from_geojson(label: str, node: object, kind: str | None, thickness: float) -> Iterator[_Item]:
    """All geometries below a GeoJSON object."""
    if not isinstance(node, dict):
        raise InputError(f"{label} is {reprlib.repr(node)}; it must be a GeoJSON object.")
    what = node.get("type")
    if what in ("FeatureCollection", "GeometryCollection"):
        key, child = ("features", "feature") if what[0] == "F" else ("geometries", "geometry")
        members = node.get(key)
        if not isinstance(members, list):
            raise InputError(f"{label}: {key} is {reprlib.repr(members)}; it must be a list.")
        for k, member in enumerate(members):
            yield from _from_geojson(f"{label}: {child} {k + 1}", member, kind, thickness)
    elif what == "Feature":
        properties = node.get("properties") or {}
        if not isinstance(properties, dict):
            raise InputError(f"{label}: properties must be an object or null.")
        kind, thickness = _properties(label, properties)
        if node.get("geometry") is None:
            raise InputError(f"{label} has no geometry; give it one or remove it.")
        yield from _from_geojson(label, node["geometry"], kind, thickness)
    elif isinstance(what, str) and what in DEPTH:
        _check_coordinates(label, node.get("coordinates"), DEPTH[what])
        try:
            geometry = shapely.geometry.shape({"type": what, "coordinates": node["coordinates"]})
        except (shapely.errors.ShapelyError, ValueError, TypeError, IndexError) as error:
            reason = str(error).partition("\n")[0].rstrip(".")
            raise InputError(
                f"{label}: the coordinates make no {what} ({reason}); correct them."
            ) from error
        yield _Item(label, checked(label, geometry), kind, thickness)
    else:
        raise InputError(
            f"{label}: type is {reprlib.repr(what)}; it must be a FeatureCollection, a Feature or "
            "a geometry of GeoJSON."
        )


def _properties(label: str, properties: dict[str, Any]) -> tuple[str | None, float]:
    """Kind and thickness that a feature gives its geometry."""
    kind = properties.get("kind")
    if kind is not None and kind not in KINDS:
        near = difflib.get_close_matches(str(kind), KINDS, n=2, cutoff=0.3) or KINDS
        raise InputError(
            f"{label}: kind is {reprlib.repr(kind)}; did you mean {' or '.join(near)}?"
        )
    thickness = properties.get("thickness", 0.0)
    if not _is_number(thickness) or thickness < 0.0:
        raise InputError(
            f"{label}: thickness is {reprlib.repr(thickness)}; it must be at least 0 m."
        )
    return kind, float(thickness)


def _check_coordinates(label: str, node: object, depth: int) -> None:
    """Nested lists of this depth, with finite numbers, at least two, at the bottom."""
    if not isinstance(node, list):
        raise InputError(
            f"{label}: coordinates hold {reprlib.repr(node)} where a list must be; correct them."
        )
    if depth > 1:
        for child in node:
            _check_coordinates(label, child, depth - 1)
    elif len(node) < 2 or not all(_is_number(v) for v in node):
        raise InputError(
            f"{label}: {reprlib.repr(node)} is not a point; it must be two finite numbers x, y."
        )


def _from_wkt(path: Path, text: str) -> Iterator[_Item]:
    lines = [line.strip() for line in text.splitlines()]
    numbered = [(k, line) for k, line in enumerate(lines, 1) if line and line[0] != "#"]
    if not numbered:
        raise InputError(f"{path}: the file is empty; write one WKT geometry on each line.")
    try:
        whole = _wkt(" ".join(line for _, line in numbered))
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
        yield from _leaves(f"{path}", whole)


def _wkt(text: str) -> BaseGeometry:
    if "\0" in text:  # the parser would take it for the end
        raise shapely.errors.ShapelyError("null byte")
    try:
        with np.errstate(invalid="ignore"):
            return shapely.from_wkt(text)
    except NotImplementedError as error:
        raise shapely.errors.ShapelyError("curve") from error


def _leaves(label: str, geometry: BaseGeometry) -> Iterator[_Item]:
    if geometry.geom_type == "GeometryCollection" and not geometry.is_empty:
        for k, part in enumerate(geometry.geoms):
            yield from _leaves(f"{label}: geometry {k + 1}", part)
    elif geometry.geom_type in DEPTH:
        yield _Item(label, checked(label, geometry))
    elif geometry.is_empty:
        raise InputError(f"{label} is empty; give it points or remove it.")
    else:
        raise InputError(f"{label} is a {geometry.geom_type}; draw polygons and lines.")


def _without_points(path: Path, items: list[_Item], notes: list[str]) -> list[_Item]:
    """The items that bound something."""
    drawn = [item for item in items if item.geometry.geom_type not in POINTS]
    if not drawn:
        raise InputError(f"{path}: there is no polygon and no line in it; draw at least a room.")
    if len(drawn) < len(items):
        note = f"{path}: {len(items) - len(drawn)} points are left out; they bound nothing."
        warnings.warn(note, InputWarning, stacklevel=3)
        notes.append(note)
    return drawn


def _tagged(items: list[_Item], notes: list[str]) -> Iterator[_Item]:
    """The items with sound polygons, and each with its kind; thick walls become obstacles."""
    sound = []
    for item in items:
        wanted = LINES if item.kind in ("wall", "opening") else POLYGONS
        if item.kind is not None and item.geometry.geom_type not in wanted:
            raise InputError(
                f"{item.label}: kind {item.kind} is drawn as a {item.geometry.geom_type}; it must "
                f"be a {wanted[0]}."
            )
        geometry = item.geometry
        if geometry.geom_type in POLYGONS:
            geometry = sound_polygon(item.label, geometry, notes)
        sound.append((item, geometry))
    around = [g for item, g in sound if g.geom_type in POLYGONS and item.kind in (None, "room")]
    tree = shapely.STRtree(around)
    for item, geometry in sound:
        kind = item.kind
        if kind is None and geometry.geom_type in POLYGONS:
            # Twice the same polygon is one room, not a room filled by an obstacle.
            covering = tree.query(geometry, predicate="covered_by")
            inside = any(around[k].area > geometry.area for k in covering)
            kind = "obstacle" if inside else "room"
        if kind in (None, "wall") and item.thickness > 0.0:
            kind = "obstacle"
            geometry = shapely.buffer(
                geometry, 0.5 * item.thickness, cap_style="flat", join_style="mitre"
            )
            if geometry.is_empty:
                raise InputError(f"{item.label} has no length; give it two different points.")
        yield _Item(item.label, geometry, kind or "wall")
