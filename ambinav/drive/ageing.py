"""Building that differs from its map: shifted walls and moved furniture."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.drive.ageing_in_space import (
    Bodies,
    Piece,
    bent_area,
    bent_lines,
    bent_prisms,
    prisms_of,
    translated,
)
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.geometry.segments import FRONTIER, Segments
from ambinav.runtime.array_types import Floats

WAVES: Final = 32
"""Number of waves, `SHORTEST` to `LONGEST` metres long, by which walls are displaced."""
SHORTEST: Final = 2.0
LONGEST: Final = 8.0
PIECE: Final = 0.25
"""Walls are bent in pieces of this length, metres."""
FURNITURE: Final = 2.5
"""Maximum width of furniture, metres: free-standing objects that are wider stay."""
# Number of shifts sampled for a piece of furniture before it stays where it is.
TRIES = 20
# Metres. Furniture this near to something else belongs to it.
TOUCHING = 1e-3
ON_BORDER = 1e-6


def with_aged_walls(mapped: Environment, std: float, rng: np.random.Generator) -> Environment:
    """Return an aged building of the map: every corner slightly moved, neighbours similarly.

    In a building of prisms all that stands at a place is off alike, at every height; floors,
    ceilings and heights stay.

    Args:
        mapped: The map; it is left as it is.
        std: How far walls stand from where the map has them, standard deviation in x and in y and
            so across any wall, metres.
        rng: The source of randomness; with another deviation the same waves are higher or lower.

    Raises:
        InputError: no free space is left, or the building is a mesh.
    """
    prisms = prisms_of(mapped, "an aged building")
    turn = rng.uniform(0.0, math.pi, WAVES)
    length = rng.uniform(SHORTEST, LONGEST, WAVES)
    wave = 2.0 * math.pi / length * np.array([np.cos(turn), np.sin(turn)])
    phase = rng.uniform(0.0, 2.0 * math.pi, (2, WAVES))

    def moved(points: Floats) -> Floats:
        waves = np.cos((points @ wave)[:, None, :] + phase)
        return np.asarray(points + std * math.sqrt(2.0 / WAVES) * waves.sum(axis=2))

    walls, owner = bent_lines(mapped.segments.xy, moved, PIECE)
    world = Environment(
        Segments(walls, mapped.segments.kind[owner]),
        bent_area(mapped.free, moved, PIECE),
        name=mapped.name,
        resolution=mapped.resolution,
    )
    if prisms is None:
        return world
    return world.in_space(bent_prisms(prisms, moved, PIECE), mapped.floor)


def with_moved_furniture(
    mapped: Environment, std: float, rng: np.random.Generator, passage: float
) -> Environment:
    """Return the building with moved furniture: free-standing objects at most `FURNITURE` wide.

    A piece is put where there is room for it, on a straight way, and no gap beside it becomes
    narrower than `passage`, but for those that are narrower on the map. Where no such place is
    drawn it stays.

    In a building of prisms the walls and solids of a piece move with it, a table with all of its
    legs, if with what overhangs it is furniture still. What touches wider bodies at any height
    stays.

    Args:
        mapped: The map; it is left as it is.
        std: Deviation of its shift in x and in y, metres.
        rng: The source of randomness.
        passage: Metres.

    Raises:
        InputError: the building is a mesh.
    """
    prisms = prisms_of(mapped, "moved furniture")
    parts = shapely.get_parts(mapped.free)
    rings = [ring for part in parts for ring in (part.exterior, *part.interiors)]
    thin = shapely.linestrings(mapped.thin_walls.reshape(-1, 2, 2))
    lines = np.array([*rings, *thin], dtype=object)
    shapely.prepare(lines)
    things = _furniture(mapped, parts, rings)
    bodies, none = None, np.empty(0, dtype=np.intp)
    pieces = [Piece([thing], thing[1], thing[1], none) for thing in things]
    if prisms is not None and things:
        bodies = Bodies(prisms, mapped.floor, FURNITURE, TOUCHING)
        pieces = bodies.pieces(things)
    rings_of = [[k for k, _ in piece.things] for piece in pieces]
    gaps = [
        min(passage, *shapely.distance(piece.on_plan, np.delete(lines, own_lines)).tolist())
        for piece, own_lines in zip(pieces, rings_of, strict=True)
    ]
    removed, put = [], []
    for piece, own_lines, gap in zip(pieces, rings_of, gaps, strict=True):
        shift = None
        if gap > TOUCHING:
            shift = _sample_shift(piece, np.delete(lines, own_lines), bodies, std, rng, gap)
        if shift is not None:
            if bodies is not None:
                bodies.move(piece, translated(piece.shape, shift), shift)
            for k, thing in piece.things:
                place = translated(thing, shift)
                removed.append(thing)
                put.append(place)
                lines[k] = place.exterior
    if not put:
        return mapped
    # `drivable` and the occupancy grid belong to the map, not to the building.
    plain = Environment(
        mapped.segments, mapped.free, name=mapped.name, resolution=mapped.resolution
    )
    world = plain.edited([Obstacle(place) for place in put], shapely.union_all(removed))
    return world if bodies is None else world.in_space(bodies.moved(), mapped.floor)


def _furniture(
    mapped: Environment, parts: Any, rings: list[Any]
) -> list[tuple[int, shapely.Polygon]]:
    """Return free-standing objects with their index among all rings of the free space."""
    frontier = mapped.segments.xy[mapped.segments.kind == FRONTIER].reshape(-1, 2, 2)
    unknown = shapely.MultiLineString(list(frontier))
    outer = {part.exterior.wkb for part in parts}
    pieces = []
    for k, ring in enumerate(rings):
        thing = shapely.Polygon(ring)
        if ring.wkb in outer or 2.0 * shapely.minimum_bounding_radius(thing) > FURNITURE:
            continue
        # A room may lie in it; and what is unknown within is not known to be a thing.
        if shapely.contains(thing, parts).any() or shapely.dwithin(ring, unknown, ON_BORDER):
            continue
        pieces.append((k, thing))
    return pieces


def _sample_shift(
    piece: Piece,
    others: NDArray[np.object_],
    bodies: Bodies | None,
    std: float,
    rng: np.random.Generator,
    gap: float,
) -> Floats | None:
    """Sample a shift of a piece that keeps clear of all others; None: it stays."""
    middle = piece.on_plan.centroid
    for _ in range(TRIES):
        shift = rng.normal(0.0, std, 2)
        dx, dy = shift.tolist()
        place = translated(piece.on_plan, shift)
        way = shapely.LineString([(middle.x, middle.y), (middle.x + dx, middle.y + dy)])
        if (
            not shapely.dwithin(others, place, gap).any()
            and not shapely.intersects(others, way).any()
            and not (
                bodies is not None
                and bodies.beside(piece, translated(piece.shape, shift), TOUCHING)
            )
        ):
            return shift
    return None
