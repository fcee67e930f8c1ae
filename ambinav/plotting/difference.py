"""Two ambiguity maps and their difference, in three panels."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import JudgedFloor
from ambinav.maps.zones import ZONES
from ambinav.plotting import style
from ambinav.plotting.canvas import new_figure
from ambinav.plotting.floor import FloorFigure, label_points, rgba_bytes, view
from ambinav.plotting.legend_patches import colour_patch, zoneless_patches
from ambinav.plotting.maps import paint_zones
from ambinav.reports.number_text import percent
from ambinav.runtime.array_types import Bools, Bounds, Floats

LEAST_SCALE: Final = 0.1
"""Smallest change in level at the ends of the scale: noise stays pale."""
_PANEL: Final = 9.0
"""Inches of the longer side of a panel, at most."""
_BESIDE: Final = 1.0
_BELOW: Final = 1.6
"""Inches between panels; below one is room for a legend."""
_LETTER: Final = 0.11
"""Inches of a letter of a title, about."""
_WALLS: Final = 2.6
"""Points, of walls that are new or gone."""
_DASHES: Final = (2.0, 1.0)
"""Dashes of removed walls."""


@dataclass(frozen=True, eq=False)
class ChangeLayer:
    """Data of the third panel, on cells that cover both maps.

    Attributes:
        bounds: (xmin, ymin, xmax, ymax) of the cells, metres.
        rise: Level after less level before, shape (ny, nx); nan where floor counts in one or none.
        new_floor: Cells that count after only, bool, shape (ny, nx).
        gone_floor: Cells that count before only.
        new_walls: Walls only in the second map: ax, ay, bx, by, metres, shape (N, 4).
        gone_walls: Walls only in the first map.
        labels: x, y and number of the regions that are listed.
    """

    bounds: Bounds
    rise: Floats
    new_floor: Bools
    gone_floor: Bools
    new_walls: Floats
    gone_walls: Floats
    labels: Sequence[tuple[float, float, str]] = ()


def plot_difference(
    first: AmbiguityMap,
    second: AmbiguityMap,
    parts: tuple[JudgedFloor, JudgedFloor],
    change: ChangeLayer,
    titles: tuple[str, str],
) -> Figure:
    """Draw the zones of both maps and the change of the level, side by side or one below another.

    Args:
        first: The map before.
        second: The map after.
        parts: Masks of the floor that counts, in both maps.
        change: The changes.
        titles: Titles of the first two panels.
    """
    views = np.array([view(first), view(second)])
    low, high = views[:, :2].min(axis=0), views[:, 2:].max(axis=0)
    bounds: Bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    panels, width, inches = _panels(bounds)
    for axes, amap, part, title in zip(panels, (first, second), parts, titles, strict=False):
        title = "\n".join(textwrap.wrap(title, max(int(width / _LETTER), 12)))
        floor = FloorFigure(amap, axes, title, bounds=bounds, longest=inches)
        paint_zones(floor, "mean", part)
        if axes is panels[1]:
            floor.legend(_zone_legend(first, second, parts), below=True)
    floor = FloorFigure(second, panels[2], "Change of the level", bounds=bounds, longest=inches)
    tints = np.zeros((*change.rise.shape, 4), dtype=np.uint8)
    for mask, colour in (
        (change.new_floor, style.NEW_FLOOR), (change.gone_floor, style.GONE_FLOOR)
    ):  # fmt: skip
        tints[mask] = rgba_bytes(colour)
    floor.paint(tints, change.bounds)
    rises = np.abs(change.rise[np.isfinite(change.rise)])
    most = max(float(rises.max(initial=0.0)), LEAST_SCALE)
    image = floor.paint(change.rise, change.bounds, cmap=style.CHANGE, norm=Normalize(-most, most))
    floor.stretches(
        change.gone_walls, colors=style.GONE, linewidths=_WALLS, linestyles=(0, _DASHES)
    )
    floor.stretches(change.new_walls, colors=style.NEW, linewidths=_WALLS)
    floor.colour_bar(image, "level after less level before (red: worse)")
    floor.legend(_change_legend(change), below=True)
    label_points(panels[2], change.labels)
    return panels[0].figure  # type: ignore[return-value]


def _panels(bounds: Bounds) -> tuple[list[Axes], float, float]:
    """Create three axes of equal size, stacked if the floor is wide; return width and diagonal too.

    Both in inches.
    """
    width, height = bounds[2] - bounds[0], bounds[3] - bounds[1]
    scale = _PANEL / max(width, height)
    if height > width:
        scale = min(scale, 0.6 * _PANEL / width)
    w, h = width * scale, height * scale
    stacked = width > 1.1 * height
    across, down = (w, 3 * h + 2 * _BELOW) if stacked else (3 * w + 2 * _BESIDE, h)
    figure = new_figure(across, down, laid_out=False)
    places = [
        (0.0, (2 - k) * (h + _BELOW)) if stacked else (k * (w + _BESIDE), 0.0) for k in range(3)
    ]
    axes = [figure.add_axes((x / across, y / down, w / across, h / down)) for x, y in places]
    return axes, w, math.hypot(w, h)


def _zone_legend(
    first: AmbiguityMap, second: AmbiguityMap, parts: tuple[JudgedFloor, JudgedFloor]
) -> list[Artist]:
    """Return the colours of the zones, with their shares before and after."""
    shares = [
        amap.zone_shares("mean", part.counted)
        for amap, part in zip((first, second), parts, strict=True)
    ]
    entries: list[Artist] = [
        colour_patch(
            style.ZONE_COLOURS[code],
            f"{name}\n{percent(shares[0][code].share)} → {percent(shares[1][code].share)}",
        )
        for code, name in enumerate(ZONES)
    ]
    return entries + zoneless_patches(parts, "not\nreachable")


def _change_legend(change: ChangeLayer) -> list[Artist]:
    """Return legend entries for the changes that occur."""
    entries: list[Artist] = []
    for mask, colour, label in (
        (change.new_floor, style.NEW_FLOOR, "new floor"),
        (change.gone_floor, style.GONE_FLOOR, "floor gone"),
    ):
        if mask.any():
            entries.append(colour_patch(colour, label))
    if len(change.new_walls):
        entries.append(Line2D([], [], color=style.NEW, linewidth=_WALLS, label="new wall"))
    if len(change.gone_walls):
        removed_walls = Line2D([], [], color=style.GONE, linewidth=_WALLS, label="wall gone")
        removed_walls.set_linestyle((0, _DASHES))
        entries.append(removed_walls)
    return entries
