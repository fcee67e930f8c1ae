"""Running a comparison into a folder: map, routes, drives, tables, pictures, reports."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from jinja2 import Environment as Templates
from jinja2 import PackageLoader, StrictUndefined

from ambinav.ambiguity.build import build_map
from ambinav.compare.document import Document, document, pairs_of
from ambinav.compare.plans import Plan, make_plans
from ambinav.compare.plots import plot_errors, plot_floor, plot_spread
from ambinav.compare.results import Results
from ambinav.compare.runs import drive_all
from ambinav.compare.scenario_file import Loaded
from ambinav.compare.tables import (
    FIGURES,
    Row,
    difference_text,
    make_rows,
    ratio_text,
    to_csv,
    value_text,
)
from ambinav.errors import InputError
from ambinav.files import replacing
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.drawing import save_figure
from ambinav.routes.files import save_route

JSON: Final = "report.json"
HTML: Final = "report.html"
MARKDOWN: Final = "report.md"
TABLE: Final = "table.csv"
WORK: Final = "work"
"""Folder of what is kept to go on after a break: the map, and a file for each piece of work."""
ROUTES: Final = "routes"
PICTURES: Final = ("floor-", "spread-", "errors-")

Bars = Callable[[str], Callable[[float], None]]


def check_output(folder: str | Path) -> Path:
    """Check that a comparison may be written to `folder`.

    Raises:
        InputError: it is a file, or a folder that holds something else than an earlier comparison.
    """
    path = Path(folder)
    if not path.exists():
        return path
    if not path.is_dir():
        raise InputError(f"{folder}: this is a file, not a folder; choose another output.")
    ours = (JSON, HTML, MARKDOWN, TABLE, WORK, ROUTES)
    for name in sorted(item.name for item in path.iterdir()):
        if name not in ours and not (name.startswith(PICTURES) and name.endswith(".png")):
            raise InputError(
                f"{folder}: this folder holds {name}, which is not of an earlier comparison; "
                "choose a new folder."
            )
    return path


def compare(
    loaded: Loaded, folder: str | Path, *, jobs: int = 1, bars: Bars | None = None
) -> tuple[Document, tuple[Row, ...]]:
    """Compare the routes of a scenario, and write all that was found.

    What an earlier call left in `folder` is used: the map and the drives whose inputs are
    unchanged are not made again.

    Args:
        loaded: The scenario.
        folder: Where to write.
        jobs: How many processes drive.
        bars: Given a text, returns what takes the share done.

    Returns:
        What report.json holds, and the rows of the table.

    Raises:
        InputError: see `check_output`, `make_plans` and `drive_all`.
    """
    out = check_output(folder)
    begin = bars or (lambda text: lambda share: None)
    amap = _map(loaded, out / WORK, begin)
    plans = make_plans(loaded, amap, begin("routes"))
    files = _save_routes(plans, out)
    results = drive_all(loaded, amap, plans, out / WORK, jobs=jobs, progress=begin("drives"))
    scenario = loaded.scenario
    rows = make_rows(plans, results, scenario.baseline, scenario.drive.seed)
    pictures = _draw(amap, plans, results, out, begin("pictures"))
    report = document(loaded, plans, files, rows, pictures)
    inlined = {name: _data_uri(out / name) for names in pictures.values() for name in names}
    _write(out / TABLE, to_csv(rows))
    _write(out / MARKDOWN, render("report.md.j2", report, rows))
    _write(out / HTML, render("report.html.j2", report, rows, inlined))
    _write(out / JSON, report.model_dump_json(indent=2) + "\n")
    return report, rows


def render(
    template: str,
    report: Document,
    rows: Sequence[Row],
    pictures: dict[str, str] | None = None,
) -> str:
    """Fill a template.

    Args:
        template: Name of a file in the folder templates.
        report: The figures.
        rows: The table.
        pictures: What stands for each picture's file name; None: the file name itself.
    """
    templates = Templates(
        loader=PackageLoader("ambinav.compare", "templates"),
        autoescape=template.endswith(".html.j2"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    templates.filters["value"] = value_text
    templates.filters["difference"] = difference_text
    templates.filters["ratio"] = ratio_text
    templates.filters["cell"] = _cell
    names = [name for names in report.pictures.values() for name in names]
    return templates.get_template(template).render(
        report=report,
        pairs=pairs_of(rows),
        rows=rows,
        figures=FIGURES,
        ratios=[figure for figure in FIGURES if figure.ratio],
        pictures=pictures or {name: name for name in names},
    )


def _map(loaded: Loaded, work: Path, begin: Bars) -> AmbiguityMap:
    """The map of the scenario, built or read."""
    asked = loaded.scenario.map.model_dump(exclude={"layer"})
    segments = loaded.environment.segments
    told = json.dumps([asked, loaded.scanner.to_yaml(), loaded.environment.name])
    digest = hashlib.sha256(told.encode())
    digest.update(segments.xy.tobytes())
    path = work / f"map-{digest.hexdigest()[:16]}.zarr"
    if path.is_dir():
        return AmbiguityMap.open(path)
    amap = build_map(loaded.environment, loaded.scanner, progress=begin("ambiguity"), **asked)
    amap.save(path)
    # Read back, so that it makes no difference whether the map was there.
    return AmbiguityMap.open(path)


def _save_routes(plans: Sequence[Plan], out: Path) -> list[str]:
    names = []
    for number, plan in enumerate(plans):
        name = f"{ROUTES}/{number + 1:02d}-{_slug(plan.pair)}-{_slug(plan.name)}.csv"
        save_route(plan.route, out / name)
        names.append(name)
    return names


def _draw(
    amap: AmbiguityMap,
    plans: Sequence[Plan],
    results: Sequence[Results],
    out: Path,
    progress: Callable[[float], None],
) -> dict[str, tuple[str, ...]]:
    """Three pictures for each pair; returns their names by pair."""
    pairs = list(dict.fromkeys(plan.pair for plan in plans))
    named: dict[str, tuple[str, ...]] = {}
    for number, pair in enumerate(pairs):
        chosen = [i for i, plan in enumerate(plans) if plan.pair == pair]
        ways, found = [plans[i] for i in chosen], [results[i] for i in chosen]
        names = tuple(f"{kind}{number + 1:02d}-{_slug(pair)}.png" for kind in PICTURES)
        figures = (
            plot_floor(amap, ways, f"Routes: {pair}"),
            plot_spread(amap, ways, found, f"Where the localizer errs: {pair}"),
            plot_errors(ways, found, f"Error along the way: {pair}"),
        )
        for name, figure in zip(names, figures, strict=True):
            with replacing(out / name) as scratch:
                save_figure(figure, scratch)
        named[pair] = names
        progress((number + 1) / len(pairs))
    return named


def _slug(name: str) -> str:
    """A name as part of a file's name."""
    return re.sub(r"[^a-z0-9.]+", "-", name.lower()).strip("-.") or "unnamed"


def _write(path: Path, text: str) -> None:
    with replacing(path) as scratch:
        scratch.write_text(text, encoding="utf-8")


def _data_uri(path: Path) -> str:
    return "data:image/png;base64," + base64.b64encode(path.read_bytes()).decode("ascii")


def _cell(value: object) -> str:
    """A parameter as a reader wants it in a table."""
    if value is None:
        return "default"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, dict):
        return ", ".join(f"{key} {_cell(entry)}" for key, entry in value.items())
    if isinstance(value, list | tuple):
        return "; ".join(map(_cell, value))
    return str(value)
