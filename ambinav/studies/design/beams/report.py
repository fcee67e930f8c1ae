"""Report of a search for fewer beams, with the scanner, a filter for ROS and pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from ambinav.plotting.beams import plot_kept_beams, plot_loss_curves
from ambinav.reports.parameters import map_parameters
from ambinav.studies.design.beams.choose import Choice
from ambinav.studies.design.beams.document import FORMAT, HOW, Document
from ambinav.studies.design.beams.scanner import ScanMask, laser_filters_text, subset_scanner
from ambinav.studies.study import Content, Study

SCANNER: Final = "scanner.yaml"
FILTER: Final = "laser_filters.yaml"
KEPT: Final = "kept-beams"
CURVES: Final = "loss-by-beams"
STUDY: Final = Study(
    "search for fewer beams",
    "ambinav.studies.design.beams",
    (KEPT, CURVES),
    (SCANNER, FILTER),
    FORMAT,
)


def write_report(
    choice: Choice,
    report: Document,
    masks: Sequence[ScanMask],
    folder: str | Path,
    image_format: str = "png",
) -> Document:
    """Write all results, see `Study.write`; return what report.json holds.

    Args:
        choice: Result of the search.
        report: Its figures.
        masks: Readings removed from LaserScan messages; empty if there are no such messages.
        folder: Output folder.
        image_format: Format of the pictures, one of `ambinav.plotting.style.FORMATS`.
    """
    files = {SCANNER: subset_scanner(choice.scanner, choice.chosen.beams).to_yaml()}
    if masks:
        files[FILTER] = laser_filters_text(masks)
    pictures = tuple(f"{name}.{image_format}" for name in STUDY.pictures)
    report = report.model_copy(update={"files": tuple(files), "pictures": pictures})
    figures = {KEPT: lambda: draw_kept(choice), CURVES: lambda: draw_curves(choice, report)}
    STUDY.write(folder, content(report, files), figures, image_format)
    return report


def draw_kept(choice: Choice) -> Figure:
    """Draw the beams that are kept and those that are left out, each to its maximum range."""
    scanner, beams = choice.scanner, choice.chosen.beams
    reach = np.array([sensor.max_range for sensor in scanner.sensors])[scanner.sensor_of_beam]
    title = f"{scanner.name}: {len(beams)} of {scanner.beams} beams"
    return plot_kept_beams(scanner.mounts, np.asarray(reach), beams, title)


def draw_curves(choice: Choice, report: Document) -> Figure:
    """Draw the loss by the number of beams."""
    curves = {
        HOW[curve.method]: ((curve.beams, curve.points), (curve.beams, curve.checked_points))
        for curve in report.curves
    }
    random = (
        [subsets.beams for subsets in report.random],
        [subsets.lowest_points for subsets in report.random],
        [subsets.mean_points for subsets in report.random],
        [subsets.highest_points for subsets in report.random],
    )
    chosen = len(choice.chosen.beams), choice.chosen.checked.points
    title = f"{report.scanner}: what fewer beams lose"
    return plot_loss_curves(curves, random, choice.limit, chosen, title)


def content(report: Document, files: Mapping[str, str]) -> Content:
    """Return what the documents say, and the further files."""
    curves = {curve.method: curve for curve in report.curves}
    values = {
        "curves": curves,
        "sizes": sorted({*curves["even"].beams, *curves["greedy"].beams}),
        "random": {subsets.beams: subsets for subsets in report.random},
        "parameters": map_parameters(report.parameters),
    }
    filters = {
        "points": lambda value: f"{value:.2f}",
        "ms": lambda value: f"{value:.3f} ms",
        "cm": lambda value: f"{100.0 * value:.2f} cm",
    }
    return Content(report, values, filters, files=files)
