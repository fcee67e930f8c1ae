"""Bad floor, or lost robots, over the cost of changes: the curve of gain over cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from ambinav.plotting import style
from ambinav.plotting.canvas import new_figure
from ambinav.plotting.labels import FONT

FRONT: Final = style.BLUE
OTHERS: Final = style.SOLID
ROOM: Final = 0.06
"""Margin around the points, as a share of the axes."""


@dataclass(frozen=True)
class CostPoint:
    """Changes with their cost and what they leave: bad floor (m²) or lost robots (%)."""

    cost: float
    left: float
    on_front: bool


@dataclass(frozen=True)
class CostCurve:
    """Points of the curve and what is marked on it.

    Attributes:
        points: Points, by rising cost.
        chosen: Cost of the recommended changes, what they leave, and their label.
        counted: Floor that counts, square metres: 100 % of the right axis. None: the points leave
            lost robots.
        limit: What may be left, and its label; None: there is no such limit.
        budget: Largest cost; None: not limited.
        advised: Whether the chosen changes are what was asked for; else the best found.
    """

    points: Sequence[CostPoint]
    chosen: tuple[float, float, str]
    counted: float | None
    limit: tuple[float, str] | None = None
    budget: float | None = None
    advised: bool = True


def plot_cost_curve(curve: CostCurve, title: str) -> Figure:
    """Draw a curve; the points on the front are joined, the recommended changes marked."""
    figure = new_figure(8.6, 5.0)
    axes = figure.subplots()
    axes.set_title(title, loc="left", fontsize=13)
    axes.set_xlabel("cost of all changes (currency of the costs file)", fontsize=FONT + 1)
    name = "bad floor" if curve.counted else "share of lost robots"
    axes.set_ylabel(
        "bad floor (m²)" if curve.counted else "robots lost on the worst trip, forecast (%)",
        fontsize=FONT + 1,
    )
    axes.grid(color="#DDDDDD", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines["top"].set_visible(False)
    front = sorted((point.cost, point.left) for point in curve.points if point.on_front)
    others = [(point.cost, point.left) for point in curve.points if not point.on_front]
    if others:
        axes.plot(
            *zip(*others, strict=True), "o", color=OTHERS, markerfacecolor="white", markersize=5,
            label="no better than another for its cost",
        )  # fmt: skip
    # There is nothing between two sets of changes, so the line has steps.
    axes.plot(
        *zip(*front, strict=True), "o-", color=FRONT, markersize=6, linewidth=1.6,
        drawstyle="steps-post", label=f"least {name} found for its cost",
    )  # fmt: skip
    cost, left, label = curve.chosen
    verdict = "recommended" if curve.advised else "best found"
    axes.plot(
        [cost], [left], "o", color="none", markeredgecolor="black", markeredgewidth=1.8,
        markersize=13, linestyle="none", label=f"{verdict}: {label}",
    )  # fmt: skip
    if curve.limit is not None:
        axes.axhline(curve.limit[0], color="black", linestyle="--", label=curve.limit[1])
    if curve.budget is not None:
        axes.axvline(curve.budget, color="black", linestyle=":", label="budget")
    most = max(max(point.cost for point in curve.points), curve.budget or 0.0)
    most = most or 1.0
    axes.set_xlim(-ROOM * most, (1.0 + ROOM) * most)
    high = max(max(point.left for point in curve.points), (curve.limit or (0.0,))[0], 1e-9)
    axes.set_ylim(-ROOM * high, (1.0 + ROOM) * high)
    if curve.counted:
        percent = 100.0 / curve.counted
        share = axes.secondary_yaxis(
            "right",
            functions=(
                lambda m2: np.asarray(m2) * percent, lambda part: np.asarray(part) / percent
            ),
        )  # fmt: skip
        share.set_ylabel("share of the floor that counts (%)", fontsize=FONT + 1)
    figure.legend(loc="outside lower left", frameon=False, fontsize=FONT, ncol=2)
    return figure
