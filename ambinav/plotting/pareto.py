"""The picture of a front: extra length against the exposure that it saves."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from ambinav.plotting import style
from ambinav.plotting.canvas import chart, foot, head, new_figure
from ambinav.plotting.labels import FONT, Labelled, along, on_paper, touching, write_labels
from ambinav.routes.bad_floor import BadFloor
from ambinav.routes.pareto import ParetoFront
from ambinav.runtime.array_types import Bools, Floats

LINE_COLOUR: Final = style.BLUE
DOMINATED_COLOUR: Final = style.SOLID
LONGEST_COLOUR: Final = style.VERMILLION
_LONGEST: Final[dict[str, Any]] = {
    "marker": "s", "markersize": 4.5, "linestyle": (0, (4, 2)), "linewidth": 1.3
}  # fmt: skip
"""Look of the line through longest stretches."""


def plot_pareto(front: ParetoFront, *, title: str | None = None) -> Figure:
    """Draw extra length against exposure, and against metres in corridor and in open zones.

    With forecasts a fourth panel has the share of robots that get lost. Beside the metres in a zone
    stands the longest stretch of them. Each point is labelled with its weight; points that no
    weight needs to choose, because another is better in both length and exposure, are hollow.

    Args:
        front: Routes between the same two poses for several weights.
        title: None names the environment and the scanner.
    """
    first = front.points[0].route
    lost = [point.lost for point in front.points if point.lost is not None]
    forecast = len(lost) == len(front.points)
    count = 4 if forecast else 3
    figure = new_figure(4.8 * count, 4.8)
    panels = figure.subplots(1, count).tolist()
    head(figure, title or f"Length and ambiguity by weight: {first.scanner} in {first.environment}")
    extra, dominated = 100.0 * np.array(front.extra), np.array(front.dominated)
    floors = [BadFloor.of(point.route) for point in front.points]
    exposure = np.array([point.route.exposure for point in front.points])
    corridor, longest_corridor, wide, longest_wide = np.array(
        [(f.corridor, f.longest_corridor, f.open, f.longest_open) for f in floors]
    ).T
    panel_values: list[tuple[Floats, Floats | None, str]] = [
        (exposure, None, f"exposure: integral of {first.layer} along the route (m)"),
        (corridor, longest_corridor, "length in corridor zones (m)"),
        (wide, longest_wide, "length in open zones (m)"),
    ]
    if forecast:
        panel_values.append((100.0 * np.array(lost), None, "robots that get lost, forecast (%)"))
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
    foot(figure, handles)
    # Positions are final only now, and labels depend on them.
    figure.draw_without_rendering()
    weights = [f"{point.weight:g}" for point in front.points]
    for axes, (values, longest, _) in zip(panels, panel_values, strict=True):
        _label(axes, extra, values, longest, ~dominated, weights)
    return figure


def _frame(axes: Axes, label: str) -> None:
    axes.set_xlabel("extra length over the shortest route (%)", fontsize=FONT + 1)
    axes.set_ylabel(label, fontsize=FONT + 1)
    axes.tick_params(labelsize=FONT)
    axes.xaxis.set_major_locator(MaxNLocator(6))
    chart(axes)


def _draw(axes: Axes, extra: Floats, values: Floats, dominated: Bools) -> None:
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


def _draw_longest(axes: Axes, extra: Floats, longest: Floats, dominated: Bools) -> None:
    """Draw the longest stretch of each route that is not dominated."""
    order = np.flatnonzero(~dominated)[np.argsort(extra[~dominated], kind="stable")]
    axes.plot(extra[order], longest[order], color=LONGEST_COLOUR, zorder=5, **_LONGEST)


def _label(
    axes: Axes,
    extra: Floats,
    values: Floats,
    longest: Floats | None,
    best: Bools,
    weights: list[str],
) -> None:
    """Draw weights beside their points without overlap; touching points share a label."""
    place = on_paper(axes, np.column_stack([extra, values]))
    drawn = [*place, *along(place[best])]
    if longest is not None and np.isfinite(longest).all():
        drawn += [*along(on_paper(axes, np.column_stack([extra, longest]))[best])]
    labels = (
        Labelled(
            _weights_text([weights[i] for i in group]),
            (float(extra[group].mean()), float(values[group].mean())),
            place[group].mean(axis=0),
            {"fontsize": FONT, "zorder": 5},
        )
        for group in touching(place)
    )
    join = {"color": "#777777", "lw": 0.8}
    write_labels(axes, labels, drawn, letter=0.65, padding=(4.0, 1.0), join=join)


def _weights_text(weights: list[str]) -> str:
    """Format weights that share a point: all of them, or first to last."""
    return ", ".join(weights) if len(weights) <= 2 else f"{weights[0]} \N{EN DASH} {weights[-1]}"
