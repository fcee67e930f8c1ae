"""Floor plans drawn as GeoJSON or WKT."""

from __future__ import annotations

import hashlib
import reprlib
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.coverage import Coverage
from ambinav.buildings.drawn_items import (
    KINDS,
    LINES,
    POINTS,
    POLYGONS,
    DrawnItem,
    Tags,
    geojson_document,
    geojson_items,
    is_number,
    wkt_items,
)
from ambinav.buildings.plan_levels import chosen_level, in_order
from ambinav.buildings.plan_units import Sizes, check_frame, check_size, metres_in
from ambinav.buildings.shapes import NEAR, environment_from_shapes, sound_polygon
from ambinav.config import read_text
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.files import sha256

__all__ = ["environment_from_shapes", "load_polygons"]


# Polygons without `kind` that fill as much of the rooms which they lie in may be rooms.
_FILLED: Final = 0.5
_GUESSED: Final = (
    "polygons that lie in another one are obstacles unless their kind says room; say it of rooms, "
    "and leave the outline around them out"
)
# Share of walls and obstacles outside of all rooms from which on there is a warning.
_BESIDE: Final = 0.1


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
        unit: What the coordinates are in (`plan_units.UNITS`); None: metres, if the plan has the
            size of a building then.

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
        items = list(wkt_items(path, text))
    else:
        document = geojson_document(path, text)
        check_frame(f"{path}", document.get("crs"), unit, notes)
        bbox = _box(path, document.get("bbox"))
        items = list(geojson_items(f"{path}", document, Tags()))
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


def _box(path: Path, bbox: object) -> list[float] | None:
    """Return the bbox of a GeoJSON file, without its heights if it has six numbers."""
    if bbox is None:
        return None
    if isinstance(bbox, list) and len(bbox) == 6:
        bbox = [bbox[0], bbox[1], bbox[3], bbox[4]]
    if not isinstance(bbox, list) or len(bbox) != 4 or not all(is_number(v) for v in bbox):
        raise InputError(
            f"{path}: bbox is {reprlib.repr(bbox)}; it must be [xmin, ymin, xmax, ymax] in metres."
        )
    return [float(v) for v in bbox]


def _without_points(path: Path, items: list[DrawnItem], notes: list[str]) -> list[DrawnItem]:
    """Return the items that bound an area."""
    drawn = [item for item in items if item.geometry.geom_type not in POINTS]
    if not drawn:
        raise InputError(f"{path}: there is no polygon and no line in it; draw at least a room.")
    if len(drawn) < len(items):
        note = f"{path}: {len(items) - len(drawn)} points are left out; they bound nothing."
        warnings.warn(note, InputWarning, stacklevel=3)
        notes.append(note)
    return drawn


def _sizes(items: list[DrawnItem], bbox: list[float] | None) -> Sizes:
    """Collect the parts of the plan that tell its unit."""
    drawn = [item.geometry for item in items]
    if bbox is not None and all(g.geom_type in LINES for g in drawn):
        drawn.append(shapely.box(*bbox))  # it is the room
    openings = [item.geometry.length for item in items if item.tags.kind == "opening"]
    return Sizes(drawn, [item.tags.thickness for item in items], openings)


def _on_floor(
    path: Path, items: list[DrawnItem], names: Sequence[str], floor: str | None, notes: list[str]
) -> list[DrawnItem]:
    """Return the items of a floor, and those without a level."""
    if floor is None:
        return items
    on_floor = [item for item in items if not item.tags.levels or floor in item.tags.levels]
    shared = sum(not item.tags.levels for item in on_floor)
    if shared and len(names) > 1:
        note = (
            f"{path}: {shared} of {len(on_floor)} features on level {floor} have no level of their "
            "own and count for all."
        )
        warnings.warn(note, InputWarning, stacklevel=3)
        notes.append(note)
    return on_floor


def _scaled(items: list[DrawnItem], scale: float) -> list[DrawnItem]:
    """Return the items in metres."""
    if scale == 1.0:
        return items
    return [
        DrawnItem(
            item.label,
            shapely.transform(item.geometry, lambda points: points * scale),
            item.tags._replace(thickness=item.tags.thickness * scale),
        )
        for item in items
    ]


def _tagged(
    items: list[DrawnItem], notes: list[str]
) -> Iterator[tuple[DrawnItem, str, BaseGeometry]]:
    """Yield each item, its kind and valid geometry; thick walls become obstacles."""
    sound = []
    for item in items:
        kind = item.tags.kind
        allowed_types = LINES if kind in ("wall", "opening") else POLYGONS
        if kind not in (None, "reflector") and item.geometry.geom_type not in allowed_types:
            raise InputError(
                f"{item.label}: kind {kind} is drawn as a {item.geometry.geom_type}; it must "
                f"be a {allowed_types[0]}."
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
