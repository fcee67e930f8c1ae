"""What to do about an audit: the three actions that a reader is told first."""

from __future__ import annotations

from typing import Final

from ambinav.audit.audit import axis_degrees, metres2, percent
from ambinav.audit.document import Document, PlacePart
from ambinav.reports.action import MOST, Action

_HEADING_HELPS: Final = 0.2
"""Difference of the level between headings of a place from which turning is advised."""
_LARGE_SHARE: Final = 0.1
"""Share of the free floor from which unexplored floor is worth mapping."""


def actions(report: Document) -> tuple[Action, ...]:
    """The actions that an audit leads to, the most floor first; at least one."""
    found = [_at_place(place, report.scanner.max_range_m) for place in report.places[:MOST]]
    if report.floor.unexplored_share >= _LARGE_SHARE:
        found.insert(
            1,
            Action(
                "Map the unexplored floor",
                f"On {metres2(report.floor.unexplored_area_m2)} "
                f"({percent(report.floor.unexplored_share)} of the free floor) half of the beams "
                "or more end in unknown space. Nothing is said of it until the map goes on there.",
            ),
        )
    found = found[:MOST]
    bad = sum(zone.area_m2 for zone in report.zones if zone.zone in ("corridor", "open"))
    general = []
    if bad:
        general.append(
            Action(
                "Plan around it",
                f"Keep the map with --save-map and plan with `ambinav plan`: routes then weigh the "
                f"{metres2(bad)} of corridor and open floor against the detour.",
            )
        )
        general.append(
            Action(
                "Compare scanners before buying one",
                "Audit the same building with another range, aperture or mounting; `ambinav "
                "presets` lists scanners.",
            )
        )
    else:
        general.append(
            Action(
                "Keep this audit as a baseline",
                "No corridor or open floor was found. Audit again when the building, its map or "
                "the scanner changes.",
            )
        )
    return tuple((found + general)[:MOST])


def _at_place(place: PlacePart, max_range: float) -> Action:
    """What would help at a place."""
    where = f"place {place.number}"
    levels = [level for _, level in place.level_by_heading]
    if levels and max(levels) - min(levels) >= _HEADING_HELPS and min(levels) < place.level:
        return Action(
            f"Choose the heading at {where}",
            f"Facing {place.best_heading_deg:.0f}° its level is {min(levels):.2f}, facing "
            f"{place.worst_heading_deg:.0f}° it is {max(levels):.2f}: turn the robot, or the "
            "scanner on it.",
            place.number,
        )
    if place.zone == "open":
        return Action(
            f"Bring something into range at {where}",
            f"Nothing useful is within {max_range:g} m over {metres2(place.area_m2)}. Landmarks, "
            "or a scanner with more range, would fix the position.",
            place.number,
        )
    along = "" if place.direction_deg is None else f" along {axis_degrees(place.direction_deg)}"
    return Action(
        f"Break the sameness of {where}",
        f"Over {place.length_m:.1f} m the robot slides unseen{along}. Furniture, niches or "
        "reflectors there, or a scanner that sees the end, would stop it.",
        place.number,
    )
