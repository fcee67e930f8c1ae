"""Pictures of a sweep: curves over one variable, heat maps over two, directions on the floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, PercentFormatter

from ambinav.geometry.segments import FRONTIER
from ambinav.maps.zones import ZONES
from ambinav.plotting import style
from ambinav.plotting.canvas import foot, head, new_figure
from ambinav.runtime.array_types import Bytes, Floats

_FONT: Final = 10
_LEVELS: Final = (("mean", style.BLUE, "o"), ("p95", style.ORANGE, "s"), ("worst", "#000000", "^"))
_LEVEL_NAMES: Final = {"mean": "mean", "p95": "95th percentile", "worst": "worst"}
_TICKS: Final = 13
"""Values that are written along an axis of a heat map, at most."""
_NARROWEST: Final = 0.05
"""The scale of a heat map has at least this range."""
_ARROWS: Final = 45
"""Lengths of an arrow that a floor is long."""
_LIGHT: Final = LinearSegmentedColormap.from_list(
    "light", colormaps["YlOrRd"](np.linspace(0.1, 0.8, 64))
)
"""From light to dark, and never so dark that a black arrow is lost on it."""


@dataclass(frozen=True, eq=False)
class Curve:
    """A figure over the values of one variable.

    Attributes:
        label: Label of the axis, with its unit.
        note: Fixed values of the other variables; empty if there are none.
        values: Shape (V,), ascending.
        levels: "mean", "p95" and "worst", shape (V,) each.
        zones: Shares in the order of `ZONES`, shape (V, 4).
        best: Values of the best setting: several where these have the same beams.
        present: Value of the present scanner; None if it has none.
    """

    label: str
    note: str
    values: Floats
    levels: dict[str, Floats]
    zones: Floats
    best: tuple[float, ...]
    present: float | None


@dataclass(frozen=True, eq=False)
class Grid:
    """Figures over the values of two variables.

    Attributes:
        labels: Labels of the vertical and the horizontal axis, with units.
        values: Values of both, ascending, shapes (V,) and (W,).
        panels: Title of each figure, its values, shape (V, W), and whether these are shares of 1.
        best: Row and column of the best setting, and of those with the same beams.
        present: Values of the present scanner; None if it is none of the settings.
    """

    labels: tuple[str, str]
    values: tuple[Floats, Floats]
    panels: Sequence[tuple[str, Floats, bool]]
    best: Sequence[tuple[int, int]]
    present: tuple[int, int] | None


def plot_curves(curves: Sequence[Curve], title: str) -> Figure:
    """Draw levels and shares of zones over each variable, one row for each."""
    figure = new_figure(11.5, 1.3 + 3.1 * len(curves), h_pad=0.12, w_pad=0.12)
    rows = figure.subplots(len(curves), 2, squeeze=False).tolist()
    head(figure, title)
    for curve, (left, right) in zip(curves, rows, strict=True):
        for axes in (left, right):
            axes.set_xlabel(curve.label, fontsize=_FONT)
            axes.tick_params(labelsize=_FONT - 1)
            _ticks(axes, curve)
            axes.set_title(curve.note, fontsize=_FONT, loc="left")
            star = 13 if len(curve.best) <= _TICKS else 8
            axes.plot(
                curve.best, [1.0] * len(curve.best), transform=axes.get_xaxis_transform(),
                clip_on=False, zorder=5, **_BEST | {"markersize": star},
            )  # fmt: skip
            if curve.present is not None:
                axes.axvline(curve.present, clip_on=False, **_PRESENT_LINE)
            for side in ("top", "right"):
                axes.spines[side].set_visible(False)
        for name, colour, mark in _LEVELS:
            left.plot(
                curve.values, curve.levels[name], color=colour, marker=mark, markersize=4.5,
                linewidth=1.6, zorder=3,
            )  # fmt: skip
        left.set_ylim(0.0, 1.05)
        left.set_ylabel("level (0 to 1, low is good)", fontsize=_FONT)
        left.grid(color="#DDDDDD", linewidth=0.7)
        left.set_axisbelow(True)
        _draw_shares(right, curve)
    handles: list[Any] = [
        Line2D(
            [], [], color=colour, marker=mark, markersize=5, label=f"level: {_LEVEL_NAMES[name]}"
        )
        for name, colour, mark in _LEVELS
    ]
    handles += [
        Patch(facecolor=colour, edgecolor=style.EDGE, label=zone)
        for zone, colour in zip(ZONES, style.ZONE_COLOURS, strict=True)
    ]
    handles.append(Line2D([], [], label="best setting", **_BEST))
    if any(curve.present is not None for curve in curves):
        handles.append(Line2D([], [], label="value of the present scanner", **_PRESENT_LINE))
    foot(figure, handles, 5)
    return figure


def plot_grid(grid: Grid, title: str) -> Figure:
    """Draw each figure as a heat map, dark is bad; a star marks the best setting."""
    figure = new_figure(12.0, 9.2, h_pad=0.12, w_pad=0.12)
    head(figure, title)
    panels = figure.subplots(2, 2).ravel().tolist()
    for axes, (name, values, is_share) in zip(panels, grid.panels, strict=True):
        low, high = _scale_ends(values)
        image = axes.imshow(
            values, origin="lower", aspect="auto", cmap="viridis_r", vmin=low, vmax=high
        )
        bar = figure.colorbar(image, ax=axes, format=PercentFormatter(1.0) if is_share else None)
        bar.ax.tick_params(labelsize=_FONT - 1)
        bar.set_label("low is good", fontsize=_FONT)
        axes.set_title(name, fontsize=_FONT + 1, loc="left")
        for axis, label, ticks in (
            (axes.yaxis, grid.labels[0], grid.values[0]),
            (axes.xaxis, grid.labels[1], grid.values[1]),
        ):
            step = -(-len(ticks) // _TICKS)
            at = np.arange(0, len(ticks), step)
            axis.set_ticks(at, [f"{ticks[i]:g}" for i in at.tolist()])
            axis.set_tick_params(labelsize=_FONT - 1)
            axis.set_label_text(label, fontsize=_FONT)
        if grid.present is not None:
            row, column = grid.present
            axes.plot(column, row, **_PRESENT)
        rows, columns = zip(*grid.best, strict=True)
        axes.plot(columns, rows, **_BEST)
    handles = [Line2D([], [], label="best setting", **_BEST)]
    if grid.present is not None:
        handles.append(Line2D([], [], label="present scanner", **_PRESENT))
    foot(figure, handles, 2)
    return figure


_PRESENT_LINE: Final[dict[str, Any]] = {
    "color": "black", "linewidth": 1.6, "linestyle": (0, (3, 2)), "zorder": 4
}  # fmt: skip
_BEST: Final[dict[str, Any]] = {
    "marker": "*", "markersize": 17, "markerfacecolor": "white", "markeredgecolor": "black",
    "linestyle": "none",
}  # fmt: skip
_PRESENT: Final[dict[str, Any]] = {
    "marker": "s", "markersize": 19, "markerfacecolor": "none", "markeredgecolor": style.VERMILLION,
    "markeredgewidth": 2.2, "linestyle": "none",
}  # fmt: skip


def plot_directions(
    xy: Floats, kind: Bytes, x: Floats, y: Floats, angle: Floats, gain: Floats, title: str
) -> Figure:
    """Draw the best direction of the scanner at each place, and the gain of turning it.

    Args:
        xy: Walls and frontiers of the building, shape (N, 4), metres.
        kind: Kind of each, shape (N,).
        x: Places, shape (K,), metres.
        y: Places.
        angle: Map frame, radians; nan where there is none.
        gain: Level with the fixed yaw less that with the best.
        title: Title of the picture.
    """
    room = 1.0 + 0.05 * max(float(np.ptp(x)), float(np.ptp(y)))
    tall = (float(np.ptp(y)) + 2.0 * room) / (float(np.ptp(x)) + 2.0 * room)
    figure = new_figure(11.0, min(max(9.5 * tall + 1.5, 4.0), 8.0))
    axes = figure.subplots()
    axes.set_aspect("equal")
    axes.set_title(title, fontsize=12, loc="left")
    walls = xy.reshape(-1, 2, 2)
    for which, colour in ((kind != FRONTIER, style.WALL), (kind == FRONTIER, style.FRONTIER)):
        axes.add_collection(LineCollection(list(walls[which]), colors=colour, linewidths=0.8))
    is_finite = np.isfinite(angle)
    axes.set_xlim(float(x.min()) - room, float(x.max()) + room)
    axes.set_ylim(float(y.min()) - room, float(y.max()) + room)
    shown = axes.scatter(
        x[is_finite], y[is_finite], c=gain[is_finite], cmap=_LIGHT, s=14, vmin=0.0, zorder=2,
        vmax=max(float(gain[is_finite].max(initial=0.0)), 0.05),
    )  # fmt: skip
    size = max(float(np.ptp(axes.get_xlim())), float(np.ptp(axes.get_ylim()))) / _ARROWS
    # One arrow for each square, so that arrows do not overlap.
    squares = np.floor(np.column_stack([x, y])[is_finite] / (1.3 * size))
    cells = np.flatnonzero(is_finite)[np.unique(squares, axis=0, return_index=True)[1]]
    axes.quiver(
        x[cells], y[cells], size * np.cos(angle[cells]), size * np.sin(angle[cells]), angles="xy",
        scale_units="xy", scale=1.0, width=0.0022, color="black", zorder=3, pivot="mid",
    )  # fmt: skip
    bar = figure.colorbar(shown, ax=axes, shrink=0.8)
    bar.set_label("drop of the level with the scanner turned", fontsize=_FONT)
    axes.set_xlabel("x (m)", fontsize=_FONT)
    axes.set_ylabel("y (m)", fontsize=_FONT)
    handles = [
        Line2D([], [], color="black", marker=">", markersize=6, linewidth=1.2,
               label="best direction of the scanner"),
        Line2D([], [], color=style.WALL, linewidth=1.2, label="wall"),
    ]  # fmt: skip
    if (kind == FRONTIER).any():
        handles.append(Line2D([], [], color=style.FRONTIER, linewidth=1.2, label="edge of the map"))
    foot(figure, handles, 3)
    return figure


def _ticks(axes: Axes, curve: Curve) -> None:
    """Set ticks at the values if they have room, otherwise at round ones."""
    values = curve.values
    if len(values) == 1 or np.diff(values).min() * _TICKS >= np.ptp(values):
        axes.set_xticks(values, [f"{value:g}" for value in values])
    elif curve.label.endswith("(degrees)"):
        axes.xaxis.set_major_locator(MaxNLocator(9, steps=[1, 1.5, 3, 4.5, 6, 9, 10]))


def _scale_ends(values: Floats) -> tuple[float, float]:
    """Return ends of a scale within 0 to 1 that do not exaggerate small differences."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return 0.0, 1.0
    low = min(float(finite.min()), 1.0 - _NARROWEST)
    return low, max(float(finite.max()), low + _NARROWEST)


def _draw_shares(axes: Axes, curve: Curve) -> None:
    """Draw the zones stacked, the worst at the bottom."""
    order = [ZONES.index(name) for name in ("open", "corridor", "transition", "localizable")]
    colours = [style.ZONE_COLOURS[i] for i in order]
    values, zones = curve.values, curve.zones[:, order]
    if len(values) == 1:
        values, zones = values[0] + np.array([-0.5, 0.5]), np.repeat(zones, 2, axis=0)
    axes.stackplot(values, zones.T, colors=colours, edgecolor=style.EDGE, linewidth=0.6)
    axes.set_xlim(float(values[0]), float(values[-1]))
    axes.set_ylim(0.0, 1.0)
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.yaxis.set_major_locator(MaxNLocator(5))
    axes.set_ylabel("share of the region", fontsize=_FONT)
