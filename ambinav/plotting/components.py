"""The picture of "no way": what can be reached from the start, and from the goal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ambinav.errors import InputError
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import UNREACHABLE_COLOUR
from ambinav.plotting.backdrop import area_text, colour_patch, outside_patches
from ambinav.plotting.legends import floor_legend
from ambinav.plotting.maps import draw_image, finish, floor_axes, view
from ambinav.plotting.route_lines import GOAL, START, draw_ends, root_figure

FROM_START: Final = "#5B3A8E"
FROM_GOAL: Final = "#8FD694"
FROM_NEITHER: Final = "#FFFFFF"
NO_ROOM: Final = UNREACHABLE_COLOUR
"""Fill of floor by what it can be reached from; dark and light, none a colour of the zones."""


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
) -> Figure:
    """Draw the part of the floor that the start lies in, and that of the goal.

    Args:
        amap: The map.
        labels: Shape (rows, columns) of the map's lattice: number of the part that each cell
            belongs to, -1 where the robot does not fit.
        start: x, y in metres; more is not looked at.
        goal: As `start`.
        start_label: Label of the part that the start lies in; if no cell has it, the start
            reaches none.
        goal_label: Label of the part that the goal lies in.
        ax: Where to draw; None makes a figure of its own.
        title: None says that there is no way.

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
        (FROM_START, "reachable from the start", from_start),
        (FROM_GOAL, "reachable from the goal", from_goal),
        (FROM_NEITHER, "reachable from neither", fits & ~from_start & ~from_goal),
        (NO_ROOM, "no room for the robot", free & (labels < 0)),
    ]
    picture = np.zeros((*free.shape, 4))
    for colour, _, cells in entries:
        picture[cells] = to_rgba(colour)
    axes = floor_axes(amap) if ax is None else ax
    draw_image(axes, amap, picture)
    finish(axes, amap, title or f"No way from start to goal in {amap.dataset.attrs['environment']}")
    draw_ends(axes, [(start[0], start[1], START), (goal[0], goal[1], GOAL)], zorder=10)
    floor_legend(
        axes,
        amap,
        [
            colour_patch(colour, f"{text}\n{area_text(float(cells.sum()) * amap.spacing**2)}")
            for colour, text, cells in entries
            if cells.any()
        ]
        + outside_patches(amap, view(amap)),
    )
    return root_figure(axes)
