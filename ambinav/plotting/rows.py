"""Rows of a picture one under the other, in groups with a heading each."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from matplotlib.axes import Axes

Item = TypeVar("Item")

_BETWEEN = 0.4
"""Room between two groups, rows."""


@dataclass(frozen=True)
class Stack(Generic[Item]):
    """Where rows and headings stand; one row is 1 high, downwards.

    Attributes:
        places: Each row with its place.
        headings: Place and text of the heading over each group.
        height: Of all.
    """

    places: list[tuple[float, Item]]
    headings: list[tuple[float, str]]
    height: float


def stacked(rows: Sequence[Item], group: Callable[[Item], str]) -> Stack[Item]:
    """Put rows under the heading of their group, in the order in which they come."""
    places: list[tuple[float, Item]] = []
    headings: list[tuple[float, str]] = []
    y = 0.0
    for name in dict.fromkeys(group(row) for row in rows):
        headings.append((y, name))
        y += 1.0
        for row in rows:
            if group(row) == name:
                places.append((y, row))
                y += 1.0
        y += _BETWEEN
    return Stack(places, headings, y)


def label_rows(axes: Axes, stack: Stack[Item], name: Callable[[Item], str], letters: int) -> None:
    """Write names and headings to the left of axes, names of so many letters at most."""
    axes.set_yticks(
        [at for at, _ in stack.places],
        [textwrap.shorten(name(row), letters, placeholder="...") for _, row in stack.places],
    )
    axes.set_ylim(stack.height - 0.6, -0.6)
    for at, heading in stack.headings:
        axes.annotate(
            textwrap.shorten(heading, 2 * letters), (0.0, at), xytext=(-9, 0), ha="right",
            va="center", xycoords=axes.get_yaxis_transform(), textcoords="offset points",
            fontsize=10, fontweight="bold", annotation_clip=False,
        )  # fmt: skip
