"""Construction of a building: rooms, doors in the walls between them, and furniture."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.environment import Environment

WALL = 0.2
"""Thickness of the walls between rooms, metres."""
AISLE = 0.8
"""Room left between things that do not touch, metres: for a robot of up to 0.4 m of radius."""
# How far a door's passage on both sides of its wall is kept clear, metres, and beyond its posts.
THRESHOLD, BESIDE = 1.0, 0.1
# A wall or a thing nearer than this is touched, metres.
TOUCHING = 1e-6

Point = tuple[float, float]


@dataclass
class Plan:
    """A building under construction, metres.

    Attributes:
        rooms: Convex polygons of free space.
        doors: Openings in the walls between them.
        solids: Objects in the rooms.
        clear: Areas to keep free: in front of doors.
    """

    rooms: list[shapely.Polygon] = field(default_factory=list)
    doors: list[shapely.Polygon] = field(default_factory=list)
    solids: list[BaseGeometry] = field(default_factory=list)
    clear: list[shapely.Polygon] = field(default_factory=list)

    def room(self, shape: shapely.Polygon) -> shapely.Polygon:
        """Add a room."""
        self.rooms.append(shape)
        return shape

    def box(self, xmin: float, ymin: float, xmax: float, ymax: float) -> shapely.Polygon:
        """Add a room with walls parallel to the axes."""
        return self.room(shapely.box(xmin, ymin, xmax, ymax))

    def door(self, middle: Point, degrees: float, width: float = 1.1, wall: float = WALL) -> None:
        """Open the wall through `middle` that runs at an angle to the x axis."""
        # Slightly into both rooms, so that no sliver of wall is left.
        self.doors.append(rectangle(middle, degrees, width, wall + 0.02))
        self.clear.append(rectangle(middle, degrees, width + 2.0 * BESIDE, wall + 2.0 * THRESHOLD))

    def stand(self, room: shapely.Polygon, shape: BaseGeometry) -> bool:
        """Place an object in a room, if a robot can still drive around it.

        It may reach into the walls. It keeps clear of doors, and keeps a distance of `AISLE` to
        other objects and to walls, except one wall or two neighbouring ones that it may touch.
        Hence robots can pass every object where it touches no wall, also between two objects.

        Returns:
            Whether it now stands there.
        """
        # Into half of the wall, so that no hair of free space is left between them.
        solid = shape.intersection(room.buffer(0.5 * WALL, join_style="mitre"))
        shape = shape.intersection(room)
        if shape.area < 0.01 or not isinstance(shape, shapely.Polygon):
            return False
        if shapely.intersects(shape, self.clear).any():
            return False
        if self.solids and float(shapely.distance(shape, self.solids).min()) < AISLE:
            return False
        walls = shapely.distance(shape, sides(room))
        touched = np.flatnonzero(walls <= TOUCHING)
        if (walls[walls > TOUCHING] < AISLE).any() or len(touched) > 2:
            return False
        if len(touched) == 2 and (touched[1] - touched[0]) not in (1, len(walls) - 1):
            return False
        self.solids.append(solid)
        return True

    def floor(self) -> shapely.Polygon:
        """Return the largest connected part of the free space."""
        free = shapely.union_all([*self.rooms, *self.doors])
        parts = shapely.get_parts(free.difference(shapely.union_all(self.solids)))
        floor: shapely.Polygon = parts[int(np.argmax(shapely.area(parts)))]
        return floor

    def environment(self, name: str, degrees: float = 0.0) -> Environment:
        """Return the building, rotated by an angle counter-clockwise about the origin.

        Corners behind things that are cut off from the rest are solid.
        """
        drawn = environment_from_shapes([self.floor()], name=name)
        return drawn.transformed(math.radians(degrees)) if degrees else drawn


def rectangle(middle: Point, degrees: float, length: float, depth: float) -> shapely.Polygon:
    """Return a rectangle about a point, its long axis at an angle to the x axis."""
    along = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    across = np.array([-along[1], along[0]])
    a, b = 0.5 * length * along, 0.5 * depth * across
    return shapely.Polygon(np.array([-a - b, a - b, a + b, -a + b]) + middle)


def disc(middle: Point, radius: float) -> shapely.Polygon:
    """Return a round object as a polygon with 16 sides."""
    return shapely.Point(middle).buffer(radius, quad_segs=4)


def sides(room: shapely.Polygon) -> list[shapely.LineString]:
    """Return the straight sides of a convex room, counter-clockwise."""
    ring = shapely.get_coordinates(shapely.geometry.polygon.orient(room).exterior)
    return list(shapely.linestrings(np.stack([ring[:-1], ring[1:]], axis=1)))
