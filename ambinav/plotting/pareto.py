"""The picture of a front: what ambiguity costs in length, and what a longer route saves."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ambinav.plotting import style
from ambinav.plotting.canvas import new_figure, root_figure
from ambinav.routes.bad_floor import BadFloor
from ambinav.routes.pareto import ParetoFront
from ambinav.routes.route import Floats

Mask = NDArray[np.bool_]

LINE_COLOUR: Final = style.BLUE
DOMINATED_COLOUR: Final = style.SOLID
LONGEST_COLOUR: Final = style.VERMILLION
_FONT: Final = 10
_TOUCHING: Final = 5.0
"""Marks so near to each other, in points, share one label."""
_AROUND: Final = (
    (7, 4), (7, -15), (-7, -15), (-7, 4), (0, 8), (0, -20), (9, -6), (-9, -6),
    (16, 14), (-16, 14), (16, -26), (-16, -26), (0, 22), (0, -34), (30, 18), (30, -28),
    (-30, 18), (-30, -28), (0, 38), (30, 34), (-30, 34), (0, 54), (-40, 50), (-40, -44),
)  # fmt: skip
"""Where a label may stand from its point, in points; the first free one is taken."""

_LONGEST: Final[dict[str, Any]] = {
    "marker": "s", "markersize": 4.5, "linestyle": (0, (4, 2)), "linewidth": 1.3
}  # fmt: skip
"""Look of the line through longest stretches."""
_FAR: Final = 20.5
"""Labels further from their point than this, in points, are joined to it by a line."""


def plot_pareto(front: ParetoFront, *, title: str | None = None) -> Figure:
    """Draw extra length against exposure, and against metres in corridor and in open zones.

    Beside the metres in a zone stands the longest stretch of them. Each point is labelled with
    its weight; points that no weight needs to choose, because another is better in both length
    and exposure, are hollow.

    Args:
        front: Routes between the same two poses for several weights.
        title: None names the environment and the scanner.
    """
    first = front.points[0].route
    figure = new_figure(14.5, 4.8)
    panels = figure.subplots(1, 3).tolist()
    figure.suptitle(
        title or f"Length and ambiguity by weight: {first.scanner} in {first.environment}",
        x=0.01,
        ha="left",
        fontsize=13,
    )
    extra, dominated = 100.0 * np.array(front.extra), np.array(front.dominated)
    floors = [BadFloor.of(point.route) for point in front.points]
    exposure = np.array([point.route.exposure for point in front.points])
    corridor, longest_corridor, wide, longest_wide = np.array(
        [(f.corridor, f.longest_corridor, f.open, f.longest_open) for f in floors]
    ).T
    panel_values = (
        (exposure, None, f"exposure: integral of {first.layer} along the route (m)"),
        (corridor, longest_corridor, "length in corridor zones (m)"),
        (wide, longest_wide, "length in open zones (m)"),
    )
    for axes, (values, longest, label) in zip(panels, panel_values, strict=True):
        _frame(axes, label)
        _draw(axes, extra, values, dominated)
        if longest is not None:
            _draw_longest(axes, extra, longest, dominated)
    handles = [Line2D([], [], color=LINE_COLOUR, marker="o", label="not dominated")]
    if dominated.any():
        handles.append(
            Line2D(
                [],
                [],
                color=DOMINATED_COLOUR,
                marker="o",
                markerfacecolor="white",
                linestyle="none",
                label="dominated: another is no longer and no more exposed",
            )
        )
    handles.append(Line2D([], [], color=LONGEST_COLOUR, label="longest stretch", **_LONGEST))
    handles.append(Line2D([], [], linestyle="none", label="numbers: weight"))
    figure.legend(
        handles=handles, loc="outside lower left", frameon=False, fontsize=_FONT, ncol=len(handles)
    )
    # Positions are final only now; labels are laid by them.
    figure.draw_without_rendering()
    weights = [f"{point.weight:g}" for point in front.points]
    for axes, (values, longest, _) in zip(panels, panel_values, strict=True):
        _label(axes, extra, values, longest, ~dominated, weights)
    return figure


def _frame(axes: Axes, label: str) -> None:
    axes.set_xlabel("extra length over the shortest route (%)", fontsize=_FONT + 1)
    axes.set_ylabel(label, fontsize=_FONT + 1)
    axes.tick_params(labelsize=_FONT)
    axes.xaxis.set_major_locator(MaxNLocator(6))
    axes.grid(color="#DDDDDD", linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _draw(axes: Axes, extra: Floats, values: Floats, dominated: Mask) -> None:
    best = ~dominated
    order = np.flatnonzero(best)[np.argsort(extra[best], kind="stable")]
    axes.plot(
        extra[order],
        values[order],
        color=LINE_COLOUR,
        marker="o",
        markersize=7,
        linewidth=1.8,
        zorder=3,
    )
    axes.plot(
        extra[dominated],
        values[dominated],
        color=DOMINATED_COLOUR,
        marker="o",
        markersize=7,
        markerfacecolor="white",
        linestyle="none",
        zorder=4,
    )
    # From zero on, so that a small saving does not look like a large one; and with room for labels.
    top = float(values.max()) if values.max() > 0.0 else 1.0
    axes.set_ylim(-0.03 * top, 1.15 * top)
    wide = max(float(extra.max()), 1.0)
    axes.set_xlim(-0.08 * wide, 1.15 * wide)


def _draw_longest(axes: Axes, extra: Floats, longest: Floats, dominated: Mask) -> None:
    """The longest stretch of each route that is not dominated."""
    order = np.flatnonzero(~dominated)[np.argsort(extra[~dominated], kind="stable")]
    axes.plot(extra[order], longest[order], color=LONGEST_COLOUR, zorder=5, **_LONGEST)


def _label(
    axes: Axes,
    extra: Floats,
    values: Floats,
    longest: Floats | None,
    best: Mask,
    weights: list[str],
) -> None:
    """Weights beside their points: one label for points that touch, none over anything else."""
    scale = 72.0 / root_figure(axes).dpi
    place = axes.transData.transform(np.column_stack([extra, values])) * scale
    inside = axes.get_window_extent()
    frame = Bbox(inside.get_points() * scale)
    drawn = [*place, *_along(place[best])]
    if longest is not None and np.isfinite(longest).all():
        lower = axes.transData.transform(np.column_stack([extra, longest])) * scale
        drawn += [*_along(lower[best])]
    lines = [Bbox.from_bounds(x - 5, y - 5, 10, 10) for x, y in drawn]
    written: list[Bbox] = []
    for group in _touching(place):
        text = _joined([weights[i] for i in group])
        x, y = place[group].mean(axis=0)
        offset, box = _free_spot(x, y, 0.65 * _FONT * len(text), lines, written, frame)
        written.append(box.padded(4.0, 1.0))
        far = math.hypot(*offset) > _FAR
        label = axes.annotate(
            text,
            (float(extra[group].mean()), float(values[group].mean())),
            xytext=offset,
            textcoords="offset points",
            ha=_side(offset),
            va="bottom",
            fontsize=_FONT,
            zorder=5,
            arrowprops={"arrowstyle": "-", "color": "#777777", "lw": 0.8} if far else None,
        )
        label.set_in_layout(False)  # the positions are computed for the axes as they are


def _free_spot(
    x: float, y: float, width: float, lines: list[Bbox], written: list[Bbox], frame: Bbox
) -> tuple[tuple[float, float], Bbox]:
    """The best place around a point for a text, and its box; all in points.

    That is the first one within the frame where it overlaps nothing, or else the one where it
    overlaps the fewest other texts, and then the least of the lines.
    """
    choices = []
    for dx, dy in _AROUND:
        left = x + dx - {"left": 0.0, "right": width, "center": 0.5 * width}[_side((dx, dy))]
        box = Bbox.from_bounds(left, y + dy, width, _FONT + 2.0)
        within = box.x0 >= frame.x0 and box.x1 <= frame.x1
        within = within and box.y0 >= frame.y0 and box.y1 <= frame.y1
        faults = box.count_overlaps(written) + (0 if within else 1), box.count_overlaps(lines)
        choices.append((faults, (dx, dy), box))
    _, offset, box = min(choices, key=lambda choice: choice[0])
    return offset, box


def _side(offset: tuple[float, float]) -> str:
    """How a text at this offset is aligned to its point."""
    return "left" if offset[0] > 0 else "right" if offset[0] < 0 else "center"


def _along(place: Floats) -> Floats:
    """Points (M, 2) closely along the line through points (N, 2), from left to right."""
    corners = place[np.argsort(place[:, 0], kind="stable")]
    steps = [np.linspace(a, b, 60) for a, b in pairwise(corners)]
    return np.concatenate([corners, *steps])


def _touching(place: Floats) -> list[list[int]]:
    """Groups of points (N, 2) that a chain of near neighbours joins, in rising order."""
    near = np.hypot(*(place[:, None] - place[None]).transpose(2, 0, 1)) < _TOUCHING
    _, label = connected_components(near, directed=False)
    return [np.flatnonzero(label == part).tolist() for part in dict.fromkeys(label.tolist())]


def _joined(weights: list[str]) -> str:
    """Text for weights that share a point: all of them, or from first to last."""
    return ", ".join(weights) if len(weights) <= 2 else f"{weights[0]} \N{EN DASH} {weights[-1]}"
