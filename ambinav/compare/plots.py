"""Pictures of a comparison: where routes run, and how far off the localizer is along them."""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from ambinav.compare.plans import Plan
from ambinav.compare.results import STEP, Results, quantiles
from ambinav.drive.metrics import LOST_POSITION
from ambinav.maps import drawing
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.plot import finish, view
from ambinav.maps.zones import OUTSIDE_COLOUR
from ambinav.routes.drawing import GOAL, START, draw_ends
from ambinav.routes.files import trace
from ambinav.routes.plot import plot_routes
from ambinav.routes.route import Route

Floats = NDArray[np.float64]

SCALE: Final = (0.05, 2.0)
"""Errors from the lightest to the darkest colour, metres."""

UNKNOWN: Final = "#BDBDBD"
"""Colour of a route where too few robots came."""

LOST: Final = "X"
COLLIDED: Final = "s"
"""Marks of where robots were lost, and of where they met a wall."""

PANEL: Final = 7.0
"""Inches of the longer side of a floor."""


def plot_floor(amap: AmbiguityMap, plans: Sequence[Plan], title: str) -> Figure:
    """All routes of a pair on the zones of the floor."""
    return plot_routes(
        amap, {plan.name: plan.route for plan in plans}, covariances=False, title=title
    )


def plot_spread(
    amap: AmbiguityMap, plans: Sequence[Plan], results: Sequence[Results], title: str
) -> Figure:
    """A floor for each route of a pair: the route in the colour of the error that 95 % keep below.

    Args:
        amap: The map, for the floor.
        plans: The routes.
        results: Of their drives, in the same order.
        title: Of the picture.
    """
    left, low, right, high = view(amap)
    inches = PANEL / max(right - left, high - low)
    columns = min(2 if right - left < 2.5 * (high - low) else 1, len(plans))
    rows = -(-len(plans) // columns)
    size = ((right - left) * inches * columns + 1.2, ((high - low) * inches + 0.55) * rows + 0.9)
    figure = Figure(figsize=size, dpi=drawing.DPI, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, squeeze=False)
    floors = grid.ravel().tolist()
    norm = LogNorm(*SCALE)
    for axes, plan, result in zip(floors, plans, results, strict=False):
        lost, count = int(result.metrics.lost.sum()), len(result)
        finish(axes, amap, f"{plan.name}: {lost} of {count} lost")
        _draw_floor(axes, amap)
        line = _coloured(plan.route, quantiles(result.errors, [0.95])[0], norm)
        axes.add_collection(line, autolim=False)
        _marks(axes, result.lost_at, LOST, "#000000", "#FFFFFF", 7)
        _marks(axes, result.end[result.metrics.collided], COLLIDED, "#FFFFFF", "#000000", 8)
        ends = [(*plan.route.start[:2], START), (*plan.route.goal[:2], GOAL)]
        draw_ends(axes, ends, zorder=10)
    for axes in floors[len(plans) :]:
        axes.set_visible(False)
    bar = figure.colorbar(line, ax=floors, location="right", fraction=0.025, extend="both")
    ticks = [0.05, 0.1, 0.2, LOST_POSITION, 1.0, 2.0]
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    bar.ax.minorticks_off()
    bar.set_label("error of the position that 95 % of the runs stay below (m)")
    figure.suptitle(title, x=0.01, ha="left", fontsize=14)
    handles = [
        Line2D([], [], marker=LOST, color="#000000", markeredgecolor="#FFFFFF", linestyle="none",
               markersize=9, label="a robot was lost here for the first time"),
    ]  # fmt: skip
    if any(result.metrics.collided.any() for result in results):
        handles.append(
            Line2D([], [], marker=COLLIDED, color="#FFFFFF", markeredgecolor="#000000",
                   linestyle="none", markersize=7, label="a robot met a wall here")
        )  # fmt: skip
    if any(np.isnan(quantiles(result.errors, [0.5])).any() for result in results):
        handles.append(
            Line2D([], [], color=UNKNOWN, linewidth=5.0, label="fewer than a quarter came here")
        )
    figure.legend(handles=handles, loc="outside lower right", frameon=False, ncol=3, fontsize=11)
    return figure


def _draw_floor(axes: Axes, amap: AmbiguityMap) -> None:
    """The free floor in white, so that only the routes have colours."""
    free = amap.dataset["free"].values
    picture = np.ones((*free.shape, 3))
    outside = (
        int(OUTSIDE_COLOUR[1:3], 16),
        int(OUTSIDE_COLOUR[3:5], 16),
        int(OUTSIDE_COLOUR[5:], 16),
    )
    picture[~free] = np.array(outside) / 255.0
    left, low, right, high = amap.bounds
    limits = axes.get_xlim(), axes.get_ylim()
    axes.imshow(
        picture, extent=(left, right, low, high), origin="lower", interpolation="nearest", zorder=1
    )
    axes.set_xlim(limits[0])
    axes.set_ylim(limits[1])


def _coloured(route: Route, errors: Floats, norm: LogNorm) -> LineCollection:
    """The route in pieces of `STEP`, each in the colour of its error."""
    line = trace(route)[:, :2]
    way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    stations = np.minimum(np.arange(len(errors)) * STEP, way[-1])
    pieces = []
    for a, b in itertools.pairwise(stations.tolist()):
        inside = line[(way > a) & (way < b)]
        ends = [[np.interp(s, way, line[:, axis]) for axis in (0, 1)] for s in (a, b)]
        pieces.append(np.vstack([ends[0], inside, ends[1]]))
    return LineCollection(
        pieces,
        array=np.ma.masked_invalid(errors[1:]),
        cmap=colormaps["plasma_r"].with_extremes(bad=UNKNOWN),
        norm=norm,
        linewidths=5.0,
        capstyle="round",
        zorder=5,
        path_effects=[Stroke(linewidth=6.6, foreground="#555555"), Normal()],
    )


def _marks(axes: Axes, places: Floats, marker: str, face: str, edge: str, size: float) -> None:
    x, y = places[np.isfinite(places[:, 0])].T
    axes.plot(
        x, y, marker, color=face, markeredgecolor=edge, markeredgewidth=0.8, markersize=size,
        zorder=8,
    )  # fmt: skip


def plot_errors(plans: Sequence[Plan], results: Sequence[Results], title: str) -> Figure:
    """The error over the way driven: for each route the median and the middle 90 % of its runs.

    Args:
        plans: The routes of a pair; the first one's median is repeated in the others' panels.
        results: Of their drives, in the same order.
        title: Of the picture.
    """
    figure = Figure(
        figsize=(10.0, 0.9 + 1.75 * len(plans)), dpi=drawing.DPI, layout="constrained",
        facecolor="white",
    )  # fmt: skip
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(plans), 1, sharex=True, sharey=True, squeeze=False)[:, 0].tolist()
    first = quantiles(results[0].errors, [0.5])[0]
    top = 2.0 * LOST_POSITION
    for axes, plan, result in zip(panels, plans, results, strict=True):
        low, middle, high = quantiles(result.errors, [0.05, 0.5, 0.95])
        way = np.arange(len(middle)) * STEP
        axes.fill_between(way, low, high, color="#9ECAE9", linewidth=0, label="5 to 95 % of runs")
        if axes is not panels[0]:
            axes.plot(
                np.arange(len(first)) * STEP, first, color="#E45756", linewidth=1.2,
                linestyle=(0, (4, 2)), label=f"median of {plans[0].name}",
            )  # fmt: skip
        axes.plot(way, middle, color="#08519C", linewidth=1.8, label="median")
        axes.axhline(LOST_POSITION, color="#333333", linewidth=0.8, linestyle=":")
        axes.grid(color="#DDDDDD", linewidth=0.5)
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_title(textwrap.shorten(plan.name, 60), loc="left", fontsize=11)
        top = max(top, 1.1 * float(np.nanmax(high)))
    panels[0].set_yscale("log")
    panels[0].set_ylim(0.01, 10.0 ** math.ceil(4.0 * math.log10(top)) if top <= 1.0 else top)
    ticks = [tick for tick in (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0) if tick <= top]
    panels[0].set_yticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    panels[0].minorticks_off()
    panels[0].set_xlim(0.0, max(len(result.errors[0]) for result in results) * STEP)
    panels[0].annotate(
        f"lost above {LOST_POSITION:g} m", (0.998, LOST_POSITION), ha="right", va="bottom",
        xycoords=("axes fraction", "data"), fontsize=9, color="#333333",
    )  # fmt: skip
    panels[-1].set_xlabel("way driven (m)")
    figure.supylabel("error of the position (m)", fontsize=11)
    figure.suptitle(title, x=0.01, ha="left", fontsize=13)
    panel = panels[-1]
    figure.legend(
        *panel.get_legend_handles_labels(), loc="outside lower center", frameon=False, ncol=3
    )
    return figure
