"""Check that obstacles close no passage.

A passage is closed where a disc as wide as it no longer gets through. The centre of such a disc may
be anywhere in the free space shrunk by half the width; an obstacle takes away what lies within half
the width of it. If its edge crosses what was there before in one piece, everything that was
connected still is, and every way round is still there; if in several, the obstacle
stands between two walls.
"""

from __future__ import annotations

from typing import Final

import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.geometry.collision.reach import room_for
from ambinav.geometry.environment import Environment

TOUCH: Final = 1e-6
"""Pieces of an edge that are shorter are of rounding, metres."""
SLACK: Final = 1e-3
"""Metres that are of rounding."""


class Passages:
    """Check of which obstacles leave the passages of a building free.

    Args:
        environment: The building.
        width: Width of the passages to keep open, metres.
    """

    def __init__(self, environment: Environment, width: float) -> None:
        self.width = width
        self.room = room_for(environment, width / 2)
        self.wide = room_for(environment, width)
        shapely.prepare([self.room, self.wide])

    def stays(self, outline: BaseGeometry, on_wall: bool) -> bool:
        """Return whether an obstacle leaves the passages free.

        It is to touch a wall, or to leave the width between itself and all of them.
        """
        if not on_wall:
            return bool(shapely.covers(self.wide, outline))
        taken = shapely.buffer(outline, self.width / 2 - SLACK, quad_segs=64)
        edge = shapely.line_merge(shapely.intersection(self.room, taken.exterior))
        pieces = shapely.length(shapely.get_parts(edge))
        # What is only touched is not crossed.
        crossed = int((pieces > TOUCH).sum())
        return crossed <= 1 if crossed else not shapely.intersects(self.room, taken)
