"""Buildings like recorded maps: ragged walls, narrow doors, clutter."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError
from ambinav_envs.buildings.plan import WALL, Plan, rectangle, sides
from ambinav_envs.buildings.plan_sampler import PlanSampler
from ambinav_envs.buildings.procedural import ProceduralParameters, procedural_plan

DOORS: Final = (0.8, 1.2)
"""Widths of the doors, metres: the procedural ones have 1 m."""
ROBOT: Final = 0.27
"""A disc of this radius gets to most of the floor where it fits, metres."""
CONNECTED: Final = 0.9
"""Least share of that floor in one piece: some corners are cut off, as in a recorded map."""
RAGGED: Final = (0.01, 0.04)
"""Range of the displacement of walls, metres, and ..."""
STRETCH: Final = 0.5
"""... over which length of the wall at most, metres."""
# Rooms smaller than this are left as they are, square metres: corridors' ends, niches.
_SMALL: Final = 4.0
# A room narrower than this is a corridor, metres, where little stands.
_NARROW: Final = 2.9
_DRAWINGS: Final = 60
# The plan is drawn bare: what stands in it is drawn here.
_BARE: Final = ProceduralParameters(
    size=(13.0, 20.0), great_halls=0.2, room_area=(14.0, 36.0), tilted=0.15, furniture=0.0,
    more_doors=0.4,
)  # fmt: skip


def cluttered_building(rng: np.random.Generator, *, name: str = "cluttered") -> Environment:
    """Draw a building; the same generator draws the same one in any process.

    Rooms and corridors are those of `procedural_plan`. Cabinets and boxes stand along the walls
    without regard for a passage between them, tables and chairs are seen by their legs, which a
    robot may drive between or not, and doors may be as narrow as 0.8 m.
    """
    sampler = PlanSampler(rng)
    for _ in range(_DRAWINGS):
        plan = procedural_plan(sampler, _BARE)
        if plan is None:
            continue
        plan.doors = [_resized(door, sampler.between(*DOORS)) for door in plan.doors]
        for room in plan.rooms:
            if room.area > _SMALL:
                _clutter(plan, sampler, room)
        floor = _ragged(plan.floor(), sampler)
        pieces = shapely.area(shapely.get_parts(floor.buffer(-ROBOT, quad_segs=4)))
        if len(pieces) and pieces.max() >= CONNECTED * pieces.sum():
            return environment_from_shapes([floor], name=name)
    raise InputError(f"{name}: no building can be drawn; take another number.")


def _clutter(plan: Plan, sampler: PlanSampler, room: shapely.Polygon) -> None:
    """Place furniture and small objects in a room."""
    narrow = _width(room) < _NARROW
    _along_walls(plan, sampler, room, 0.25 if narrow else 0.6, 0.3 if narrow else 0.6)
    area = 0.3 * room.area if narrow else room.area
    for _ in range(sampler.count(0, int(area / 5.0))):
        _table(plan, sampler, _inside(sampler, room))
    for _ in range(sampler.count(0, int(area / 4.0))):
        _chair(plan, sampler, _inside(sampler, room))
    for _ in range(sampler.count(0, int(area / 8.0))):
        size = sampler.between(0.25, 0.7)
        shape = rectangle(_inside(sampler, room), sampler.between(0.0, 180.0), size, 0.7 * size)
        _place_object(plan, shape)


def _along_walls(
    plan: Plan, sampler: PlanSampler, room: shapely.Polygon, share: float, deepest: float
) -> None:
    """Place cabinets, boxes and radiators against the walls, at random distances."""
    for side in sides(room):
        (ax, ay), (bx, by) = shapely.get_coordinates(side)
        size = math.hypot(bx - ax, by - ay)
        if size < 0.5:
            continue
        ux, uy = (bx - ax) / size, (by - ay) / size
        degrees = math.degrees(math.atan2(uy, ux))
        along = sampler.between(0.0, 1.0)
        while along < size:
            length, depth = sampler.between(0.2, 1.5), sampler.between(0.1, deepest)
            if sampler.happens(share):
                # Into half of the wall, so that no hair of free space is left behind it.
                middle, out = along + 0.5 * length, 0.5 * depth - 0.25 * WALL
                centre = (ax + middle * ux - out * uy, ay + middle * uy + out * ux)
                shape = rectangle(centre, degrees, length, depth + 0.5 * WALL)
                _place_object(plan, shape.intersection(room.buffer(0.5 * WALL, join_style="mitre")))
            along += length + (0.0 if sampler.happens(0.4) else sampler.between(0.1, 1.0))


def _table(plan: Plan, sampler: PlanSampler, middle: tuple[float, float]) -> None:
    """Place the four legs of a table."""
    degrees = sampler.between(0.0, 180.0)
    corners = rectangle(
        middle, degrees, sampler.between(0.9, 1.6), sampler.between(0.5, 0.8)
    ).exterior.coords
    thick = sampler.between(0.04, 0.1)
    for x, y in list(corners)[:4]:
        _place_object(plan, rectangle((x, y), degrees, thick, thick))


def _chair(plan: Plan, sampler: PlanSampler, middle: tuple[float, float]) -> None:
    """Place the legs of a chair, close together."""
    for _ in range(sampler.count(1, 4)):
        x = middle[0] + sampler.between(-0.25, 0.25)
        y = middle[1] + sampler.between(-0.25, 0.25)
        thick = sampler.between(0.03, 0.1)
        _place_object(plan, rectangle((x, y), sampler.between(0.0, 90.0), thick, thick))


def _place_object(plan: Plan, shape: BaseGeometry) -> None:
    """Place an object at its position, unless it blocks a door."""
    if shape.area > 0.0 and not shapely.intersects(shape, plan.clear).any():
        plan.solids.append(shape)


def _inside(sampler: PlanSampler, room: shapely.Polygon) -> tuple[float, float]:
    """Draw a point in the bounding box of a room."""
    xmin, ymin, xmax, ymax = room.bounds
    return sampler.between(xmin, xmax), sampler.between(ymin, ymax)


def _width(room: shapely.Polygon) -> float:
    """Return the width of the narrowest rectangle around a room, metres."""
    ring = shapely.get_coordinates(shapely.minimum_rotated_rectangle(room))
    return float(np.hypot(*np.diff(ring[:3], axis=0).T).min())


def _resized(door: shapely.Polygon, width: float) -> shapely.Polygon:
    """Return a door of another width with the same middle."""
    ring = shapely.get_coordinates(door)[:4]
    edges = np.diff(ring[:3], axis=0)
    lengths = np.hypot(*edges.T)
    along = edges[lengths.argmax()] / lengths.max()
    middle = ring.mean(axis=0)
    degrees = math.degrees(math.atan2(along[1], along[0]))
    return rectangle((float(middle[0]), float(middle[1])), degrees, width, float(lengths.min()))


def _ragged(floor: shapely.Polygon, sampler: PlanSampler) -> shapely.Polygon:
    """Return the floor with irregular walls; furniture legs stay as they are."""
    out = sampler.between(*RAGGED)
    solid = [
        _roughened(hole, out, sampler) if hole.length > 2.0 * STRETCH else shapely.Polygon(hole)
        for hole in floor.interiors
    ]
    free = _roughened(floor.exterior, out, sampler).difference(shapely.union_all(solid))
    parts = shapely.get_parts(free)
    largest: shapely.Polygon = parts[int(np.argmax(shapely.area(parts)))]
    return largest


def _roughened(ring: shapely.LinearRing, out: float, sampler: PlanSampler) -> BaseGeometry:
    """Return the polygon of a ring after extra corners are inserted and all are moved a little."""
    points = shapely.get_coordinates(shapely.segmentize(ring, STRETCH))[:-1]
    noise = [[sampler.between(-out, out) for _ in range(2)] for _ in points]
    return shapely.Polygon(points + np.array(noise)).buffer(0.0)
