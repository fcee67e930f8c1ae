"""Report of a layout of reflectors, with reflectors.geojson and a picture."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

from matplotlib.axes import Axes

from ambinav.plotting import style
from ambinav.plotting.floor import FloorFigure
from ambinav.plotting.legend_patches import colour_patch
from ambinav.plotting.maps import paint_codes
from ambinav.plotting.placement import PlacementView, plot_state
from ambinav.reports.parameters import map_parameters
from ambinav.runtime.progress import Progress, silent
from ambinav.studies.design.improved import PICTURES, improved_text, state_figures
from ambinav.studies.design.reflectors.document import FORMAT, Document, document
from ambinav.studies.design.reflectors.study import STATES, ReflectorLayout
from ambinav.studies.study import Content, Study

GEOJSON: Final = "reflectors.geojson"
STUDY: Final = Study(
    "layout of reflectors", "ambinav.studies.design.reflectors", PICTURES, (GEOJSON,), FORMAT
)


def write_report(
    layout: ReflectorLayout,
    requested: int,
    folder: str | Path,
    progress: Progress = silent,
    image_format: str = "png",
) -> Document:
    """Write a layout, see `Study.write`; return what report.json holds.

    Args:
        layout: The layout.
        requested: How many new reflectors were asked for, at most.
        folder: Output folder.
        progress: Called with the fraction done, 0 to 1.
        image_format: Format of the picture, one of `ambinav.plotting.style.FORMATS`.
    """
    report = document(layout, requested)
    figures = state_figures(lambda placed: draw(layout, report, placed))
    STUDY.write(folder, content(report), figures, image_format, progress)
    return report


def draw(layout: ReflectorLayout, report: Document, placed: bool) -> Axes:
    """Draw where the robot navigates without or with the new reflectors, which are numbered."""

    def paint(floor: FloorFigure) -> None:
        paint_codes(floor, layout.maps[placed], style.NAVIGATION, layout.parts)

    entries = [colour_patch(*entry) for entry in zip(style.NAVIGATION, STATES, strict=True)]
    kind = layout.positions.kind if layout.positions is not None else "post"
    return plot_state(
        layout.amap,
        paint,
        entries,
        layout.parts,
        PlacementView(
            reflective=True,
            outlines=tuple(candidate.obstacle.outline for candidate in layout.chosen),
            kinds=(kind,) * len(layout.chosen),
            improved=[(place.x_m, place.y_m) for place in report.improved],
        ),
        placed=placed,
    )


def content(report: Document) -> Content:
    """Return what the documents say, and the new reflectors as GeoJSON."""
    values = {
        "parameters": map_parameters(report.parameters),
        "geojson": GEOJSON,
        "captions": (
            f"Before: navigates on {report.before.good_share:.0%}",
            f"After: navigates on {report.after.good_share:.0%}",
        ),
        "improved": improved_text(report.improved, "New floor on which the robot navigates"),
    }
    filters = {"cm": lambda value: "" if value is None else f"{100.0 * value:.1f} cm"}
    files = {GEOJSON: json.dumps(report.geojson, indent=1) + "\n"}
    return Content(report, values, filters, files=files)
