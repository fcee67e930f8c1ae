"""Pictures of routes on the floor map."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import Normal, Stroke

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting import style
from ambinav.plotting.canvas import root_figure
from ambinav.plotting.floor import FloorFigure, Heading, label_points
from ambinav.plotting.legend_patches import zone_patches
from ambinav.plotting.maps import ZONES_OF_ALL, floor_title, paint_zones
from ambinav.plotting.style import GOAL, SIGMAS, START, RouteStyle, route_style
from ambinav.routes.bad_floor import IN_BRACKETS, BadFloor, unexplored_note
from ambinav.routes.files import trace_route
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

LINE: Final = 40
"""Letters to a line of the legend."""
_NARROWEST: Final = 2.2
_WIDEST: Final = 9.0
_CASING: Final = 0.8
"""Widths in points; the casing's on each side."""


def plot_routes(
    amap: AmbiguityMap,
    routes: Mapping[str, Route] | Sequence[Route],
    ax: Axes | None = None,
    *,
    heading: Heading = "mean",
    covariances: bool = True,
    legend: bool = True,
    title: str | None = None,
    kinds: Mapping[str, str] | None = None,
    stops: Sequence[tuple[float, float]] = (),
) -> Figure:
    """Draw routes on the zones of the floor, with their figures in the legend.

    Args:
        amap: The map.
        routes: Routes by name, or a sequence: then the planner and the weight name them. The first
            is drawn lowest and widest, so that all show where they run together. Those that are the
            same path share a line.
        ax: Axes to draw on; None makes a figure of its own.
        heading: "mean", "best", "worst" or radians: of the zones, where the heading matters.
        covariances: Whether to draw ellipses of 2 standard deviations along routes that have
            predicted covariances.
        legend: Whether to tell the routes' figures and the zones.
        title: None names the environment and the scanner.
        kinds: Kind of routes by name, which decides their colour; `route_kind` finds out what is
            left out.
        stops: x, y of stops, metres, which are numbered from 1 on.

    Raises:
        InputError: no routes, or no such heading.
    """
    named = dict(routes) if isinstance(routes, Mapping) else name_routes(routes)
    if not named:
        raise InputError("routes is empty; give at least one route to draw.")
    groups = _same_path(named)
    looks = route_styles({name: named[name] for name in map(_first, groups)}, kinds or {})
    lines = list(zip(looks.values(), _widths(len(groups)).tolist(), strict=True))
    floor = FloorFigure(amap, ax, title or floor_title(amap, "Routes", heading, ZONES_OF_ALL))
    paint_zones(floor, heading, amap.judged)
    uncertain = False
    gap = max(np.ptp(floor.bounds[::2]), np.ptp(floor.bounds[1::2])) / 40.0
    for i, (group, (look, width)) in enumerate(zip(groups, lines, strict=True)):
        route = group[_first(group)]
        line = route_line(look, width, trace_route(route))
        line.set_zorder(6 + 0.01 * i)
        floor.axes.add_line(line)
        if covariances and route.covariances is not None:
            uncertain = True
            _draw_ellipses(floor.axes, route, look, gap=gap, zorder=7 + 0.01 * i)
    ends = [(route.start[:2], route.goal[:2]) for route in named.values()]
    # A tour ends where it starts: one mark has both letters.
    starts = [(*start, START if start != goal else START + GOAL) for start, goal in ends]
    goals = [(*goal, GOAL) for start, goal in ends if start != goal]
    numbered = [(*stop, str(k)) for k, stop in enumerate(stops, start=1)]
    label_points(floor.axes, [*starts, *numbered, *goals])
    if legend:
        floor.legend(zone_patches() + floor.part_patches(amap.judged) + floor.outside_patches())
        handles = [route_line(look, width) for look, width in lines]
        for handle, group in zip(handles, groups, strict=True):
            handle.set_label(describe(group))
        caption = [f"{START}: start", f"{GOAL}: goal", IN_BRACKETS]
        if stops:
            caption.insert(1, "1, 2 ...: stops" if len(stops) > 1 else "1: stop")
        if amap.has_theta:
            caption.append("zones of a route: at its own headings")
        if uncertain:
            caption.append(f"ellipses: {SIGMAS:g} standard deviations of the position")
        floor.legend(handles, caption)
    return root_figure(floor.finish())


def route_kind(route: Route) -> str:
    """Return the kind of a route by its planning purpose, a key of `style.ROUTE_COLOURS`."""
    for kind in ("belief-roadmap", "belief", "policy"):
        if route.planner.startswith(kind):
            return kind
    if route.weight > 0.0:
        return "ambiguity"
    return "clearance" if route.clearance_weight > 0.0 else "shortest"


def route_styles(routes: Mapping[str, Route], kinds: Mapping[str, str]) -> dict[str, RouteStyle]:
    """Return the styles of routes by name, kind by kind; arguments as of `plot_routes`."""
    seen: dict[str, int] = {}
    styles = {}
    for name, route in routes.items():
        kind = kinds.get(name, "")
        kind = kind if kind in style.ROUTE_COLOURS else route_kind(route)
        styles[name] = route_style(kind, seen.get(kind, 0))
        seen[kind] = seen.get(kind, 0) + 1
    return styles


def route_line(look: RouteStyle, width: float, points: Floats | None = None) -> Line2D:
    """Return a cased line along points (M, 2 or more), or one for a legend."""
    x, y = ([], []) if points is None else points[:, :2].T.tolist()
    line = Line2D(
        x,
        y,
        color=look.colour,
        linewidth=width,
        solid_joinstyle="round",
        dash_joinstyle="round",
        solid_capstyle="round",
        dash_capstyle="butt",
        path_effects=[Stroke(linewidth=width + 2.0 * _CASING, foreground=look.casing), Normal()],
    )
    if look.dashes:
        line.set_dashes(look.dashes)
    return line


def name_routes(routes: Sequence[Route]) -> dict[str, Route]:
    """Return names for routes: planner and weight, numbered if two are equal."""
    names = [f"{route.planner}, weight {route.weight:g}" for route in routes]
    return {
        name if names.count(name) == 1 else f"{name} ({names[:i].count(name) + 1})": route
        for i, (name, route) in enumerate(zip(names, routes, strict=True))
    }


def describe(group: Mapping[str, Route]) -> str:
    """Format a legend entry: names, length, cost, metres in corridor and in open zones.

    Args:
        group: Routes by name that are one and the same path. Their cost is given if they were
            planned with the same weight.
    """
    route = group[_first(group)]
    costs = {(round(other.cost, 1), other.weight) for other in group.values()}
    cost = f", cost {route.cost:.1f} (weight {route.weight:g})" if len(costs) == 1 else ""
    floor = BadFloor.of(route)
    lines = [
        textwrap.fill(", ".join(group), LINE),
        f"{route.length:.1f} m{cost}",
        f"corridor {floor.corridor_text()} m, open {floor.open_text()} m",
        unexplored_note(floor),
    ]
    return "\n".join(filter(None, lines))


def _first(group: Mapping[str, Route]) -> str:
    return next(iter(group))


def _same_path(named: Mapping[str, Route]) -> list[dict[str, Route]]:
    """Group the names of routes with the same path, since one line would hide the other."""
    groups: list[dict[str, Route]] = []
    for name, route in named.items():
        for group in groups:
            first = group[_first(group)]
            if (
                first.steering == route.steering
                and np.array_equal(first.poses, route.poses)
                and first.covariances is None
                and route.covariances is None
            ):
                group[name] = route
                break
        else:
            groups.append({name: route})
    return groups


def _widths(count: int) -> Floats:
    """Return the line widths of routes in their order, points.

    The first is the widest and lies lowest: where routes run together, all of them show.
    """
    if count == 1:
        return np.array([0.5 * (_NARROWEST + _WIDEST)])
    return np.linspace(min(_WIDEST, _NARROWEST + 2.8 * (count - 1)), _NARROWEST, count)


def _draw_ellipses(
    axes: Axes, route: Route, look: RouteStyle, *, gap: float, zorder: float
) -> None:
    """Draw ellipses of the predicted position, `SIGMAS` standard deviations, along a route.

    Args:
        axes: Axes to draw on.
        route: Route with covariances.
        look: Style of the route.
        gap: Metres along the route between two ellipses, at least; the last pose has one.
        zorder: Drawing order.
    """
    assert route.covariances is not None
    chosen = _spaced(route.distance, gap)
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


def _spaced(distance: Floats, gap: float) -> list[int]:
    """Return indices of the last pose, and of poses at least `gap` metres apart before it."""
    chosen, free_below = [], math.inf
    for i in range(len(distance) - 1, -1, -1):
        if distance[i] <= free_below:
            chosen.append(i)
            free_below = distance[i] - gap
    return chosen
