"""A floor before and after obstacles are placed, in two panels."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import JudgedFloor
from ambinav.maps.zones import ZONES
from ambinav.plotting import style
from ambinav.plotting.canvas import new_figure
from ambinav.plotting.floor import (
    Bounds,
    FloorFigure,
    colour_patch,
    unexplored_patch,
    view,
)
from ambinav.plotting.maps import paint_zones

PANEL: Final = 6.8
"""Inches of the longer side of a panel, at most."""
FLAT: Final = 2.2
"""A floor that is so much wider than high has one panel below the other."""
BESIDE: Final = 0.7
"""Inches between panels."""
BELOW: Final = 1.4
"""Inches below panels, for coordinates and legend."""
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
ASKED: Final[dict[str, Any]] = {"color": "black", "linewidth": 1.2, "linestyle": "--"}
"""Style of the region or routes where bad floor counts."""


@dataclass(frozen=True, eq=False)
class PlacementView:
    """Elements drawn over both maps.

    Attributes:
        titles: Titles of the panels.
        reflective: Whether they are reflectors.
        outlines: Outlines of the obstacles, metres, in the order of their numbers.
        kinds: Kind of each.
        shapes: Polygons within which bad floor counts; none: everywhere.
        routes: Poses of routes, each of shape (N, 3).
        bounds: (xmin, ymin, xmax, ymax) to be shown, metres; None: all floor.
        numbers: Numbers of the obstacles; None: from 1 on.
    """

    titles: tuple[str, str]
    reflective: bool
    outlines: Sequence[BaseGeometry]
    kinds: Sequence[str]
    shapes: Sequence[BaseGeometry] = ()
    routes: Sequence[NDArray[np.float64]] = ()
    bounds: Bounds | None = None
    numbers: Sequence[int] | None = None

    @property
    def middles(self) -> NDArray[np.float64]:
        """Centres of the obstacles, metres, shape (N, 2)."""
        return np.asarray(shapely.get_coordinates([outline.centroid for outline in self.outlines]))


def plot_placement(
    before: AmbiguityMap, after: AmbiguityMap, parts: JudgedFloor, shown: PlacementView
) -> Figure:
    """Draw the zones without and with the obstacles, side by side or one below the other.

    Args:
        before: The map without them.
        after: The map with them, on the same lattice.
        parts: Masks of the floor that counts, without the obstacles.
        shown: Elements drawn over both maps.
    """

    def paint(floor: FloorFigure, panel: int) -> None:
        # Where an obstacle stands there is no zone.
        paint_zones(floor, "mean", parts)

    entries = [colour_patch(*entry) for entry in zip(style.ZONE_COLOURS, ZONES, strict=True)]
    return plot_before_after((before, after), paint, entries, parts, shown)


def plot_before_after(
    maps: tuple[AmbiguityMap, AmbiguityMap],
    paint: Callable[[FloorFigure, int], None],
    entries: Sequence[Artist],
    parts: JudgedFloor,
    shown: PlacementView,
) -> Figure:
    """Draw a floor without and with obstacles, side by side or one below the other.

    Args:
        maps: The map without them and with them, on the same lattice.
        paint: Paints the floor of panel 0 or 1.
        entries: Legend entries of what it paints.
        parts: Masks of the floor that counts, without the obstacles.
        shown: Elements drawn over both maps.
    """
    bounds = shown.bounds or view(maps[0])
    width, height = bounds[2] - bounds[0], bounds[3] - bounds[1]
    scale = PANEL / max(width, height)
    w, h = width * scale, height * scale
    stacked = width > FLAT * height
    across, down = (w, 2 * (h + BELOW)) if stacked else (2 * w + BESIDE, h + BELOW)
    figure = new_figure(across, down, laid_out=False)
    for k, (amap, title) in enumerate(zip(maps, shown.titles, strict=True)):
        left, low = (0.0, (1 - k) * (h + BELOW)) if stacked else (k * (w + BESIDE), 0.0)
        axes = figure.add_axes((left / across, (low + BELOW) / down, w / across, h / down))
        floor = FloorFigure(amap, axes, title, bounds=bounds, longest=math.hypot(w, h))
        paint(floor, k)
        for poses in shown.routes:
            axes.plot(poses[:, 0], poses[:, 1], **ASKED)
        for ring in shapely.get_rings(shapely.get_parts(list(shown.shapes))).tolist():
            axes.plot(*ring.xy, **ASKED)
        if k == 0:
            lines = floor.reflector_lines()
            floor.legend([*entries, *_part_entries(parts), *lines], below=True)
        else:
            _draw_obstacles(floor, shown)
            floor.legend(_obstacle_entries(shown), below=True)
    return figure


def _draw_obstacles(floor: FloorFigure, shown: PlacementView) -> None:
    """Draw each obstacle to scale, at least as large as a mark, with its number beside it."""
    axes = floor.axes
    corners, at = (
        _on_paper(floor, np.reshape(floor.bounds, (2, 2))),
        _on_paper(floor, shown.middles),
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
    lines = np.concatenate([np.empty((0, 2)), *(poses[:, :2] for poses in shown.routes)])
    spots = label_spots(at, corners, _on_paper(floor, lines)) - at
    numbers = shown.numbers or range(1, len(spots) + 1)
    for number, (x, y), spot in zip(numbers, shown.middles.tolist(), spots, strict=True):
        axes.annotate(
            str(number), (x, y), spot, textcoords="offset points", ha="center",
            va="center_baseline", fontsize=9.5, fontweight="bold", color="black", zorder=10,
            bbox={"boxstyle": f"circle,pad={0.2 if number < 10 else 0.05}", "facecolor": "white",
                  "edgecolor": "black", "linewidth": 1.2},
            arrowprops={"arrowstyle": "-", "color": "black", "linewidth": 1.0, "shrinkB": 0.0,
                        "zorder": 9},
        )  # fmt: skip


def _on_paper(floor: FloorFigure, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert points of the floor (N, 2) to points on paper, 72 an inch."""
    return np.asarray(floor.axes.transData.transform(points) * 72.0 / floor.axes.figure.dpi)


def label_spots(
    at: NDArray[np.float64], corners: NDArray[np.float64], lines: NDArray[np.float64]
) -> NDArray[np.float64]:
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


def _count_near(
    spots: NDArray[np.float64], others: NDArray[np.float64], distance: float
) -> NDArray[np.int64]:
    """Count the other points that are nearer than a distance to each spot."""
    apart = np.linalg.norm(spots[:, None] - others[None], axis=-1)
    return np.asarray((apart < distance).sum(axis=1))


def _axis(outline: BaseGeometry, least: float) -> NDArray[np.float64]:
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


def _part_entries(parts: JudgedFloor) -> list[Artist]:
    entries = list[Artist]()
    if parts.unexplored.any():
        entries.append(unexplored_patch("unexplored"))
    if parts.unreachable.any():
        entries.append(colour_patch(style.UNREACHABLE, "not reachable"))
    return entries


def _obstacle_entries(shown: PlacementView) -> list[Artist]:
    entries = list[Artist]()
    for kind in dict.fromkeys(shown.kinds):
        look = _obstacle_style(kind, shown.reflective)
        if kind == "post":
            look["linestyle"] = "none"
        label = f"{'reflecting ' if shown.reflective and kind != 'tag' else ''}{kind}"
        entries.append(Line2D([], [], label=f"{label} put up", **look))
    if shown.shapes or shown.routes:
        label = "region that counts" if shown.shapes else "route"
        entries.append(Line2D([], [], label=label, **ASKED))
    return entries
