"""Pictures of an ambiguity map: the zones of the floor, and any layer as a continuous scale."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize, to_rgba
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

from ambinav.errors import InputError
from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.floor_parts import FloorParts
from ambinav.maps.zones import COLOURS, NOT_FREE, UNKNOWN_COLOUR, ZONES
from ambinav.plotting import floor as drawing
from ambinav.plotting.backdrop import (
    area_text,
    colour_patch,
    draw_backdrop,
    outside_patches,
    paint_parts,
    part_patches,
)

Heading = str | float

_SHARES: Final = frozenset({"ambiguity", "major", "minor", "level", "heading"})
"""Layers that run from 0 to 1: drawn on that scale, so that pictures can be compared."""

WIDE: Final = 1e4
"""Ratio of the highest values to the lowest from which an added layer is drawn on a log scale."""

COLUMN: Final = 2.0
"""Inches below a picture that a column of its legend takes."""
UNDER_BAR: Final = 34.0
"""Points from a floor's lower edge to a legend that stands below the scale bar."""

_BELOW: Final[dict[str, Any]] = {"loc": "upper right", "bbox_to_anchor": (1.0, -0.01)}
_BESIDE: Final[dict[str, Any]] = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.0)}


def floor_axes(amap: AmbiguityMap, longest: float = drawing.LONGEST) -> Axes:
    """Axes on a figure of their own, shaped like the map's free floor.

    Args:
        amap: The map.
        longest: Inches of the longer side, about.
    """
    return drawing.new_axes(view(amap), longest=longest)


def plot_zones(
    amap: AmbiguityMap,
    ax: Axes | None = None,
    heading: Heading = "mean",
    *,
    strokes: bool = True,
    legend: bool = True,
    title: str | None = None,
    parts: FloorParts | None = None,
) -> Axes:
    """Draw the floor in the four zones, with walls and the weak direction.

    Floor that is unexplored or not reached has no zone: it is hatched or grey.

    Args:
        amap: The map.
        ax: Where to draw; None makes a figure of its own (`ax.figure`).
        heading: "mean", "best", "worst" or radians, where the heading matters.
        strokes: Whether to draw the weak direction.
        legend: Whether to tell the colours, with share and area of each zone.
        title: None names the environment and the scanner.
        parts: Which floor counts; None: all that is explored. Shares in the legend are of it.

    Raises:
        InputError: no such heading.
    """
    axes = floor_axes(amap) if ax is None else ax
    parts = FloorParts.of(amap) if parts is None else parts
    palette = np.array([*map(to_rgba, COLOURS), (0.0, 0.0, 0.0, 0.0)])
    zone = amap.floor("zone", heading).values
    picture = palette[np.where(zone == NOT_FREE, len(ZONES), zone)]
    paint_parts(picture, amap, parts, view(amap))
    draw_image(axes, amap, picture)
    finish(axes, amap, title or floor_title(amap, "Zones", heading))
    if strokes:
        _strokes(axes, amap, heading, parts)
    if legend:
        _legend(axes, amap, heading, strokes, parts)
    return axes


def plot_layer(
    amap: AmbiguityMap,
    layer: str,
    ax: Axes | None = None,
    heading: Heading = "mean",
    *,
    strokes: bool = False,
    title: str | None = None,
    parts: FloorParts | None = None,
) -> Axes:
    """Draw one layer on a continuous scale with a colour bar; dark is badly localized.

    Args:
        amap: The map.
        layer: Name of a layer, without suffix. Angles are drawn in degrees on a cyclic scale.
        ax: Where to draw; None makes a figure of its own (`ax.figure`).
        heading: "mean", "best", "worst" or radians, where the heading matters.
        strokes: Whether to draw the weak direction too.
        title: None names the layer, the environment and the scanner.
        parts: Which floor counts; what does not is hatched or grey, with a legend. None: the layer
            is drawn wherever it has a value.

    Raises:
        InputError: no such layer or heading, or a layer of classes.
    """
    if schema.base_name(layer) in ("zone", "free"):
        raise InputError(f"{layer}: this layer holds classes; draw it with plot_zones.")
    data = amap.floor(layer, heading)
    values = data.values.astype(np.float64)
    label = str(amap.dataset[layer].attrs.get("long_name", layer))
    units = str(data.attrs.get("units", ""))
    axes = floor_axes(amap) if ax is None else ax
    if units == "rad" or schema.is_axis(layer):
        values, units = np.degrees(values), "degrees"
        top = 180.0 if schema.is_axis(layer) else 360.0
        # The only cyclic scale that is perceptually uniform passes through a near white, hence
        # the darker grey of what is not known.
        norm, colours, unknown = Normalize(0.0, top), "twilight", "#A6A6A6"
        values = np.mod(values, top)
    else:
        # Perceptually uniform and fit for colour-blind eyes; turned round so that the bad places
        # are the dark ones. cividis fades into the greys.
        low_is_bad = data.attrs.get("worse") == "low" or data.attrs.get("better") == "high"
        colours, unknown = "viridis" if low_is_bad else "viridis_r", UNKNOWN_COLOUR
        if parts is not None:
            values = np.where(parts.counted, values, np.nan)
        norm = _scale(layer, values, added="source" in data.attrs)
        values = np.clip(values, norm.vmin, norm.vmax)
    if parts is not None:
        values = np.where(parts.counted, values, np.nan)
        others = np.zeros((*values.shape, 4))
        paint_parts(others, amap, parts, view(amap))
        draw_image(axes, amap, others)
    image = draw_image(axes, amap, values, cmap=colours, norm=norm)
    finish(
        axes,
        amap,
        title or floor_title(amap, layer.replace("_", " ").capitalize(), heading),
        unknown,
    )
    if strokes:
        _strokes(axes, amap, heading, FloorParts.of(amap) if parts is None else parts)
    if parts is not None:
        _legend_of_parts(axes, amap, parts, unknown)
    bar = axes.figure.colorbar(
        image, ax=axes, location="right", fraction=0.03, pad=0.01, aspect=30, shrink=0.8
    )
    bar.set_label(label if units in ("", "1") else f"{label} ({units})")
    bar.outline.set_linewidth(0.5)
    return axes


def _legend(
    axes: Axes, amap: AmbiguityMap, heading: Heading, strokes: bool, parts: FloorParts
) -> None:
    handles: list[Patch | Line2D] = [
        colour_patch(colour, f"{share.zone}\n{share.share:.0%}, {area_text(share.area)}")
        for share, colour in zip(amap.zone_shares(heading, parts.counted), COLOURS, strict=True)
    ]
    handles += part_patches(amap, parts)
    handles += outside_patches(amap, view(amap))
    if strokes:
        handles.append(
            Line2D([], [], color=drawing.WALL_COLOUR, linewidth=1.7, label="weak\ndirection")
        )
    # A quarter of the width is the scale bar's.
    width = 0.75 * axes.get_figure(root=True).get_figwidth()  # type: ignore[union-attr]
    rows = -(-len(handles) // max(int(width / COLUMN), 2))
    columns = -(-len(handles) // rows)
    axes.legend(
        handles=handles,
        frameon=False,
        fontsize=11,
        handlelength=1.6,
        columnspacing=1.4,
        borderaxespad=0.2,
        **_BESIDE if drawing.is_tall(view(amap)) else {**_BELOW, "ncol": columns},
    )


def _legend_of_parts(axes: Axes, amap: AmbiguityMap, parts: FloorParts, unknown: str) -> None:
    """Tell what is hatched or grey, below the scale bar: the colour bar stands beside."""
    handles = part_patches(amap, parts) + outside_patches(amap, view(amap))
    for handle in handles:
        if handle.get_label() == "unknown":
            handle.set_facecolor(unknown)
    figure = axes.get_figure(root=True)
    if not handles or figure is None:
        return
    down = ScaledTranslation(0.0, -UNDER_BAR / 72.0, figure.dpi_scale_trans)
    axes.legend(
        handles=handles,
        frameon=False,
        fontsize=11,
        handlelength=1.6,
        columnspacing=1.4,
        borderaxespad=0.2,
        loc="upper left",
        bbox_to_anchor=(0.0, 0.0),
        bbox_transform=axes.transAxes + down,
        ncol=2 if drawing.is_tall(view(amap)) else len(handles),
    )


def view(amap: AmbiguityMap) -> tuple[float, float, float, float]:
    """Bounds of the free cells and a small margin: maps often lie in a sea of unknown cells."""
    free = amap.dataset["free"].values
    x, y = amap.dataset["x"].values, amap.dataset["y"].values
    columns, rows = np.nonzero(free.any(axis=0))[0], np.nonzero(free.any(axis=1))[0]
    if columns.size == 0:
        return amap.bounds
    left, right, low, high = x[columns[0]], x[columns[-1]], y[rows[0]], y[rows[-1]]
    margin = amap.spacing + 0.01 * max(right - left, high - low)
    return (
        float(left - margin), float(low - margin), float(right + margin), float(high + margin)
    )  # fmt: skip


def draw_image(
    axes: Axes, amap: AmbiguityMap, values: NDArray[np.float64], **scale: object
) -> AxesImage:
    """Lay values (ny, nx), or colours (ny, nx, 4), over the cells of the map."""
    xmin, ymin, xmax, ymax = amap.bounds
    return axes.imshow(
        values,
        extent=(xmin, xmax, ymin, ymax),
        origin="lower",
        interpolation="nearest",
        zorder=1,
        **scale,  # type: ignore[arg-type]
    )


def finish(axes: Axes, amap: AmbiguityMap, title: str, unknown: str = UNKNOWN_COLOUR) -> None:
    """Add what every picture of a floor has: frame, backdrop, walls, scale bar and title."""
    drawing.frame(axes, view(amap), unknown)
    draw_backdrop(axes, amap, unknown)
    drawing.draw_walls(axes, amap.segments)
    drawing.draw_scale_bar(axes)
    axes.set_title(title, fontsize=13, loc="left")


def _strokes(axes: Axes, amap: AmbiguityMap, heading: Heading, parts: FloorParts) -> None:
    major, minor, direction = (
        amap.floor(name, heading).values.astype(np.float64)
        for name in ("major", "minor", "direction")
    )
    x, y = amap.dataset["x"].values, amap.dataset["y"].values
    depth = amap.dataset["clearance"].values.astype(np.float64)
    strength = np.where(parts.counted, major - minor, np.nan)
    drawing.draw_weak_direction(axes, x, y, direction, strength, depth)


def floor_title(amap: AmbiguityMap, what: str, heading: Heading) -> str:
    """What is shown, for which scanner, where, and at which heading if that matters."""
    text = f"{what}: {amap.dataset.attrs['scanner']} in {amap.dataset.attrs['environment']}"
    if not amap.has_theta:
        return text
    if heading == "mean":
        return f"{text} (mean over all headings)"
    if isinstance(heading, str):
        return f"{text} (each point at its {heading} heading)"
    return f"{text} (heading {math.degrees(heading):.0f}°)"


def _scale(layer: str, values: NDArray[np.float64], *, added: bool) -> Normalize:
    """From 0, or from below it, to the highest value; by powers where an added layer is wide."""
    if schema.base_name(layer) in _SHARES:
        return Normalize(0.0, 1.0)
    known = values[np.isfinite(values)]
    if not known.size:
        return Normalize(0.0, 1.0)
    low, high = min(float(known.min()), 0.0), float(known.max())
    if added and low == 0.0 < high:
        # The lowest hundredth is no guide: it may be next to nothing.
        most, least = np.percentile(known[known > 0.0], [99.0, 1.0])
        if most > WIDE * least:
            return LogNorm(max(float(least), 1e-9 * high), high)
    return Normalize(low, high if high > low else low + 1.0)
