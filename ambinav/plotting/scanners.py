"""Pictures of compared scanners: figures row by row, and small maps to one scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import TOO_CLOSE, JudgedFloor
from ambinav.maps.zones import CORRIDOR, NOT_FREE, OPEN, ZONES
from ambinav.plotting import style
from ambinav.plotting.canvas import foot, new_figure
from ambinav.plotting.floor import FloorFigure, view
from ambinav.plotting.legend_patches import colour_patch, zone_patches, zoneless_patches
from ambinav.plotting.maps import paint_zone_codes
from ambinav.plotting.rows import RowChart
from ambinav.runtime.array_types import Bytes

ERROR_COLOUR: Final = style.BLUE
WORST_COLOUR: Final = style.VERMILLION
_BAR: Final = 0.62
"""Height of a bar; a row is 1 high."""
_WIDTH: Final = 15.0
"""Inches of a sheet of maps."""
_GAP, _TITLE, _TOP, _BELOW = 0.12, 0.26, 0.45, 0.95
"""Inches between maps, above each, above all, and below all for scale bar and legend."""
_SMALLEST: Final = 1e-4
"""Metres: no error is drawn smaller on the scale of powers."""


@dataclass(frozen=True)
class ScannerBars:
    """Figures of one scanner in the chart.

    Attributes:
        name: Name of the scanner.
        corridor: Area of corridor zones, square metres.
        open: Area of open zones.
        worst: Both at the worst heading of every place; None where the heading does not matter.
        longest_open: Longest open stretch of all routes, metres; None: no routes.
        mean_error: Expected error on routes, metres, its mean and its largest value; or None.
        worst_error: See there.
        dominated: Whether it is on no front, for the colour of the name.
    """

    name: str
    corridor: float
    open: float
    worst: float | None
    longest_open: float | None
    mean_error: float | None
    worst_error: float | None
    dominated: bool


@dataclass(frozen=True, eq=False)
class ScannerFloor:
    """The floor of one scanner: a title, zone codes of shape (ny, nx), and which floor counts."""

    title: str
    zone: Bytes
    parts: JudgedFloor


def plot_scanner_bars(rows: Sequence[ScannerBars], heading: str, title: str) -> Figure:
    """Draw bad area, and on routes the longest open stretch and the expected error, row by row.

    Args:
        rows: Scanners from the best to the worst.
        heading: Above the names: what the order is.
        title: Title of the picture.
    """
    routes = any(row.longest_open is not None for row in rows)
    chart = RowChart(
        [(heading, row.name) for row in rows], (3.0, 1.6, 2.2) if routes else (3.0,), title,
        13.0 if routes else 8.5, 34,
    )  # fmt: skip
    for label, row in zip(chart.panels[0].get_yticklabels(), rows, strict=True):
        label.set_color("#8A8A8A" if row.dominated else "black")
    handles = _draw_areas(chart.panels[0], chart.places, rows)
    if routes:
        stretch, error = chart.panels[1:]
        _draw_bars(stretch, chart.places, [row.longest_open or 0.0 for row in rows], _colour(OPEN))
        stretch.set_xlabel("longest open stretch of a route (m)")
        handles += _draw_errors(error, chart.places, rows)
    handles.append(Line2D([], [], linestyle="none", label="black name: not dominated"))
    foot(chart.figure, handles, font=9.5)
    return chart.figure


def plot_scanner_maps(floors: Sequence[ScannerFloor], amap: AmbiguityMap, title: str) -> Figure:
    """Draw the zones of several scanners side by side, all to the same scale.

    Args:
        floors: Floors in order, row by row.
        amap: A map of the same building on the same lattice, for the walls.
        title: Title of the picture.
    """
    anywhere = np.logical_or.reduce([floor.zone != NOT_FREE for floor in floors])
    bounds = view(amap)
    width, height = bounds[2] - bounds[0], bounds[3] - bounds[1]
    columns = _columns(len(floors), width, height)
    rows = -(-len(floors) // columns)
    w = (_WIDTH - (columns - 1) * _GAP) / columns
    w = min(w, 7.0, 7.0 * width / height)
    h = w * height / width
    across = columns * w + (columns - 1) * _GAP
    down = _TOP + rows * (h + _TITLE) + (rows - 1) * _GAP + _BELOW
    figure = new_figure(across, down, laid_out=False)
    for number, floor in enumerate(floors):
        row, column = divmod(number, columns)
        top = down - _TOP - row * (h + _TITLE + _GAP) - _TITLE
        axes = figure.add_axes(
            (column * (w + _GAP) / across, (top - h) / down, w / across, h / down)
        )
        last = number == len(floors) - 1
        picture = FloorFigure(
            amap, axes, "", bounds=bounds, longest=max(w, h), walls=0.45, scale_bar=last
        )
        # Where only this scanner has no room for its sensors, the robot cannot stand either.
        cramped = anywhere & (floor.zone == NOT_FREE)
        parts = replace(floor.parts, code=np.where(cramped, TOO_CLOSE, floor.parts.code))
        paint_zone_codes(picture, floor.zone, parts)
        axes.set(xlabel="", ylabel="", xticks=[], yticks=[])
        axes.set_title(floor.title, fontsize=_title_size(w, floor.title), loc="left", pad=3.0)
    figure.suptitle(title, x=0.0, y=1.0, ha="left", va="top", fontsize=13)
    handles = zone_patches() + zoneless_patches(floor.parts for floor in floors)
    figure.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0.0, 0.0), frameon=False,
        fontsize=9.5, ncol=6 if across > 7.0 else 3, borderaxespad=0.0,
    )  # fmt: skip
    return figure


def _draw_areas(axes: Axes, places: Sequence[float], rows: Sequence[ScannerBars]) -> list[Artist]:
    """Draw open and corridor zones as one bar, and their sum at the worst heading as a mark."""
    wide = [row.open for row in rows]
    axes.barh(places, wide, _BAR, color=_colour(OPEN), edgecolor=style.EDGE, linewidth=0.5)
    axes.barh(
        places, [row.corridor for row in rows], _BAR, left=wide, color=_colour(CORRIDOR),
        edgecolor=style.EDGE, linewidth=0.5,
    )  # fmt: skip
    handles: list[Artist] = [
        colour_patch(_colour(code), f"{ZONES[code]} zones") for code in (OPEN, CORRIDOR)
    ]
    at = [(row.worst, place) for row, place in zip(rows, places, strict=True)]
    marked = [(area, place) for area, place in at if area is not None]
    if marked:
        look: dict[str, Any] = {
            "marker": "|",
            "color": "black",
            "linestyle": "none",
            "markersize": 9,
        }
        axes.plot(*zip(*marked, strict=True), **look)
        handles.append(Line2D([], [], label="both, at the worst heading", **look))
    axes.set_xlim(left=0.0)
    axes.set_xlabel("bad area (m²)")
    return handles


def _draw_bars(axes: Axes, places: Sequence[float], values: Sequence[float], colour: str) -> None:
    axes.barh(places, values, _BAR, color=colour, edgecolor=style.EDGE, linewidth=0.5)
    axes.set_xlim(0.0, max(*values, 0.1) * 1.05)


def _draw_errors(axes: Axes, places: Sequence[float], rows: Sequence[ScannerBars]) -> list[Artist]:
    """Draw mean and largest expected error, on a scale of powers, joined by a line."""
    for place, row in zip(places, rows, strict=True):
        if row.mean_error is None or row.worst_error is None:
            continue
        ends = [max(row.mean_error, _SMALLEST), max(row.worst_error, _SMALLEST)]
        axes.plot(ends, [place, place], color="#BBBBBB", linewidth=1.2, zorder=2)
        axes.plot(ends[0], place, "o", color=ERROR_COLOUR, markersize=6, zorder=3)
        axes.plot(ends[1], place, "X", color=WORST_COLOUR, markersize=6, zorder=3)
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(10.0, numticks=8))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("expected error on routes (m)")
    return [
        Line2D([], [], marker="o", color=ERROR_COLOUR, linestyle="none", label="mean error"),
        Line2D([], [], marker="X", color=WORST_COLOUR, linestyle="none", label="largest error"),
    ]


def _columns(count: int, width: float, height: float) -> int:
    """Compute the number of map columns for a sheet of about 3 to 2."""
    best = math.sqrt(1.5 * count * height / width)
    return min(max(round(best), 1), count)


def _title_size(width: float, text: str) -> float:
    """Compute the font size of a title that fits a map of a given width in inches."""
    return min(11.0, max(5.0, 72.0 * width / (0.56 * max(len(text), 1))))


def _colour(code: int) -> str:
    return style.ZONE_COLOURS[code]
