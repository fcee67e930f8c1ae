"""Figures of a difference for conditions, as `diff.json` has them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Final

from ambinav.maps.zones import ZONES
from ambinav.reports.conditions import Quantities, Quantity, catalogue
from ambinav.studies.diff.document import Document, LevelPart, ZonePart
from ambinav.studies.diff.provenance import FILE
from ambinav.studies.diff.regions import NOTABLE

_NOT_JUDGED: Final = "because no floor counts in one of the maps; check what is known of it"
_NO_LEVEL = "because no floor counts in both maps; give two maps of one building"


def _zone(report: Document, name: str) -> ZonePart:
    return next(zone for zone in report.zones if zone.zone == name)


def _location(*kinds: str, after: str = "", before: str = "") -> Callable[[Document], str]:
    """Return a function that locates the largest listed region of a kind or a zone, in words."""

    def where(report: Document) -> str:
        regions = [
            region
            for region in report.regions
            if (not kinds or region.kind in kinds)
            and region.after == (after or region.after)
            and region.before == (before or region.before)
        ]
        if not regions:
            return ""
        most = max(regions, key=lambda region: region.area_m2)
        return (
            f"The largest such region listed is of {most.area_m2:.1f} m² around "
            f"x = {most.x_m:.1f} m, y = {most.y_m:.1f} m; it was {most.before}, it is {most.after}."
        )

    return where


def _judged(report: Document, value: float) -> float | None:
    """Return a figure of the zones; None if no floor counts in one of the maps."""
    areas = [(zone.before_m2, zone.after_m2) for zone in report.zones]
    return value if all(sum(of_one) > 0.0 for of_one in zip(*areas, strict=True)) else None


def _of_zone(name: str) -> Iterator[Quantity]:
    """Yield the figures of a zone."""
    yield Quantity(
        f"new {name} area", "m²", f"floor in the {name} zone after, and not before",
        lambda report: _judged(report, _zone(report, name).new_m2), _location(after=name),
        _NOT_JUDGED,
    )  # fmt: skip
    yield Quantity(
        f"lost {name} area", "m²", f"floor in the {name} zone before, and not after",
        lambda report: _judged(report, _zone(report, name).lost_m2), _location(before=name),
        _NOT_JUDGED,
    )  # fmt: skip
    yield Quantity(
        f"{name} area change", "m²", f"area in the {name} zone after, minus that before",
        lambda report: _judged(
            report, _zone(report, name).after_m2 - _zone(report, name).before_m2
        ),
        _location(after=name), _NOT_JUDGED, least=-math.inf,
    )  # fmt: skip
    yield Quantity(
        f"{name} change", "%",
        f"share of explored, reachable floor in the {name} zone after, minus that before, in "
        "percentage points",
        lambda report: _judged(
            report, 100.0 * (_zone(report, name).after_share - _zone(report, name).before_share)
        ),
        _location(after=name), _NOT_JUDGED, least=-100.0,
    )  # fmt: skip


def _level(
    name: str, unit: str, meaning: str, read: Callable[[LevelPart], float],
    where: Callable[[Document], str] = lambda report: "",
    least: float = 0.0, most: float | None = None,
) -> Quantity:  # fmt: skip
    return Quantity(
        name, unit, f"{meaning}, on floor that counts in both maps",
        lambda report: None if report.level is None else read(report.level), where, _NO_LEVEL,
        least, most,
    )  # fmt: skip


QUANTITIES: Final[Quantities] = catalogue(
    *(quantity for name in ZONES for quantity in _of_zone(name)),
    Quantity(
        "changed zone area", "m²", "floor that counts in both maps and is in another zone",
        lambda report: report.changed_zone_m2,
    ),
    _level(
        "worse area", "m²", f"floor whose level rises by {NOTABLE:g} or more",
        lambda level: level.worse_m2, _location("worse"),
    ),
    _level(
        "better area", "m²", f"floor whose level falls by {NOTABLE:g} or more",
        lambda level: level.better_m2, _location("better"),
    ),
    _level(
        "mean level change", "", "mean level after, minus that before",
        lambda level: level.mean_change, least=-1.0, most=1.0,
    ),
    _level(
        "largest level rise", "", "largest rise of the level; 0 if nothing rises",
        lambda level: level.largest_rise, _location("worse"), most=1.0,
    ),
    _level(
        "largest level fall", "", "largest fall of the level as a number above 0",
        lambda level: 0.0 - level.largest_fall, _location("better"), most=1.0,
    ),
    Quantity(
        "new floor area", "m²", "floor that counts in the second map only",
        lambda report: report.new_floor_m2, _location("new floor"),
    ),
    Quantity(
        "gone floor area", "m²", "floor that counts in the first map only",
        lambda report: report.gone_floor_m2,
    ),
    Quantity(
        "new wall length", "m", "walls that only the second map has",
        lambda report: report.walls.new_m,
    ),
    Quantity(
        "gone wall length", "m", "walls that only the first map has",
        lambda report: report.walls.gone_m,
    ),
    Quantity(
        "differing parameters", "",
        "number of parameters that differ, versions included, the building's file not",
        lambda report: float(sum(part.name not in FILE for part in report.parameters)),
    ),
    Quantity(
        "differing layers", "", "number of layers that only one of the maps has",
        lambda report: float(len(report.first.own_layers) + len(report.second.own_layers)),
    ),
)  # fmt: skip
"""By their names."""
