"""Report of the changes that meet a requirement, with pictures and changes.geojson."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ambinav.plotting.cost_curve import CostCurve, CostPoint, plot_cost_curve
from ambinav.plotting.placement import PlacementView, plot_placement
from ambinav.reports.parameters import map_parameters
from ambinav.runtime.progress import Progress, silent
from ambinav.studies.design.improved import PICTURES, improved_text, state_figures, zones_after
from ambinav.studies.design.requirement.document import (
    FORMAT,
    Document,
    document,
    money,
    state_label,
)
from ambinav.studies.design.requirement.requirement import LOST
from ambinav.studies.design.requirement.study import Solution
from ambinav.studies.design.requirement.trip_part import trip_text
from ambinav.studies.study import Content, Study

GEOJSON: Final = "changes.geojson"
CURVE: Final = "curve"
BAD: Final = ("bad", "bad area")
"""Figures of requirements that are limits on the curve."""
STUDY: Final = Study(
    "solution", "ambinav.studies.design.requirement", (*PICTURES, CURVE), (GEOJSON,), FORMAT
)


def write_report(
    solution: Solution, folder: str | Path, progress: Progress = silent, image_format: str = "png"
) -> Document:
    """Write a solution, see `Study.write`; return what report.json holds.

    Args:
        solution: The solution.
        folder: Output folder.
        progress: Called with the fraction done, 0 to 1.
        image_format: Format of the pictures, one of `ambinav.plotting.style.FORMATS`.
    """
    report = document(solution)
    figures = state_figures(lambda placed: draw_zones(solution, report, placed))
    figures[CURVE] = lambda: draw_curve(solution, report)
    STUDY.write(folder, content(solution, report), figures, image_format, progress)
    return report


def draw_zones(solution: Solution, report: Document, placed: bool) -> Axes:
    """Draw the zones without or with the changes, the obstacles by the numbers of their steps."""
    obstacles = [step.obstacle for step in solution.steps if step.obstacle is not None]
    numbers = [k for k, step in enumerate(solution.steps, 1) if step.obstacle is not None]
    before, after = solution.before.amap, solution.after.amap
    losses = (solution.after if placed else solution.before).losses
    return plot_placement(
        before,
        zones_after(before, after if placed else before),
        solution.before.amap.judged,
        PlacementView(
            reflective=any(each.obstacle.reflective for each in obstacles),
            outlines=tuple(each.obstacle.outline for each in obstacles),
            kinds=tuple(each.kind for each in obstacles),
            numbers=tuple(numbers),
            improved=[(place.x_m, place.y_m) for place in report.improved],
            routes=() if losses is None else [route.poses for route in losses.routes],
            names={
                name: at
                for trip in report.trips
                for name, at in ((trip.start, trip.start_m), (trip.goal, trip.goal_m))
            },
        ),
        placed=placed,
    )


def draw_curve(solution: Solution, report: Document) -> Figure:
    """Draw what is left over cost: the states that were looked at, those on the front joined."""
    is_lost, requirement = bool(report.trips), solution.requirement
    limit = None
    if requirement is not None and requirement.condition.quantity.name in (*BAD, LOST):
        number = requirement.condition.limit.number
        of_floor = requirement.condition.quantity.unit == "%" and not is_lost
        limit = number / 100.0 * report.counted_area_m2 if of_floor else number, str(requirement)
    left = report.after.value if is_lost else report.after.bad_area_m2
    assert left is not None
    curve = CostCurve(
        points=[
            CostPoint(
                point.cost,
                point.bad_area_m2 if point.lost is None else 100.0 * point.lost,
                point.on_front,
            )
            for point in report.curve
        ],
        chosen=(report.cost, left, state_label(solution.after.state)),
        counted=None if is_lost else report.counted_area_m2,
        advised=report.met is not False,
        limit=limit,
        budget=report.budget,
    )
    title = "Lost robots" if is_lost else "Bad floor"
    return plot_cost_curve(curve, f"{title} over cost: {report.environment}")


def content(solution: Solution, report: Document) -> Content:
    """Return what the documents say, and the obstacles as GeoJSON."""
    before, after = solution.before.state, solution.after.state
    values = {
        "parameters": map_parameters(report.parameters),
        "geojson": GEOJSON,
        "captions": (
            f"Before: {before.bad:,.1f} m² bad, {before.hardware.scanner.name}",
            f"After: {after.bad:,.1f} m² bad, {after.hardware.scanner.name}",
        ),
        "improved": improved_text(report.improved),
    }
    filters = {
        "money": money,
        "percent": lambda value: f"{value:.1f} %",
        "trip": trip_text,
        "degrees": lambda value: "" if value is None else f"{value:z.0f}°",
    }
    files = {GEOJSON: json.dumps(report.geojson, indent=1) + "\n"}
    return Content(report, values, filters, files=files)
