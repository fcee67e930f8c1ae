"""The pictures of an audit: two floor maps with numbered places, and one scan for each place."""

from __future__ import annotations

from pathlib import Path

from matplotlib.axes import Axes

from ambinav.maps import schema
from ambinav.plotting.aliasing import plot_aliasing
from ambinav.plotting.canvas import save_figure
from ambinav.plotting.floor import label_points
from ambinav.plotting.maps import plot_layer, plot_zones
from ambinav.plotting.scan import plot_scan
from ambinav.runtime.progress import Progress, silent
from ambinav.studies.audit.aliasing_part import FLOOR_ALIASING
from ambinav.studies.audit.audit import Audit, Finding, degrees
from ambinav.studies.audit.document import (
    FLOOR_BEST,
    FLOOR_LEVEL,
    FLOOR_WORST,
    FLOOR_ZONES,
    floor_pictures,
    layer_picture,
    place_picture,
)


def save_pictures(
    audit: Audit, folder: Path, progress: Progress = silent, image_format: str = "png"
) -> None:
    """Draw all pictures into `folder`.

    Args:
        audit: The audit to draw.
        folder: Output folder.
        progress: Called with the fraction done.
        image_format: One of `ambinav.plotting.style.FORMATS`.
    """
    places = [finding.place for finding in audit.findings]
    numbers = [(place.x, place.y, str(place.number)) for place in places]
    floors = floor_pictures(audit)
    total = len(floors) + len(places)
    for done, name in enumerate(floors, start=1):
        axes = plot_floor(audit, name)
        if name in (FLOOR_ZONES, FLOOR_LEVEL):
            # The worst place lies on top.
            label_points(axes, reversed(numbers))
        save_figure(axes, folder / f"{name}.{image_format}")
        progress(done / total)
    for finding in audit.findings:
        name = place_picture(finding.place.number)
        save_figure(plot_finding(audit, finding), folder / f"{name}.{image_format}")
        progress((len(floors) + finding.place.number) / total)


def plot_floor(audit: Audit, name: str) -> Axes:
    """Draw one of the pictures that `floor_pictures` names, without the places."""
    amap, heading, parts = audit.amap, audit.heading, audit.parts
    if name == FLOOR_LEVEL:
        return plot_layer(amap, "level", heading=heading, parts=parts)
    if name == FLOOR_ZONES:
        return plot_zones(amap, heading=heading, parts=parts)
    if name == FLOOR_ALIASING and audit.aliasing is not None:
        return plot_aliasing(amap, audit.aliasing.pairs, audit.aliasing.spacing, parts)
    for layer in schema.added(amap.dataset):
        if name == layer_picture(layer):
            return plot_layer(amap, layer, heading=heading, parts=parts)
    # These two stand side by side.
    heading = {FLOOR_BEST: "best", FLOOR_WORST: "worst"}[name]
    title = f"Each point at its {heading} heading"
    return plot_zones(amap, None, heading, title=title, parts=parts, longest=8.0)


def plot_finding(audit: Audit, finding: Finding) -> Axes:
    """Draw what the scanner sees at a place."""
    place = finding.place
    slide = None
    # At a heading without an echo no direction is seen better than the others.
    if place.direction is not None and finding.sight.silent < finding.sight.beams:
        slide = (place.direction, place.major_radius)
    title = f"Place {place.number}: {place.zone} at ({place.x:.1f}, {place.y:.1f}) m"
    if place.worst_heading is not None:
        title += f", at its worst heading, {degrees(finding.sight.theta)}"
    walls = [(wall.start, wall.end) for wall in finding.cause.walls]
    return plot_scan(audit.amap, finding.sight, slide=slide, walls=walls, title=title)
