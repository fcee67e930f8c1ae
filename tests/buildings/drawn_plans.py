"""Drawings of buildings whose floor is known by construction."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import ezdxf
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.affinity import rotate
from shapely.geometry.base import BaseGeometry

THICK = 0.3
"""Of walls that are drawn as two lines, metres."""
STYLES = ("outlines", "lines", "single")
"""Walls as closed outlines, as two lines without ends at openings, or as one line."""
Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class DrawnPlan:
    """Walls along lines, with openings in them, and what is floor.

    Attributes:
        name: What it is.
        walls: Axes of walls, x0, y0, x1, y1 with x0 <= x1 and y0 <= y1, parallel to x or y, metres.
        openings: The same, on an axis.
        within: What the axes of the outer walls enclose, and what of it is not floor is wall.
        leaves: Openings with a door's arc.
        solids: Columns.
        labels: Names of rooms, and where they are written.
        style: One of `STYLES`.
        angle: By which all of it is turned, radians.
    """

    name: str
    walls: Sequence[Box]
    openings: Sequence[Box]
    within: BaseGeometry
    leaves: Sequence[Box] = ()
    solids: Sequence[BaseGeometry] = ()
    labels: Sequence[tuple[str, float, float]] = ()
    style: str = "outlines"
    angle: float = 0.0

    @property
    def thickness(self) -> float:
        """Of the walls."""
        return 0.0 if self.style == "single" else THICK

    def bodies(self) -> BaseGeometry:
        """The walls without their openings: polygons, or lines in the style "single"."""
        if self.style == "single":
            lines = shapely.union_all([shapely.LineString([w[:2], w[2:]]) for w in self.walls])
            gaps = [shapely.LineString([o[:2], o[2:]]) for o in self.openings]
            return shapely.difference(lines, shapely.union_all(gaps))
        half = THICK / 2
        solid = shapely.union_all(
            [shapely.box(a - half, b - half, c + half, d + half) for a, b, c, d in self.walls]
        )
        # Across the wall all of it, along it as wide as it says.
        cut = [
            shapely.box(a, b - THICK, c, d + THICK)
            if d == b
            else shapely.box(a - THICK, b, c + THICK, d)
            for a, b, c, d in self.openings
        ]
        return shapely.difference(solid, shapely.union_all(cut))

    def floor(self) -> BaseGeometry:
        """The floor: within the outer faces of the walls, openings up to the outer face."""
        half = self.thickness / 2
        outline = shapely.buffer(self.within, half, join_style="mitre")
        floor = shapely.difference(outline, shapely.union_all([self.bodies(), *self.solids]))
        return self._turned(floor)

    def _turned(self, shape: BaseGeometry) -> BaseGeometry:
        return rotate(shape, self.angle, origin=(0.0, 0.0), use_radians=True)

    def write(self, path: Path) -> Path:
        """Draw it, in metres."""
        document = ezdxf.new("R2010", setup=True)
        document.header["$INSUNITS"] = 6
        space = document.modelspace()
        bodies = self._turned(self.bodies())
        if self.style == "single":
            for line in shapely.get_parts(shapely.line_merge(bodies)):
                space.add_lwpolyline(line.coords[:], dxfattribs={"layer": "Walls"})
        for ring in _rings(bodies):
            corners = _bends(ring)
            if self.style == "outlines":
                space.add_lwpolyline(
                    corners[:-1].tolist(), close=True, dxfattribs={"layer": "Walls"}
                )
                continue
            for a, b in itertools.pairwise(corners):
                if not math.isclose(math.dist(a, b), THICK, rel_tol=1e-6):
                    space.add_line(a.tolist(), b.tolist(), dxfattribs={"layer": "Walls"})
        for solid in self.solids:
            for ring in _rings(self._turned(solid)):
                space.add_lwpolyline(
                    ring[:-1].tolist(), close=True, dxfattribs={"layer": "Columns"}
                )
        for a, b, c, d in self.leaves:
            ends = self._turned(shapely.LineString([(a, b), (c, d)]))
            (hx, hy), (ex, ey) = ends.coords
            start = math.degrees(math.atan2(ey - hy, ex - hx))
            space.add_arc((hx, hy), ends.length, start, start + 90, dxfattribs={"layer": "Doors"})
            tip = rotate(shapely.Point(ex, ey), 90, origin=(hx, hy))
            space.add_line((hx, hy), (tip.x, tip.y), dxfattribs={"layer": "Doors"})
        for text, x, y in self.labels:
            at = self._turned(shapely.Point(x, y))
            space.add_text(text, dxfattribs={"layer": "Rooms"}).set_placement((at.x, at.y))
        document.saveas(path)
        return path


def _rings(shape: BaseGeometry) -> Iterator[NDArray[np.float64]]:
    for part in shapely.get_parts(shape):
        if isinstance(part, shapely.Polygon):
            for ring in (part.exterior, *part.interiors):
                yield shapely.get_coordinates(ring)


def _bends(ring: NDArray[np.float64]) -> NDArray[np.float64]:
    """A closed ring without corners at which it does not bend."""
    corners = ring[:-1]
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    bends = np.abs(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]) > 1e-9
    return np.concatenate([corners[bends], corners[bends][:1]])


def rectangle(x0: float, y0: float, x1: float, y1: float) -> list[Box]:
    """The axes of four walls."""
    return [(x0, y0, x1, y0), (x0, y1, x1, y1), (x0, y0, x0, y1), (x1, y0, x1, y1)]


def office(
    mouths: float,
    *,
    mouth: float = 2.0,
    doors: float = 0.9,
    corridor: float = 2.5,
    arcs: bool = False,
) -> DrawnPlan:
    """A corridor with four rooms on either side, open at one or at both of its ends.

    Args:
        mouths: At how many ends.
        mouth: Width of the openings there, metres; as wide as the corridor: no wall is left.
        doors: Width of the rooms' openings to the corridor, metres.
        corridor: Clear width between its walls, metres, of two lines.
        arcs: Whether the rooms' doors have arcs.
    """
    deep, wide = 4.0, max(4.0, doors + 1.5)
    y0, y1 = deep, deep + corridor + THICK
    length, top = 4 * wide, 2 * deep + corridor + THICK
    walls = [*rectangle(0, 0, length, top), (0, y0, length, y0), (0, y1, length, y1)]
    openings: list[Box] = []
    for k in range(4):
        if k:
            walls += [(k * wide, 0, k * wide, y0), (k * wide, y1, k * wide, top)]
        a = k * wide + 0.5 * (wide - doors)
        openings += [(a, y0, a + doors, y0), (a, y1, a + doors, y1)]
    leaves = list(openings) if arcs else []
    middle = 0.5 * (y0 + y1)
    for x in (0, length)[: int(mouths)]:
        half = 0.5 * min(mouth, corridor)
        openings.append((x, middle - half, x, middle + half))
    return DrawnPlan(
        f"corridor of {corridor:g} m, {mouths:g} openings of {mouth:g} m, doors of {doors:g} m"
        f"{' with arcs' if arcs else ''}",
        walls,
        openings,
        shapely.box(0, 0, length, top),
        leaves,
        labels=[("Office", 0.5 * wide, 0.5 * deep), ("Corridor", 0.5 * length, middle)],
    )


def hall(gate: float, columns: bool = False) -> DrawnPlan:
    """A hall of 40 x 24 m with a gate in one side and a door in the other."""
    posts = [shapely.box(x, y, x + 0.4, y + 0.4) for x in (8, 16, 24, 32) for y in (8, 16)]
    return DrawnPlan(
        f"hall, gate of {gate:g} m{', columns' if columns else ''}",
        rectangle(0, 0, 40, 24),
        [(20 - gate / 2, 0, 20 + gate / 2, 0), (10, 24, 10.9, 24)],
        shapely.box(0, 0, 40, 24),
        solids=posts if columns else (),
    )


def hall_and_rooms(gate: float) -> DrawnPlan:
    """A hall of 312 m² with a gate to outdoors, and two rooms of 155 m² beside it."""
    x, width, y = 19.93, 10.2, 16.16
    return DrawnPlan(
        f"hall and rooms, gate of {gate:g} m",
        [*rectangle(0, 0, x + width, y), (x, 0, x, y), (x, y / 2, x + width, y / 2)],
        [(9, 0, 9 + gate, 0), (x, 3, x, 3.9), (x + 5, y / 2, x + 5.9, y / 2)],
        shapely.box(0, 0, x + width, y),
    )


def two_buildings(apart: float, doors: str = "away") -> DrawnPlan:
    """Two buildings of two rooms each, with open entrances of 2 m on their far sides.

    Args:
        apart: Width of the gap between them, metres, of walls of two lines.
        doors: "away": none leads into the gap; "one": one of the first building does.
    """
    x = 10 + THICK + apart
    first, second = rectangle(0, 0, 10, 8), rectangle(x, 0, x + 10, 8)
    openings: list[Box] = [(0, 1, 0, 3), (x + 10, 1, x + 10, 3), (2, 4, 3, 4), (x + 2, 4, x + 3, 4)]
    if doors == "one":
        openings.append((10, 1, 10, 2))
    return DrawnPlan(
        f"two buildings {apart:g} m apart, doors {doors}",
        [*first, *second, (0, 4, 10, 4), (x, 4, x + 10, 4)],
        openings,
        shapely.MultiPolygon([shapely.box(0, 0, 10, 8), shapely.box(x, 0, x + 10, 8)]),
    )


def courtyard(mouth: float) -> DrawnPlan:
    """Four wings around a court with two doors to it; or three of them, the court open at an end.

    Args:
        mouth: Between the axes of the walls there, metres; 0: the court is closed.
    """
    if not mouth:
        walls = [*rectangle(0, 0, 24, 20), *rectangle(6, 6, 18, 14)]
        return DrawnPlan(
            "closed court",
            walls,
            [(6, 9, 6, 10), (18, 9, 18, 10), (0, 2, 0, 5)],
            shapely.box(0, 0, 24, 20),
        )
    x1 = 6 + mouth
    walls = [
        (0, 0, x1 + 6, 0), (0, 0, 0, 20), (x1 + 6, 0, x1 + 6, 20), (0, 20, 6, 20),
        (x1, 20, x1 + 6, 20), (6, 6, 6, 20), (x1, 6, x1, 20), (6, 6, x1, 6),
    ]  # fmt: skip
    within = shapely.box(0, 0, x1 + 6, 20) - shapely.box(6, 6, x1, 20)
    return DrawnPlan(
        f"court open for {mouth:g} m", walls, [(6, 9, 6, 10), (x1, 9, x1, 10), (0, 2, 0, 5)], within
    )


def l_shape() -> DrawnPlan:
    """Two wings at a right angle with entrances of 3 m towards the notch and away from it."""
    walls: list[Box] = [
        (0, 0, 20, 0), (20, 0, 20, 8), (8, 8, 20, 8), (8, 8, 8, 18), (0, 18, 8, 18), (0, 0, 0, 18),
        (8, 0, 8, 8),
    ]  # fmt: skip
    return DrawnPlan(
        "two wings at a right angle",
        walls,
        [(12, 8, 15, 8), (8, 12, 8, 15), (20, 2, 20, 5), (8, 3, 8, 4)],
        shapely.Polygon([(0, 0), (20, 0), (20, 8), (8, 8), (8, 18), (0, 18)]),
    )


def niche(wide: float, deep: float) -> DrawnPlan:
    """A house whose entrance stands back from its front."""
    a, b = 6 - wide / 2, 6 + wide / 2
    walls: list[Box] = [
        (0, 0, a, 0), (b, 0, 12, 0), (a, 0, a, deep), (b, 0, b, deep), (a, deep, b, deep),
        (0, 0, 0, 9), (0, 9, 12, 9), (12, 0, 12, 9),
    ]  # fmt: skip
    return DrawnPlan(
        f"entrance {deep:g} m behind the front, {wide:g} m wide",
        walls,
        [(5.5, deep, 6.5, deep)],
        shapely.box(0, 0, 12, 9) - shapely.box(a, 0, b, deep),
    )


def row_of_columns() -> DrawnPlan:
    """A hall whose front is open between columns in line with its walls."""
    posts = [shapely.box(x - 0.15, -0.15, x + 0.15, 0.15) for x in (6, 12, 18)]
    return DrawnPlan(
        "front open between columns",
        rectangle(0, 0, 24, 12),
        [(1, 0, 23, 0)],
        shapely.box(0, 0, 24, 12),
        solids=posts,
    )


def random_rooms(rng: np.random.Generator) -> DrawnPlan:
    """Rooms in rows and columns, openings of any width in most walls and in some outer ones."""
    xs, ys = (
        [0.0, *np.cumsum(rng.uniform(2.5, 8.0, rng.integers(1, 5))).tolist()] for _ in range(2)
    )
    walls: list[Box] = []
    openings: list[Box] = []
    for across, along, turned in ((ys, xs, False), (xs, ys, True)):
        for k, at in enumerate(across):
            runs = [(along[0], along[-1])]
            gaps = []
            for a, b in itertools.pairwise(along):
                if rng.random() < (0.25 if k in (0, len(across) - 1) else 0.8):
                    wide = rng.uniform(0.7, b - a - 1.2)
                    start = rng.uniform(a + 0.5, b - 0.5 - wide)
                    gaps.append((start, start + wide))
            for lines, found in ((runs, walls), (gaps, openings)):
                found += [(at, a, at, b) if turned else (a, at, b, at) for a, b in lines]
    return DrawnPlan("rooms", walls, openings, shapely.box(0, 0, xs[-1], ys[-1]))


def plans() -> list[DrawnPlan]:
    """All of them but the random ones."""
    found = [
        *(
            office(1, mouth=w, corridor=max(2.5, w + 0.5))
            for w in (0.8, 1.2, 1.6, 2.0, 3.0, 4.0, 6.0)
        ),
        *(office(1, mouth=w, corridor=w) for w in (1.2, 1.6, 2.0, 3.0, 4.0, 6.0)),
        *(office(2, mouth=w, corridor=max(2.5, w + 0.5)) for w in (1.2, 2.0, 4.0)),
        *(office(2, mouth=w, corridor=w) for w in (1.2, 2.0, 3.0)),
        *(office(1, doors=w) for w in (0.8, 1.3, 1.6, 2.5, 4.0, 6.0)),
        office(1, arcs=True),
        office(2, mouth=3.0, corridor=4.0, arcs=True),
        *(hall(w) for w in (1.2, 3.0, 6.0, 20.0)),
        hall(6.0, columns=True),
        *(two_buildings(w) for w in (0.2, 0.5, 1.0, 1.3, 2.0, 3.0, 5.0)),
        two_buildings(1.0, "one"),
        courtyard(0.0),
        *(courtyard(w) for w in (7.0, 12.0)),
        l_shape(),
        *(niche(w, d) for w, d in ((1.2, 0.6), (2.0, 1.0), (3.0, 1.5), (4.0, 2.0))),
        row_of_columns(),
    ]
    return [replace(plan, style=style) for plan in found for style in STYLES]
