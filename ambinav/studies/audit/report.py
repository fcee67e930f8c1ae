"""Writing of an audit into a folder: report.html, report.md, report.json and the pictures."""

from __future__ import annotations

import contextlib
import shutil
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

from ambinav.maps.judged_floor import unreachable_label
from ambinav.maps.zones import UNEXPLORED_MEANING
from ambinav.plotting import style
from ambinav.reports.pages import data_uri, fill
from ambinav.runtime.files import replacing
from ambinav.runtime.runfolder import RunFolder
from ambinav.studies.audit.audit import Audit, axis_degrees, metres2, percent, places_text
from ambinav.studies.audit.document import FORMAT, Document, document
from ambinav.studies.audit.drawing import Draw, drawing
from ambinav.studies.audit.page import audit_page, page_map

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


def write_audit(
    audit: Audit,
    folder: str | Path,
    progress: Callable[[float], None] | None = None,
    image_format: str = "png",
    advise: Callable[[Audit, Callable[[], None]], Audit] | None = None,
    draw: Draw | None = None,
) -> Document:
    """Write the report atomically; an earlier report in `folder` is replaced.

    Advice is sought in a thread while pictures are drawn. Where these are done first they are
    written at once, without the page, so that they can be looked at.

    Args:
        audit: The audit to report.
        folder: Output folder.
        progress: Called with the fraction done, 0 to 1.
        image_format: Format of the pictures, one of `ambinav.plotting.style.FORMATS`.
        advise: Adds a verdict (`ambinav.studies.audit.advise.advise`); it calls what it is given
            now and then, which raises where it is to end. None: the audit is as it is.
        draw: Draws the pictures (`ambinav.studies.audit.drawing.drawing`); None: a process made
            for it.

    Returns:
        What report.json holds.

    Raises:
        InputError: see `RunFolder.check`; or the place is not writable.
    """
    path = FOLDER.check(folder).absolute()
    if draw is None:
        with drawing() as draw:
            return write_audit(audit, folder, progress, image_format, advise, draw)
    if advise is None:
        with replacing(path) as fresh:
            fresh.mkdir()
            draw(audit, fresh, progress, image_format)
            return _write_texts(audit, fresh, image_format, page_map(audit))
    with _work_in_threads(advise, audit) as (advice, shown):
        with replacing(path) as fresh:
            fresh.mkdir()
            draw(audit, fresh, progress, image_format)
            if advice.done():
                return _write_texts(advice.result(), fresh, image_format, shown.result())
            _write_texts(audit, fresh, image_format)
        advised = advice.result()
    with replacing(path) as fresh:
        fresh.mkdir()
        for name in _pictures(document(advised, image_format)):
            shutil.copy2(path / name, fresh / name)
        return _write_texts(advised, fresh, image_format, shown.result())


@contextlib.contextmanager
def _work_in_threads(
    advise: Callable[[Audit, Callable[[], None]], Audit], audit: Audit
) -> Iterator[tuple[Future[Audit], Future[dict[str, Any]]]]:
    """Search for advice and prepare the page's map data, in threads.

    Advice ends at its next report where the block is left by an error.
    """
    ended = threading.Event()

    def go_on() -> None:
        if ended.is_set():
            raise InterruptedError

    with ThreadPoolExecutor(2, thread_name_prefix="advice") as executor:
        try:
            yield executor.submit(advise, audit, go_on), executor.submit(page_map, audit)
        except BaseException:
            ended.set()
            raise


def _write_texts(
    audit: Audit, folder: Path, image_format: str, shown: dict[str, Any] | None = None
) -> Document:
    """Write figures and texts beside the pictures; without map data no HTML page is written."""
    report = document(audit, image_format)
    (folder / JSON).write_text(report.model_dump_json(indent=2) + "\n", encoding="utf-8")
    (folder / MARKDOWN).write_text(render("report.md.j2", report), encoding="utf-8")
    if shown is not None:
        inlined = {name: data_uri(folder / name) for name in _pictures(report)}
        page = audit_page(shown, report, inlined, _values(report))
        (folder / HTML).write_text(page, encoding="utf-8")
    return report


def render(template: str, report: Document, pictures: dict[str, str] | None = None) -> str:
    """Fill a template with a report.

    Args:
        template: Name of a file in the folder templates.
        report: The figures.
        pictures: Replacement of each picture's file name; None: the file name itself.
    """
    filters: dict[str, Callable[..., str]] = {
        "percent": percent,
        "metres2": metres2,
        "axis_degrees": axis_degrees,
        "places": places_text,
    }
    named = pictures or {name: name for name in _pictures(report)}
    return fill(
        "ambinav.studies.audit", template, filters, report=report, pictures=named, **_values(report)
    )


def _values(report: Document) -> dict[str, Any]:
    """Return the values that the templates need beside the report and its pictures."""
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
