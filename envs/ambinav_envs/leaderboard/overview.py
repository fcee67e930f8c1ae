"""The picture of a leaderboard: what became of the episodes, and what they cost."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ambinav.plotting import floor as drawing
from ambinav.plotting.rows import label_rows, stacked
from ambinav_envs.leaderboard.figures import Row

ENDS: Final = {
    "arrived": "#009E73",
    "missed": "#E69F00",
    "collided": "#D55E00",
    "timeout": "#999999",
}
"""How episodes end, and colours of Okabe and Ito."""

PANELS: Final = {
    "lost": "ever lost (%)",
    "error": "error (m)",
    "length": "way / shortest way",
    "exposure": "exposure per metre",
}
LETTERS: Final = 30


def plot_board(rows: Sequence[Row], title: str) -> Figure:
    """Ends, lost episodes, error, length and exposure of all methods, with intervals.

    Args:
        rows: The table, settings one after the other.
        title: Of the picture.
    """
    stack = stacked(rows, lambda row: row.setting)
    figure = Figure(figsize=(12.0, 1.5 + 0.27 * stack.height), dpi=drawing.DPI, facecolor="white")
    figure.set_layout_engine("constrained", wspace=0.05)
    FigureCanvasAgg(figure)
    ends, *panels = figure.subplots(
        1, 1 + len(PANELS), sharey=True, width_ratios=(1.6, *(1.0 for _ in PANELS))
    ).tolist()
    for at, row in stack.places:
        _bar(ends, at, row)
        for axes, key in zip(panels, PANELS, strict=True):
            _point(axes, at, row, key)
    ends.set_xlim(0.0, 100.0)
    ends.set_xlabel("episodes that end so (%)")
    for axes, (key, label) in zip(panels, PANELS.items(), strict=True):
        axes.set_xlabel(label)
        axes.grid(axis="x", color="#DDDDDD", linewidth=0.6)
        high = axes.get_xlim()[1]
        if key == "length":
            axes.axvline(1.0, color="#333333", linewidth=0.8, linestyle=":", zorder=1)
        else:
            axes.set_xlim(0.0, max(high, 5.0 if key == "lost" else 0.0))
    label_rows(ends, stack, lambda row: row.method, LETTERS)
    for axes in (ends, *panels):
        axes.set_axisbelow(True)
        axes.spines[["top", "right", "left"]].set_visible(False)
        axes.tick_params(axis="y", length=0, labelsize=10, pad=9)
        axes.tick_params(axis="x", labelsize=9)
    figure.suptitle(title, x=0.01, ha="left", fontsize=13)
    handles = [Patch(color=colour, label=name) for name, colour in ENDS.items()]
    figure.legend(handles=handles, loc="outside lower left", frameon=False, ncol=len(handles))
    return figure


def _bar(axes: Axes, at: float, row: Row) -> None:
    left = 0.0
    for key, colour in ENDS.items():
        share = row[key].value.value
        axes.barh(at, share, left=left, height=0.7, color=colour)
        left += share
    arrived = row["arrived"].value
    # The interval of arriving lies over the bar's end.
    axes.plot([arrived.low, arrived.high], [at, at], color="black", linewidth=1.2)


def _point(axes: Axes, at: float, row: Row, key: str) -> None:
    cell = row[key]
    value = cell.value
    if math.isnan(value.value):
        return
    base = cell.difference is None
    colour = "#000000" if base else "#0072B2"
    axes.plot([value.low, value.high], [at, at], color=colour, linewidth=2.0, zorder=3,
              solid_capstyle="butt", clip_on=False)  # fmt: skip
    axes.plot(value.value, at, "D" if base else "o", color=colour, markersize=6, zorder=4,
              clip_on=False)  # fmt: skip
