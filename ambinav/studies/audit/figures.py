"""Figures of an audit for conditions, as `report.json` has them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

from ambinav.maps.zones import BAD, CORRIDOR, OPEN, ZONES
from ambinav.reports.conditions import Quantities, Quantity, catalogue
from ambinav.studies.audit.document import Document, PlacePart, ZonePart

ALIASING: Final = frozenset({"aliased", "aliased area", "aliased pairs"})
"""Those that ask for perceptual aliasing to be sought."""

_COUNTED = "of the explored, reachable floor"


_NOTHING = (
    "because no floor is explored and reachable; read the report, and choose another start with "
    "--start"
)
_SEEK = "because aliasing was not searched for; add --aliasing"


def _zone(report: Document, name: str) -> ZonePart:
    return next(zone for zone in report.zones if zone.zone == name)


def _if_counted(report: Document, value: float) -> float | None:
    """Return a figure of the floor that counts, or None if no floor counts."""
    return value if report.floor.counted_area_m2 > 0.0 else None


def _places(report: Document, name: str) -> list[PlacePart]:
    return [place for place in report.places if place.zone == name]


def _location(report: Document, name: str, *, longest: bool = False) -> str:
    """Describe the worst, or the longest, listed place of a zone in a sentence; empty if none."""
    places = _places(report, name)
    if not places:
        return ""
    place = max(places, key=lambda region: region.length_m) if longest else places[0]
    which = "longest listed" if longest else "worst"
    return (
        f"The {which} {name} place is around x = {place.x_m:.1f} m, y = {place.y_m:.1f} m, "
        f"{place.length_m:.1f} x {place.width_m:.1f} m."
    )


def _of_zone(name: str) -> Iterator[Quantity]:
    """Yield the figures of a zone."""

    def where(report: Document) -> str:
        return _location(report, name)

    def quantity(
        title: str, unit: str, meaning: str, read: Callable[[ZonePart], float],
        where: Callable[[Document], str] = where,
    ) -> Quantity:  # fmt: skip
        return Quantity(
            title, unit, meaning, lambda report: _if_counted(report, read(_zone(report, name))),
            where, _NOTHING,
        )  # fmt: skip

    def percent(share: float, at_heading: float | None) -> float:
        return 100.0 * (share if at_heading is None else at_heading)

    heading = "everywhere; if the heading does not matter, the same as without"
    yield quantity(
        name, "%", f"share {_COUNTED} in the {name} zone", lambda zone: 100.0 * zone.share
    )
    yield quantity(
        f"{name} area", "m²", f"area {_COUNTED} in the {name} zone", lambda zone: zone.area_m2
    )
    yield quantity(
        f"{name} at best heading", "%",
        f"share {_COUNTED} in the {name} zone at the least ambiguous heading {heading}",
        lambda zone: percent(zone.share, zone.share_best_heading),
    )  # fmt: skip
    yield quantity(
        f"{name} at worst heading", "%",
        f"share {_COUNTED} in the {name} zone at the most ambiguous heading {heading}",
        lambda zone: percent(zone.share, zone.share_worst_heading),
    )  # fmt: skip
    if name in (ZONES[CORRIDOR], ZONES[OPEN]):
        yield quantity(
            f"{name} places", "", f"number of bad places that are mostly in the {name} zone",
            lambda zone: float(zone.places),
        )  # fmt: skip
        yield quantity(
            f"longest {name} stretch", "m",
            f"longer side of the smallest rectangle around the longest {name} place; 0 without one",
            lambda zone: zone.longest_place_m or 0.0,
            lambda report: _location(report, name, longest=True),
        )  # fmt: skip


def _bad(report: Document, read: Callable[[ZonePart], float]) -> float | None:
    """Return the sum of a figure of the zones that leave a robot lost."""
    return _if_counted(report, sum(read(_zone(report, ZONES[code])) for code in BAD))


def _floor(name: str, meaning: str) -> Quantity:
    """Return a figure of a part of the floor: its area, or its share of the free floor."""
    if name.endswith(" area"):
        field = f"{name.replace(' ', '_')}_m2"
        return Quantity(name, "m²", meaning, lambda report: getattr(report.floor, field))
    field = f"{name}_share"
    return Quantity(name, "%", meaning, lambda report: 100.0 * getattr(report.floor, field))


QUANTITIES: Final[Quantities] = catalogue(
    *(quantity for name in ZONES for quantity in _of_zone(name)),
    Quantity(
        "bad", "%", f"share {_COUNTED} in the corridor and open zones",
        lambda report: _bad(report, lambda zone: 100.0 * zone.share), needs=_NOTHING,
    ),
    Quantity(
        "bad area", "m²", f"area {_COUNTED} in the corridor and open zones",
        lambda report: _bad(report, lambda zone: zone.area_m2), needs=_NOTHING,
    ),
    Quantity(
        "places", "", "number of bad places, listed or not",
        lambda report: _if_counted(report, float(report.places_in_all)), needs=_NOTHING,
    ),
    _floor("free area", "area of the free floor of the map"),
    _floor("counted", "share of the free floor that is explored and reachable"),
    _floor("counted area", "area of the explored, reachable floor"),
    _floor(
        "unexplored",
        "share of the free floor that is reachable but where half of the beams or more end in "
        "unknown space",
    ),
    _floor("unexplored area", "area of floor that is reachable but unexplored"),
    _floor("unreachable", "share of the free floor that the robot's centre cannot reach"),
    _floor("unreachable area", "area of the free floor that the robot's centre cannot reach"),
    _floor("cut off area", "area where the robot would fit but that it cannot reach"),
    _floor("outside", "share of the free floor that lies outside of the building"),
    _floor(
        "outside area",
        "area outside of the building: a page's margin, or reachable floor at the border of the "
        "map",
    ),
    Quantity(
        "notes", "", "number of elements of the map that were repaired or left out",
        lambda report: float(len(report.environment.notes)),
    ),
    Quantity(
        "aliased", "%", "mean share of the poses with the same scan that are elsewhere",
        lambda report: _aliased(report, "share"), needs=_SEEK,
    ),
    Quantity(
        "aliased area", "m²",
        "area of floor where half of the poses with the same scan or more are elsewhere",
        lambda report: _aliased(report, "area"), needs=_SEEK,
    ),
    Quantity(
        "aliased pairs", "", "number of listed pairs of aliased regions",
        lambda report: _aliased(report, "pairs"), needs=_SEEK,
    ),
)  # fmt: skip
"""By their names."""


def _aliased(report: Document, figure: str) -> float | None:
    aliasing = report.aliasing
    if aliasing is None or not aliasing.sought or aliasing.share is None:
        return None
    return {
        "share": 100.0 * aliasing.share,
        "area": aliasing.area_m2,
        "pairs": float(len(aliasing.pairs)),
    }[figure]
