"""Writing of a difference into a folder: diff.html, diff.md, diff.json and the picture."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from ambinav.plotting import style
from ambinav.plotting.canvas import save_figure
from ambinav.plotting.difference import ChangeLayer, plot_difference
from ambinav.reports.pages import data_uri, fill
from ambinav.runtime.files import replacing
from ambinav.runtime.runfolder import RunFolder
from ambinav.studies.diff.difference import Difference
from ambinav.studies.diff.document import FORMAT, Document
from ambinav.studies.diff.registration import STATES

JSON: Final = "diff.json"
HTML: Final = "diff.html"
MARKDOWN: Final = "diff.md"
PICTURE: Final = "difference"
"""File name of the picture; the suffix is its format."""
FOLDER: Final = RunFolder(
    "difference",
    (JSON, HTML, MARKDOWN, *(f"{PICTURE}.{ending}" for ending in style.FORMATS)),
    proof=JSON,
    format=FORMAT.split("/")[0],
)


def write_report(
    result: Difference, report: Document, folder: str | Path, image_format: str = "png"
) -> None:
    """Write a difference atomically; an earlier one in `folder` is replaced.

    Args:
        result: The difference.
        report: Its figures.
        folder: Output folder.
        image_format: Format of the picture, one of `ambinav.plotting.style.FORMATS`.

    Raises:
        InputError: see `RunFolder.check`; or the place is not writable.
    """
    path = FOLDER.check(folder).absolute()
    picture = f"{PICTURE}.{image_format}"
    with replacing(path) as fresh:
        fresh.mkdir()
        save_figure(draw(result, report), fresh / picture)
        (fresh / JSON).write_text(report.model_dump_json(indent=2) + "\n", encoding="utf-8")
        (fresh / MARKDOWN).write_text(_filled("diff.md.j2", report, picture), encoding="utf-8")
        page = _filled("diff.html.j2", report, data_uri(fresh / picture))
        (fresh / HTML).write_text(page, encoding="utf-8")


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


def _filled(template: str, report: Document, picture: str) -> str:
    filters: dict[str, Callable[..., str]] = {
        "m2": lambda area: f"{area:,.1f} m²",
        "share": lambda share: f"{100.0 * share:.1f} %",
        "change": lambda value: f"{value:+.3f}",
        "md": _escape_for_table,
    }
    seen = {
        state
        for transition in report.transitions
        for state in (transition.before, transition.after)
    }
    states = [state for state in STATES if state in seen]
    cells = {(transition.before, transition.after): transition for transition in report.transitions}
    return fill(
        "ambinav.studies.diff", template, filters, report=report, picture=picture,
        states=states, cells=cells,
    )  # fmt: skip


def _escape_for_table(text: str) -> str:
    """Escape a user's text for a table in Markdown: no bar ends a cell, no tag opens."""
    return text.replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")
