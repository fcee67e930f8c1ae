"""Labels of points in a chart, placed beside their points without overlap where possible."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.transforms import Bbox
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components

from ambinav.plotting.canvas import root_figure
from ambinav.runtime.array_types import Floats

FONT: Final = 10
"""Points, of the letters."""
FAR: Final = 20.5
"""Labels further from their point than this, in points, are joined to it by a line."""
_TOUCHING: Final = 5.0
"""Marks so near to each other, in points, share one label."""
_AROUND: Final = (
    (7, 4), (7, -15), (-7, -15), (-7, 4), (0, 8), (0, -20), (9, -6), (-9, -6),
    (16, 14), (-16, 14), (16, -26), (-16, -26), (0, 22), (0, -34), (30, 18), (30, -28),
    (-30, 18), (-30, -28), (0, 38), (30, 34), (-30, 34), (0, 54), (-40, 50), (-40, -44),
)  # fmt: skip
"""Offsets of a label from its point, in points; the first free one is taken."""


class Labelled(NamedTuple):
    """A text for a point of a chart.

    Attributes:
        text: The text.
        at: The point, in the units of the axes.
        place: The same on paper, points.
        look: Arguments of Matplotlib's `annotate`.
    """

    text: str
    at: tuple[float, float]
    place: Floats
    look: Mapping[str, Any]


def on_paper(axes: Axes, points: ArrayLike) -> Floats:
    """Convert points of a chart (N, 2) to points on paper, 72 an inch."""
    return np.asarray(axes.transData.transform(points) * 72.0 / root_figure(axes).dpi)


def write_labels(
    axes: Axes,
    labels: Iterable[Labelled],
    drawn: Iterable[Floats],
    *,
    letter: float,
    padding: tuple[float, float],
    join: Mapping[str, Any],
) -> None:
    """Write texts beside their points without overlap where possible, the first ones first.

    Args:
        axes: The chart; its layout is final.
        labels: The texts.
        drawn: Points on paper that no text should hide.
        letter: Width of a letter, as a share of its height.
        padding: Room around a text, points.
        join: Look of the line from a text to a point far from it.
    """
    frame = Bbox(axes.get_window_extent().get_points() * 72.0 / root_figure(axes).dpi)
    lines = [Bbox.from_bounds(x - 5, y - 5, 10, 10) for x, y in drawn]
    written: list[Bbox] = []
    for text, at, (x, y), look in labels:
        offset, box = free_spot(x, y, letter * FONT * len(text), lines, written, frame)
        written.append(box.padded(*padding))
        arrow = {"arrowstyle": "-", **join} if math.hypot(*offset) > FAR else None
        label = axes.annotate(
            text, at, xytext=offset, textcoords="offset points", ha=alignment(offset), va="bottom",
            arrowprops=arrow, **look,
        )  # fmt: skip
        label.set_in_layout(False)  # the positions are computed for the axes as they are


def free_spot(
    x: float, y: float, width: float, lines: list[Bbox], written: list[Bbox], frame: Bbox
) -> tuple[tuple[float, float], Bbox]:
    """Find the best place around a point for a text, and its box; all in points.

    That is the first one within the frame where it overlaps nothing, or else the one where it
    overlaps the fewest other texts, and then the least of the lines.
    """
    choices = []
    for dx, dy in _AROUND:
        left = x + dx - {"left": 0.0, "right": width, "center": 0.5 * width}[alignment((dx, dy))]
        box = Bbox.from_bounds(left, y + dy, width, FONT + 2.0)
        within = box.x0 >= frame.x0 and box.x1 <= frame.x1
        within = within and box.y0 >= frame.y0 and box.y1 <= frame.y1
        faults = box.count_overlaps(written) + (0 if within else 1), box.count_overlaps(lines)
        choices.append((faults, (dx, dy), box))
    _, offset, box = min(choices, key=lambda choice: choice[0])
    return offset, box


def alignment(offset: tuple[float, float]) -> str:
    """Return the horizontal alignment of a text at this offset from its point."""
    return "left" if offset[0] > 0 else "right" if offset[0] < 0 else "center"


def along(place: Floats) -> Floats:
    """Return closely spaced points (M, 2) on the line through points (N, 2), left to right."""
    corners = place[np.argsort(place[:, 0], kind="stable")]
    steps = [np.linspace(a, b, 60) for a, b in pairwise(corners)]
    return np.concatenate([corners, *steps])


def touching(place: Floats) -> list[list[int]]:
    """Group points (N, 2) that are joined by chains of near neighbours, in rising order."""
    near = np.hypot(*(place[:, None] - place[None]).transpose(2, 0, 1)) < _TOUCHING
    _, label = connected_components(near, directed=False)
    return [np.flatnonzero(label == part).tolist() for part in dict.fromkeys(label.tolist())]
