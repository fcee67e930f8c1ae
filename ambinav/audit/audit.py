"""The audit of a building for a scanner: the zones, the worst places, what is seen there."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ambinav.audit.alikes import Alikes
from ambinav.audit.places import Place, find_places
from ambinav.audit.sight import Sight, look
from ambinav.errors import InputError
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap, ZoneShare
from ambinav.maps.zones import CORRIDOR, LOCALIZABLE, OPEN
from ambinav.sensing.scanner import RangeScanner

_HEADING_MATTERS = 0.1
"""Difference in level between headings from which a best one is told."""


_WORTH_TELLING = 0.005
"""Share of the free floor from which what is unexplored is told."""


@dataclass(frozen=True, eq=False)
class Finding:
    """A bad place and what the scanner sees there.

    Attributes:
        place: Where it is and how bad.
        sight: The scan at the place's point; at its most ambiguous heading if that matters.
    """

    place: Place
    sight: Sight


@dataclass(frozen=True, eq=False)
class Audit:
    """Where a building leaves a scanner lost.

    Attributes:
        amap: The ambiguity map.
        environment: The building.
        scanner: The scanner.
        heading: Which headings the figures are for: "mean", "best", "worst" or radians.
        shares: Share and area of each zone, in the order of ZONES.
        findings: The worst places, the worst first.
        regions: Number of all such places, listed or not.
        alikes: Look-alikes, or None if nobody asked.
    """

    amap: AmbiguityMap
    environment: Environment
    scanner: RangeScanner
    heading: str | float
    shares: tuple[ZoneShare, ...]
    findings: tuple[Finding, ...]
    regions: int
    alikes: Alikes | None = None

    @property
    def _unexplored(self) -> tuple[float, float]:
        """Square metres that are unexplored, and how much of them is open."""
        cells = self.amap.unexplored
        open_cells = cells & (self.amap.floor("zone", self.heading).values == OPEN)
        area = self.amap.spacing**2
        return float(cells.sum()) * area, float(open_cells.sum()) * area

    @property
    def summary(self) -> str:
        """The result in a few sentences of plain words."""
        area = self.amap.free_area
        sentences = [
            f"With {self.scanner.name} a robot can tell its position well on "
            f"{percent(self.shares[LOCALIZABLE].share)} of the {metres2(area)} of free floor of "
            f"{self.environment.name}."
        ]
        corridor, open_floor = self.shares[CORRIDOR], self.shares[OPEN]
        if corridor.area:
            sentences.append(
                f"On {percent(corridor.share)} ({metres2(corridor.area)}) it can slide along a "
                "wall or corridor without noticing."
            )
        if open_floor.area:
            sentences.append(
                f"On {percent(open_floor.share)} ({metres2(open_floor.area)}) it has nothing to "
                "hold on to in any direction."
            )
        unexplored, open_there = self._unexplored
        if unexplored >= _WORTH_TELLING * area:
            sentences.append(
                f"On {metres2(unexplored)}, {metres2(open_there)} of the open floor among them, "
                "most beams end in unknown space (faded in the picture): there the map ends, and "
                "no place is listed."
            )
        if self.amap.has_theta and self.heading == "mean":
            best, most = (self.amap.zone_shares(name) for name in ("best", "worst"))
            sentences.append(
                "These are means over all headings: always facing the best way it can tell its "
                f"position well on {percent(best[LOCALIZABLE].share)}, always facing the worst way "
                f"on {percent(most[LOCALIZABLE].share)}."
            )
        if self.findings:
            worst = self.findings[0].place
            kind = "an open area" if worst.zone == "open" else "a corridor effect"
            sentences.append(
                f"The worst of {self.regions} places is {kind} over {metres2(worst.area)} "
                f"around x = {worst.x:.1f} m, y = {worst.y:.1f} m."
                if self.regions > 1
                else f"The only bad place is {kind} over {metres2(worst.area)} around "
                f"x = {worst.x:.1f} m, y = {worst.y:.1f} m."
            )
        else:
            sentences.append("No place of notable size leaves it lost.")
        return " ".join(sentences)


def audit(
    amap: AmbiguityMap,
    environment: Environment,
    scanner: RangeScanner,
    *,
    places: int = 10,
    heading: str | float = "mean",
    alikes: Alikes | None = None,
) -> Audit:
    """Find the worst places of a map and look at each through the scanner.

    Args:
        amap: The ambiguity map of this environment for this scanner.
        environment: What the map was built from.
        scanner: What the map was built for.
        places: How many places to list at most; 0 or more.
        heading: "mean", "best", "worst" or radians, where the heading matters.
        alikes: Look-alikes to report, see `ambinav.audit.alikes.find_alikes`.

    Raises:
        InputError: a negative number of places, or no such heading.
    """
    if places < 0:
        raise InputError(f"places: {places} is negative; give 0 or more.")
    found = find_places(amap, None, heading)
    findings = tuple(Finding(place, _look(environment, scanner, place)) for place in found[:places])
    return Audit(
        amap=amap,
        environment=environment,
        scanner=scanner,
        heading=heading,
        shares=amap.zone_shares(heading),
        findings=findings,
        regions=len(found),
        alikes=alikes,
    )


def _look(environment: Environment, scanner: RangeScanner, place: Place) -> Sight:
    """Scan at a place: at its worst heading, or along the weak direction if all are alike."""
    heading = place.worst_heading
    if heading is None:
        heading = place.direction or 0.0
    return look(environment, scanner, place.x, place.y, heading)


def percent(share: float) -> str:
    """A share as a whole percentage; one decimal below 1 %, so that a little is not nothing."""
    if 0.0 < share < 0.001:
        return "less than 0.1 %"
    return f"{share * 100:.1f} %" if 0.0 < share < 0.01 else f"{share * 100:.0f} %"


def metres2(area: float) -> str:
    """An area in square metres with as many digits as it deserves."""
    return f"{area:,.0f} m²" if area >= 10.0 else f"{area:.1f} m²"


def degrees(angle: float) -> str:
    """An angle in whole degrees."""
    return f"{math.degrees(angle):.0f}°"


def axis_degrees(axis: float | None) -> str:
    """A direction without sense, given in degrees, as whole degrees from 0 to 179."""
    return "none" if axis is None else f"{round(axis) % 180}°"


def heading_words(place: Place) -> str:
    """How much the robot's heading matters at a place; empty if the map knows no headings."""
    if not place.by_heading:
        return ""
    levels = sorted(level for _, level in place.by_heading)
    if levels[-1] - levels[0] < _HEADING_MATTERS:
        return f"Turning helps little: level {levels[0]:.2f} at best, {levels[-1]:.2f} at worst."
    return (
        f"Best heading {degrees(place.best_heading or 0.0)} (level {levels[0]:.2f}), "
        f"worst {degrees(place.worst_heading or 0.0)} (level {levels[-1]:.2f})."
    )
