"""The picture that leads a report: lost runs, error, length and bad floor of every route."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import zip_longest
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from ambinav.compare.tables import Cell, Row, judge
from ambinav.compare.verdict_text import ERROR
from ambinav.maps.zones import COLOURS, CORRIDOR, OPEN, ZONES
from ambinav.plotting import floor as drawing
from ambinav.plotting.rows import label_rows, stacked
from ambinav.routes.bad_floor import BadFloor

LOOKS: Final[dict[str, tuple[str, str, bool, str]]] = {
    "baseline": ("#000000", "D", True, "what the others are compared with"),
    "met": ("#0072B2", "o", True, "better, goal met"),
    "better": ("#0072B2", "o", False, "better"),
    "none": ("#777777", "s", False, "no difference shown"),
    "mixed": ("#CC79A7", "P", False, "better and worse"),
    "worse": ("#D55E00", "X", True, "worse"),
}
"""Colour, mark, whether that is filled, and name of what runs show; colours of Okabe and Ito."""

FLOOR: Final = ((CORRIDOR, -0.17), (OPEN, 0.17))
"""Zones whose metres have bars, and where these are drawn in a route's row."""

PALE: Final = 0.4
"""Share of its colour that a bar has beyond the longest stretch."""

LETTERS: Final = 34
"""To a line of a route's name."""


def plot_overview(rows: Sequence[Row], title: str) -> Figure:
    """Lost runs, error and length of all routes, and their metres on bad floor, a line for each.

    Args:
        rows: The table, pairs one after the other.
        title: Of the picture.
    """
    stack = stacked(rows, lambda row: row.pair)
    walls = any(row["collided"].value.value for row in rows)
    keys = ("lost", "error_p95", "collided") if walls else ("lost", "error_p95")
    figure = Figure(
        figsize=(12.5 if len(keys) == 2 else 14.5, 1.75 + 0.27 * stack.height),
        dpi=drawing.DPI,
        facecolor="white",
    )
    figure.set_layout_engine("constrained", wspace=0.05)
    FigureCanvasAgg(figure)
    panels = figure.subplots(
        1, len(keys) + 2, sharey=True, width_ratios=(*(1.0 for _ in keys), 0.7, 0.9)
    ).tolist()
    lost, length, floor = panels[0], panels[-2], panels[-1]
    bases = {row.pair: row for row in rows if row.is_baseline}
    shown = set()
    for at, row in stack.places:
        look = _look(row, bases[row.pair])
        shown.add(look)
        for axes, key in zip(panels, keys, strict=False):
            _point(axes, at, row[key], look)
        ratio = 100.0 * (row.planned / bases[row.pair].planned - 1.0)
        _floor_bars(floor, at, row.floor)
        length.plot(ratio, at, clip_on=False, zorder=4, **_mark(look))
    _scales(dict(zip(keys, panels, strict=False)), length, rows)
    _floor_scale(floor)
    label_rows(lost, stack, lambda row: row.route, LETTERS)
    figure.suptitle(title, x=0.01, ha="left", fontsize=13)
    handles = [
        Line2D([], [], color=colour, linewidth=2.0, label=name, **_mark(look))
        for look, (colour, _, _, name) in LOOKS.items()
        if look in shown
    ]
    bars = [
        Patch(color=COLOURS[zone], label=f"planned in {ZONES[zone]} zones") for zone, _ in FLOOR
    ]
    bars.append(Patch(color="#777777", alpha=PALE, label="pale: beyond the longest stretch"))
    columns = max(len(handles), len(bars))
    figure.legend(
        # Column by column: marks above, bars below.
        handles=[
            handle
            for pair in zip_longest(handles, bars, fillvalue=Line2D([], [], ls="none", label=" "))
            for handle in pair
        ],
        loc="outside lower center", frameon=False, ncol=columns, fontsize=10,
    )  # fmt: skip
    return figure


def _look(row: Row, base: Row) -> str:
    """Key of `LOOKS` for a route."""
    if row is base:
        return "baseline"
    verdict = judge(row, base)
    return "met" if verdict.outcome == "met" else verdict.effect


def _mark(look: str) -> dict[str, Any]:
    colour, mark, filled, _ = LOOKS[look]
    return {
        "marker": mark, "markersize": 7, "markeredgecolor": colour, "markeredgewidth": 1.4,
        "markerfacecolor": colour if filled else "white",
    }  # fmt: skip


def _point(axes: Axes, at: float, cell: Cell, look: str) -> None:
    value = cell.value
    if math.isnan(value.value):
        return
    axes.plot([value.low, value.high], [at, at], color=LOOKS[look][0], linewidth=2.0, zorder=3,
              solid_capstyle="butt", clip_on=False)  # fmt: skip
    axes.plot(value.value, at, clip_on=False, zorder=4, **_mark(look))


def _floor_bars(axes: Axes, at: float, floor: BadFloor) -> None:
    """Metres in corridor and in open zones: the longest stretch in full colour, the rest pale."""
    told = ((floor.corridor, floor.longest_corridor), (floor.open, floor.longest_open))
    for (zone, offset), (metres, longest) in zip(FLOOR, told, strict=True):
        place: dict[str, Any] = {
            "height": 0.28,
            "color": COLOURS[zone],
            "linewidth": 0.0,
            "zorder": 3,
        }
        axes.barh(at + offset, metres, alpha=PALE, **place)
        if longest > 0.0:
            axes.barh(at + offset, longest, **place)


def _floor_scale(axes: Axes) -> None:
    axes.set_xlim(0.0, max(1.0, 1.03 * axes.dataLim.x1))
    axes.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    axes.set_xlabel("in corridor and open zones (m)")
    _plain(axes)


def _scales(panels: dict[str, Axes], length: Axes, rows: Sequence[Row]) -> None:
    for key, label in (("lost", "runs that were lost (%)"), ("collided", "runs into walls (%)")):
        if key in panels:
            panels[key].set_xlim(0.0, 100.0)
            panels[key].set_xticks(range(0, 101, 25))
            panels[key].set_xlabel(label)
    error = panels["error_p95"]
    ends = [row["error_p95"].value.high for row in rows]
    error.set_xlim(0.0, 1.06 * max((end for end in ends if end > 0.0), default=1.0))
    error.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    error.set_xlabel("95 % of error below (m)" if len(panels) > 2 else f"{ERROR} (m)")
    left, right = length.get_xlim()
    length.set_xlim(min(left, -1.0), max(right, 12.0))
    length.axvline(10.0, color="#333333", linewidth=0.8, linestyle=":", zorder=1)
    length.set_xlabel("way longer by (%)")
    length.annotate(
        "goal", (10.0, 1.0), xycoords=("data", "axes fraction"), ha="center", va="bottom",
        fontsize=9, color="#333333", annotation_clip=False,
    )  # fmt: skip
    for axes in (*panels.values(), length):
        _plain(axes)


def _plain(axes: Axes) -> None:
    """Only a grid and its numbers."""
    axes.grid(axis="x", color="#DDDDDD", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0, labelsize=10, pad=9)
    axes.tick_params(axis="x", labelsize=9)
