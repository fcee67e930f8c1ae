"""The picture of "no path found": floor reachable from the start, and from the goal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting import style
from ambinav.plotting.canvas import root_figure
from ambinav.plotting.floor import FloorFigure, label_points, rgba_bytes
from ambinav.plotting.legend_patches import colour_patch
from ambinav.reports.number_text import metres2
from ambinav.runtime.errors import InputError


def plot_components(
    amap: AmbiguityMap,
    labels: NDArray[np.integer],
    start: Sequence[float],
    goal: Sequence[float],
    start_label: int,
    goal_label: int,
    ax: Axes | None = None,
    *,
    title: str | None = None,
    narrowest: tuple[float, float, float] | None = None,
) -> Figure:
    """Draw the part of the floor that the start lies in, and that of the goal.

    Args:
        amap: The map.
        labels: Shape (rows, columns) of the map's lattice: number of the part that each cell
            belongs to, -1 where the robot does not fit.
        start: x, y in metres; more is not looked at.
        goal: Goal, in the form of `start`.
        start_label: Label of the part that the start lies in; if no cell has it, the start
            reaches none.
        goal_label: Label of the part that the goal lies in.
        ax: Axes to draw on; None makes a figure of its own.
        title: None says that no path was found.
        narrowest: x, y and width, metres, of the narrowest place of the widest way; None: no mark.

    Raises:
        InputError: the labels have another shape than the lattice.
    """
    free = amap.dataset["free"].values
    if labels.shape != free.shape:
        raise InputError(
            f"labels has the shape {labels.shape}; the map's lattice has {free.shape}."
        )
    fits = labels >= 0
    from_start, from_goal = fits & (labels == start_label), fits & (labels == goal_label)
    entries = [
        (style.FROM_START, "reachable from the start", from_start),
        (style.FROM_GOAL, "reachable from the goal", from_goal),
        (style.FLOOR, "reachable from neither", fits & ~from_start & ~from_goal),
        (style.UNREACHABLE, "no room for the robot", free & (labels < 0)),
    ]
    picture = np.zeros((*free.shape, 4), dtype=np.uint8)
    for colour, _, cells in entries:
        picture[cells] = rgba_bytes(colour)
    building = amap.dataset.attrs["environment"]
    title = title or f"No path from start to goal in {building}"
    floor = FloorFigure(amap, ax, title)
    floor.paint(picture)
    label_points(floor.axes, [(start[0], start[1], style.START), (goal[0], goal[1], style.GOAL)])
    patches = [
        colour_patch(colour, f"{text}\n{metres2(float(cells.sum()) * amap.spacing**2)}")
        for colour, text, cells in entries
        if cells.any()
    ]
    handles = [*patches, *floor.outside_patches()]
    if narrowest is not None:
        x, y, width = narrowest
        handles += floor.axes.plot(
            x, y, linestyle="none", marker="D", markersize=6.0, markerfacecolor="none",
            markeredgecolor="black", label=f"narrowest place,\n{width:.2f} m wide",
        )  # fmt: skip
    floor.legend(handles)
    return root_figure(floor.finish())
