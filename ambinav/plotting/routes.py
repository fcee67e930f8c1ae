"""Pictures of routes on the floor map."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ambinav.errors import InputError
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import COLOURS, ZONES
from ambinav.plotting.backdrop import colour_patch, outside_patches, unexplored_patch
from ambinav.plotting.legends import floor_legend, lower_legend, make_room
from ambinav.plotting.maps import Heading, floor_axes, floor_title, plot_zones, view
from ambinav.plotting.route_lines import (
    GOAL,
    SIGMAS,
    START,
    draw_ellipses,
    draw_ends,
    draw_route,
    root_figure,
    route_line,
    style,
    widths,
)
from ambinav.routes.bad_floor import IN_BRACKETS, BadFloor
from ambinav.routes.route import Route

LINE: Final = 40
"""Letters to a line of the legend."""


def plot_routes(
    amap: AmbiguityMap,
    routes: Mapping[str, Route] | Sequence[Route],
    ax: Axes | None = None,
    *,
    heading: Heading = "mean",
    covariances: bool = True,
    legend: bool = True,
    title: str | None = None,
) -> Figure:
    """Draw routes on the zones of the floor, with their figures in the legend.

    Args:
        amap: The map.
        routes: By name, or in a row: then the planner and the weight name them. The first is
            drawn lowest and widest, so that all show where they run together. Those that are
            the same way share a line.
        ax: Where to draw; None makes a figure of its own.
        heading: "mean", "best", "worst" or radians: of the zones, where the heading matters.
        covariances: Whether to draw ellipses of 2 standard deviations along routes that have
            predicted covariances.
        legend: Whether to tell the routes' figures and the zones.
        title: None names the environment and the scanner.

    Raises:
        InputError: no routes, or no such heading.
    """
    named = dict(routes) if isinstance(routes, Mapping) else name_routes(routes)
    if not named:
        raise InputError("routes is empty; give at least one route to draw.")
    groups = _alike(named)
    axes = floor_axes(amap) if ax is None else ax
    if ax is None and legend:
        make_room(axes, amap, len(groups))
    title = title or floor_title(amap, "Routes", heading)
    plot_zones(amap, axes, heading, strokes=False, legend=False, title=title)
    xmin, ymin, xmax, ymax = view(amap)
    looks = [(style(i), width) for i, width in enumerate(widths(len(groups)).tolist())]
    uncertain = False
    for i, (group, (look, width)) in enumerate(zip(groups, looks, strict=True)):
        route = next(iter(group.values()))
        draw_route(axes, route, look, width, zorder=6 + 0.01 * i)
        if covariances and route.covariances is not None:
            uncertain = True
            gap = max(xmax - xmin, ymax - ymin) / 40.0
            draw_ellipses(axes, route, look, gap=gap, zorder=7 + 0.01 * i)
    starts = [(*route.start[:2], START) for route in named.values()]
    goals = [(*route.goal[:2], GOAL) for route in named.values()]
    draw_ends(axes, [*starts, *goals], zorder=10)
    if legend:
        zones = [colour_patch(*entry) for entry in zip(COLOURS, ZONES, strict=True)]
        if amap.unexplored.any():
            zones.append(unexplored_patch("unexplored"))
        zones += outside_patches(amap, view(amap))
        floor_legend(axes, amap, zones)
        handles = [route_line(look, width) for look, width in looks]
        for handle, group in zip(handles, groups, strict=True):
            handle.set_label(describe(group))
        caption = [f"{START}: start", f"{GOAL}: goal", IN_BRACKETS]
        if amap.has_theta:
            caption.append("zones of a route: at its own headings")
        if uncertain:
            caption.append(f"ellipses: {SIGMAS:g} standard deviations of the position")
        lower_legend(axes, amap, handles, caption)
    return root_figure(axes)


def name_routes(routes: Sequence[Route]) -> dict[str, Route]:
    """Names for routes: planner and weight, numbered where two are alike."""
    names = [f"{route.planner}, weight {route.weight:g}" for route in routes]
    return {
        name if names.count(name) == 1 else f"{name} ({names[:i].count(name) + 1})": route
        for i, (name, route) in enumerate(zip(names, routes, strict=True))
    }


def describe(group: Mapping[str, Route]) -> str:
    """Text of an entry in the legend: names, length, cost, metres in corridor and in open zones.

    Args:
        group: Routes by name that are one and the same way. Their cost is told if they were
            planned with the same weight.
    """
    route = next(iter(group.values()))
    costs = {(round(other.cost, 1), other.weight) for other in group.values()}
    cost = f", cost {route.cost:.1f} (weight {route.weight:g})" if len(costs) == 1 else ""
    floor = BadFloor.of(route)
    return (
        f"{textwrap.fill(', '.join(group), LINE)}\n{route.length:.1f} m{cost}\n"
        f"corridor {floor.corridor_text()} m, open {floor.open_text()} m"
    )


def _alike(named: Mapping[str, Route]) -> list[dict[str, Route]]:
    """Routes by name, those together that are the same way: one line would hide the other."""
    groups: list[dict[str, Route]] = []
    for name, route in named.items():
        for group in groups:
            first = next(iter(group.values()))
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
