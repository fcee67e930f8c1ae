"""A floor before and after obstacles are placed: two pictures that lie on one another exactly."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from string import ascii_uppercase
from typing import Any, Final

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke
from shapely.geometry.base import BaseGeometry

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import JudgedFloor
from ambinav.plotting import style
from ambinav.plotting.floor import FloorFigure
from ambinav.plotting.labels import on_paper
from ambinav.plotting.legend_patches import zone_patches, zoneless_patches
from ambinav.plotting.maps import paint_zone_codes
from ambinav.runtime.array_types import Bounds, Bytes, Floats, Ints

LONGEST: Final = 9.0
"""Inches of the longer side of a picture, about."""
MARKER: Final = 6.0
"""Points across the mark of an obstacle, however small it is."""
BAR: Final = 2.6
"""Points across one that is long."""
RIM: Final = 1.3
"""Points of the rim around both."""
ROUND: Final = 8.5
"""Radius of a label, points,"""
OFF: Final = (16.0, 23.0, 32.0, 44.0)
"""and how far from its obstacle it may stand, the nearest first."""
DIRECTIONS: Final = 16
"""Number of directions, starting upwards and going to the right."""
BOX: Final[dict[str, Any]] = {"facecolor": "white", "edgecolor": "black", "linewidth": 1.2}
TEXT: Final[dict[str, Any]] = {
    "ha": "center", "va": "center_baseline", "fontsize": 9.5, "fontweight": "bold",
    "color": "black", "zorder": 10,
}  # fmt: skip
"""Style of labels: numbers in circles, names of places in squares."""
NAME_OFF: Final = (0.0, -13.0)
"""Offset of the name of a place, points."""
NAME: Final[dict[str, Any]] = {
    "ha": "center", "va": "center", "fontsize": 9.5, "zorder": 8, "parse_math": False,
    "path_effects": [Stroke(linewidth=3.0, foreground="white"), Normal()],
}  # fmt: skip
"""Style of the names of places."""
ASKED: Final[dict[str, Any]] = {"color": "black", "linewidth": 1.2, "linestyle": "--"}
"""Style of the region or routes where bad floor counts."""


@dataclass(frozen=True, eq=False)
class PlacementView:
    """Elements drawn over the floor.

    Attributes:
        reflective: Whether the obstacles are reflectors.
        outlines: Outlines of the obstacles, metres, in the order of their numbers.
        kinds: Kind of each.
        shapes: Polygons within which bad floor counts; none: everywhere.
        routes: Poses of routes, each of shape (N, 3).
        bounds: (xmin, ymin, xmax, ymax) to be shown, metres; None: all floor.
        numbers: Numbers of the obstacles; None: from 1 on.
        improved: Where most floor becomes good, x and y of each place, metres.
        names: Named places, x and y of each, metres.
    """

    reflective: bool
    outlines: Sequence[BaseGeometry]
    kinds: Sequence[str]
    shapes: Sequence[BaseGeometry] = ()
    routes: Sequence[Floats] = ()
    bounds: Bounds | None = None
    numbers: Sequence[int] | None = None
    improved: Sequence[tuple[float, float]] = ()
    names: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def middles(self) -> Floats:
        """Centres of the obstacles, metres, shape (N, 2)."""
        return np.asarray(shapely.get_coordinates([outline.centroid for outline in self.outlines]))


def plot_placement(
    amap: AmbiguityMap, zone: Bytes, parts: JudgedFloor, shown: PlacementView, *, placed: bool
) -> Axes:
    """Draw the zones without or with the obstacles.

    Args:
        amap: The map without them.
        zone: Codes of the zones that are drawn, on its lattice, shape (ny, nx).
        parts: Masks of the floor that counts, without the obstacles.
        shown: Elements drawn over the floor.
        placed: Whether the obstacles are there.
    """

    def paint(floor: FloorFigure) -> None:
        # Where an obstacle stands there is no zone.
        paint_zone_codes(floor, zone, parts)

    return plot_state(amap, paint, zone_patches(), parts, shown, placed=placed)


def plot_state(
    amap: AmbiguityMap,
    paint: Callable[[FloorFigure], None],
    entries: Sequence[Artist],
    parts: JudgedFloor,
    shown: PlacementView,
    *,
    placed: bool,
) -> Axes:
    """Draw a floor without or with obstacles; both pictures have one size and one legend.

    Args:
        amap: The map without them: walls, extent and legend of both pictures are its own.
        paint: Paints the floor.
        entries: Legend entries of what it paints.
        parts: Masks of the floor that counts, without the obstacles.
        shown: Elements drawn over the floor.
        placed: Whether the obstacles are there.
    """
    floor = FloorFigure(amap, None, "", bounds=shown.bounds, longest=LONGEST)
    paint(floor)
    for poses in shown.routes:
        floor.axes.plot(poses[:, 0], poses[:, 1], **ASKED)
    for ring in shapely.get_rings(shapely.get_parts(list(shown.shapes))).tolist():
        floor.axes.plot(*ring.xy, **ASKED)
    for name, (x, y) in shown.names.items():
        floor.axes.plot([x], [y], "D", color="white", markeredgecolor="black", zorder=8)
        floor.axes.annotate(name, (x, y), NAME_OFF, textcoords="offset points", **NAME)
    for name, (x, y) in zip(ascii_uppercase, shown.improved, strict=False):
        floor.axes.text(x, y, name, bbox={"boxstyle": "square,pad=0.15", **BOX}, **TEXT)
    if placed:
        _draw_obstacles(floor, shown)
    lines = floor.reflector_lines()
    floor.legend([*entries, *zoneless_patches([parts]), *lines, *_entries(shown)], below=True)
    return floor.finish()


def _draw_obstacles(floor: FloorFigure, shown: PlacementView) -> None:
    """Draw each obstacle to scale, at least as large as a mark, with its number beside it."""
    axes = floor.axes
    corners, at = (
        on_paper(axes, points) for points in (np.reshape(floor.bounds, (2, 2)), shown.middles)
    )
    metre = float((corners[1, 0] - corners[0, 0]) / (floor.bounds[2] - floor.bounds[0]))
    for outline, kind, (x, y) in zip(
        shown.outlines, shown.kinds, shown.middles.tolist(), strict=True
    ):
        look = _obstacle_style(kind, shown.reflective)
        if kind == "post":
            axes.fill(*outline.exterior.xy, color=look["color"], linewidth=0.0, zorder=6)
            axes.plot([x], [y], linestyle="none", zorder=6, **look)
        else:
            axes.plot(*_axis(outline, MARKER / metre).T, zorder=6, **look)
    kept_off = [
        np.reshape([*shown.improved, *shown.names.values()], (-1, 2)),
        *(poses[:, :2] for poses in shown.routes),
    ]
    lines = np.concatenate(kept_off)
    spots = label_spots(at, corners, on_paper(axes, lines)) - at
    numbers = shown.numbers or range(1, len(spots) + 1)
    for number, (x, y), spot in zip(numbers, shown.middles.tolist(), spots, strict=True):
        axes.annotate(
            str(number), (x, y), spot, textcoords="offset points", **TEXT,
            bbox={"boxstyle": f"circle,pad={0.2 if number < 10 else 0.05}", **BOX},
            arrowprops={"arrowstyle": "-", "color": "black", "linewidth": 1.0, "shrinkB": 0.0,
                        "zorder": 9},
        )  # fmt: skip


def label_spots(at: Floats, corners: Floats, lines: Floats) -> Floats:
    """Place round labels so that they hide no obstacle, no label and, if possible, no line.

    Args:
        at: Obstacles, shape (N, 2), points on paper.
        corners: Lower left and upper right of the floor, shape (2, 2).
        lines: Points of lines, shape (M, 2).

    Returns:
        Middles of the labels, shape (N, 2): near their obstacles, within the floor.
    """
    angle = math.pi / 4 + np.arange(DIRECTIONS) * 2 * math.pi / DIRECTIONS
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    offsets = np.concatenate([off * around for off in OFF])
    placed = np.empty((0, 2))
    for point in at:
        spots = point + offsets
        outside = ((spots < corners[0] + ROUND) | (spots > corners[1] - ROUND)).any(axis=1)
        faults = (
            4.0 * outside
            + 2.0 * _count_near(spots, placed, 2.0 * ROUND + 1.0)
            + 2.0 * _count_near(spots, at, ROUND + MARKER / 2 + 1.0)
            + 1.0 * (_count_near(spots, lines, ROUND + 2.0) > 0)
        )
        placed = np.vstack([placed, spots[np.argmin(faults)]])
    return placed


def _count_near(spots: Floats, others: Floats, distance: float) -> Ints:
    """Count the other points that are nearer than a distance to each spot."""
    apart = np.linalg.norm(spots[:, None] - others[None], axis=-1)
    return np.asarray((apart < distance).sum(axis=1))


def _axis(outline: BaseGeometry, least: float) -> Floats:
    """Return the ends of a thin outline's centre line, at least `least` metres, shape (2, 2)."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(outline))[:4]
    sides = np.diff(corners[:3], axis=0)
    long = sides[int(np.argmax(np.hypot(*sides.T)))]
    length = float(np.hypot(*long))
    half = long / length * max(length, least) / 2.0
    return np.asarray(corners.mean(axis=0) + np.stack([-half, half]))


def _obstacle_style(kind: str, reflective: bool) -> dict[str, Any]:
    """Return the drawing style of obstacles, on the floor and in the legend."""
    colour, rim = (style.REFLECTOR, "black") if reflective else ("black", "white")
    if kind == "post":
        return {
            "color": colour, "marker": "o", "markersize": MARKER, "markeredgecolor": rim,
            "markeredgewidth": RIM,
        }  # fmt: skip
    return {
        "color": colour,
        "linewidth": BAR,
        "solid_capstyle": "butt",
        "path_effects": [Stroke(linewidth=BAR + 2.0 * RIM, foreground=rim), Normal()],
    }


def _entries(shown: PlacementView) -> list[Artist]:
    entries = list[Artist]()
    for kind in dict.fromkeys(shown.kinds):
        look = _obstacle_style(kind, shown.reflective)
        if kind == "post":
            look["linestyle"] = "none"
        label = f"{'reflecting ' if shown.reflective and kind != 'tag' else ''}{kind}"
        entries.append(Line2D([], [], label=f"{label} put up", **look))
    if shown.improved:
        names = ", ".join(ascii_uppercase[: len(shown.improved)])
        look = {"linestyle": "none", "marker": "s", "markersize": 9, "color": "white"}
        label = f"{names}: most floor becomes good"
        entries.append(Line2D([], [], markeredgecolor="black", label=label, **look))
    if shown.shapes or shown.routes:
        label = "region that counts" if shown.shapes else "trip" if shown.names else "route"
        entries.append(Line2D([], [], label=label, **ASKED))
    return entries
