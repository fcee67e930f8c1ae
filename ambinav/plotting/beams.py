"""Pictures of a beam subset: the kept beams, and the loss with fewer beams."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from ambinav.plotting import style
from ambinav.plotting.canvas import new_figure
from ambinav.runtime.array_types import Floats

LEFT_OUT: Final = "#C9C9C9"
"""Beams that are left out."""
_LEAST: Final = 0.1
"""Points: where the logarithmic scale of losses begins."""
_POINTS: Final = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)
"""Marks of that scale."""

Curve = tuple[Sequence[int], Sequence[float]]
"""Numbers of beams, and points lost with them."""


def plot_kept_beams(mounts: Floats, reach: Floats, beams: Sequence[int], title: str = "") -> Figure:
    """Draw the beams around the robot, which looks up: those that are kept, and the others.

    Args:
        mounts: x, y (metres) and yaw (radians) of each beam, robot frame, shape (B, 3).
        reach: Range to which each is drawn, metres, shape (B,).
        beams: Indices of the beams that are kept.
        title: Above the picture.
    """
    figure = new_figure(5.2, 5.6)
    axes = figure.add_subplot()
    # x forward is up, y left is left.
    start = np.column_stack([-mounts[:, 1], mounts[:, 0]])
    end = start + reach[:, None] * np.column_stack([-np.sin(mounts[:, 2]), np.cos(mounts[:, 2])])
    lines = np.stack([start, end], axis=1)
    chosen = np.zeros(len(mounts), dtype=bool)
    chosen[np.asarray(beams, dtype=np.intp)] = True
    few = int(chosen.sum())
    axes.add_collection(LineCollection(list(lines[~chosen]), colors=LEFT_OUT, linewidths=0.5))
    axes.add_collection(
        LineCollection(list(lines[chosen]), colors=style.ECHO, linewidths=1.6 if few < 60 else 1.0)
    )
    axes.plot(*end[chosen].T, ".", color=style.ECHO, markersize=5)
    size = 0.05 * float(reach.max())
    nose = size * np.array([[0.0, 1.8], [-0.9, -0.8], [0.9, -0.8]])
    axes.add_patch(Polygon(nose, color=style.ROBOT, zorder=5))
    half = 1.06 * float(np.abs(end).max())
    axes.set(xlim=(-half, half), ylim=(-half, half), aspect="equal", title=title)
    axes.set_xlabel("metres to the right (the robot looks up)")
    axes.set_ylabel("metres ahead")
    handles = [Line2D([], [], color=style.ECHO, linewidth=2, label=f"kept ({few})")]
    if few < len(chosen):
        label = f"left out ({len(chosen) - few})"
        handles.append(Line2D([], [], color=LEFT_OUT, linewidth=2, label=label))
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    return figure


def plot_loss_curves(
    curves: Mapping[str, tuple[Curve, Curve]],
    random: tuple[Sequence[int], Sequence[float], Sequence[float], Sequence[float]],
    limit: float,
    chosen: tuple[int, float],
    title: str = "",
) -> Figure:
    """Draw percentage points lost against the number of beams.

    Args:
        curves: Curves by method: on the poses on which beams were chosen, and on other poses.
        random: Numbers of beams; least, mean and greatest loss of random subsets.
        limit: The stated loss, points.
        chosen: Number of beams and loss of the subset that is chosen, on other poses.
        title: Above the picture.
    """
    figure = new_figure(9.2, 4.4)
    axes: Axes = figure.add_subplot()
    count, low, mean, high = random
    axes.fill_between(count, _kept_figures(low), _kept_figures(high), color="#DDDDDD", linewidth=0)
    axes.plot(
        count, _kept_figures(mean), color="#777777", linestyle="-.", label="random: mean and range"
    )
    for number, (method, both) in enumerate(curves.items()):
        where = ("poses it was chosen on", "other poses")
        for (sizes, points), dashes, on in zip(both, (":", "-"), where, strict=True):
            axes.plot(
                sizes, _kept_figures(points), color=style.SERIES[number % len(style.SERIES)],
                linestyle=dashes, linewidth=1.8, label=f"{method}: {on}",
            )  # fmt: skip
    axes.axhline(limit, color="black", linewidth=0.9, label=f"may be lost: {limit:g} points")
    axes.plot(
        chosen[0], max(chosen[1], _LEAST), "o", color="black",
        label=f"chosen: {chosen[0]} beams, {chosen[1]:.1f} points",
    )  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="beams kept", ylabel="percentage points lost")
    axes.set_title(title, loc="left")
    # Smaller losses, none too, are drawn at the lowest mark.
    plain = FuncFormatter(lambda value, _: f"{'≤ ' if value == _LEAST else ''}{value:g}")
    for axis, ticks in ((axes.xaxis, _ticks(max(count))), (axes.yaxis, _POINTS)):
        axis.set_major_locator(FixedLocator(list(ticks)))
        axis.set_major_formatter(plain)
        axis.set_minor_locator(NullLocator())
    axes.grid(alpha=0.3)
    figure.legend(loc="outside right upper", frameon=False)
    return figure


def _kept_figures(points: Sequence[float]) -> list[float]:
    return [max(value, _LEAST) for value in points]


def _ticks(most: int) -> list[int]:
    """Return ticks 1, 2, 5, 10 ... up to `most`."""
    tens = range(int(math.log10(max(most, 1))) + 1)
    return [step * 10**ten for ten in tens for step in (1, 2, 5) if step * 10**ten <= most]
