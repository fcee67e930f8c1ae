"""The overview figure of a leaderboard: outcomes of the episodes, and their costs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ambinav.plotting.rows import RowChart, draw_point
from ambinav.plotting.style import BASELINE, EFFECTS, OUTCOMES
from ambinav_envs.leaderboard.figures import Row

ENDS: Final = ("arrived", "missed", "collided", "timeout")
PANELS: Final = {
    "lost": "ever lost (%)",
    "error": "error (m)",
    "length": "length / shortest path",
    "exposure": "exposure per metre",
}
LETTERS: Final = 30


def plot_board(rows: Sequence[Row], title: str) -> Figure:
    """Plot ends, lost episodes, error, length and exposure of all methods, with intervals.

    Args:
        rows: The table, settings one after the other.
        title: Title of the picture.
    """
    names = [(row.setting, row.method) for row in rows]
    chart = RowChart(names, (1.6, *(1.0 for _ in PANELS)), title, 12.0, LETTERS)
    ends, *panels = chart.panels
    for at, row in zip(chart.places, rows, strict=True):
        _bar(ends, at, row)
        for axes, key in zip(panels, PANELS, strict=True):
            look = BASELINE if row[key].difference is None else EFFECTS["met"]
            draw_point(axes, at, row[key].value, look)
    ends.grid(visible=False)
    ends.set_xlim(0.0, 100.0)
    ends.set_xlabel("episodes that end so (%)")
    for axes, (key, label) in zip(panels, PANELS.items(), strict=True):
        axes.set_xlabel(label)
        high = axes.get_xlim()[1]
        if key == "length":
            axes.axvline(1.0, color="#333333", linewidth=0.8, linestyle=":", zorder=1)
        else:
            axes.set_xlim(0.0, max(high, 5.0 if key == "lost" else 0.0))
    handles = [Patch(color=OUTCOMES[name].colour, label=name) for name in ENDS]
    chart.figure.legend(handles=handles, loc="outside lower left", frameon=False, ncol=len(handles))
    return chart.figure


def _bar(axes: Axes, at: float, row: Row) -> None:
    left = 0.0
    for key in ENDS:
        share = row[key].value.value
        axes.barh(at, share, left=left, height=0.7, color=OUTCOMES[key].colour)
        left += share
    arrived = row["arrived"].value
    # The interval of arriving lies over the bar's end.
    axes.plot([arrived.low, arrived.high], [at, at], color="black", linewidth=1.2)
