"""Pictures of an ambiguity map: the zones of the floor, and any layer on a continuous scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import JudgedFloor
from ambinav.maps.zones import NOT_FREE
from ambinav.plotting import style
from ambinav.plotting.floor import LONGEST, FloorFigure, Heading, rgba_bytes
from ambinav.plotting.legend_patches import colour_patch
from ambinav.plotting.scales import layer_norm as layer_norm
from ambinav.plotting.scales import layer_scale
from ambinav.reports.number_text import metres2, percent
from ambinav.runtime.array_types import Bytes
from ambinav.runtime.errors import InputError

ZONES_OF_ALL: Final = "over all headings"
"""Said of zones that are those of a map's floor, in titles."""


def plot_zones(
    amap: AmbiguityMap,
    ax: Axes | None = None,
    heading: Heading = "mean",
    *,
    strokes: bool = True,
    legend: bool = True,
    title: str | None = None,
    parts: JudgedFloor | None = None,
    longest: float = LONGEST,
) -> Axes:
    """Draw the floor in the four zones, with walls and the weak direction.

    Floor that is unexplored or not reached has no zone: it is hatched or grey.

    Args:
        amap: The map.
        ax: Axes to draw on; None makes a figure of its own (`ax.figure`).
        heading: "mean", "best", "worst" or radians, where the heading matters.
        strokes: Whether to draw the weak direction.
        legend: Whether to tell the colours, with share and area of each zone.
        title: None names the environment and the scanner.
        parts: Masks of the floor that counts; None: the map's own. Shares in the legend are of it.
        longest: Inches of the longer side in a figure of its own, about.

    Raises:
        InputError: no such heading.
    """
    parts = amap.judged if parts is None else parts
    title = title or floor_title(amap, "Zones", heading, ZONES_OF_ALL)
    floor = FloorFigure(amap, ax, title, longest=longest)
    paint_zones(floor, heading, parts)
    if strokes:
        floor.strokes(heading, parts)
    if legend:
        shares = zip(amap.zone_shares(heading, parts.counted), style.ZONE_COLOURS, strict=True)
        handles: list[Artist] = [
            colour_patch(colour, f"{share.zone}\n{percent(share.share)}, {metres2(share.area)}")
            for share, colour in shares
        ]
        handles += floor.part_patches(parts) + floor.outside_patches()
        weak = Line2D([], [], color=style.WALL, linewidth=1.7, label="weak\ndirection")
        floor.legend([*handles, weak] if strokes else handles)
    return floor.finish()


def plot_layer(
    amap: AmbiguityMap,
    layer: str,
    ax: Axes | None = None,
    heading: Heading = "mean",
    *,
    strokes: bool = False,
    title: str | None = None,
    parts: JudgedFloor | None = None,
) -> Axes:
    """Draw one layer on a continuous scale with a colour bar; dark is badly localized.

    Args:
        amap: The map.
        layer: Name of a layer, without suffix. Angles are drawn in degrees on a cyclic scale.
        ax: Axes to draw on; None makes a figure of its own (`ax.figure`).
        heading: "mean", "best", "worst" or radians, where the heading matters.
        strokes: Whether to draw the weak direction too.
        title: None names the layer, the environment and the scanner.
        parts: Masks of the floor that counts; what does not is hatched or grey, with a legend.
            None: the layer is drawn wherever it has a value.

    Raises:
        InputError: no such layer or heading, or a layer of classes.
    """
    if schema.base_name(layer) in ("zone", "free"):
        raise InputError(f"{layer}: this layer holds classes; draw it with plot_zones.")
    data = amap.floor(layer, heading)
    values = data.values.astype(np.float64)
    if parts is not None:
        values = np.where(parts.counted, values, np.nan)
    label = str(amap.dataset[layer].attrs.get("long_name", layer))
    scale = layer_scale(layer, data, values)
    # A layer without headings has no mean over them.
    at = heading if "theta" in amap.dataset[layer].dims else None
    title = title or floor_title(amap, layer.replace("_", " ").capitalize(), at)
    floor = FloorFigure(amap, ax, title, unknown=scale.unknown)
    image = floor.paint(scale.values, cmap=scale.colours, norm=scale.norm)
    if strokes:
        floor.strokes(heading, amap.judged if parts is None else parts)
    floor.colour_bar(image, label if scale.unit in ("", "1") else f"{label} ({scale.unit})")
    if parts is not None:
        others = np.zeros((*values.shape, 4), dtype=np.uint8)
        floor.paint_parts(others, parts)
        floor.paint(others)
        floor.legend(floor.part_patches(parts) + floor.outside_patches(), below=True)
    return floor.finish()


def paint_zones(floor: FloorFigure, heading: Heading, parts: JudgedFloor) -> None:
    """Draw the colours of the zones on a floor, stripes and grey where there is no zone."""
    paint_zone_codes(floor, floor.amap.floor("zone", heading).values, parts)


def paint_zone_codes(floor: FloorFigure, zone: Bytes, parts: JudgedFloor) -> None:
    """Draw zones given as codes, shape (ny, nx), of a map on the same lattice."""
    paint_codes(floor, zone, style.ZONE_COLOURS, parts)


def paint_codes(
    floor: FloorFigure, code: Bytes, colours: Sequence[str], parts: JudgedFloor
) -> None:
    """Draw codes, shape (ny, nx), each in its colour; `NOT_FREE` is left out."""
    palette = np.array([*map(rgba_bytes, colours), np.zeros(4, dtype=np.uint8)])
    picture = palette[np.where(code == NOT_FREE, len(colours), code)]
    floor.paint_parts(picture, parts)
    floor.paint(picture)


def floor_title(
    amap: AmbiguityMap, quantity: str, heading: Heading | None, mean: str = "mean over all headings"
) -> str:
    """Return a title: content, scanner, building, and heading if it matters and is not None."""
    text = f"{quantity}: {amap.dataset.attrs['scanner']} in {amap.dataset.attrs['environment']}"
    if heading is None or not amap.has_theta:
        return text
    if heading == "mean":
        return f"{text} ({mean})"
    if isinstance(heading, str):
        return f"{text} (each point at its {heading} heading)"
    return f"{text} (heading {math.degrees(heading):.0f}°)"
