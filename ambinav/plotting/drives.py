"""Pictures of a comparison: where routes run, and how far off the localizer is along them."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence
from typing import Final

import numpy as np
import shapely
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from ambinav.compare.plans import Plan
from ambinav.compare.results import STEP, Results, quantiles
from ambinav.drive.metrics import LOST_POSITION
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting import floor as drawing
from ambinav.plotting.maps import finish, view
from ambinav.plotting.route_lines import GOAL, START, draw_ends
from ambinav.plotting.routes import plot_routes
from ambinav.routes.files import trace
from ambinav.routes.route import Route

Floats = NDArray[np.float64]

SCALE: Final = (0.05, 2.0)
"""Errors from the lightest to the darkest colour, metres."""

UNKNOWN: Final = "#BDBDBD"
"""Colour of a route where too few robots came."""

LOST: Final = "X"
COLLIDED: Final = "s"
"""Marks of where robots were lost, and of where they met a wall."""

BOX: Final = "#56B4E9"
"""Colour of obstacles that the map lacks."""

SPECK: Final = 1e-4
"""Square metres: what is smaller comes from rounding."""

TICKS: Final = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
"""Marks of the scale of errors over the way, metres."""

PANEL: Final = 5.2
"""Inches of the longer side of a floor."""


def plot_floor(amap: AmbiguityMap, plans: Sequence[Plan], title: str) -> Figure:
    """All routes of a pair on the zones of the floor."""
    return plot_routes(
        amap, {plan.name: plan.route for plan in plans}, covariances=False, title=title
    )


def plot_spread(
    amap: AmbiguityMap,
    plans: Sequence[Plan],
    results: Sequence[Results],
    title: str,
    world: Environment | None = None,
) -> Figure:
    """A floor for each route of a pair: the route in the colour of the error that 95 % keep below.

    Args:
        amap: The map, for the floor.
        plans: The routes.
        results: Of their drives, in the same order.
        title: Of the picture.
        world: What truly stands there, where that is more than the map has.
    """
    boxes = _boxes(amap, world)
    left, low, right, high = view(amap)
    inches = PANEL / max(right - left, high - low)
    columns = min(2 if right - left < 2.5 * (high - low) else 1, len(plans))
    rows = -(-len(plans) // columns)
    size = ((right - left) * inches * columns + 0.9, ((high - low) * inches + 0.62) * rows + 0.95)
    figure = Figure(figsize=size, dpi=drawing.DPI, facecolor="white")
    figure.set_layout_engine("constrained", w_pad=0.03, h_pad=0.03)
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, squeeze=False)
    floors = grid.ravel().tolist()
    norm = LogNorm(*SCALE)
    letters = max(16, int(PANEL * 11.0))
    for axes, plan, result in zip(floors, plans, results, strict=False):
        name = textwrap.shorten(plan.name, letters - 34, placeholder="...")
        finish(axes, amap, f"{name}: {_counts(result)}")
        axes.title.set_fontsize(11)
        _draw_floor(axes, amap)
        _draw_boxes(axes, boxes)
        line = _coloured(plan.route, quantiles(result.errors, [0.95])[0], norm)
        axes.add_collection(line, autolim=False)
        _marks(axes, result.lost_at, LOST, "#000000", "#FFFFFF", 5.0)
        _marks(axes, result.end[result.metrics.collided], COLLIDED, "#FFFFFF", "#000000", 5.0)
        ends = [(*plan.route.start[:2], START), (*plan.route.goal[:2], GOAL)]
        draw_ends(axes, ends, zorder=10)
    for axes in floors[len(plans) :]:
        axes.set_visible(False)
    bar = figure.colorbar(
        line, ax=floors, location="right", fraction=0.03, pad=0.015, aspect=32, extend="both"
    )
    ticks = [0.05, 0.1, 0.2, LOST_POSITION, 1.0, 2.0]
    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    bar.ax.minorticks_off()
    bar.ax.axhline(LOST_POSITION, color="#FFFFFF", linewidth=1.5)
    bar.outline.set_linewidth(0.5)
    bar.set_label(
        f"error that 95 % of the runs stay below (m); lost: above {LOST_POSITION:g} m", fontsize=10
    )
    figure.suptitle(title, x=0.005, ha="left", fontsize=13)
    figure.legend(
        handles=_explained(results, len(boxes) > 0),
        loc="outside lower left",
        frameon=False,
        ncol=4,
        fontsize=10,
    )
    return figure


def _counts(result: Results) -> str:
    """How many of the runs were lost and, if any did, met a wall."""
    lost, walls = int(result.metrics.lost.sum()), int(result.metrics.collided.sum())
    return f"{lost} of {len(result)} runs lost" + (f", {walls} met a wall" if walls else "")


def _boxes(amap: AmbiguityMap, world: Environment | None) -> list[Floats]:
    """Outlines, shape (N, 2), of what truly stands there but is not in the map."""
    if world is None:
        return []
    solid = shapely.get_parts(amap.environment.free.difference(world.free))
    return [shapely.get_coordinates(shape.exterior) for shape in solid if shape.area > SPECK]


def _draw_boxes(axes: Axes, boxes: Sequence[Floats]) -> None:
    axes.add_collection(
        PolyCollection(boxes, facecolors=BOX, edgecolors="#000000", linewidths=0.5, zorder=3),
        autolim=False,
    )


def _explained(results: Sequence[Results], boxes: bool) -> list[Artist]:
    """Entries of the legend for what there is."""
    handles: list[Artist] = []
    if boxes:
        handles.append(Patch(facecolor=BOX, edgecolor="#000000", label="stands here unmapped"))
    if any(result.metrics.lost.any() for result in results):
        handles.append(
            Line2D([], [], marker=LOST, color="#000000", markeredgecolor="#FFFFFF",
                   linestyle="none", markersize=8.5, label="here a robot was first lost")
        )  # fmt: skip
    if any(result.metrics.collided.any() for result in results):
        handles.append(
            Line2D([], [], marker=COLLIDED, color="#FFFFFF", markeredgecolor="#000000",
                   linestyle="none", markersize=6.5, label="here a robot met a wall")
        )  # fmt: skip
    if any(np.isnan(quantiles(result.errors, [0.5])).any() for result in results):
        handles.append(
            Line2D([], [], color=UNKNOWN, linewidth=5.0, label="fewer than a quarter came here")
        )
    return handles


def _draw_floor(axes: Axes, amap: AmbiguityMap) -> None:
    """The free floor in white, so that only the routes have colours."""
    picture = np.zeros((*amap.solid.shape, 4))
    picture[amap.dataset["free"].values] = 1.0
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
        linewidths=6.0,
        capstyle="round",
        zorder=5,
        path_effects=[Stroke(linewidth=7.4, foreground="#555555"), Normal()],
    )


def _marks(axes: Axes, places: Floats, marker: str, face: str, edge: str, size: float) -> None:
    x, y = places[np.isfinite(places[:, 0])].T
    axes.plot(
        x, y, marker, color=face, markeredgecolor=edge, markeredgewidth=0.6, markersize=size,
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
        figsize=(10.0, 1.1 + 1.45 * len(plans)), dpi=drawing.DPI, layout="constrained",
        facecolor="white",
    )  # fmt: skip
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(plans), 1, sharex=True, sharey=True, squeeze=False)[:, 0].tolist()
    first = quantiles(results[0].errors, [0.5])[0]
    bottom, top = 0.05, 2.0 * LOST_POSITION
    for axes, plan, result in zip(panels, plans, results, strict=True):
        low, middle, high = quantiles(result.errors, [0.05, 0.5, 0.95])
        way = np.arange(len(middle)) * STEP
        axes.fill_between(
            way, low, high, color="#9ECAE9", linewidth=0, label="middle 90 % of the runs", zorder=2
        )
        if axes is not panels[0]:
            axes.plot(
                np.arange(len(first)) * STEP, first, color="#D55E00", linewidth=1.4,
                linestyle=(0, (4, 2)), label=f"median of {plans[0].name}", zorder=3,
            )  # fmt: skip
        axes.plot(way, middle, color="#08519C", linewidth=2.0, label="median", zorder=4)
        axes.axhline(LOST_POSITION, color="#333333", linewidth=0.9, linestyle=":", zorder=3)
        axes.grid(color="#E3E3E3", linewidth=0.5, zorder=0)
        axes.spines[["top", "right"]].set_visible(False)
        name = textwrap.shorten(plan.name, 60, placeholder="...")
        axes.set_title(f"{name}: {_counts(result)}", loc="left", fontsize=10.5)
        known = np.isfinite(high)
        top = max(top, 1.15 * float(high[known].max(initial=0.0)))
        # A tenth of the stations may reach below the scale; without errors none are on it.
        told = np.sort(low[known & (low > 0.0)])
        bottom = min(bottom, float(told[len(told) // 10])) if len(told) else bottom
    panels[0].set_yscale("log")
    panels[0].set_ylim(max(0.001, 0.8 * bottom), top)
    ticks = [tick for tick in TICKS if 0.8 * bottom <= tick <= top]
    panels[0].set_yticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    panels[0].minorticks_off()
    longest = max(result.errors.shape[1] for result in results) - 1
    panels[0].set_xlim(0.0, longest * STEP)
    panels[0].annotate(
        f"lost: above {LOST_POSITION:g} m", (0.998, LOST_POSITION), ha="right", va="bottom",
        xycoords=("axes fraction", "data"), fontsize=9, color="#333333",
        xytext=(0, 1), textcoords="offset points",
    )  # fmt: skip
    panels[-1].set_xlabel("way driven (m)")
    figure.supylabel("error of the position (m)", fontsize=10.5)
    figure.suptitle(title, x=0.005, ha="left", fontsize=13)
    panel = panels[-1]
    figure.legend(
        *panel.get_legend_handles_labels(), loc="outside lower center", frameon=False, ncol=3,
        fontsize=10,
    )  # fmt: skip
    return figure
