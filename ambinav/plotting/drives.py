"""Pictures of drives: localization error over the floor and along the route."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke

from ambinav.drive.metrics import LOST_POSITION
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting import style
from ambinav.plotting.canvas import foot, new_figure
from ambinav.plotting.floor import FloorFigure, label_points, rgba_bytes, view
from ambinav.plotting.routes import route_line, route_styles
from ambinav.routes.files import trace_route
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Floats

SCALE: Final = (0.05, 2.0)
"""Errors from the lightest to the darkest colour, metres."""

FEW: Final = "#BDBDBD"
"""Colour of a route where too few robots came."""

LOST: Final = "X"
COLLIDED: Final = "s"
"""Marks of where robots were lost, and of where they collided."""

SPECK: Final = 1e-4
"""Square metres: what is smaller comes from rounding."""

TICKS: Final = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
"""Marks of the scale of errors over the distance, metres."""

PANEL: Final = 5.2
"""Inches of the longer side of a floor."""


@dataclass(frozen=True, eq=False)
class DrivenRoute:
    """A route and the results of the robots that drove it.

    Attributes:
        name: Name of the route.
        route: The route.
        kind: Kind of the route, see `plot_routes`.
        runs: Number of robots that drove.
        error: Shape (3, S): the position's error, metres, that 5, 50 and 95 % of the runs stay
            below after every `step` metres; nan where too few were still driving.
        step: Metres.
        lost_at: Shape (L, 2), metres: where robots were when they were first lost.
        collided_at: Shape (C, 2), metres: where robots collided.
    """

    name: str
    route: Route
    kind: str
    runs: int
    error: Floats
    step: float
    lost_at: Floats
    collided_at: Floats

    def title(self, letters: int) -> str:
        """Return the name, shortened to `letters`, and the number of lost and collided runs."""
        name = textwrap.shorten(self.name, letters, placeholder="...")
        collided = f", {len(self.collided_at)} collided" if len(self.collided_at) else ""
        return f"{name}: {len(self.lost_at)} of {self.runs} runs lost{collided}"


def plot_spread(
    amap: AmbiguityMap, driven: Sequence[DrivenRoute], title: str, world: Environment | None = None
) -> Figure:
    """Draw a floor for each route of a pair, coloured by the 95th percentile of the error.

    Args:
        amap: The map, for the floor.
        driven: The routes and their drives.
        title: Title of the picture.
        world: The true building, if it has more than the map.
    """
    boxes = _boxes(amap, world)
    left, low, right, high = view(amap)
    inches = PANEL / max(right - left, high - low)
    columns = min(2 if right - left < 2.5 * (high - low) else 1, len(driven))
    rows = -(-len(driven) // columns)
    figure = new_figure(
        (right - left) * inches * columns + 1.6,
        ((high - low) * inches + 0.42) * rows + 1.2,
        w_pad=0.03,
        h_pad=0.03,
        compress=True,
    )
    grid = figure.subplots(rows, columns, squeeze=False)
    floors = grid.ravel().tolist()
    norm = LogNorm(*SCALE)
    free = np.where(
        amap.dataset["free"].values[..., np.newaxis], rgba_bytes(style.FLOOR), np.uint8(0)
    )
    for number, (axes, route) in enumerate(zip(floors, driven, strict=False)):
        name = route.title(max(16, int(PANEL * 11.0)) - 34)
        floor = FloorFigure(amap, axes, name, longest=PANEL, scale_bar=False)
        floor.paint(free)
        axes.add_collection(
            PolyCollection(boxes, facecolors=style.BOX, edgecolors="#000000", linewidths=0.5,
                           zorder=3), autolim=False,
        )  # fmt: skip
        line = _error_line(route, norm)
        axes.add_collection(line, autolim=False)
        _marks(axes, route.lost_at, LOST, "#000000", "#FFFFFF")
        _marks(axes, route.collided_at, COLLIDED, "#FFFFFF", "#000000")
        label_points(
            floor.axes, [(*route.route.start[:2], style.START), (*route.route.goal[:2], style.GOAL)]
        )
        # The coordinates of the neighbouring panels apply here too.
        if number % columns:
            axes.set_ylabel("")
            axes.tick_params(labelleft=False)
        if number + columns < len(driven):
            axes.set_xlabel("")
            axes.tick_params(labelbottom=False)
    for axes in floors[len(driven) :]:
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
        "error after as many metres driven (m),\n"
        f"that 95 % of the runs stay below; lost: above {LOST_POSITION:g} m",
        fontsize=10,
    )
    figure.suptitle(title, x=0.005, ha="left", fontsize=13)
    foot(figure, _legend_entries(driven, len(boxes) > 0), 4)
    return figure


def _boxes(amap: AmbiguityMap, world: Environment | None) -> list[Floats]:
    """Return outlines, shape (N, 2), of true obstacles that are not in the map."""
    if world is None:
        return []
    solid = shapely.get_parts(amap.environment.free.difference(world.free))
    return [shapely.get_coordinates(shape.exterior) for shape in solid if shape.area > SPECK]


def _legend_entries(driven: Sequence[DrivenRoute], boxes: bool) -> list[Artist]:
    """Return the legend entries of the drawn elements."""
    handles: list[Artist] = []
    if boxes:
        handles.append(Patch(facecolor=style.BOX, edgecolor="#000000", label="unmapped obstacle"))
    if any(len(route.lost_at) for route in driven):
        handles.append(
            Line2D([], [], marker=LOST, color="#000000", markeredgecolor="#FFFFFF",
                   linestyle="none", markersize=8.5, label="here a robot was first lost")
        )  # fmt: skip
    if any(len(route.collided_at) for route in driven):
        handles.append(
            Line2D([], [], marker=COLLIDED, color="#FFFFFF", markeredgecolor="#000000",
                   linestyle="none", markersize=6.5, label="here a robot collided")
        )  # fmt: skip
    if any(np.isnan(route.error).any() for route in driven):
        handles.append(
            Line2D([], [], color=FEW, linewidth=5.0, label="fewer than a quarter drove so far")
        )
    return handles


def _error_line(route: DrivenRoute, norm: LogNorm) -> LineCollection:
    """Return the route in steps, each in the colour of its error."""
    line, errors = trace_route(route.route)[:, :2], route.error[-1]
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    stations = np.minimum(np.arange(len(errors)) * route.step, along[-1])
    pieces = []
    for a, b in itertools.pairwise(stations.tolist()):
        inside = line[(along > a) & (along < b)]
        ends = [[np.interp(s, along, line[:, axis]) for axis in (0, 1)] for s in (a, b)]
        pieces.append(np.vstack([ends[0], inside, ends[1]]))
    return LineCollection(
        pieces,
        array=np.ma.masked_invalid(errors[1:]),
        cmap=colormaps["plasma_r"].with_extremes(bad=FEW),
        norm=norm,
        linewidths=6.0,
        capstyle="round",
        zorder=5,
        path_effects=[Stroke(linewidth=7.4, foreground="#555555"), Normal()],
    )


def _marks(axes: Axes, places: Floats, marker: str, face: str, edge: str) -> None:
    axes.plot(
        *places.T, marker, color=face, markeredgecolor=edge, markeredgewidth=0.6, markersize=5.0,
        zorder=8,
    )  # fmt: skip


def plot_errors(driven: Sequence[DrivenRoute], title: str) -> Figure:
    """Draw the error over the distance: median and middle 90 % of each route's runs.

    Args:
        driven: The routes of a pair; the first one's median is repeated in the others' panels.
        title: Title of the picture.
    """
    figure = new_figure(10.0, 1.1 + 1.45 * len(driven))
    panels = figure.subplots(len(driven), 1, sharex=True, sharey=True, squeeze=False)[:, 0].tolist()
    looks = route_styles(
        {route.name: route.route for route in driven}, {route.name: route.kind for route in driven}
    )
    first = driven[0]
    bottom, top = 0.05, 2.0 * LOST_POSITION
    for axes, route in zip(panels, driven, strict=True):
        low, middle, high = route.error
        axes.fill_between(_driven_metres(route), low, high, color="#CFCFCF", linewidth=0, zorder=2)
        if route is not first:
            axes.plot(
                _driven_metres(first), first.error[1], color=looks[first.name].colour,
                linewidth=1.4, linestyle=(0, (4, 2)), zorder=3,
            )  # fmt: skip
        median = route_line(
            looks[route.name], 2.4, np.column_stack([_driven_metres(route), middle])
        )
        median.set_zorder(4)
        axes.add_line(median)
        axes.axhline(LOST_POSITION, color="#333333", linewidth=0.9, linestyle=":", zorder=3)
        axes.grid(color="#E3E3E3", linewidth=0.5, zorder=0)
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_title(route.title(60), loc="left", fontsize=10.5)
        is_finite = np.isfinite(high)
        top = max(top, 1.15 * float(high[is_finite].max(initial=0.0)))
        # A tenth of the stations may reach below the scale; without errors none are on it.
        positive = np.sort(low[is_finite & (low > 0.0)])
        bottom = min(bottom, float(positive[len(positive) // 10])) if len(positive) else bottom
    panels[0].set_yscale("log")
    panels[0].set_ylim(max(0.001, 0.8 * bottom), top)
    ticks = [tick for tick in TICKS if 0.8 * bottom <= tick <= top]
    panels[0].set_yticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    panels[0].minorticks_off()
    panels[0].set_xlim(0.0, max(_driven_metres(route)[-1] for route in driven))
    panels[0].annotate(
        f"lost: above {LOST_POSITION:g} m", (0.998, LOST_POSITION), ha="right", va="bottom",
        xycoords=("axes fraction", "data"), fontsize=9, color="#333333",
        xytext=(0, 2), textcoords="offset points",
        bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0.0, "pad": 0.8},
    )  # fmt: skip
    panels[-1].set_xlabel("distance driven (m)")
    figure.supylabel("error of the position (m)", fontsize=10.5)
    figure.suptitle(title, x=0.005, ha="left", fontsize=13)
    cased = route_line(looks[driven[-1].name], 2.4)
    cased.set_label("median, in the colour of the route")
    handles: list[Artist] = [cased, Patch(color="#CFCFCF", label="middle 90 % of the runs")]
    if len(driven) > 1:
        handles.append(
            Line2D([], [], color=looks[first.name].colour, linewidth=1.4, linestyle=(0, (4, 2)),
                   label=f"median of {first.name}")
        )  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", frameon=False, ncol=3, fontsize=10)
    return figure


def _driven_metres(route: DrivenRoute) -> Floats:
    """Return the metres driven at each column of the errors."""
    return np.arange(route.error.shape[1], dtype=np.float64) * route.step
