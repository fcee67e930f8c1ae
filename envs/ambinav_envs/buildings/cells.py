"""A floor cut into convex rooms by straight walls at any angle, and where doors can be."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.runtime.array_types import Floats
from ambinav_envs.buildings.plan import Point

Ring = NDArray[np.float64]
"""Corners of a convex polygon, counter-clockwise, shape (N, 2), metres."""

# Up to this a corner lies on a line, metres, and two walls are parallel.
_EXACT = 1e-6


@dataclass(frozen=True)
class Doorway:
    """A stretch of wall between two rooms that is long enough for a door.

    Attributes:
        rooms: Their numbers.
        middle: The middle of the stretch, halfway through the wall.
        degrees: Angle of the wall to the x axis.
        length: Length of the stretch, metres.
    """

    rooms: tuple[int, int]
    middle: Point
    degrees: float
    length: float

    def at(self, share: float, width: float) -> Point:
        """Return the middle of a door on the stretch; `share` is 0 at one end, 1 at the other."""
        along = (share - 0.5) * (self.length - width)
        angle = math.radians(self.degrees)
        return self.middle[0] + along * math.cos(angle), self.middle[1] + along * math.sin(angle)


def cut(ring: Ring, point: Point, degrees: float) -> tuple[Ring, Ring]:
    """Cut a convex polygon along a line; return the part left of it and the part right of it."""
    angle = math.radians(degrees)
    x, y = ring[:, 0] - point[0], ring[:, 1] - point[1]
    height = -math.sin(angle) * x + math.cos(angle) * y
    height[np.abs(height) < _EXACT] = 0.0
    left: list[Floats] = []
    right: list[Floats] = []
    for k in range(len(ring)):
        following = (k + 1) % len(ring)
        a, b = height[k], height[following]
        if a >= 0.0:
            left.append(ring[k])
        if a <= 0.0:
            right.append(ring[k])
        if a * b < 0.0:
            crossing = ring[k] + a / (a - b) * (ring[following] - ring[k])
            left.append(crossing)
            right.append(crossing)
    return np.array(left).reshape(-1, 2), np.array(right).reshape(-1, 2)


def is_roomy(ring: Ring, width: float, side: float, area: float, angle: float) -> bool:
    """Return whether a polygon can be a room: wide and large enough, without sharp corners.

    Args:
        ring: The polygon.
        width: Least distance between two parallel lines around it, metres.
        side: Least length of a side, metres.
        area: Least area, square metres.
        angle: Sharpest corner, degrees.
    """
    if len(ring) < 3:
        return False
    ahead = np.roll(ring, -1, axis=0) - ring
    length = np.hypot(*ahead.T)
    if length.min() < side:
        return False
    turn = np.degrees(np.arctan2(ahead[:, 1], ahead[:, 0]))
    inner = 180.0 - (np.roll(turn, -1) - turn) % 360.0
    normal = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) / length[:, None]
    # The narrowest strip around a convex polygon lies along one of its sides.
    across = (ring @ normal.T).max(axis=0) - (ring * normal).sum(axis=1)
    return bool(
        inner.min() >= angle and across.min() >= width and shapely.Polygon(ring).area >= area
    )


def long_axis(ring: Ring) -> float:
    """Return the direction of the longer side of the tightest box around a polygon, degrees."""
    box = shapely.get_coordinates(shapely.Polygon(ring).minimum_rotated_rectangle)
    sides = np.diff(box[:3], axis=0)
    longer = sides[int(np.argmax(np.hypot(*sides.T)))]
    return math.degrees(math.atan2(longer[1], longer[0]))


def doorways(rooms: list[shapely.Polygon], wall: float, least: float) -> list[Doorway]:
    """Find the stretches where only a wall separates two rooms.

    Args:
        rooms: Convex.
        wall: Thickness of the walls, metres.
        least: Least length of the stretch, metres.
    """
    stretches = []
    edges = [_edges(room) for room in rooms]
    for i, j in combinations(range(len(rooms)), 2):
        if rooms[i].distance(rooms[j]) > wall * (1.0 + _EXACT):
            continue
        for ax, ay, ux, uy, length in edges[i]:
            for bx, by, vx, vy, other_start in edges[j]:
                # Both run counter-clockwise: along the same wall in opposite directions.
                if ux * vx + uy * vy > -0.5 or abs(ux * vy - uy * vx) > _EXACT:
                    continue
                gap = uy * (bx - ax) - ux * (by - ay)
                if abs(gap - wall) > 1e3 * _EXACT:
                    continue
                start = ux * (bx - ax) + uy * (by - ay)
                low, high = max(start - other_start, 0.0), min(start, length)
                if high - low >= least:
                    along, out = 0.5 * (low + high), 0.5 * wall
                    middle = ax + along * ux + out * uy, ay + along * uy - out * ux
                    degrees = math.degrees(math.atan2(uy, ux))
                    stretches.append(Doorway((i, j), middle, degrees, high - low))
    return stretches


def _edges(room: shapely.Polygon) -> list[tuple[float, float, float, float, float]]:
    """Return start, direction and length of each side, counter-clockwise."""
    ring = shapely.get_coordinates(shapely.geometry.polygon.orient(room).exterior)
    ahead = np.diff(ring, axis=0)
    length = np.hypot(*ahead.T)
    rows = np.column_stack([ring[:-1], ahead / length[:, None], length])
    return [(float(a), float(b), float(c), float(d), float(e)) for a, b, c, d, e in rows]
