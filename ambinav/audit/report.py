"""Writing an audit into a folder: report.html, report.md, report.json and the pictures."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from ambinav.audit.audit import Audit, axis_degrees, metres2, percent, places_text
from ambinav.audit.document import FORMAT, Document, document
from ambinav.audit.page import audit_page
from ambinav.audit.pictures import save_pictures
from ambinav.files import replacing
from ambinav.maps.judged_floor import unreachable_label
from ambinav.maps.zones import UNEXPLORED_MEANING
from ambinav.plotting import style
from ambinav.reports.pages import data_uri, fill
from ambinav.runfolder import RunFolder

JSON: Final = "report.json"
HTML: Final = "report.html"
MARKDOWN: Final = "report.md"
FOLDER: Final = RunFolder(
    "audit",
    (
        JSON,
        HTML,
        MARKDOWN,
        *(f"{kind}-*.{f}" for f in style.FORMATS for kind in ("floor", "place")),
    ),
    proof=JSON,
    format=FORMAT.split("/")[0],
)


def write_report(
    audit: Audit,
    folder: str | Path,
    progress: Callable[[float], None] | None = None,
    image_format: str = "png",
    advise: Callable[[Audit], Audit] | None = None,
) -> Document:
    """Write the report, whole or not at all; an earlier report in `folder` is replaced.

    Where advice is to come it is written twice, so that the pictures can be looked at meanwhile:
    first without the page.

    Args:
        audit: What to report.
        folder: Where to.
        progress: Called with the fraction done, 0 to 1.
        image_format: Of the pictures, one of `ambinav.plotting.style.FORMATS`.
        advise: Adds a verdict (`ambinav.audit.advise.advise`); None: the audit is as it is.

    Returns:
        What report.json holds.

    Raises:
        InputError: see `RunFolder.check`; or the place is not writable.
    """
    path = FOLDER.check(folder).absolute()
    report = document(audit, image_format)
    with replacing(path) as fresh:
        fresh.mkdir()
        save_pictures(audit, fresh, progress, image_format)
        _write_texts(audit, report, fresh, with_page=advise is None)
    if advise is None:
        return report
    advised = advise(audit)
    report = document(advised, image_format)
    with replacing(path) as fresh:
        fresh.mkdir()
        for name in _pictures(report):
            shutil.copy2(path / name, fresh / name)
        _write_texts(advised, report, fresh, with_page=True)
    return report


def _write_texts(audit: Audit, report: Document, folder: Path, *, with_page: bool) -> None:
    """Write figures and texts beside the pictures."""
    (folder / JSON).write_text(report.model_dump_json(indent=2) + "\n", encoding="utf-8")
    (folder / MARKDOWN).write_text(render("report.md.j2", report), encoding="utf-8")
    if with_page:
        inlined = {name: data_uri(folder / name) for name in _pictures(report)}
        page = audit_page(audit, report, inlined, _values(report))
        (folder / HTML).write_text(page, encoding="utf-8")


def render(template: str, report: Document, pictures: dict[str, str] | None = None) -> str:
    """Fill a template with a report.

    Args:
        template: Name of a file in the folder templates.
        report: The figures.
        pictures: What stands for each picture's file name; None: the file name itself.
    """
    filters: dict[str, Callable[..., str]] = {
        "percent": percent,
        "metres2": metres2,
        "axis_degrees": axis_degrees,
        "places": places_text,
    }
    named = pictures or {name: name for name in _pictures(report)}
    return fill(
        "ambinav.audit", template, filters, report=report, pictures=named, **_values(report)
    )


def _values(report: Document) -> dict[str, Any]:
    """What the templates ask for beside the report and its pictures."""
    floor = report.floor
    stripes = f"{style.UNKNOWN} 0 2px, {style.UNEXPLORED} 2px 4px"
    unexplored = {
        "meaning": UNEXPLORED_MEANING,
        "swatch": f"repeating-linear-gradient(135deg, {stripes})",
    }
    unreachable = {
        "label": unreachable_label(floor.robot_radius_m),
        "meaning": f"{metres2(floor.cut_off_area_m2)} where it would fit but cannot get to, "
        f"{metres2(floor.beside_walls_area_m2)} too close to walls for it",
        "swatch": style.UNREACHABLE,
    }
    outside = {
        "meaning": "the margin around the building, or reached where the map ends",
        "swatch": style.UNKNOWN,
    }
    return {
        "outside": outside,
        "image_format": report.pictures[0].rpartition(".")[2],
        "unexplored": unexplored,
        "unreachable": unreachable,
    }


def _pictures(report: Document) -> list[str]:
    return [*report.pictures, *(place.picture for place in report.places)]
