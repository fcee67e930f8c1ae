"""Environment built from rooms, obstacles, walls and openings."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final, TypeAlias

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.adjoining import union_of
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER, GLASS, REFLECTOR, WALL, Segments, pieces_of
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError, InputWarning

Shape: TypeAlias = BaseGeometry | ArrayLike

# Metres. An opening or a wall this near to the boundary lies on it.
NEAR: Final = 1e-3
# Metres. What lies on the boundary for less than this merely crosses it.
SHORTEST: Final = 1e-2
# Metres. A point this near to an edge lies on it but for rounding.
ON_EDGE: Final = 1e-9
# Square metres. Smaller pieces of free space come from rounding.
SLIVER: Final = 1e-6
# Metres. Beyond this, coordinates are not those of a building in its map frame.
FURTHEST: Final = 1e8


def environment_from_shapes(
    rooms: Iterable[Shape] = (),
    obstacles: Iterable[Shape] = (),
    walls: Iterable[Shape] = (),
    openings: Iterable[Shape] = (),
    bbox: Sequence[float] | None = None,
    name: str = "environment",
    *,
    reflectors: Iterable[Shape] = (),
    glass: Iterable[Shape] = (),
    drivable: BaseGeometry | None = None,
    source: Path | None = None,
    checksum: str = "",
    notes: Iterable[str] = (),
) -> Environment:
    """Build an environment: rooms without obstacles are free, walls are lines in them.

    A shape is a Shapely geometry or an array of points, shape (n, 2): the ring of a room or an
    obstacle, the course of a wall or an opening. All lengths are metres in the map frame. Rooms
    that overlap or share a stretch of their edges are one room there; draw a wall between them
    to part them.

    Args:
        rooms: Polygons. Their holes are solid. Without a room, all of `bbox` is free space and
            its edge is the frontier to unknown space, save where a wall lies on it.
        obstacles: Polygons.
        walls: Lines without thickness. What lies outside the free space is left out.
        openings: Lines on the boundary of the free space (to a millimetre) that turn this
            stretch of it into frontier: a door to space that is not mapped.
        bbox: (xmin, ymin, xmax, ymax), used if there is no room; bounds of all shapes if None.
        name: Name of the environment in reports.
        reflectors: What returns more light than a wall (`REFLECTOR`): a line on the boundary of the
            free space (to a millimetre) is a tag on the wall there, a line within it a panel
            without thickness that reflects on both sides, a polygon an obstacle with such a face.
        glass: Lines along which the wall is of glass (`GLASS`), as `reflectors`.
        drivable: What no footprint may leave; see `Environment`.
        source: The file that the shapes come from.
        checksum: SHA-256 of that file.
        notes: Remarks to keep with the environment; repairs are added to them.

    Raises:
        InputError: A shape is empty, not finite or of the wrong type, a polygon has no area, an
            opening is not on the boundary, a reflector borders no free space, or no free space is
            left.

    Warns:
        InputWarning: A polygon that crosses itself was repaired.
    """
    label = str(source) if source is not None else name
    for role, shapes in (("rooms", rooms), ("obstacles", obstacles), ("walls", walls)):
        if isinstance(shapes, BaseGeometry):
            raise InputError(f"{label}: {role} is a {shapes.geom_type}; give a list of shapes.")
    remarks = list(notes)
    room_list = [_polygon(label, "room", k, s, remarks) for k, s in enumerate(rooms)]
    solid_list = [_polygon(label, "obstacle", k, s, remarks) for k, s in enumerate(obstacles)]
    wall_list = [_line(label, "wall", k, s) for k, s in enumerate(walls)]
    opening_list = [_line(label, "opening", k, s) for k, s in enumerate(openings)]
    tags, posts = _reflectors(label, reflectors, remarks)
    solid_list += posts
    panes = [_line(label, "glass", k, s) for k, s in enumerate(glass)]
    wall_list += [*tags, *panes]
    faces = [*tags, *(post.boundary for post in posts)]
    frontier = list(opening_list)
    extent = None
    if room_list:
        free = union_of(room_list, NEAR, SHORTEST)
    else:
        free = extent = _box(label, bbox, [*solid_list, *wall_list, *opening_list])
        frontier.append(shapely.get_exterior_ring(free))
    free = shapely.difference(free, shapely.union_all(solid_list))
    parts = [p for p in _parts(free, shapely.Polygon) if p.area > SLIVER]
    if not parts and not solid_list:
        west, south, east, north = shapely.union_all(room_list or [free]).bounds
        raise InputError(
            f"{label}: the rooms are {east - west:.2g} by {north - south:.2g} m in all; give "
            "coordinates in metres, not in degrees of longitude and latitude."
        )
    if not parts:
        raise InputError(
            f"{label}: the obstacles leave no free space; draw a room larger than what is in it."
        )
    free = parts[0] if len(parts) == 1 else shapely.MultiPolygon(parts)
    rings = [ring for p in parts for ring in (p.exterior, *p.interiors)]
    edges = np.concatenate([pieces_of(ring) for ring in rings])
    for k, line in enumerate(opening_list):
        if not len(_split(edges, _around(line))[1]):
            raise InputError(
                f"{label}: opening {k + 1} from {_start(line)} does not lie on the boundary of the "
                f"free space for {SHORTEST:g} m; draw it along the edge of a room."
            )
    zone = shapely.union_all([_around(line) for line in frontier])
    zone = shapely.difference(zone, shapely.union_all([_around(line) for line in wall_list]))
    solid, open_ = _split(edges, zone)
    bright = clear = np.empty((0, 4))
    if panes:
        solid, clear = _split(solid, shapely.union_all([_around(line) for line in panes]))
    if faces:
        solid, bright = _split(solid, shapely.union_all([_around(line) for line in faces]))
    free = _noded(free, np.concatenate([solid, clear, bright, open_]).reshape(-1, 2))
    inside = _within(free, wall_list)
    lit = _on(inside, tags)
    glazed = ~lit & _on(inside, panes)
    bright = np.concatenate([bright, inside[lit]])
    clear = np.concatenate([clear, inside[glazed]])
    for face in faces:
        if not _on(bright, [face]).any():
            raise InputError(
                f"{label}: the reflector at {_start(face)} borders no free space for {SHORTEST:g} "
                "m; draw it along the edge of a room or within one."
            )
    parted = [solid, inside[~lit & ~glazed], open_, bright, clear]
    xy = np.concatenate(parted)
    kinds = np.array([WALL, WALL, FRONTIER, REFLECTOR, GLASS], dtype=np.uint8)
    kind = np.repeat(kinds, [len(part) for part in parted])
    return Environment(
        Segments(xy, kind),
        free,
        name=name,
        source=source,
        checksum=checksum,
        notes=tuple(remarks),
        extent=extent,
        drivable=drivable,
    )


def checked(label: str, geometry: BaseGeometry) -> BaseGeometry:
    """Return the geometry without heights.

    Raises:
        InputError: It is empty, or a coordinate is not finite or beyond any building.
    """
    geometry = shapely.force_2d(geometry)
    points = shapely.get_coordinates(geometry)
    if len(points) == 0:
        raise InputError(f"{label} is empty; give it points or remove it.")
    wrong = ~(np.abs(points) <= FURTHEST)
    if wrong.any():
        raise InputError(
            f"{label} has the coordinate {points[wrong][0]:g}; coordinates are finite numbers of "
            "metres in the map frame."
        )
    return geometry


def sound_polygon(label: str, geometry: BaseGeometry, remarks: list[str]) -> BaseGeometry:
    """Return the polygon, repaired if it crosses itself; add a warning and a remark then.

    Raises:
        InputError: It has no area.
    """
    if not geometry.is_valid:
        reason = shapely.is_valid_reason(geometry)
        repaired = _parts(shapely.make_valid(geometry), shapely.Polygon)
        geometry = shapely.union_all(repaired)
        if geometry.area > 0.0:
            remark = f"{label} is not a simple polygon ({reason}) and was repaired; check it."
            warnings.warn(remark, InputWarning, stacklevel=2)
            remarks.append(remark)
    if not geometry.area > 0.0:
        raise InputError(f"{label} has no area; give it three corners that are not in line.")
    return geometry


def _polygon(label: str, role: str, number: int, shape: Shape, remarks: list[str]) -> BaseGeometry:
    label = f"{label}: {role} {number + 1}"
    if not isinstance(shape, BaseGeometry):
        shape = shapely.Polygon(_points(label, shape, 3))
    if not isinstance(shape, shapely.Polygon | shapely.MultiPolygon):
        raise InputError(f"{label} is a {shape.geom_type}; it must be a Polygon.")
    return sound_polygon(label, checked(label, shape), remarks)


def _line(label: str, role: str, number: int, shape: Shape) -> BaseGeometry:
    label = f"{label}: {role} {number + 1}"
    if not isinstance(shape, BaseGeometry):
        shape = shapely.LineString(_points(label, shape, 2))
    if not isinstance(shape, shapely.LineString | shapely.MultiLineString):
        raise InputError(f"{label} is a {shape.geom_type}; it must be a LineString.")
    shape = checked(label, shape)
    if shape.length <= 0.0:
        raise InputError(f"{label} has no length; give it two different points.")
    return shape


def _reflectors(
    label: str, shapes: Iterable[Shape], remarks: list[str]
) -> tuple[list[BaseGeometry], list[BaseGeometry]]:
    """Return the lines among the reflectors, and the polygons."""
    lines, polygons = [], []
    for k, shape in enumerate(shapes):
        if isinstance(shape, shapely.Polygon | shapely.MultiPolygon):
            polygons.append(_polygon(label, "reflector", k, shape, remarks))
        else:
            lines.append(_line(label, "reflector", k, shape))
    return lines, polygons


def _points(label: str, shape: ArrayLike, least: int) -> Floats:
    try:
        points = np.asarray(shape, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{label} is not an array of numbers; give points (x, y).") from error
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < least:
        raise InputError(
            f"{label} has the shape {points.shape}; it must be (n, 2) with n at least {least}."
        )
    if not np.isfinite(points).all():
        raise InputError(f"{label} has a coordinate that is nan or infinite; correct it.")
    return points


def _box(label: str, bbox: Sequence[float] | None, shapes: list[BaseGeometry]) -> BaseGeometry:
    if bbox is None:
        if not shapes:
            raise InputError(f"{label}: there is no room and no wall in it; draw at least one.")
        bbox = shapely.total_bounds(shapes).tolist()
    try:
        xmin, ymin, xmax, ymax = (float(v) for v in bbox)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{label}: bbox is {bbox!r}; it must be xmin, ymin, xmax, ymax in metres."
        ) from error
    if not (-FURTHEST <= xmin < xmax <= FURTHEST and -FURTHEST <= ymin < ymax <= FURTHEST):
        raise InputError(
            f"{label}: without a room the free space is the box {[xmin, ymin, xmax, ymax]}, which "
            "has no sound area; draw a room or give a bbox."
        )
    return shapely.box(xmin, ymin, xmax, ymax)


def _parts(geometry: BaseGeometry, kind: type[BaseGeometry]) -> list[BaseGeometry]:
    """Return the simple geometries of one kind in a geometry."""
    parts: list[BaseGeometry] = []
    for part in shapely.get_parts(geometry):
        if isinstance(part, kind):
            parts.append(part)
        elif hasattr(part, "geoms"):
            parts += _parts(part, kind)
    return parts


def _start(line: BaseGeometry) -> str:
    x, y = shapely.get_coordinates(line)[0]
    return f"({x:g}, {y:g})"


def _around(line: BaseGeometry) -> BaseGeometry:
    """Return the strip beside a line, without the area beyond its ends."""
    # GEOS divides by 0 for the tip of a mitre that has none; what it returns is right.
    with np.errstate(divide="ignore", invalid="ignore"):
        return shapely.buffer(line, NEAR, cap_style="flat", join_style="mitre")


def _split(edges: Floats, zone: BaseGeometry) -> tuple[Floats, Floats]:
    """Return pieces of the edges, shape (N, 4), outside the zone, and those inside it."""
    outside: list[Floats] = []
    inside: list[Floats] = []
    lines = shapely.linestrings(edges.reshape(-1, 2, 2))
    shapely.prepare(zone)
    for edge, line, met in zip(edges, lines, shapely.intersects(zone, lines), strict=True):
        cuts = [0.0]
        if met:
            for part in _parts(shapely.intersection(line, zone), shapely.LineString):
                if part.length >= min(SHORTEST, 0.5 * line.length):
                    ends = shapely.get_coordinates(part)[[0, -1]]
                    along = sorted(line.project(shapely.points(p)) / line.length for p in ends)
                    # A cut beside an end of the edge is that end.
                    snap = min(SHORTEST / line.length, 0.5)
                    cuts += [0.0 if t < snap else 1.0 if t > 1.0 - snap else t for t in along]
        cuts.append(1.0)
        a, run = edge[:2], edge[2:] - edge[:2]
        # cuts: outside from 0 to 1, inside from 1 to 2, outside from 2 to 3, ...
        cuts[1:-1] = sorted(cuts[1:-1])
        for k, (low, high) in enumerate(itertools.pairwise(cuts)):
            if high > low:
                start = a + low * run if low > 0.0 else a
                end = a + high * run if high < 1.0 else edge[2:]
                (inside if k % 2 else outside).append(np.concatenate([start, end]))
    return np.array(outside).reshape(-1, 4), np.array(inside).reshape(-1, 4)


def _on(pieces: Floats, lines: Sequence[BaseGeometry]) -> Bools:
    """Return the mask of the pieces, shape (n, 4), whose middle lies on a line."""
    middle = shapely.points(0.5 * (pieces[:, :2] + pieces[:, 2:]))
    return np.asarray(shapely.dwithin(shapely.union_all(lines), middle, NEAR), dtype=np.bool_)


def _noded(free: BaseGeometry, points: Floats) -> BaseGeometry:
    """Add corners to polygons wherever an edge is part wall, part frontier.

    Each edge of the free space is then of one kind, as scans take it to be.
    """
    corners = {tuple(point) for point in shapely.get_coordinates(free).tolist()}
    fresh = np.array([p for p in np.unique(points, axis=0).tolist() if tuple(p) not in corners])
    if not len(fresh):
        return free

    def ring(coordinates: Floats) -> Floats:
        out = []
        for a, b in itertools.pairwise(coordinates):
            # Not by @: BLAS rounds it in another way on each kind of processor.
            along = ((fresh - a) * (b - a)).sum(axis=1) / ((b - a) * (b - a)).sum()
            away = np.hypot(*(fresh - a - along[:, np.newaxis] * (b - a)).T)
            on = (along > 0.0) & (along < 1.0) & (away < ON_EDGE)
            out += [a[np.newaxis], fresh[on][np.argsort(along[on])]]
        return np.concatenate([*out, coordinates[-1:]])

    polygons = [
        shapely.Polygon(
            ring(shapely.get_coordinates(part.exterior)),
            [ring(shapely.get_coordinates(hole)) for hole in part.interiors],
        )
        for part in _parts(free, shapely.Polygon)
    ]
    return polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)


def _within(free: BaseGeometry, walls: list[BaseGeometry]) -> Floats:
    """Return pieces of the walls inside the free space, split at crossings, shape (n, 4)."""
    if not walls:
        return np.empty((0, 4))
    border = free.boundary
    # Walls that leave the border at a corner pass it by what is rounded: they are led through it.
    corners = shapely.multipoints(shapely.get_coordinates(border))
    walls = [shapely.snap(wall, corners, NEAR) for wall in walls]
    # Union with the border parts the walls where they reach it.
    noded = _parts(shapely.union_all([*walls, border]), shapely.LineString)
    pieces = np.concatenate([pieces_of(line) for line in noded])
    middle = shapely.points(0.5 * (pieces[:, :2] + pieces[:, 2:]))
    shapely.prepare(free)
    inside = shapely.contains(free, middle) & (shapely.distance(border, middle) > NEAR)
    return np.ascontiguousarray(pieces[inside])
