"""Draws the demo building and writes it to demo.geojson beside this file.

The building has what makes a place easy or hard for a range scanner: a hall wider than a short
range, a long bare corridor, corridors at odd angles, furnished offices, rows of equal racks, a
round room. From the lobby in the west to the store in the east lead a bare path, along the
corridor, and a furnished one, through the offices, that is hardly longer.

Run it after a change: python configs/draw_demo.py
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely
import shapely.affinity
import shapely.geometry
from shapely.geometry.base import BaseGeometry

PATH = Path(__file__).with_name("demo.geojson")


@dataclass
class Drawing:
    """Named shapes in metres, in the order in which they are drawn."""

    features: list[tuple[str, str, BaseGeometry]] = field(default_factory=list)

    def add(self, kind: str, name: str, shape: BaseGeometry) -> None:
        """Add one shape; `kind` is room, obstacle or wall."""
        self.features.append((kind, name, shape))

    def room(self, name: str, xmin: float, ymin: float, xmax: float, ymax: float) -> None:
        """Add a room with walls along the axes."""
        self.add("room", name, shapely.box(xmin, ymin, xmax, ymax))

    def door_x(self, name: str, x: float, y: float, width: float = 1.0) -> None:
        """Open the wall between x and x + 0.2, upwards from y."""
        self.room(name, x - 0.1, y, x + 0.3, y + width)

    def door_y(self, name: str, x: float, y: float, width: float = 1.0) -> None:
        """Open the wall between y and y + 0.2, rightwards from x."""
        self.room(name, x, y - 0.1, x + width, y + 0.3)

    def block(self, name: str, x: float, y: float, width: float, depth: float) -> None:
        """Stand a piece of furniture with its lower left corner at (x, y)."""
        self.add("obstacle", name, shapely.box(x, y, x + width, y + depth))

    def disc(self, name: str, x: float, y: float, radius: float) -> None:
        """Stand a round obstacle, a 32-gon, at (x, y)."""
        self.add("obstacle", name, shapely.Point(x, y).buffer(radius, quad_segs=8))

    def wall(self, name: str, *points: tuple[float, float]) -> None:
        """Draw a wall without thickness."""
        self.add("wall", name, shapely.LineString(points))

    def geojson(self) -> str:
        """The drawing as GeoJSON, one feature a line, coordinates to the millimetre."""
        lines = []
        for kind, name, shape in self.features:
            rounded = shapely.transform(shape, lambda xy: np.round(xy, 3) + 0.0)
            feature = {
                "type": "Feature",
                "properties": {"kind": kind, "name": name},
                "geometry": shapely.geometry.mapping(rounded),
            }
            lines.append(json.dumps(feature))
        body = ",\n".join(lines)
        return f'{{"type": "FeatureCollection", "name": "demo", "features": [\n{body}\n]}}\n'


def strip(x: float, y: float, degrees: float, length: float, width: float) -> shapely.Polygon:
    """A straight corridor that starts with the middle of its short side at (x, y)."""
    along = shapely.box(x, y - width / 2, x + length, y + width / 2)
    return shapely.affinity.rotate(along, degrees, origin=(x, y))


def draw_halls(plan: Drawing) -> None:
    """The entrance, the bare corridor, the great hall and the rooms beside it."""
    plan.room("lobby", 0.2, 10.0, 6.0, 18.0)
    plan.block("reception", 1.6, 15.2, 2.6, 0.8)
    plan.block("bench", 0.2, 11.4, 0.5, 2.2)
    plan.disc("plant", 5.5, 17.5, 0.3)

    plan.room("long corridor", 6.2, 12.0, 31.2, 14.0)
    plan.door_x("corridor, west end", 6.0, 12.3, 1.4)
    plan.door_x("corridor, east end", 31.2, 12.3, 1.4)

    plan.room("great hall", 7.0, 14.2, 23.0, 28.2)
    plan.door_y("hall to corridor", 7.4, 14.0, 1.2)
    plan.block("pillar", 9.2, 17.2, 0.6, 0.6)
    plan.block("pillar", 9.2, 25.0, 0.6, 0.6)
    plan.disc("pillar", 20.9, 25.4, 0.35)
    plan.disc("pillar", 20.4, 16.6, 0.35)
    plan.block("stage", 12.2, 27.2, 5.6, 1.0)

    plan.room("workshop", 0.2, 18.2, 6.8, 24.0)
    plan.door_y("workshop to lobby", 3.0, 18.0)
    plan.door_x("workshop to hall", 6.8, 21.6)
    plan.block("workbench", 0.2, 19.4, 0.8, 3.4)
    plan.block("workbench", 2.6, 20.4, 2.0, 1.0)
    plan.block("lathe", 4.4, 23.2, 1.8, 0.8)
    plan.room("tool room", 0.2, 24.2, 3.6, 28.2)
    plan.door_y("tool room to workshop", 2.2, 24.0, 0.9)
    plan.block("shelf", 0.2, 24.8, 0.5, 3.4)
    plan.block("shelf", 1.4, 27.7, 2.2, 0.5)
    plan.room("cloakroom", 3.8, 24.2, 6.8, 28.2)
    plan.door_x("cloakroom to hall", 6.8, 26.6)
    plan.wall("coat rail", (3.8, 25.6), (5.6, 25.6))
    plan.wall("coat rail", (3.8, 26.6), (5.6, 26.6))


def draw_offices(plan: Drawing) -> None:
    """The furnished path: a row of offices from the lobby to the store, with inner doors."""
    plan.room("office 1", 6.2, 6.0, 10.2, 11.8)
    plan.door_x("lobby to office 1", 6.0, 10.5)
    plan.door_y("office 1 to corridor", 8.8, 11.8, 0.9)
    plan.block("desk", 6.2, 8.2, 0.8, 1.6)
    plan.block("desk", 8.8, 6.0, 1.4, 0.8)
    plan.block("cabinet", 9.8, 7.4, 0.4, 1.6)

    plan.room("office 2", 10.4, 6.0, 14.2, 11.8)
    plan.door_x("office 1 to office 2", 10.2, 10.2)
    plan.door_y("office 2 to corridor", 12.6, 11.8, 0.9)
    plan.block("desks", 12.0, 8.0, 1.6, 1.6)
    plan.block("cabinet", 10.4, 6.6, 0.4, 2.4)

    plan.room("open-plan office", 14.4, 6.0, 20.6, 11.8)
    plan.door_x("office 2 to open-plan office", 14.2, 10.0)
    plan.wall("screen", (16.4, 6.0), (16.4, 8.6))
    plan.wall("screen", (18.6, 6.0), (18.6, 8.6))
    for x in (14.8, 16.9, 19.0):
        plan.block("desk", x, 6.0, 1.4, 0.8)
    plan.block("cabinet", 16.2, 11.3, 3.0, 0.5)
    plan.block("table", 17.0, 9.4, 1.0, 0.7)

    plan.room("office 4", 20.8, 6.0, 23.8, 11.8)
    plan.door_x("open-plan office to office 4", 20.6, 9.9)
    plan.block("desk", 20.8, 7.2, 0.8, 1.6)
    plan.block("cabinet", 21.6, 11.3, 2.0, 0.5)

    plan.room("copy room", 24.0, 6.0, 26.8, 11.8)
    plan.door_x("office 4 to copy room", 23.8, 9.7)
    plan.block("copier", 24.0, 6.6, 0.7, 1.2)
    plan.block("shelf", 26.3, 6.0, 0.5, 2.8)
    plan.block("bin", 24.0, 11.2, 0.6, 0.6)

    plan.room("kitchenette", 27.0, 8.8, 31.2, 11.8)
    plan.door_x("copy room to kitchenette", 26.8, 9.9)
    plan.door_x("kitchenette to store", 31.2, 9.8)
    plan.door_y("kitchenette to corridor", 29.4, 11.8, 0.9)
    plan.block("counter", 27.6, 8.8, 2.6, 0.6)
    plan.disc("table", 28.3, 11.1, 0.35)


def draw_south(plan: Drawing) -> None:
    """Meeting room, canteen, archive and laboratory, and the corridor at 33 degrees."""
    plan.room("meeting room", 0.2, 6.0, 6.0, 9.8)
    plan.door_y("meeting room to lobby", 4.6, 9.8)
    plan.block("table", 1.6, 7.3, 2.8, 1.2)
    plan.block("sideboard", 5.5, 6.8, 0.5, 1.6)

    plan.room("canteen", 0.2, 0.2, 8.6, 5.8)
    plan.door_y("canteen to meeting room", 0.5, 5.8)
    plan.door_y("canteen to office 1", 7.2, 5.8)
    for x in (2.0, 4.4, 6.8):
        plan.disc("table", x, 1.7, 0.5)
        plan.disc("table", x - 0.4, 4.1, 0.5)
    plan.block("serving counter", 0.2, 0.2, 0.6, 3.2)

    plan.room("archive", 8.8, 0.2, 15.0, 5.8)
    plan.door_x("canteen to archive", 8.6, 2.5)
    plan.door_y("archive to office 2", 11.6, 5.8)
    for x in (10.4, 11.6, 12.8, 14.0):
        plan.wall("shelves", (x, 0.2), (x, 3.4))

    plan.room("laboratory", 15.2, 0.2, 23.2, 5.8)
    plan.door_x("archive to laboratory", 15.0, 4.2)
    plan.door_y("laboratory to office 4", 21.4, 5.8)
    plan.block("bench", 17.0, 1.4, 3.2, 0.9)
    plan.block("bench", 17.0, 3.6, 3.2, 0.9)
    plan.block("fume hood", 15.2, 0.2, 0.8, 2.4)
    plan.add("room", "corridor at 33 degrees", strip(22.4, 1.81, 33.0, 11.7, 1.5))


def draw_east(plan: Drawing) -> None:
    """The store with its racks, the corridor at 17 degrees, the round room and its neighbours."""
    plan.room("store", 31.4, 3.0, 44.8, 18.0)
    for row in range(5):
        plan.block("rack", 34.2, 4.4 + 2.4 * row, 8.8, 1.0)
    plan.block("packing table", 34.4, 16.8, 2.4, 0.8)
    plan.block("pallets", 31.4, 3.0, 1.2, 1.2)

    plan.add("room", "corridor at 17 degrees", strip(22.2, 19.52, 17.0, 14.7, 1.6))
    plan.add("room", "round room", shapely.Point(38.5, 24.5).buffer(3.0, quad_segs=16))
    plan.room("passage", 37.75, 17.9, 39.25, 22.5)

    corners = [(23.2, 14.2), (31.2, 14.2), (31.2, 21.1), (23.2, 18.65)]
    plan.add("room", "lecture room", shapely.Polygon(corners))
    plan.door_x("lecture room to hall", 23.0, 15.4)
    plan.door_x("lecture room to store", 31.2, 16.2)
    for x in (25.2, 26.9, 28.6):
        plan.block("row of desks", x, 15.2, 0.6, 3.0)
    plan.block("lectern", 30.2, 18.8, 0.5, 0.9)

    corners = [(23.2, 20.95), (31.2, 23.4), (31.2, 28.2), (23.2, 28.2)]
    plan.add("room", "gallery", shapely.Polygon(corners))
    plan.door_x("gallery to hall", 23.0, 25.4)
    threshold = strip(27.5, 21.14, 17.0, 1.0, 1.3)
    plan.add("room", "gallery to corridor", shapely.affinity.translate(threshold, -0.25, 0.85))
    plan.block("plinth", 25.2, 26.0, 0.8, 0.8)
    plan.block("plinth", 28.0, 25.0, 0.8, 0.8)
    plan.wall("screen", (26.9, 28.2), (26.9, 26.4))
    plan.room("control room", 31.4, 24.6, 35.2, 28.2)
    plan.door_x("gallery to control room", 31.2, 26.0)
    plan.block("console", 33.0, 24.6, 2.2, 0.8)
    plan.block("cabinets", 34.7, 26.0, 0.5, 2.0)

    plan.room("plant room", 41.8, 18.2, 44.8, 28.2)
    plan.door_y("plant room to store", 43.2, 18.0)
    plan.room("plant room to round room", 41.2, 24.0, 42.0, 25.0)
    plan.block("boiler", 43.4, 20.6, 1.4, 1.4)
    plan.disc("tank", 43.6, 26.8, 0.7)
    plan.block("pump", 41.8, 21.6, 0.6, 1.0)


def draw() -> str:
    """The demo building as GeoJSON text."""
    plan = Drawing()
    draw_halls(plan)
    draw_offices(plan)
    draw_south(plan)
    draw_east(plan)
    return plan.geojson()


if __name__ == "__main__":
    PATH.write_text(draw(), encoding="utf-8")
