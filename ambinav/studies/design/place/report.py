"""Writing of a placement into a folder: report.html, .md, .json, placement.geojson, picture."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Final

import shapely
from matplotlib.figure import Figure

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting import style
from ambinav.plotting.canvas import save_figure
from ambinav.plotting.floor import Bounds
from ambinav.plotting.placement import PlacementView, plot_placement
from ambinav.reports.pages import data_uri, fill
from ambinav.reports.parameters import map_parameters
from ambinav.routes.files import trace_route
from ambinav.runtime.files import replacing
from ambinav.runtime.runfolder import RunFolder
from ambinav.studies.design.place.document import FORMAT, Document, amount, document
from ambinav.studies.design.place.greedy import NOTHING
from ambinav.studies.design.place.study import Remedy

JSON: Final = "report.json"
HTML: Final = "report.html"
MARKDOWN: Final = "report.md"
GEOJSON: Final = "placement.geojson"
PICTURE: Final = "before-after"
"""File name of the picture; the suffix is its format."""
FOLDER: Final = RunFolder(
    "placement",
    (JSON, HTML, MARKDOWN, GEOJSON, *(f"{PICTURE}.{ending}" for ending in style.FORMATS)),
    proof=JSON,
    format=FORMAT.split("/")[0],
)
MARGIN: Final = 3.0
"""Metres around a region that is drawn."""


def write_report(
    study: Remedy,
    asked: int,
    folder: str | Path,
    progress: Callable[[float], None] = lambda share: None,
    image_format: str = "png",
) -> Document:
    """Write a placement atomically; an earlier one in `folder` is replaced.

    Args:
        study: The placement.
        asked: How many obstacles were asked for.
        folder: Output folder.
        progress: Called with the fraction done, 0 to 1.
        image_format: Format of the picture, one of `ambinav.plotting.style.FORMATS`.

    Returns:
        What report.json holds.

    Raises:
        InputError: see `RunFolder.check`; or the place is not writable.
    """
    path = FOLDER.check(folder).absolute()
    report = document(study, asked)
    picture = f"{PICTURE}.{image_format}"
    after = study.amap.update(study.edited(), progress=lambda share: progress(0.8 * share))
    with replacing(path) as fresh:
        fresh.mkdir()
        save_figure(draw(study, after), fresh / picture)
        (fresh / JSON).write_text(report.model_dump_json(indent=2) + "\n", encoding="utf-8")
        (fresh / GEOJSON).write_text(json.dumps(report.geojson, indent=1) + "\n", encoding="utf-8")
        (fresh / MARKDOWN).write_text(_filled("report.md.j2", report, picture), encoding="utf-8")
        page = _filled("report.html.j2", report, data_uri(fresh / picture))
        (fresh / HTML).write_text(page, encoding="utf-8")
    progress(1.0)
    return report


def draw(study: Remedy, after: AmbiguityMap) -> Figure:
    """Draw the zones before and after, side by side, with the obstacles numbered."""
    unit, placement = study.unit, study.placement
    shapes = [region.shape for region in study.regions if region.shape is not None]
    routes = [trace_route(region.route) for region in study.regions if region.route is not None]
    lines = [shapely.LineString(poses[:, :2]) for poses in routes]
    view: Bounds | None = None
    if shapes or lines:
        xmin, ymin, xmax, ymax = shapely.total_bounds([*shapes, *lines]).tolist()
        view = xmin - MARGIN, ymin - MARGIN, xmax + MARGIN, ymax + MARGIN
    return plot_placement(
        study.amap,
        after,
        study.parts,
        PlacementView(
            titles=(
                f"Before: {amount(placement.before.bad, unit)} bad",
                f"After: {amount(placement.after.bad, unit)} bad",
            ),
            kind=study.rules.kind,
            reflective=study.rules.reflective,
            outlines=tuple(candidate.obstacle.outline for candidate in study.chosen),
            shapes=shapes,
            routes=routes,
            bounds=view,
        ),
    )


def _filled(template: str, report: Document, picture: str) -> str:
    filters: dict[str, Callable[..., str]] = {
        "amount": lambda value: amount(value, report.unit),
        "share": lambda share: f"{100.0 * share:.1f} %",
        "metres": lambda value: f"{value:.2f}",
        "md": _escape_for_table,
    }
    return fill(
        "ambinav.studies.design.place", template, filters, report=report, picture=picture,
        parameters=map_parameters(report.parameters), geojson=GEOJSON,
        nothing=f"{NOTHING:g} {'m²' if report.unit == 'm2' else 'm'}",
    )  # fmt: skip


def _escape_for_table(text: str) -> str:
    """Escape a user's text for a table in Markdown: no bar ends a cell, no tag opens."""
    return text.replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")
