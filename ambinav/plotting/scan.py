"""A picture of one scan: the walls around a robot and the end of every beam."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection, PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyArrowPatch, Patch, PathPatch, Polygon, Wedge
from matplotlib.path import Path
from shapely import Polygon as ShapelyPolygon
from shapely.geometry.base import BaseGeometry

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting import style
from ambinav.plotting.floor import FloorFigure, blend_white
from ambinav.runtime.array_types import Bools, Bounds, Floats
from ambinav.sensing.sight import Sight

Point = tuple[float, float]

LONGEST: Final = 6.4
"""Inches of a picture of its own."""
_MANY = 120
"""Beams of a fan that is drawn as an area: single lines would fill the picture."""
_PALE: Final = 0.45
"""Share of the colour in such an area."""


def plot_scan(
    amap: AmbiguityMap,
    scan: Sight,
    ax: Axes | None = None,
    *,
    slide: tuple[float, float] | None = None,
    walls: Sequence[tuple[Point, Point]] = (),
    title: str = "",
) -> Axes:
    """Draw a scan over the walls: beams with and without echo, or into unknown space, the robot.

    Args:
        amap: A map of the building.
        scan: The scan.
        ax: Axes to draw on; None makes a figure of its own (`ax.figure`).
        slide: Direction (radians) and radius (metres) in which the robot can slide unseen; drawn
            as a double arrow, never shorter than can be seen.
        walls: Ends of walls, metres, along which it slides.
        title: Above the picture.
    """
    reach = _reach(scan)
    bounds = (scan.x - reach, scan.y - reach, scan.x + reach, scan.y + reach)
    floor = FloorFigure(amap, ax, title, bounds=bounds, longest=LONGEST, walls=1.5)
    axes = floor.axes
    _draw_free(axes, amap.environment.free, bounds)
    returned = np.isfinite(scan.distance)
    unknown = returned & scan.frontier
    _draw_beams(axes, scan, returned, unknown)
    _draw_robot(axes, scan, reach)
    if slide is not None:
        _draw_slide(axes, scan, slide, reach)
    along = LineCollection(walls, colors=style.SLIDE, linewidths=4.5, alpha=0.85, zorder=6.5)
    axes.add_collection(along, autolim=False)
    handles = _legend_entries(returned, unknown, slide)
    if walls:
        label = "along these walls" if len(walls) > 1 else "along this wall"
        handles.append(Line2D([], [], color=style.SLIDE, linewidth=4.5, label=label))
    floor.legend(handles + floor.reflector_lines())
    return floor.finish()


def _reach(scan: Sight) -> float:
    """Return half the side of the picture, metres: all beams, or with a long range all echoes."""
    echoes = scan.distance[np.isfinite(scan.distance)]
    longest = float(scan.max_range.max())
    if echoes.size == scan.distance.size:
        longest = float(echoes.max())
    offset = float(np.hypot(scan.origin[:, 0] - scan.x, scan.origin[:, 1] - scan.y).max())
    return 1.06 * (longest + offset)


def _draw_free(axes: Axes, free: BaseGeometry, bounds: Bounds) -> None:
    shown = free.intersection(ShapelyPolygon.from_bounds(*bounds))
    for part in getattr(shown, "geoms", [shown]):
        if isinstance(part, ShapelyPolygon) and not part.is_empty:
            rings = [np.asarray(ring.coords) for ring in (part.exterior, *part.interiors)]
            outline = Path.make_compound_path(*(Path(ring, closed=True) for ring in rings))
            axes.add_patch(PathPatch(outline, facecolor=style.FLOOR, linewidth=0, zorder=1.0))


def _draw_beams(axes: Axes, scan: Sight, returned: Bools, unknown: Bools) -> None:
    few = scan.axis.size <= _MANY
    end = scan.origin + scan.max_range[:, None] * np.column_stack(
        [np.cos(scan.axis), np.sin(scan.axis)]
    )
    end[returned] = scan.hit[returned]
    lines = np.stack([scan.origin, end], axis=1)
    cone = scan.aperture > 0
    area = ~cone & (not few)
    for mask, colour, dashes in (
        (returned & ~unknown, style.ECHO, "solid"),
        (unknown, style.FRONTIER, (0, (1, 2))),
        (~returned, style.SILENT, (0, (5, 4))),
    ):
        axes.add_collection(
            LineCollection(
                list(lines[mask & ~cone & ~area]),
                colors=colour,
                linewidths=0.9,
                linestyles=dashes,
                alpha=0.75,
                zorder=2,
            ),
            autolim=False,
        )
        axes.add_collection(
            # Opaque and not smoothed, so that no seam shows where two triangles touch.
            PolyCollection(
                list(_beam_triangles(scan, end)[mask & area]),
                facecolors=blend_white(colour, _PALE),
                linewidths=0,
                antialiaseds=False,
                zorder=2,
            ),
            autolim=False,
        )
        wedges = [
            Wedge(
                (float(scan.origin[i, 0]), float(scan.origin[i, 1])),
                float(min(scan.distance[i], scan.max_range[i])),
                math.degrees(scan.axis[i] - scan.aperture[i] / 2),
                math.degrees(scan.axis[i] + scan.aperture[i] / 2),
            )
            for i in np.flatnonzero(mask & cone)
        ]
        axes.add_collection(
            PatchCollection(
                wedges, facecolors=colour, edgecolors=colour, alpha=0.22, linewidths=0.8, zorder=2
            ),
            autolim=False,
        )
    hits = scan.hit[returned & ~unknown]
    axes.plot(*hits.T, ".", color=style.ECHO, markersize=5 if few else 2.5, zorder=6)


def _beam_triangles(scan: Sight, end: Floats) -> Floats:
    """Return (B, 3, 2) metres: triangle of each beam, as wide as the beam spacing."""
    angles = np.sort(np.mod(scan.axis, 2 * math.pi))
    half = 0.5 * float(np.median(np.diff(angles))) if angles.size > 1 else 0.0
    step = (end - scan.origin) / math.cos(min(half, 1.0))
    c, s = math.cos(half), math.sin(half)
    left, right = step @ np.array([[c, s], [-s, c]]), step @ np.array([[c, -s], [s, c]])
    return np.stack([scan.origin, scan.origin + left, scan.origin + right], axis=1)


def _draw_robot(axes: Axes, scan: Sight, reach: float) -> None:
    size = 0.035 * reach
    axes.add_patch(Circle((scan.x, scan.y), size, color=style.ROBOT, zorder=7))
    c, s = math.cos(scan.theta), math.sin(scan.theta)
    nose = np.array([[2.4, 0.0], [0.5, 0.85], [0.5, -0.85]]) * size
    axes.add_patch(
        Polygon(nose @ np.array([[c, s], [-s, c]]) + [scan.x, scan.y], color=style.ROBOT, zorder=7)
    )


def _draw_slide(axes: Axes, scan: Sight, slide: tuple[float, float], reach: float) -> None:
    angle, radius = slide
    half = max(radius, 0.18 * reach)
    dx, dy = half * math.cos(angle), half * math.sin(angle)
    axes.add_patch(
        FancyArrowPatch(
            (scan.x - dx, scan.y - dy),
            (scan.x + dx, scan.y + dy),
            arrowstyle="<|-|>",
            mutation_scale=13,
            shrinkA=0,
            shrinkB=0,
            linewidth=2.2,
            color=style.SLIDE,
            zorder=8,
        )
    )


def _legend_entries(
    returned: Bools, unknown: Bools, slide: tuple[float, float] | None
) -> list[Artist]:
    """Return the entries of the legend."""
    classes: list[tuple[str, int, str, dict[str, Any]]] = [
        ("echo", int((returned & ~unknown).sum()), style.ECHO, {"marker": "."}),
        ("no echo", int((~returned).sum()), style.SILENT, {"linestyle": "--"}),
    ]
    if unknown.any():
        classes.append(("to unknown", int(unknown.sum()), style.FRONTIER, {"linestyle": ":"}))
    handles: list[Artist] = [
        Patch(facecolor=blend_white(colour, _PALE), label=f"{name} ({count})")
        if returned.size > _MANY
        else Line2D([], [], color=colour, label=f"{name} ({count})", **line)
        for name, count, colour, line in classes
    ]
    if slide is not None:
        handles.append(Line2D([], [], color=style.SLIDE, linewidth=2.2, label="slides unseen"))
    return handles
