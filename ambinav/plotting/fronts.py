"""Pareto fronts of named items: two figures of each, less is better for both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ambinav.plotting import style
from ambinav.plotting.canvas import chart, foot, head, new_figure
from ambinav.plotting.labels import FONT, Labelled, along, on_paper, write_labels
from ambinav.runtime.array_types import Floats

LINE_COLOUR: Final = style.BLUE
DOMINATED_COLOUR: Final = style.SOLID
COLUMNS: Final = 3
"""Panels side by side, at most."""
_WIDE: Final = 8.0
"""Ratio of the largest value to the smallest from which a scale goes by powers, not from 0 on."""
_DECADES: Final = 100.0
"""Ratio of the ends of such a scale up to which 2 and 5 are marked too."""
_WIDEST: Final = 1e4
"""The smallest value that such a scale tells from 0 is the largest by this."""


@dataclass(frozen=True)
class FrontDot:
    """An item in a front.

    Attributes:
        label: Beside its point.
        x: Cost.
        y: Badness.
        dominated: Whether another is no worse in both, and better in one.
    """

    label: str
    x: float
    y: float
    dominated: bool


@dataclass(frozen=True)
class FrontPanel:
    """A front: its axis and its items."""

    label: str
    dots: Sequence[FrontDot]


def plot_fronts(panels: Sequence[FrontPanel], label: str, title: str, caption: str) -> Figure:
    """Draw fronts side by side.

    Args:
        panels: At least one, each with at least one thing.
        label: Label of the vertical axes.
        title: Title of the picture.
        caption: Explanation of the labels.
    """
    columns = min(len(panels), COLUMNS)
    rows = -(-len(panels) // columns)
    figure = new_figure(max(4.9 * columns, 7.0), 4.4 * rows + 0.5)
    every: list[Axes] = figure.subplots(rows, columns, squeeze=False).ravel().tolist()
    head(figure, title)
    for axes in every[len(panels) :]:
        axes.set_axis_off()
    for axes, panel in zip(every, panels, strict=False):
        _frame(axes, panel, label)
        _draw(axes, panel)
    look: dict[str, Any] = {"color": DOMINATED_COLOUR, "marker": "o", "markerfacecolor": "white"}
    handles = [
        Line2D([], [], color=LINE_COLOUR, marker="o", label="not dominated"),
        Line2D(
            [],
            [],
            linestyle="none",
            label="dominated: another is no worse in both, and better in one",
            **look,
        ),
        Line2D([], [], linestyle="none", label=caption),
    ]
    foot(figure, handles)
    figure.draw_without_rendering()  # positions are final only now; labels are laid by them
    for axes, panel in zip(every, panels, strict=False):
        _label(axes, panel)
    return figure


def _frame(axes: Axes, panel: FrontPanel, label: str) -> None:
    axes.set_xlabel(panel.label, fontsize=FONT + 1)
    axes.set_ylabel(label, fontsize=FONT + 1)
    axes.tick_params(labelsize=FONT - 1)
    chart(axes)
    cost, bad = (np.array([getattr(dot, name) for dot in panel.dots]) for name in ("x", "y"))
    for scale, limit, values, room in (
        (axes.set_xscale, axes.set_xlim, cost, (2.5, 0.18)),
        (axes.set_yscale, axes.set_ylim, bad, (1.8, 0.12)),
    ):
        high = max(float(values.max()), 1e-6)
        least = float(values[values > 0.0].min(initial=high))
        least = max(least, high / _WIDEST)
        if high <= _WIDE * least:
            limit(-0.04 * high, (1.0 + room[1]) * high)
        elif values.min() >= least:
            scale("log")
            limit(least / 1.8, high * room[0])
        else:
            scale("symlog", linthresh=least)
            limit(-0.3 * least, high * room[0])
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() != "linear":
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())
        if axis.get_scale() == "log":
            low, high = axis.get_view_interval()
            few = high < _DECADES * low
            axis.set_major_locator(LogLocator(10.0, (1.0, 2.0, 5.0) if few else (1.0,), numticks=8))


def _draw(axes: Axes, panel: FrontPanel) -> None:
    best = sorted((dot.x, dot.y) for dot in panel.dots if not dot.dominated)
    others = [(dot.x, dot.y) for dot in panel.dots if dot.dominated]
    # There is nothing between two items of a front, so the line has steps.
    axes.plot(*np.array(best).T, color=LINE_COLOUR, linewidth=1.6, drawstyle="steps-post", zorder=3)
    axes.plot(*np.array(best).T, "o", color=LINE_COLOUR, markersize=7, zorder=5)
    if others:
        axes.plot(
            *np.array(others).T, "o", color=DOMINATED_COLOUR, markerfacecolor="white", markersize=6,
            zorder=4,
        )  # fmt: skip


def _label(axes: Axes, panel: FrontPanel) -> None:
    """Draw labels beside their points, those of the front first."""
    place = on_paper(axes, [(dot.x, dot.y) for dot in panel.dots])
    best = [at for at, dot in zip(place, panel.dots, strict=True) if not dot.dominated]
    looks = {
        False: {"fontsize": FONT, "color": "black", "zorder": 6},
        True: {"fontsize": FONT - 2, "color": "#666666", "zorder": 6},
    }
    labels = [
        Labelled(dot.label, (dot.x, dot.y), at, looks[dot.dominated])
        for at, dot in sorted(
            zip(place, panel.dots, strict=True), key=lambda placed: placed[1].dominated
        )
    ]
    drawn = [*place, *_steps(np.array(best))]
    join = {"color": "#999999", "lw": 0.7}
    write_labels(axes, labels, drawn, letter=0.6, padding=(2.0, 0.5), join=join)


def _steps(place: Floats) -> Floats:
    """Return points along the step line through points (N, 2)."""
    corners = place[np.argsort(place[:, 0], kind="stable")]
    turns = np.column_stack([corners[1:, 0], corners[:-1, 1]])
    joined = np.empty((2 * len(corners) - 1, 2))
    joined[::2], joined[1::2] = corners, turns
    return along(joined)
