"""Report of a difference: diff.html, diff.md, diff.json and the picture."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from ambinav.plotting.difference import ChangeLayer, plot_difference
from ambinav.studies.diff.difference import Difference
from ambinav.studies.diff.document import FORMAT, Document
from ambinav.studies.diff.registration import STATES
from ambinav.studies.study import Content, Study

PICTURE: Final = "difference"
STUDY: Final = Study("difference", "ambinav.studies.diff", (PICTURE,), format=FORMAT, stem="diff")


def write_report(
    result: Difference, report: Document, folder: str | Path, image_format: str = "png"
) -> None:
    """Write a difference and its figures; see `Study.write`."""
    STUDY.write(folder, content(report), {PICTURE: lambda: draw(result, report)}, image_format)


def draw(result: Difference, report: Document) -> Figure:
    """Draw the picture."""
    counted = result.before.counted, result.after.counted
    change = ChangeLayer(
        result.lattice.bounds,
        result.rise,
        counted[1] & ~counted[0],
        counted[0] & ~counted[1],
        result.new_walls,
        result.gone_walls,
        [(region.x_m, region.y_m, str(region.number)) for region in report.regions],
    )
    titles = (
        f"A: {report.first.scanner} in {report.first.environment}",
        f"B: {report.second.scanner} in {report.second.environment}",
    )
    return plot_difference(result.first, result.second, result.parts, change, titles)


def content(report: Document) -> Content:
    """Return what the documents say."""
    seen = {
        state
        for transition in report.transitions
        for state in (transition.before, transition.after)
    }
    cells = {(transition.before, transition.after): transition for transition in report.transitions}
    return Content(
        report,
        {"states": [state for state in STATES if state in seen], "cells": cells},
        {"change": lambda value: f"{value:+.3f}"},
    )
