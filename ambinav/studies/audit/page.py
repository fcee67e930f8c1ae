"""The audit as a single HTML file: its map and its text."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from ambinav.reports.page.html import fill_page
from ambinav.reports.page.map_data import map_data
from ambinav.reports.parameters import map_parameters
from ambinav.studies.audit.actions import actions
from ambinav.studies.audit.audit import Audit, axis_degrees, metres2, percent, places_text
from ambinav.studies.audit.document import Document, PlacePart


def page_map(audit: Audit) -> dict[str, Any]:
    """Return the map data of the page; advice does not change them."""
    return map_data(audit.amap, audit.scanner, heading=audit.heading, parts=audit.parts)


def audit_page(
    data: dict[str, Any], report: Document, pictures: Mapping[str, str], values: Mapping[str, Any]
) -> str:
    """Write the audit's HTML page.

    Args:
        data: See `page_map`; places and zones are added to it.
        report: The figures of the audit.
        pictures: Replacement of each picture's file name.
        values: Further values of the template, which the other written report has too.
    """
    data["places"] = [_place(place) for place in report.places]
    data["map"]["zones"] = [
        {"zone": zone.zone, "share": zone.share, "area_m2": zone.area_m2} for zone in report.zones
    ]
    lead, remainder = _lead(report)
    filters: dict[str, Callable[..., str]] = {
        "percent": percent,
        "metres2": metres2,
        "axis_degrees": axis_degrees,
        "places": places_text,
    }
    return fill_page(
        "ambinav.studies.audit",
        "page.html.j2",
        data,
        filters,
        report=report,
        lead=lead,
        rest=remainder,
        actions=actions(report),
        parameters=map_parameters(report.parameters),
        pictures=pictures,
        block=data["map"]["block"],
        **values,
    )


def _lead(report: Document) -> tuple[str, str]:
    """Return the opening of the page (the verdict if there is one) and the text after it."""
    if report.verdict is not None:
        return report.verdict.sentence, report.summary
    first, stop, remainder = report.summary.partition(". ")
    return first + stop.strip(), remainder


def _place(place: PlacePart) -> dict[str, Any]:
    """Return a place in the form of the HTTP service, metres and radians."""
    heading, direction = place.worst_heading_deg, place.direction_deg
    return {
        "number": place.number,
        "x": place.x_m,
        "y": place.y_m,
        "theta": None if heading is None else math.radians(heading),
        "zone": place.zone,
        "level": place.level,
        "area_m2": place.area_m2,
        "length": place.length_m,
        "width": place.width_m,
        "reason": place.sees.sentence,
        "weak_direction": None if direction is None else math.radians(direction),
    }
