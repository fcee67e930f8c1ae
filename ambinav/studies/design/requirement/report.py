"""Report of the changes that meet a requirement, with pictures and changes.geojson."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from ambinav.plotting.cost_curve import CostCurve, CostPoint, plot_cost_curve
from ambinav.plotting.placement import PlacementView, plot_placement
from ambinav.reports.parameters import map_parameters
from ambinav.studies.design.requirement.document import (
    FORMAT,
    Document,
    document,
    money,
    state_label,
)
from ambinav.studies.design.requirement.study import Solution
from ambinav.studies.study import Content, Progress, Study

GEOJSON: Final = "changes.geojson"
ZONES: Final = "before-after"
CURVE: Final = "curve"
BAD: Final = ("bad", "bad area")
"""Figures of requirements that are limits on the curve."""
STUDY: Final = Study(
    "solution", "ambinav.studies.design.requirement", (ZONES, CURVE), (GEOJSON,), FORMAT
)


def write_report(
    solution: Solution,
    folder: str | Path,
    progress: Progress = lambda share: None,
    image_format: str = "png",
) -> Document:
    """Write a solution, see `Study.write`; return what report.json holds.

    Args:
        solution: The solution.
        folder: Output folder.
        progress: Called with the fraction done, 0 to 1.
        image_format: Format of the pictures, one of `ambinav.plotting.style.FORMATS`.
    """
    report = document(solution)
    figures = {ZONES: lambda: draw_zones(solution), CURVE: lambda: draw_curve(solution, report)}
    STUDY.write(folder, content(report), figures, image_format, progress)
    return report


def draw_zones(solution: Solution) -> Figure:
    """Draw the zones before and after, with the obstacles by the numbers of their steps."""
    obstacles = [step.obstacle for step in solution.steps if step.obstacle is not None]
    numbers = [k for k, step in enumerate(solution.steps, 1) if step.obstacle is not None]
    before, after = solution.before.state, solution.after.state
    return plot_placement(
        solution.before.amap,
        solution.after.amap,
        solution.before.amap.judged,
        PlacementView(
            titles=(
                f"Before: {before.bad:,.1f} m² bad, {before.hardware.scanner.name}",
                f"After: {after.bad:,.1f} m² bad, {after.hardware.scanner.name}",
            ),
            reflective=any(one.obstacle.reflective for one in obstacles),
            outlines=tuple(one.obstacle.outline for one in obstacles),
            kinds=tuple(one.kind for one in obstacles),
            numbers=tuple(numbers),
        ),
    )


def draw_curve(solution: Solution, report: Document) -> Figure:
    """Draw bad floor over cost: the states that were looked at, those on the front joined."""
    state, counted = solution.after.state, report.counted_area_m2
    limit = None
    if solution.requirement is not None and solution.requirement.condition.quantity.name in BAD:
        number = solution.requirement.condition.limit.number
        share = solution.requirement.condition.quantity.unit == "%"
        limit = number / 100.0 * counted if share else number, str(solution.requirement)
    curve = CostCurve(
        points=[CostPoint(point.cost, point.bad_area_m2, point.on_front) for point in report.curve],
        chosen=(report.cost, report.after.bad_area_m2, state_label(state)),
        counted=counted,
        limit=limit,
        budget=report.budget,
    )
    return plot_cost_curve(curve, f"Bad floor over cost: {report.environment}")


def content(report: Document) -> Content:
    """Return what the documents say, and the obstacles as GeoJSON."""
    values = {"parameters": map_parameters(report.parameters), "geojson": GEOJSON}
    filters = {
        "area": lambda value: f"{value:,.1f} m²",
        "share": lambda share: f"{100.0 * share:.1f} %",
        "metres": lambda value: "" if value is None else f"{value:.2f}",
        "money": money,
        "degrees": lambda value: "" if value is None else f"{value:.0f}°",
    }
    files = {GEOJSON: json.dumps(report.geojson, indent=1) + "\n"}
    return Content(report, values, filters, files=files)
