"""The pictures of an audit: two floor maps with numbered places, and one scan for each place."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke

from ambinav.audit.ambiguous_regions import Place
from ambinav.audit.audit import Audit, Finding, degrees
from ambinav.audit.document import (
    FLOOR_ALIKES,
    FLOOR_BEST,
    FLOOR_LEVEL,
    FLOOR_WORST,
    FLOOR_ZONES,
    floor_pictures,
    layer_picture,
    place_picture,
)
from ambinav.maps import schema
from ambinav.plotting.aliasing import plot_links
from ambinav.plotting.floor import save_figure
from ambinav.plotting.maps import floor_axes, plot_layer, plot_zones
from ambinav.plotting.scan import plot_scan


def save_pictures(
    audit: Audit, folder: Path, progress: Callable[[float], None] | None = None
) -> None:
    """Draw all pictures into `folder`; `progress` is called with the fraction done."""
    places = [finding.place for finding in audit.findings]
    floors = floor_pictures(audit)
    total = len(floors) + len(places)

    def tell(done: int) -> None:
        if progress is not None:
            progress(done / total)

    for done, name in enumerate(floors, start=1):
        axes = plot_floor(audit, name)
        if name in (FLOOR_ZONES, FLOOR_LEVEL):
            mark_places(axes, places)
        save_figure(axes, folder / name)
        tell(done)
    for finding in audit.findings:
        save_figure(plot_finding(audit, finding), folder / place_picture(finding.place.number))
        tell(len(floors) + finding.place.number)


def plot_floor(audit: Audit, name: str) -> Axes:
    """Draw one of the pictures that `floor_pictures` names, without the places."""
    if name == FLOOR_LEVEL:
        return plot_layer(audit.amap, "level", heading=audit.heading, parts=audit.parts)
    if name == FLOOR_ZONES:
        return plot_zones(audit.amap, heading=audit.heading, parts=audit.parts)
    if name == FLOOR_ALIKES and audit.alikes is not None:
        return plot_links(audit.amap, audit.alikes.links, audit.alikes.spacing, audit.parts)
    for layer in schema.added(audit.amap.dataset):
        if name == layer_picture(layer):
            return plot_layer(audit.amap, layer, heading=audit.heading, parts=audit.parts)
    # These two stand side by side.
    heading = {FLOOR_BEST: "best", FLOOR_WORST: "worst"}[name]
    axes = floor_axes(audit.amap, longest=8.0)
    title = f"Each point at its {heading} heading"
    return plot_zones(audit.amap, axes, heading, legend=False, title=title, parts=audit.parts)


def mark_places(axes: Axes, places: Iterable[Place]) -> None:
    """Number the places on a floor map: a round label on each place's point."""
    for place in sorted(places, key=lambda place: -place.number):
        axes.annotate(
            str(place.number),
            (place.x, place.y),
            ha="center",
            va="center_baseline",
            fontsize=10,
            fontweight="bold",
            color="black",
            bbox={
                "boxstyle": "circle,pad=0.25",
                "facecolor": "white",
                "edgecolor": "black",
                "linewidth": 1.2,
            },
            path_effects=[withStroke(linewidth=2, foreground="white")],
            zorder=10,
        )


def plot_finding(audit: Audit, finding: Finding) -> Axes:
    """Draw what the scanner sees at a place."""
    place = finding.place
    slide = None
    if place.direction is not None:
        slide = (place.direction, place.major_radius)
    title = f"Place {place.number}: {place.zone} at ({place.x:.1f}, {place.y:.1f}) m"
    if place.worst_heading is not None:
        title += f", heading {degrees(finding.sight.theta)}"
    return plot_scan(
        audit.environment.segments,
        finding.sight,
        audit.environment.free,
        slide=slide,
        title=title,
        amap=audit.amap,
    )
