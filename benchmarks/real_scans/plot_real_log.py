"""Figure of a log: the path coloured by its scans' ambiguity, on the floor of the map."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from ambinav.ambiguity.tensor import classify
from ambinav.maps.zones import ZONES
from ambinav.plotting.canvas import new_figure
from ambinav.plotting.floor import view
from ambinav.plotting.legend_patches import colour_patch
from ambinav.plotting.maps import plot_layer, plot_zones
from ambinav.plotting.style import ZONE_COLOURS
from real_scans.real_log import RealLog

# Of the picture's longer side, inches, about.
LONGEST: Final = 12.0
# Dots of the path are this far apart at least, and so wide at most: shares of the longer side of
# the floor, and metres, so that the floor of a corridor shows beside them.
APART: Final = 1.0 / 110.0
WIDE: Final = 1.0 / 120.0
WIDEST: Final = 1.6


def plot_real_log(study: RealLog) -> Figure:
    """Draw the floor of the first map, and the path on it.

    Left the zones: of the floor as the map predicts them (mean over all headings), of the path
    as each scan alone measures them at its own heading. Right the level: of the floor as
    predicted, of the path as its pairs of scans measure it: how well they agree among all pairs
    of the same distance.
    """
    amap = study.maps[0]
    bounds = view(amap)
    width, height = bounds[2] - bounds[0], bounds[3] - bounds[1]
    inches = LONGEST / max(2.0 * width, 1.2 * height)
    figure = new_figure(2.0 * width * inches + 2.2, height * inches + 1.9)
    zones, level = figure.subplots(1, 2)
    name = study.log.name.removesuffix("-corrected")
    far = f"{study.scanner.max_range:g} m"
    plot_zones(amap, zones, strokes=False, legend=False, title=f"{name}, {far}: zones")
    seen, model = study.scan_says, study.model
    measured = classify(seen["major"], seen["minor"], model.low, model.high)
    dot = 72.0 * inches * min(WIDE * max(width, height), WIDEST)
    _path(zones, study, study.alone, np.array(ZONE_COLOURS)[measured], dot)
    plot_layer(amap, "level", level, title="Level and pairs")
    _path(level, study, *study.pairs.mean_by_scan(study.pairs.measured_rank), dot)
    handles = [
        *(
            colour_patch(colour, zone)
            for zone, colour in zip(ZONES, ZONE_COLOURS, strict=True)
        ),
        Line2D(
            [], [], marker="o", linestyle="", markerfacecolor="white", markeredgecolor="black",
            label="path: measured by its scans\n(left: zone; right: rank of the pairs'\n"
            "agreement, on the scale of the level)",
        ),
    ]  # fmt: skip
    columns = 3 if height > 1.1 * width else len(handles)
    figure.legend(
        handles=handles, frameon=False, fontsize=9, ncol=columns, loc="outside lower right"
    )
    return figure


def _path(
    axes: Axes, study: RealLog, scans: NDArray[np.intp], colours: NDArray[Any], dot: float
) -> None:
    """Draw dots `dot` points wide along the path, with a least distance."""
    x, y = study.place(scans)
    gap = APART * max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
    is_marked = np.zeros(len(x), dtype=np.bool_)
    for k in range(len(x)):
        is_marked[k] = not (np.hypot(x[is_marked] - x[k], y[is_marked] - y[k]) < gap).any()
    scale: dict[str, Any] = {}
    if colours.dtype.kind != "U":
        scale = {"cmap": "viridis_r", "vmin": 0.0, "vmax": 1.0}
    axes.scatter(
        x[is_marked], y[is_marked], s=dot**2, c=colours[is_marked], edgecolors="black",
        linewidths=min(0.1 * dot, 0.5), zorder=8, **scale,
    )  # fmt: skip
