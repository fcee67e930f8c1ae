"""Report of an audit; pictures are drawn beside the search for advice."""

from __future__ import annotations

import contextlib
import shutil
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final

from ambinav.config import check_kind
from ambinav.maps.judged_floor import unreachable_label
from ambinav.maps.zones import UNEXPLORED_MEANING
from ambinav.plotting import style
from ambinav.reports.number_text import metres2, percent
from ambinav.reports.parameters import map_parameters
from ambinav.runtime.files import replacing
from ambinav.runtime.progress import Progress, silent
from ambinav.studies.audit.actions import actions
from ambinav.studies.audit.audit import Audit, axis_degrees, places_text
from ambinav.studies.audit.document import FORMAT, Document, document
from ambinav.studies.audit.drawing import Draw, drawing
from ambinav.studies.audit.lost_routes import MEASURED
from ambinav.studies.audit.page import lead, page_map, with_places
from ambinav.studies.audit.verdict import CHOICE
from ambinav.studies.design.improved import improved_text
from ambinav.studies.study import Content, Study

STUDY: Final = Study("audit", "ambinav.studies.audit", ("floor-*", "place-*"), format=FORMAT)


def write_audit(
    audit: Audit,
    folder: str | Path,
    progress: Progress = silent,
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
    check_kind(audit, Audit, "audit", "give what `audit` returns")
    style.check_format(image_format)
    path = STUDY.folder.check(folder).absolute()
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
    """Write figures and texts beside the pictures; without map data no page is written."""
    report = document(audit, image_format)
    pictures = {name: name for name in _pictures(report)}
    STUDY.write_documents(folder, content(report, shown), pictures, page=shown is not None)
    return report


def content(report: Document, shown: dict[str, Any] | None = None) -> Content:
    """Return the content of the documents.

    Args:
        report: The figures.
        shown: See `page_map`; places and zones are added to it.
    """
    floor = report.floor
    first, remainder = lead(report)
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
    counted = report.floor.counted_area_m2
    filters: dict[str, Callable[..., str]] = {
        "of_counted": lambda share: percent(share if counted else None),
        "axis_degrees": axis_degrees,
        "places": places_text,
        "improved": lambda places: improved_text(places, named=False),
    }
    values = {
        "lead": first,
        "rest": remainder,
        "actions": actions(report),
        "choice": CHOICE,
        "measured": MEASURED,
        "parameters": map_parameters(report.parameters),
        "outside": outside,
        "image_format": report.pictures[0].rpartition(".")[2],
        "unexplored": unexplored,
        "unreachable": unreachable,
    }
    return Content(report, values, filters, None if shown is None else with_places(shown, report))


def _pictures(report: Document) -> list[str]:
    return [*report.pictures, *(place.picture for place in report.places)]
