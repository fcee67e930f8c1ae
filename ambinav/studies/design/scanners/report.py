"""Report of a comparison of scanners, with table.csv, sampled routes and pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from ambinav.maps.zones import CORRIDOR, OPEN
from ambinav.plotting.fronts import FrontDot, FrontPanel, plot_fronts
from ambinav.plotting.scanners import (
    ScannerBars,
    ScannerFloor,
    plot_scanner_bars,
    plot_scanner_maps,
)
from ambinav.reports.number_text import metres2
from ambinav.reports.parameters import map_parameters
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.files import save_route
from ambinav.runtime.progress import Progress, silent
from ambinav.service.service import AmbiguityService
from ambinav.studies.design.scanners.compare import ScannerTable, bad_area
from ambinav.studies.design.scanners.document import FORMAT, Document, document, table_csv
from ambinav.studies.study import Content, Study

TABLE: Final = "table.csv"
BARS, MAPS, FRONTS = "scanners", "maps", "fronts"
STUDY: Final = Study(
    "comparison of scanners",
    "ambinav.studies.design.scanners",
    (BARS, MAPS, FRONTS),
    (TABLE, "route-*.csv"),
    FORMAT,
)


def write_report(
    table: ScannerTable, folder: str | Path, progress: Progress = silent, image_format: str = "png"
) -> Document:
    """Write a comparison, see `Study.write`; return what report.json holds.

    Sampled routes are written too, as measured with the scanner whose map the table keeps, so that
    they can be given again.

    Args:
        table: The comparison.
        folder: Output folder.
        progress: Called with the fraction done, 0 to 1.
        image_format: Format of the pictures, one of `ambinav.plotting.style.FORMATS`.
    """
    report = document(table)
    figures = {BARS: lambda: draw_bars(table), MAPS: lambda: draw_maps(table)}
    if table.fronts:
        figures[FRONTS] = lambda: draw_fronts(table)
    STUDY.write(
        folder,
        content(report),
        figures,
        image_format,
        progress,
        more=lambda fresh: _save_routes(table, fresh) if table.sampled else None,
    )
    return report


def draw_bars(table: ScannerTable) -> Figure:
    """Draw bad area, longest open stretch and expected error of each scanner."""
    front = table.front
    rows = [
        ScannerBars(
            name=f"{number}  {row.name}",
            corridor=row.shares[CORRIDOR].area,
            open=row.shares[OPEN].area,
            worst=None if row.worst is None else bad_area(row.worst),
            longest_open=None if row.routes is None else row.routes.floor.longest_open,
            mean_error=None if row.routes is None else row.routes.mean_error,
            worst_error=None if row.routes is None else row.routes.worst_error,
            dominated=front is None or row.name not in {point.name for point in front.best},
        )
        for number, row in enumerate(table.rows, start=1)
    ]
    title = f"Scanners in {table.environment.name}, robot of radius {table.reach.radius:.2f} m"
    return plot_scanner_bars(rows, "by bad area", title)


def draw_maps(table: ScannerTable) -> Figure:
    """Draw the zones of each scanner."""
    floors = [
        ScannerFloor(f"{number}  {row.name}: {metres2(row.bad_area)} bad", row.zone, row.parts)
        for number, row in enumerate(table.rows, start=1)
    ]
    title = f"Zones by scanner: {table.environment.name}"
    return plot_scanner_maps(floors, table.amap, title)


def draw_fronts(table: ScannerTable) -> Figure:
    """Draw bad area against the costs of scanners."""
    number = {row.name: count for count, row in enumerate(table.rows, start=1)}
    panels = []
    for front in table.fronts:
        unit = f" ({front.unit})" if front.unit else ""
        dots = [
            FrontDot(
                str(number[point.name]) + (f" {point.name}" if point.dominated_by is None else ""),
                point.against,
                point.bad_area,
                point.dominated_by is not None,
            )
            for point in front.points
        ]
        panels.append(FrontPanel(f"{front.title}{unit}", dots))
    title = f"Bad area against what a scanner costs: {table.environment.name}"
    return plot_fronts(panels, "bad area (m²)", title, "numbers: rows of the table")


def _save_routes(table: ScannerTable, folder: Path) -> None:
    service = AmbiguityService(table.amap)
    digits = len(str(len(table.routes)))
    for number, route in enumerate(table.routes, start=1):
        measured = evaluate_route(service, route.poses, route.steering, planner=route.planner)
        save_route(measured, folder / f"route-{number:0{max(digits, 2)}d}.csv")


def content(report: Document) -> Content:
    """Return what the documents say, and the table."""
    scanners = report.scanners
    values = {
        "parameters": map_parameters(report.parameters),
        "has_price": any(scanner.price is not None for scanner in scanners),
        "has_power": any(scanner.power_w is not None for scanner in scanners),
        "has_headings": any(scanner.headings is not None for scanner in scanners),
        "has_unexplored": any(scanner.unexplored_area_m2 > 0.0 for scanner in scanners),
        "floors_differ": len({scanner.counted_area_m2 for scanner in scanners}) > 1,
        "layers": {name: part for scanner in scanners for name, part in scanner.layers.items()},
        "lacking": [
            (scanner.name, why) for scanner in scanners for why in scanner.lacking.values()
        ],
    }
    filters = {
        "m2": lambda area: "" if area is None else f"{area:,.1f}",
        "metres": lambda metres: "" if metres is None else f"{metres:.1f}",
        "error": lambda metres: "" if metres is None else f"{metres:.3f}",
        "plain": lambda value: "" if value is None else f"{value:g}",
        "brief": lambda value: "" if value is None else f"{value:.3g}",
        "seconds": lambda value: "store" if value is None else f"{value:.1f}",
    }
    return Content(report, values, filters, files={TABLE: table_csv(report)})
