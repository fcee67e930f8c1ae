"""Floor plans drawn as GeoJSON or WKT."""

from __future__ import annotations

import difflib
import hashlib
import json
import math
import reprlib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.coverage import Coverage
from ambinav.buildings.plan_levels import chosen_level, in_order, levels_of
from ambinav.buildings.plan_units import Sizes, check_frame, check_size, metres_in
from ambinav.buildings.shapes import NEAR, checked, environment_from_shapes, sound_polygon
from ambinav.config import read_text
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.files import sha256
from ambinav.runtime.input_suggestions import PLAN, kind_of, refuse

__all__ = ["environment_from_shapes", "load_polygons"]

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


# Polygons without `kind` that fill as much of the rooms which they lie in may be rooms.
_FILLED: Final = 0.5
_GUESSED: Final = (
    "polygons that lie in another one are obstacles unless their kind says room; say it of rooms, "
    "and leave the outline around them out"
)
# Share of walls and obstacles outside of all rooms from which on there is a warning.
_BESIDE: Final = 0.1


class _Tags(NamedTuple):
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
class _Item:
    """Geometry of a file, with the file's properties of it."""

    label: str
    geometry: BaseGeometry
    tags: _Tags


def load_polygons(
    path: str | Path, *, level: str | int | None = None, unit: str | None = None
) -> Environment:
    """Read a floor plan: `.geojson` and `.json` as GeoJSON, `.wkt` as WKT.

    Coordinates are x, y in metres in the map frame (or in `unit`), not degrees. GeoJSON may hold a
    FeatureCollection, a Feature or a bare geometry; WKT one geometry for each line (lines that
    begin with # are remarks) or one for the whole file. The property `kind` of a feature says
    what its geometry is:

    - "room": Polygon of free space; its holes are solid;
    - "obstacle": Polygon that is not free;
    - "wall": LineString; with the property `thickness` (in the unit of the coordinates) it has
      two sides and flat ends;
    - "opening": LineString along the edge of a room that makes it a frontier there;
    - "reflector": LineString along the edge of a room (a tag on the wall) or within one (a panel;
      with `thickness` it has two sides), or Polygon (a post): a wall or an obstacle whose
      reflection is stronger. WKT cannot say this of a geometry.

    Without `kind`, lines are walls, a polygon is an obstacle if it lies in another one and else
    a room. Without any room, the member `bbox` (else the bounds of everything) is the room and
    its edge a frontier. Points are left out.

    The property `level` of a feature says its floor (`plan_levels`): where there are several,
    one has to be chosen, and only its features and those without a level are read.

    Args:
        path: The file.
        level: Which floor, by name or by position from 0 on.
        unit: What the coordinates are in: "m", "cm" or "mm"; None: metres, if the plan has the
            size of a building then (`plan_units`).

    Raises:
        InputError: The file cannot be read, is not GeoJSON or WKT, is in degrees or in a unit
            that has to be stated, there is no such level or several, or `environment_from_shapes`
            cannot use what is in it.

    Warns:
        InputWarning: A polygon was repaired, points were left out, features without a level
            count for the one that was chosen, or a reference system is not used.
    """
    path = Path(path)
    scale = metres_in(unit, str(path))
    text = read_text(path)
    notes: list[str] = []
    bbox: list[float] | None = None
    if path.suffix.lower() == ".wkt":
        items = list(_from_wkt(path, text))
    else:
        document = _json(path, text)
        check_frame(f"{path}", document.get("crs"), unit, notes)
        bbox = _box(path, document.get("bbox"))
        items = list(_from_geojson(f"{path}", document, _Tags()))
    items = _without_points(path, items, notes)
    check_size(f"{path}", _sizes(items, bbox), unit)
    names = in_order(name for item in items for name in item.tags.levels)
    floor = chosen_level(f"{path}", names, level)
    items = _scaled(_on_floor(path, items, names, floor, notes), scale)
    shapes: dict[str, list[BaseGeometry]] = {kind: [] for kind in KINDS}
    covered = Coverage(f"{path}")
    guessed: list[BaseGeometry] = []
    for item, kind, geometry in _tagged(items, notes):
        shapes[kind].append(geometry)
        if kind == "room" and item.tags.name:
            covered.rooms.append((item.tags.name, geometry))
        if kind == "obstacle" and item.tags.kind is None and item.geometry.geom_type in POLYGONS:
            guessed.append(geometry)
    if sum(g.area for g in guessed) >= _FILLED * shapely.union_all(shapes["room"]).area:
        covered.leave_out(guessed, _GUESSED)
    notes += _outside_rooms(f"{path}", shapes)
    # The result depends on both.
    checksum = sha256(path)
    if len(names) > 1 or scale != 1.0:
        read = f"{checksum} level={floor} unit={unit}"
        checksum = hashlib.sha256(read.encode()).hexdigest()
    environment = environment_from_shapes(
        shapes["room"],
        shapes["obstacle"],
        shapes["wall"],
        shapes["opening"],
        None if bbox is None else [scale * v for v in bbox],
        path.stem if len(names) < 2 else f"{path.stem} {floor}",
        reflectors=shapes["reflector"],
        source=path,
        checksum=checksum,
        notes=notes,
    )
    environment.notes += tuple(covered.notes(environment.free))
    return environment


def load_region(path: str | Path) -> BaseGeometry:
    """Read the area of all polygons of a `.geojson`, `.json` or `.wkt` file, map frame, metres.

    It is their union: unlike in a plan, one that lies in another takes nothing away. Holes do.
    Properties of features are not read.

    Raises:
        InputError: the file cannot be read, or holds no polygon or anything else.
    """
    path = Path(path)
    text = read_text(path)
    shapes = (
        _from_wkt(path, text)
        if path.suffix.lower() == ".wkt"
        else _from_geojson(f"{path}", _json(path, text), None)
    )
    polygons = []
    for item in shapes:
        kind = item.geometry.geom_type
        if kind not in POLYGONS:
            raise InputError(f"{item.label}: it is a {kind}; give polygons, which have an area.")
        polygons.append(shapely.make_valid(item.geometry))
    if not polygons:
        raise InputError(f"{path}: it holds no polygon; draw one, in metres of the map frame.")
    return shapely.union_all(polygons)


def _outside_rooms(where: str, shapes: Mapping[str, Sequence[BaseGeometry]]) -> list[str]:
    """List the walls and obstacles outside of all rooms, where they have no effect."""
    if not shapes["room"]:
        return []
    rooms = shapely.union_all(shapes["room"])
    things = [*shapes["wall"], *shapes["obstacle"]]
    away = [thing for thing in things if not shapely.dwithin(rooms, thing, NEAR)]
    if not away:
        return []
    note = (
        f"{where}: {len(away)} of {len(things)} walls and obstacles lie outside of its rooms and "
        "change nothing; draw a room around them if there is floor."
    )
    if len(away) > _BESIDE * len(things):
        warnings.warn(note, InputWarning, stacklevel=3)
    return [note]


def _json(path: Path, text: str) -> dict[str, Any]:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        where = f" in line {error.lineno}" if isinstance(error, json.JSONDecodeError) else ""
        raise InputError(f"{path}: this is not valid JSON{where}; correct the file.") from error
    if not isinstance(document, dict):
        raise InputError(f"{path}: this is JSON but not GeoJSON; its top must be an object.")
    refuse(f"{path}", kind_of(document), "a floor plan", PLAN)
    return document


def _box(path: Path, bbox: object) -> list[float] | None:
    """Return the bbox of a GeoJSON file, without its heights if it has six numbers."""
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


def _from_geojson(label: str, node: object, tags: _Tags | None) -> Iterator[_Item]:
    """Yield all geometries below a GeoJSON object; without tags no properties are read."""
    if not isinstance(node, dict):
        raise InputError(f"{label} is {reprlib.repr(node)}; it must be a GeoJSON object.")
    what = node.get("type")
    if what in ("FeatureCollection", "GeometryCollection"):
        key, child = ("features", "feature") if what[0] == "F" else ("geometries", "geometry")
        members = node.get(key)
        if not isinstance(members, list):
            raise InputError(f"{label}: {key} is {reprlib.repr(members)}; it must be a list.")
        for k, member in enumerate(members):
            yield from _from_geojson(f"{label}: {child} {k + 1}", member, tags)
    elif what == "Feature":
        properties = node.get("properties") or {}
        if not isinstance(properties, dict):
            raise InputError(f"{label}: properties must be an object or null.")
        tags = None if tags is None else _properties(label, properties)
        if node.get("geometry") is None:
            raise InputError(f"{label} has no geometry; give it one or remove it.")
        yield from _from_geojson(label, node["geometry"], tags)
    elif isinstance(what, str) and what in DEPTH:
        _check_coordinates(label, node.get("coordinates"), DEPTH[what])
        try:
            geometry = shapely.geometry.shape({"type": what, "coordinates": node["coordinates"]})
        except (shapely.errors.ShapelyError, ValueError, TypeError, IndexError) as error:
            reason = str(error).partition("\n")[0].rstrip(".")
            raise InputError(
                f"{label}: the coordinates make no {what} ({reason}); correct them."
            ) from error
        yield _Item(label, checked(label, geometry), tags or _Tags())
    else:
        raise InputError(
            f"{label}: type is {reprlib.repr(what)}; it must be a FeatureCollection, a Feature or "
            "a geometry of GeoJSON."
        )


def _properties(label: str, properties: dict[str, Any]) -> _Tags:
    """Read the properties that describe the geometry of a feature."""
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
    name = properties.get("name")
    levels = levels_of(label, properties.get("level"))
    return _Tags(kind, float(thickness), levels, name if isinstance(name, str) else "")


def _check_coordinates(label: str, node: object, depth: int) -> None:
    """Check nested lists of this depth with at least two finite numbers at the bottom."""
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


def _leaves(label: str, geometry: BaseGeometry) -> Iterator[_Item]:
    if geometry.geom_type == "GeometryCollection" and not geometry.is_empty:
        for k, part in enumerate(geometry.geoms):
            yield from _leaves(f"{label}: geometry {k + 1}", part)
    elif geometry.geom_type in DEPTH:
        yield _Item(label, checked(label, geometry), _Tags())
    elif geometry.is_empty:
        raise InputError(f"{label} is empty; give it points or remove it.")
    else:
        raise InputError(f"{label} is a {geometry.geom_type}; draw polygons and lines.")


def _without_points(path: Path, items: list[_Item], notes: list[str]) -> list[_Item]:
    """Return the items that bound an area."""
    drawn = [item for item in items if item.geometry.geom_type not in POINTS]
    if not drawn:
        raise InputError(f"{path}: there is no polygon and no line in it; draw at least a room.")
    if len(drawn) < len(items):
        note = f"{path}: {len(items) - len(drawn)} points are left out; they bound nothing."
        warnings.warn(note, InputWarning, stacklevel=3)
        notes.append(note)
    return drawn


def _sizes(items: list[_Item], bbox: list[float] | None) -> Sizes:
    """Collect the parts of the plan that tell its unit."""
    drawn = [item.geometry for item in items]
    if bbox is not None and all(g.geom_type in LINES for g in drawn):
        drawn.append(shapely.box(*bbox))  # it is the room
    openings = [item.geometry.length for item in items if item.tags.kind == "opening"]
    return Sizes(drawn, [item.tags.thickness for item in items], openings)


def _on_floor(
    path: Path, items: list[_Item], names: Sequence[str], floor: str | None, notes: list[str]
) -> list[_Item]:
    """Return the items of a floor, and those without a level."""
    if floor is None:
        return items
    kept = [item for item in items if not item.tags.levels or floor in item.tags.levels]
    shared = sum(not item.tags.levels for item in kept)
    if shared and len(names) > 1:
        note = (
            f"{path}: {shared} of {len(kept)} features on level {floor} have no level of their own "
            "and count for all."
        )
        warnings.warn(note, InputWarning, stacklevel=3)
        notes.append(note)
    return kept


def _scaled(items: list[_Item], scale: float) -> list[_Item]:
    """Return the items in metres."""
    if scale == 1.0:
        return items
    return [
        _Item(
            item.label,
            shapely.transform(item.geometry, lambda points: points * scale),
            item.tags._replace(thickness=item.tags.thickness * scale),
        )
        for item in items
    ]


def _tagged(items: list[_Item], notes: list[str]) -> Iterator[tuple[_Item, str, BaseGeometry]]:
    """Yield each item, its kind and valid geometry; thick walls become obstacles."""
    sound = []
    for item in items:
        kind = item.tags.kind
        wanted = LINES if kind in ("wall", "opening") else POLYGONS
        if kind not in (None, "reflector") and item.geometry.geom_type not in wanted:
            raise InputError(
                f"{item.label}: kind {kind} is drawn as a {item.geometry.geom_type}; it must "
                f"be a {wanted[0]}."
            )
        geometry = item.geometry
        if geometry.geom_type in POLYGONS:
            geometry = sound_polygon(item.label, geometry, notes)
        sound.append((item, geometry))
    around = [
        g for item, g in sound if g.geom_type in POLYGONS and item.tags.kind in (None, "room")
    ]
    tree = shapely.STRtree(around)
    for item, geometry in sound:
        kind = item.tags.kind
        if kind is None and geometry.geom_type in POLYGONS:
            # Twice the same polygon is one room, not a room filled by an obstacle.
            covering = tree.query(geometry, predicate="covered_by")
            inside = any(around[k].area > geometry.area for k in covering)
            kind = "obstacle" if inside else "room"
        is_line = geometry.geom_type in LINES
        if kind in (None, "wall", "reflector") and is_line and item.tags.thickness > 0.0:
            kind = kind if kind == "reflector" else "obstacle"
            geometry = shapely.buffer(
                geometry, 0.5 * item.tags.thickness, cap_style="flat", join_style="mitre"
            )
            if geometry.is_empty:
                raise InputError(f"{item.label} has no length; give it two different points.")
        yield item, kind or "wall", geometry
