"""Report of a placement, with placement.geojson and a picture."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import shapely
from matplotlib.axes import Axes

from ambinav.plotting.placement import PlacementView, plot_placement
from ambinav.reports.parameters import map_parameters
from ambinav.routes.files import trace_route
from ambinav.runtime.array_types import Bounds
from ambinav.runtime.progress import Progress, silent
from ambinav.studies.design.improved import PICTURES, improved_text, state_figures, zones_after
from ambinav.studies.design.place.document import FORMAT, Document, amount, document
from ambinav.studies.design.place.greedy import NOTHING
from ambinav.studies.design.place.study import Remedy
from ambinav.studies.study import Content, Study

GEOJSON: Final = "placement.geojson"
STUDY: Final = Study("placement", "ambinav.studies.design.place", PICTURES, (GEOJSON,), FORMAT)
MARGIN: Final = 3.0
"""Metres around a region that is drawn."""


def write_report(
    study: Remedy,
    requested: int,
    folder: str | Path,
    progress: Progress = silent,
    image_format: str = "png",
) -> Document:
    """Write a placement, see `Study.write`; return what report.json holds.

    Args:
        study: The placement.
        requested: How many obstacles were asked for.
        folder: Output folder.
        progress: Called with the fraction done, 0 to 1.
        image_format: Format of the picture, one of `ambinav.plotting.style.FORMATS`.
    """
    STUDY.folder.check(folder)
    report = document(study, requested)
    figures = state_figures(lambda placed: draw(study, report, placed))
    STUDY.write(folder, content(report), figures, image_format, progress)
    return report


def draw(study: Remedy, report: Document, placed: bool) -> Axes:
    """Draw the zones without or with the obstacles, which are numbered."""
    shapes = [region.shape for region in study.regions if region.shape is not None]
    routes = [trace_route(region.route) for region in study.regions if region.route is not None]
    lines = [shapely.LineString(poses[:, :2]) for poses in routes]
    view: Bounds | None = None
    if shapes or lines:
        xmin, ymin, xmax, ymax = shapely.total_bounds([*shapes, *lines]).tolist()
        view = xmin - MARGIN, ymin - MARGIN, xmax + MARGIN, ymax + MARGIN
    return plot_placement(
        study.amap,
        zones_after(study.amap, study.after if placed else study.amap),
        study.parts,
        PlacementView(
            reflective=study.rules.reflective,
            outlines=tuple(candidate.obstacle.outline for candidate in study.chosen),
            kinds=(study.rules.kind,) * len(study.chosen),
            shapes=shapes,
            routes=routes,
            bounds=view,
            improved=[(place.x_m, place.y_m) for place in report.improved],
        ),
        placed=placed,
    )


def content(report: Document) -> Content:
    """Return what the documents say, and the obstacles as GeoJSON."""
    values = {
        "parameters": map_parameters(report.parameters),
        "geojson": GEOJSON,
        "captions": (
            f"Before: {amount(report.before.bad, report.unit)} bad",
            f"After: {amount(report.after.bad, report.unit)} bad",
        ),
        "improved": improved_text(report.improved),
        "nothing": f"{NOTHING:g} {'m²' if report.unit == 'm2' else 'm'}",
    }
    filters = {"amount": lambda value: amount(value, report.unit)}
    files = {GEOJSON: json.dumps(report.geojson, indent=1) + "\n"}
    return Content(report, values, filters, files=files)
