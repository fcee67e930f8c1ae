"""Writing of the results into a folder: report, scanner, filter for ROS, pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ambinav.plotting import style
from ambinav.plotting.beams import plot_kept_beams, plot_loss_curves
from ambinav.plotting.canvas import save_figure
from ambinav.reports.pages import data_uri, fill
from ambinav.reports.parameters import map_parameters
from ambinav.runtime.files import replacing
from ambinav.runtime.runfolder import RunFolder
from ambinav.studies.design.beams.choose import Choice
from ambinav.studies.design.beams.document import FORMAT, HOW, Document, document
from ambinav.studies.design.beams.localizer import ScanInformation, UpdateTime
from ambinav.studies.design.beams.sample import MapSample
from ambinav.studies.design.beams.scanner import ScanMask, laser_filters_text, subset_scanner

JSON: Final = "report.json"
HTML: Final = "report.html"
MARKDOWN: Final = "report.md"
SCANNER: Final = "scanner.yaml"
FILTER: Final = "laser_filters.yaml"
KEPT: Final = "kept-beams"
CURVES: Final = "loss-by-beams"
FOLDER: Final = RunFolder(
    "search for fewer beams",
    (
        JSON,
        HTML,
        MARKDOWN,
        SCANNER,
        FILTER,
        *(f"{kind}.{ending}" for ending in style.FORMATS for kind in (KEPT, CURVES)),
    ),
    proof=JSON,
    format=FORMAT.split("/")[0],
)


def write_report(
    choice: Choice,
    samples: Sequence[MapSample],
    sources: Sequence[str],
    updates: Sequence[UpdateTime],
    information: ScanInformation,
    masks: Sequence[ScanMask],
    parameters: Mapping[str, Any],
    folder: str | Path,
    image_format: str = "png",
) -> Document:
    """Write all results atomically; an earlier search in `folder` is replaced.

    Args:
        choice: Result of the search.
        samples: The poses of each map that beams were chosen on.
        sources: File of each map.
        updates: Durations of the localizers' updates.
        information: Position accuracy from one scan.
        masks: Readings removed from LaserScan messages; empty if there are no such messages.
        parameters: Parameters of the search, by name.
        folder: Output folder.
        image_format: Format of the pictures, one of `ambinav.plotting.style.FORMATS`.

    Returns:
        What report.json holds.

    Raises:
        InputError: see `RunFolder.check`; or the place is not writable.
    """
    path = FOLDER.check(folder).absolute()
    pictures = [f"{kind}.{image_format}" for kind in (KEPT, CURVES)]
    files = [SCANNER, *([FILTER] if masks else [])]
    report = document(
        choice, samples, sources, updates, information, masks, parameters, files, pictures
    )
    with replacing(path) as fresh:
        fresh.mkdir()
        _draw(choice, samples, report, [fresh / picture for picture in pictures])
        subset_scanner(choice.scanner, choice.chosen.beams).to_yaml(fresh / SCANNER)
        if masks:
            (fresh / FILTER).write_text(laser_filters_text(masks), encoding="utf-8")
        (fresh / JSON).write_text(report.model_dump_json(indent=2) + "\n", encoding="utf-8")
        (fresh / MARKDOWN).write_text(_filled("beams.md.j2", report, pictures), encoding="utf-8")
        inlined = [data_uri(fresh / picture) for picture in pictures]
        (fresh / HTML).write_text(_filled("beams.html.j2", report, inlined), encoding="utf-8")
    return report


def _draw(
    choice: Choice, samples: Sequence[MapSample], report: Document, paths: Sequence[Path]
) -> None:
    title = f"{report.scanner}: {len(report.chosen.beams)} of {report.beams} beams"
    figure = plot_kept_beams(choice.scanner.mounts, _reach(choice), choice.chosen.beams, title)
    save_figure(figure, paths[0])
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
    save_figure(plot_loss_curves(curves, random, choice.limit, chosen, title), paths[1])


def _reach(choice: Choice) -> NDArray[np.float64]:
    """Return the drawn length of each beam, metres: its maximum range."""
    scanner = choice.scanner
    limit = np.array([sensor.max_range for sensor in scanner.sensors])
    return np.asarray(limit[scanner.sensor_of_beam])


def _filled(template: str, report: Document, pictures: Sequence[str]) -> str:
    filters: dict[str, Callable[..., str]] = {
        "points": lambda value: f"{value:.2f}",
        "share": lambda value: f"{100.0 * value:.1f} %",
        "ms": lambda value: f"{value:.3f} ms",
        "cm": lambda value: f"{100.0 * value:.2f} cm",
        "md": lambda text: text.replace("|", "\\|").replace("<", "&lt;").replace("\n", " "),
    }
    curves = {curve.method: curve for curve in report.curves}
    sizes = sorted({*curves["even"].beams, *curves["greedy"].beams})
    return fill(
        "ambinav.studies.design", template, filters, report=report, kept_picture=pictures[0],
        curves_picture=pictures[1], curves=curves, sizes=sizes,
        random={subsets.beams: subsets for subsets in report.random},
        parameters=map_parameters(report.parameters),
    )  # fmt: skip
