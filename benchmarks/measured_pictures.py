"""Draw the pictures of docs/measured.md from the figures of docs/measured-table.md.

python benchmarks/measured_pictures.py
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from harness import ROOT
from matplotlib.axes import Axes
from measured import Figure, figures

from ambinav.plotting.canvas import new_figure, save_figure
from ambinav.plotting.style import MARKS, SERIES

IMAGES = ROOT / "docs" / "images"
WIDTH = 5.2
"""Inches: 832 pixels and the margins."""


def main() -> None:
    """Draw all six."""
    known = figures()
    fast = [f for f in known if f.what == "ambiguity map" and "a process for each" in f.conditions]
    axes = axes_of(fast, height=2.3)
    draw_intervals(axes, [fast], [""])
    axes.set(xlabel="time to build (s): median, extremes of 5 builds", xlim=0)
    save(axes, "fast")

    logs = chosen(known, "rank correlation", "none missing")
    axes = axes_of(ending(logs, "cut at 4 m"), last=1, height=2.8)
    ranges = ("cut at 4 m", "full range")
    draw_intervals(axes, [ending(logs, one) for one in ranges], ranges)
    axes.set(xlabel="rank correlation of computed with measured ambiguity, 95 % interval")
    axes.set_xlim(0, 1)
    save(axes, "right")

    claim = chosen(
        known, "robots lost, difference", "poor odometry, lasers of 3.5 and 4 m, 30 seeds"
    )
    # Of two pairs the interval says nothing.
    claim = [
        f
        for f in claim
        if "either" not in f.conditions and "; open stretch of 4 to 8 m" not in f.conditions
    ]
    axes = axes_of(ending(claim, "`product`"), last=1, height=3.2)
    draw_intervals(
        axes, [ending(claim, "`product`"), ending(claim, "`kalman`")],
        ["Monte Carlo localization", "Kalman filter"],
    )  # fmt: skip
    axes.axvline(0.0, color="0.4", lw=1.0)
    kind = claim[0].spread.partition(", ")[2]
    axes.set(xlabel=f"robots lost, aware less shortest (points)\n{kind}")
    save(axes, "help")

    draw_planners(known)

    sonar = chosen(known, "robots lost", "ring of 16 sonars, open loop")
    halves = [
        [f for f in sonar if f"; {kind} odometry" in f.conditions] for kind in ("mediocre", "poor")
    ]
    axes = axes_of(halves[0], height=2.3)
    draw_intervals(axes, halves, ["mediocre odometry", "poor odometry"])
    axes.set(xlabel="robots lost of 360 with a ring of sonars (%), 95 % interval", xlim=(-2, 100))
    save(axes, "localizer")

    draw_limits(known)


def draw_planners(published: Sequence[Figure]) -> None:
    """Draw how much more than the reference's the routes of each planner cost."""
    median, worst = (
        chosen(published, f"cost above the reference, {part}", "") for part in ("median", "worst")
    )
    axes = axes_of([f for f in median if "; 1 s;" in f.conditions], height=3.3)
    for k, seconds in enumerate(("1 s", "5 s")):
        pairs = [
            (float(a.value), float(b.value))
            for a, b in zip(median, worst, strict=True)
            if f"; {seconds};" in a.conditions
        ]
        for at, pair in enumerate(pairs):
            height = at + (k - 0.5) * 0.44
            axes.plot(pair, [height] * 2, color=SERIES[k], lw=1.2)
            axes.plot(
                pair[0], height, MARKS[k], color=SERIES[k], ms=6,
                label=f"{seconds}: median" if at == 0 else None,
            )  # fmt: skip
            axes.plot(
                pair[1], height, MARKS[k], mfc="white", color=SERIES[k], ms=6,
                label=f"{seconds}: worst of 60" if at == 0 else None,
            )  # fmt: skip
    axes.set_xscale("log")
    axes.set(xlabel="cost of the route above the reference's (%)", xlim=(0.01, 500))
    axes.set_xticks([0.01, 0.1, 1, 10, 100], ["0.01", "0.1", "1", "10", "100"])
    add_legend(axes)
    save(axes, "planner")


def draw_limits(published: Sequence[Figure]) -> None:
    """Draw for how many pairs of places in each building a better route exists."""
    kinds = {
        "weight 5 halves the bad metres": "pairs whose bad metres weight 5 halves",
        "only another weight does": "pairs whose bad metres only another weight halves",
        "no weight does": "pairs for which no weight does",
    }
    parts = [
        [f for f in chosen(published, quantity, "") if not f.conditions.endswith("all")]
        for quantity in kinds.values()
    ]
    axes = axes_of(parts[0], height=2.5)
    left = [0.0] * len(parts[0])
    for part, name, colour, hatch in zip(
        parts, kinds, (SERIES[0], SERIES[5], "0.8"), ("", "//", ""), strict=True
    ):
        values = [float(f.value) for f in part]
        axes.barh(
            range(len(values)), values, 0.6, left=left, color=colour, hatch=hatch,
            edgecolor="white", label=name,
        )  # fmt: skip
        left = [a + b for a, b in zip(left, values, strict=True)]
    axes.set(
        xlabel="pairs of places whose shortest route has 1 m or more of bad floor", xlim=(0, 10)
    )
    add_legend(axes)
    save(axes, "limits")


def chosen(published: Sequence[Figure], quantity: str, conditions: str) -> list[Figure]:
    """Return the figures of a quantity under some conditions."""
    return [f for f in published if f.what.startswith(quantity) and conditions in f.conditions]


def ending(published: Sequence[Figure], condition: str) -> list[Figure]:
    """Return the figures whose last condition is this one."""
    return [f for f in published if f.conditions.endswith(f"; {condition}")]


def axes_of(rows: Sequence[Figure], *, height: float, last: int = 0) -> Axes:
    """Return axes with a row for each figure, named by its last condition but `last`."""
    axes = new_figure(WIDTH, height).subplots()
    names = [f.conditions.split("; ")[-1 - last] for f in rows]
    axes.set_yticks(range(len(rows)), names, fontsize=8)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.tick_params(axis="x", labelsize=8)
    axes.xaxis.label.set_fontsize(8.5)
    axes.grid(axis="x", color="0.9", lw=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    return axes


def draw_intervals(axes: Axes, series: Sequence[Sequence[Figure]], names: Sequence[str]) -> None:
    """Draw each figure as a mark with its interval, the series beside each other in a row."""
    for k, (part, name) in enumerate(zip(series, names, strict=True)):
        at = [row + (k - (len(series) - 1) / 2) * 0.3 for row in range(len(part))]
        values = [float(f.value) for f in part]
        ends = [[float(end) for end in re.findall(r"[-+]?[\d.]+", f.spread)[:2]] for f in part]
        errors = [
            [value - low for value, (low, _) in zip(values, ends, strict=True)],
            [high - value for value, (_, high) in zip(values, ends, strict=True)],
        ]
        axes.errorbar(
            values, at, xerr=errors, fmt=MARKS[k], color=SERIES[k], ms=5.5, capsize=2.5, lw=1.4,
            label=name or None,
        )  # fmt: skip
    if len(series) > 1:
        add_legend(axes)


def add_legend(axes: Axes) -> None:
    """Put the legend above the axes."""
    axes.legend(loc="lower center", bbox_to_anchor=(0.4, 1.0), ncols=2, fontsize=8, frameon=False)


def save(axes: Axes, name: str) -> None:
    """Write a picture of the page."""
    save_figure(axes, IMAGES / f"measured-{name}.png")


if __name__ == "__main__":
    main()
