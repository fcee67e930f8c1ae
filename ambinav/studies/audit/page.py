"""The parts of the audit's page: its map and its opening."""

from __future__ import annotations

import math
from typing import Any

from ambinav.reports.page.map_data import map_data
from ambinav.studies.audit.audit import Audit
from ambinav.studies.audit.document import Document, PlacePart


def page_map(audit: Audit) -> dict[str, Any]:
    """Return the map data of the page; advice does not change them."""
    return map_data(audit.amap, audit.scanner, heading=audit.heading, parts=audit.parts)


def with_places(data: dict[str, Any], report: Document) -> dict[str, Any]:
    """Add the places and zones of an audit to the map data of its page, and return them."""
    data["places"] = [_place(place) for place in report.places]
    data["map"]["zones"] = [
        {"zone": zone.zone, "share": zone.share, "area_m2": zone.area_m2} for zone in report.zones
    ]
    return data


def lead(report: Document) -> tuple[str, str]:
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
        "reason": place.cause.sentence,
        "weak_direction": None if direction is None else math.radians(direction),
    }
