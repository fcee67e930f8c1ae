"""The learning curve of a training: outcomes of the episodes over the steps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from matplotlib.axes import Axes

from ambinav.plotting.canvas import new_figure
from ambinav.plotting.style import BLUE, OUTCOMES, SKY
from ambinav.runtime.files import replacing
from ambinav_envs.training.progress import Row

ENDS: Final = {
    "collided": "collided",
    "timeout": "out of time",
    "missed": "stopped elsewhere",
    "lost": "ever lost",
}
"""Lines drawn beside arrival, and their names."""
Line = tuple[list[float], list[float]]


def plot_curve(rows: Sequence[Row], path: Path) -> None:
    """Plot the rows of a table of progress.

    Args:
        rows: See `folder.COLUMNS`.
        path: The picture, a .png.
    """
    figure = new_figure(10.0, 4.2)
    left, right = figure.subplots(1, 2, sharex=True).tolist()
    most = max((row["steps"] or 0.0 for row in rows), default=0.0)
    unit, name = (1e6, "million steps") if most >= 1e6 else (1e3, "thousand steps")
    for kind, colour, mark, label in (
        ("train", SKY, "", "in training, with exploration"),
        ("eval", BLUE, "o", "judged, without exploration"),
    ):
        _draw(left, _line(rows, f"{kind}_arrived", unit), color=colour, marker=mark, label=label)
    for key, label in ENDS.items():
        colour, mark, _ = OUTCOMES[key]
        _draw(right, _line(rows, f"eval_{key}", unit), color=colour, marker=mark, label=label)
    left.set_title("arrived", loc="left")
    right.set_title("how else it ends, judged", loc="left")
    top = max([5.0, *(y for key in ENDS for y in _line(rows, f"eval_{key}", unit)[1])])
    for axes, high in ((left, 100.0), (right, top)):
        axes.set_ylim(0.0, 1.04 * high)
        axes.set_xlim(0.0, most / unit or 1.0)
        axes.set_xlabel(name)
        axes.set_ylabel("% of episodes")
        axes.grid(color="#DDDDDD", linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        if axes.lines:
            # Below: lines and the marks of stages may be anywhere.
            axes.legend(
                frameon=False, fontsize="small", loc="upper left", bbox_to_anchor=(-0.16, -0.14),
                ncols=4, columnspacing=1.0, handlelength=1.4,
            )  # fmt: skip
    _stages(left, rows, unit)
    _minutes(left, rows, unit)
    with replacing(path) as fresh:
        figure.savefig(fresh, format="png")


def _draw(axes: Axes, line: Line, **look: Any) -> None:
    """Draw a line if it has points; markers at the edges are not clipped."""
    if line[0]:
        axes.plot(*line, markersize=4, clip_on=False, zorder=3, **look)


def _line(rows: Sequence[Row], column: str, unit: float) -> Line:
    """Return steps and percentages of a column, where it has values."""
    points = [(row["steps"] or 0.0, value) for row in rows if (value := row[column]) is not None]
    points = [(steps, value) for steps, value in points if math.isfinite(value)]
    return [steps / unit for steps, _ in points], [100.0 * value for _, value in points]


def _stages(axes: Axes, rows: Sequence[Row], unit: float) -> None:
    """Draw lines where the paths become longer."""
    for before, row in itertools.pairwise(rows):
        longest, at = row["longest"], before["steps"] or 0.0
        if longest != before["longest"]:
            axes.axvline(at / unit, color="#999999", linewidth=0.8, linestyle=":")
            label = f" to {longest:g} m"
            axes.text(at / unit, 2.0, label, rotation=90, va="bottom", fontsize="x-small")


def _minutes(axes: Axes, rows: Sequence[Row], unit: float) -> None:
    """Write the duration of the training."""
    if not rows:
        return
    steps = (rows[-1]["steps"] or 0.0) / unit
    duration = duration_text(rows[-1]["seconds"] or 0.0)
    axes.text(
        1.0, 1.02, f"{steps:.3g} {'million' if unit == 1e6 else 'thousand'} steps in {duration}",
        transform=axes.transAxes, ha="right", fontsize="small", color="#555555",
    )  # fmt: skip


def duration_text(seconds: float) -> str:
    """Return a duration in seconds, or from 100 of them in minutes."""
    return f"{seconds:.0f} seconds" if seconds < 99.5 else f"{seconds / 60.0:.1f} minutes"
