"""Charts of rows in groups with headings, with panels side by side."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from ambinav.drive.bootstrap import Interval
from ambinav.plotting.canvas import head, new_figure
from ambinav.plotting.style import Mark

_ROW: Final = 0.27
"""Inches of a row."""
_BETWEEN: Final = 0.4
"""Room between two groups, rows."""


class RowChart:
    """Rows with names, and panels for their data.

    Args:
        rows: Group and name of each row; the rows of a group follow each other.
        panels: Relative widths of the panels.
        title: Title of the picture.
        width: Inches.
        letters: Most letters of a name.

    Attributes:
        figure: The picture.
        panels: Their axes, from left to right.
        places: Position of each row; one row is 1 high, downwards.
    """

    def __init__(
        self,
        rows: Sequence[tuple[str, str]],
        panels: Sequence[float],
        title: str,
        width: float,
        letters: int,
    ) -> None:
        self.places: list[float] = []
        headings: dict[str, float] = {}
        at = 0.0
        for group, _ in rows:
            if group not in headings:
                at += _BETWEEN if headings else 0.0
                headings[group] = at
                at += 1.0
            self.places.append(at)
            at += 1.0
        self.figure = new_figure(width, 1.75 + _ROW * (at + _BETWEEN), wspace=0.05)
        grid = self.figure.subplots(1, len(panels), sharey=True, width_ratios=panels, squeeze=False)
        self.panels: list[Axes] = grid[0].tolist()
        for axes in self.panels:
            _clear_frame(axes)
        first = self.panels[0]
        first.set_yticks(
            self.places, [textwrap.shorten(name, letters, placeholder="...") for _, name in rows]
        )
        first.set_ylim(at + _BETWEEN - 0.6, -0.6)
        for heading, place in headings.items():
            first.annotate(
                textwrap.shorten(heading, 2 * letters), (0.0, place), xytext=(-9, 0), ha="right",
                va="center", xycoords=first.get_yaxis_transform(), textcoords="offset points",
                fontsize=10, fontweight="bold", annotation_clip=False,
            )  # fmt: skip
        head(self.figure, title)


def draw_point(axes: Axes, at: float, value: Interval, look: Mark) -> None:
    """Draw a mark with its interval; nothing where there is no figure."""
    if value.value == value.value:
        axes.plot([value.low, value.high], [at, at], color=look.colour, linewidth=2.0, zorder=3,
                  solid_capstyle="butt", clip_on=False)  # fmt: skip
        axes.plot(value.value, at, clip_on=False, zorder=4, **mark_style(look))


def mark_entry(look: Mark, label: str) -> Line2D:
    """Return a legend entry for a mark."""
    return Line2D([], [], color=look.colour, linewidth=2.0, label=label, **mark_style(look))


def mark_style(look: Mark) -> dict[str, Any]:
    """Return a mark as arguments of Matplotlib's `plot`."""
    return {
        "marker": look.mark, "markersize": 7, "markeredgecolor": look.colour,
        "markeredgewidth": 1.4, "markerfacecolor": look.colour if look.filled else "white",
    }  # fmt: skip


def _clear_frame(axes: Axes) -> None:
    """Keep only a grid and its numbers."""
    axes.grid(axis="x", color="#DDDDDD", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0, labelsize=10, pad=9)
    axes.tick_params(axis="x", labelsize=9)
