"""Writing an audit into a folder: report.html, report.md, report.json and the pictures."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Final

from ambinav.audit.audit import Audit, axis_degrees, metres2, percent, places_text
from ambinav.audit.document import FORMAT, Document, document
from ambinav.audit.pictures import save_pictures
from ambinav.errors import InputError
from ambinav.files import replacing
from ambinav.maps.floor_parts import unreachable_label
from ambinav.maps.zones import UNEXPLORED_MEANING
from ambinav.pages import data_uri, fill
from ambinav.plotting import style

JSON: Final = "report.json"
HTML: Final = "report.html"
MARKDOWN: Final = "report.md"


def check_output(folder: str | Path) -> Path:
    """Check that a report may be written to `folder`: that nothing else would be lost.

    Returns:
        The absolute path.

    Raises:
        InputError: it is a file, or a folder that holds something else than an earlier report.
    """
    path = Path(folder).absolute()
    if not path.exists():
        return path
    if not path.is_dir():
        raise InputError(f"{folder}: this is a file, not a folder; choose another output.")
    foreign = sorted(item.name for item in path.iterdir() if not _is_ours(item.name))
    if foreign or (any(path.iterdir()) and not _is_report(path / JSON)):
        what = f"{foreign[0]} and perhaps more" if foreign else "files"
        raise InputError(
            f"{folder}: this folder holds {what}, which is not of an earlier report and would be "
            "lost; choose a new folder."
        )
    return path


def write_report(
    audit: Audit,
    folder: str | Path,
    progress: Callable[[float], None] | None = None,
    image_format: str = "png",
) -> Document:
    """Write the report, whole or not at all; an earlier report in `folder` is replaced.

    Args:
        audit: What to report.
        folder: Where to.
        progress: Called with the fraction done, 0 to 1.
        image_format: Of the pictures, one of `ambinav.plotting.style.FORMATS`.

    Returns:
        What report.json holds.

    Raises:
        InputError: see `check_output`; or the place is not writable.
    """
    path = check_output(folder)
    report = document(audit, image_format)
    with replacing(path) as fresh:
        fresh.mkdir()
        save_pictures(audit, fresh, progress, image_format)
        (fresh / JSON).write_text(report.model_dump_json(indent=2) + "\n", encoding="utf-8")
        (fresh / MARKDOWN).write_text(render("report.md.j2", report), encoding="utf-8")
        inlined = {name: data_uri(fresh / name) for name in _pictures(report)}
        (fresh / HTML).write_text(render("report.html.j2", report, inlined), encoding="utf-8")
    return report


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
    floor = report.floor
    stripes = f"{style.UNKNOWN} 0 2px, {style.UNEXPLORED} 2px 4px"
    unexplored = {
        "meaning": UNEXPLORED_MEANING,
        "swatch": f"repeating-linear-gradient(135deg, {stripes})",
    }
    unreachable = {
        "label": unreachable_label(floor.robot_radius_m),
        "meaning": f"{metres2(floor.cut_off_area_m2)} where it would fit but cannot get to, "
        f"{metres2(floor.beside_walls_area_m2)} nearer to a wall than its centre comes",
        "swatch": style.UNREACHABLE,
    }
    return fill(
        "ambinav.audit",
        template,
        filters,
        report=report,
        pictures=named,
        image_format=report.pictures[0].rpartition(".")[2],
        unexplored=unexplored,
        unreachable=unreachable,
    )


def _pictures(report: Document) -> list[str]:
    return [*report.pictures, *(place.picture for place in report.places)]


def _is_ours(name: str) -> bool:
    if name.endswith(tuple(f".{image_format}" for image_format in style.FORMATS)):
        return name.startswith(("floor-", "place-"))
    return name in (JSON, HTML, MARKDOWN)


def _is_report(path: Path) -> bool:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    # Of whichever version: an older report may be replaced.
    kind = FORMAT.split("/")[0]
    return isinstance(content, dict) and str(content.get("format")).split("/")[0] == kind
