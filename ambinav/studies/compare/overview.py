"""The overview picture of a report: lost runs, error, length and bad floor of every route."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from ambinav.maps.zones import CORRIDOR, OPEN, ZONES
from ambinav.plotting.rows import RowChart, draw_point, mark_entry, mark_style
from ambinav.plotting.style import BASELINE, EFFECTS, ZONE_COLOURS
from ambinav.routes.bad_floor import BadFloor
from ambinav.studies.compare.tables import Row, judge
from ambinav.studies.compare.verdict_text import ERROR

NAMES: Final = {
    "baseline": "baseline of the comparison",
    "met": "better, criterion met",
    "better": "better",
    "none": "no difference shown",
    "mixed": "better and worse",
    "worse": "worse",
}
"""Legend texts of the effects."""
MARKS: Final = {"baseline": BASELINE, **EFFECTS}

FLOOR: Final = ((CORRIDOR, -0.17), (OPEN, 0.17))
"""Zones whose metres have bars, and where these are drawn in a route's row."""

PALE: Final = 0.4
"""Share of its colour that a bar has beyond the longest stretch."""

LETTERS: Final = 34
"""To a line of a route's name."""


def plot_overview(rows: Sequence[Row], title: str) -> Figure:
    """Draw lost runs, error, length and metres on bad floor, one line for each route.

    Args:
        rows: The table, pairs one after the other.
        title: Title of the picture.
    """
    walls = any(row["collided"].value.value for row in rows)
    keys = ("lost", "error_p95", "collided") if walls else ("lost", "error_p95")
    chart = RowChart(
        [(row.pair, row.route) for row in rows],
        (*(1.0 for _ in keys), 0.7, 0.9),
        title,
        14.5 if walls else 12.5,
        LETTERS,
    )
    *panels, length, floor = chart.panels
    bases = {row.pair: row for row in rows if row.is_baseline}
    looks = [_mark_key(row, bases[row.pair]) for row in rows]
    for at, row, look in zip(chart.places, rows, looks, strict=True):
        for axes, key in zip(panels, keys, strict=True):
            draw_point(axes, at, row[key].value, MARKS[look])
        ratio = 100.0 * (row.planned / bases[row.pair].planned - 1.0)
        _floor_bars(floor, at, row.floor)
        length.plot(ratio, at, clip_on=False, zorder=4, **mark_style(MARKS[look]))
    _scales(dict(zip(keys, panels, strict=True)), length, rows)
    floor.set_xlim(0.0, max(1.0, 1.03 * floor.dataLim.x1))
    floor.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    floor.set_xlabel("in corridor and open zones (m)")
    handles = [mark_entry(MARKS[look], name) for look, name in NAMES.items() if look in looks]
    bars = [
        Patch(color=ZONE_COLOURS[zone], label=f"planned in {ZONES[zone]} zones")
        for zone, _ in FLOOR
    ]
    bars.append(Patch(color="#777777", alpha=PALE, label="pale: beyond the longest stretch"))
    chart.figure.legend(
        # Column by column: marks above, bars below.
        handles=[
            handle
            for pair in zip_longest(handles, bars, fillvalue=Line2D([], [], ls="none", label=" "))
            for handle in pair
        ],
        loc="outside lower center", frameon=False, ncol=max(len(handles), len(bars)), fontsize=10,
    )  # fmt: skip
    return chart.figure


def _mark_key(row: Row, base: Row) -> str:
    """Return the key of `MARKS` for a route."""
    if row is base:
        return "baseline"
    verdict = judge(row, base)
    return "met" if verdict.outcome == "met" else verdict.effect


def _floor_bars(axes: Axes, at: float, floor: BadFloor) -> None:
    """Draw metres in corridor and open zones: longest stretch in full colour, remainder pale."""
    lengths = ((floor.corridor, floor.longest_corridor), (floor.open, floor.longest_open))
    for (zone, offset), (metres, longest) in zip(FLOOR, lengths, strict=True):
        place: dict[str, Any] = {
            "height": 0.28,
            "color": ZONE_COLOURS[zone],
            "linewidth": 0.0,
            "zorder": 3,
        }
        axes.barh(at + offset, metres, alpha=PALE, **place)
        if longest > 0.0:
            axes.barh(at + offset, longest, **place)


def _scales(panels: dict[str, Axes], length: Axes, rows: Sequence[Row]) -> None:
    for key, label in (("lost", "runs that were lost (%)"), ("collided", "runs that collided (%)")):
        if key in panels:
            panels[key].set_xlim(0.0, 100.0)
            panels[key].set_xticks(range(0, 101, 25))
            panels[key].set_xlabel(label)
    error = panels["error_p95"]
    ends = [
        end for row in rows for end in (row["error_p95"].value.value, row["error_p95"].value.high)
    ]
    error.set_xlim(0.0, 1.06 * max((end for end in ends if end > 0.0), default=1.0))
    error.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    error.set_xlabel("95 % of error below (m)" if len(panels) > 2 else f"{ERROR} (m)")
    left, right = length.get_xlim()
    length.set_xlim(min(left, -1.0), max(right, 12.0))
    length.axvline(10.0, color="#333333", linewidth=0.8, linestyle=":", zorder=1)
    length.set_xlabel("route longer by (%)")
    length.annotate(
        "criterion", (10.0, 1.0), xycoords=("data", "axes fraction"), ha="center", va="bottom",
        fontsize=9, color="#333333", annotation_clip=False,
    )  # fmt: skip
