"""Parts of a picture of routes: cased lines, marks of their ends, ellipses of covariances."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke

from ambinav.routes.files import trace
from ambinav.routes.route import Floats, Route

START: Final = "S"
GOAL: Final = "G"
"""Letters that mark where routes begin and end."""


class Style(NamedTuple):
    """How one of several routes is drawn."""

    colour: str
    casing: str
    dashes: tuple[float, ...]


# Dark lines are cased in white and light ones in black, so that each stays visible on all four
# colours of the zones. Neighbours in the list differ in lightness, hence for every kind of
# colour blindness and in grey print; from the fifth on the dashes tell them apart as well.
STYLES: Final = (
    Style("#000000", "#FFFFFF", ()),
    Style("#3DF2B0", "#000000", ()),
    Style("#5B1A9A", "#FFFFFF", ()),
    Style("#FFF36B", "#000000", ()),
    Style("#000000", "#FFFFFF", (4.0, 1.6)),
    Style("#3DF2B0", "#000000", (4.0, 1.6)),
    Style("#5B1A9A", "#FFFFFF", (4.0, 1.6)),
    Style("#FFF36B", "#000000", (4.0, 1.6)),
)

NARROWEST: Final = 2.2
WIDEST: Final = 9.0
CASING: Final = 0.8
"""Widths in points; the casing's on each side."""

SIGMAS: Final = 2.0
"""Radius of the ellipses in standard deviations: 86 % of a plane normal distribution."""


def style(number: int) -> Style:
    """Style of the route with this number, from 0 on; they repeat after the eighth."""
    return STYLES[number % len(STYLES)]


def widths(count: int) -> Floats:
    """Line widths of routes in their order, points.

    The first is the widest and lies lowest: where routes run together, all of them show.
    """
    if count == 1:
        return np.array([0.5 * (NARROWEST + WIDEST)])
    return np.linspace(min(WIDEST, NARROWEST + 2.8 * (count - 1)), NARROWEST, count)


def route_line(look: Style, width: float, poses: Floats | None = None) -> Line2D:
    """A cased line along poses (M, 3), or one for a legend."""
    x, y = ([], []) if poses is None else poses[:, :2].T.tolist()
    line = Line2D(
        x,
        y,
        color=look.colour,
        linewidth=width,
        solid_joinstyle="round",
        dash_joinstyle="round",
        solid_capstyle="round",
        dash_capstyle="butt",
        path_effects=[Stroke(linewidth=width + 2.0 * CASING, foreground=look.casing), Normal()],
    )
    if look.dashes:
        line.set_dashes(look.dashes)
    return line


def draw_route(axes: Axes, route: Route, look: Style, width: float, *, zorder: float) -> None:
    """Draw one route, curves as curves."""
    line = route_line(look, width, trace(route))
    line.set_zorder(zorder)
    axes.add_line(line)


def draw_ellipses(axes: Axes, route: Route, look: Style, *, gap: float, zorder: float) -> None:
    """Ellipses of the predicted position, `SIGMAS` standard deviations, along a route.

    Args:
        axes: Where to draw.
        route: With covariances.
        look: Of the route.
        gap: Metres along the route between two ellipses, at least; the last pose has one.
        zorder: Where in the picture's stack.
    """
    if route.covariances is None:
        raise ValueError("this route has no covariances")
    chosen = _apart(route.distance, gap)
    values, vectors = np.linalg.eigh(route.covariances[chosen, :2, :2])
    full = 2.0 * SIGMAS * np.sqrt(np.maximum(values, 0.0))
    angle = np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1]))
    for colour, width in ((look.casing, 2.6), (look.colour, 1.2)):
        axes.add_collection(
            EllipseCollection(
                full[:, 1],
                full[:, 0],
                angle,
                units="xy",
                offsets=route.poses[chosen, :2],
                offset_transform=axes.transData,
                facecolors="none",
                edgecolors=colour,
                linewidths=width,
                zorder=zorder,
            ),
            autolim=False,
        )


def draw_ends(axes: Axes, ends: Iterable[tuple[float, float, str]], *, zorder: float) -> None:
    """Round labels with a letter at points (x, y, letter), each place once."""
    for x, y, letter in dict.fromkeys((round(x, 3), round(y, 3), text) for x, y, text in ends):
        axes.annotate(
            letter,
            (x, y),
            ha="center",
            va="center_baseline",
            fontsize=11,
            fontweight="bold",
            color="black",
            bbox={
                "boxstyle": "circle,pad=0.22",
                "facecolor": "white",
                "edgecolor": "black",
                "linewidth": 1.6,
            },
            zorder=zorder,
        )


def root_figure(axes: Axes) -> Figure:
    """The figure that holds some axes, also where a part of a figure lies between."""
    figure = axes.get_figure(root=True)
    if figure is None:
        raise ValueError("these axes were removed from their figure")
    return figure


def _apart(distance: Floats, gap: float) -> list[int]:
    """Indices of the last pose, and of poses at least `gap` metres apart before it."""
    chosen, free_below = [], math.inf
    for i in range(len(distance) - 1, -1, -1):
        if distance[i] <= free_below:
            chosen.append(i)
            free_below = distance[i] - gap
    return chosen
