"""Pictures of routes on the floor map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ambinav.errors import InputError
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.plot import Heading, floor_axes, plot_zones, view
from ambinav.maps.zones import COLOURS, ZONES
from ambinav.routes.drawing import (
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
from ambinav.routes.legends import colour_patch, floor_legend, lower_legend
from ambinav.routes.route import BAD_ZONES, Route


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
            drawn lowest and widest, so that all show where they run together.
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
    axes = floor_axes(amap) if ax is None else ax
    if title is None:
        attrs = amap.dataset.attrs
        title = f"Routes: {attrs['scanner']} in {attrs['environment']}"
    plot_zones(amap, axes, heading, strokes=False, legend=False, title=title)
    xmin, ymin, xmax, ymax = view(amap)
    looks = [(style(i), width) for i, width in enumerate(widths(len(named)).tolist())]
    uncertain = False
    for i, (route, (look, width)) in enumerate(zip(named.values(), looks, strict=True)):
        draw_route(axes, route, look, width, zorder=6 + 0.01 * i)
        if covariances and route.covariances is not None:
            uncertain = True
            gap = max(xmax - xmin, ymax - ymin) / 40.0
            draw_ellipses(axes, route, look, gap=gap, zorder=7 + 0.01 * i)
    starts = [(*route.start[:2], START) for route in named.values()]
    goals = [(*route.goal[:2], GOAL) for route in named.values()]
    draw_ends(axes, [*starts, *goals], zorder=10)
    if legend:
        zones = zip(COLOURS, ZONES, strict=True)
        floor_legend(axes, amap, [colour_patch(colour, zone) for colour, zone in zones])
        handles = [route_line(look, width) for look, width in looks]
        for handle, (name, route) in zip(handles, named.items(), strict=True):
            handle.set_label(describe(name, route))
        caption = f"{START}: start   {GOAL}: goal"
        if uncertain:
            caption += f"   ellipses: {SIGMAS:g} standard deviations of the position"
        lower_legend(axes, amap, handles, caption)
    return root_figure(axes)


def name_routes(routes: Sequence[Route]) -> dict[str, Route]:
    """Names for routes: planner and weight, numbered where two are alike."""
    names = [f"{route.planner}, weight {route.weight:g}" for route in routes]
    return {
        name if names.count(name) == 1 else f"{name} ({names[:i].count(name) + 1})": route
        for i, (name, route) in enumerate(zip(names, routes, strict=True))
    }


def describe(name: str, route: Route) -> str:
    """Text of a route's entry in the legend: its name, length, cost, and metres in bad zones."""
    share = route.bad_metres / route.length if route.length > 0.0 else 0.0
    return (
        f"{name}\n{route.length:.1f} m, cost {route.cost:.1f} (weight {route.weight:g})\n"
        f"{route.bad_metres:.1f} m ({share:.0%}) in {' or '.join(BAD_ZONES)}"
    )
