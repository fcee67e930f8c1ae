"""The audit of a building for a scanner: zones, worst regions, and the scans there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ambinav.config import check_kind
from ambinav.geometry.collision.reach import Reach, find_reach
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import JudgedFloor
from ambinav.maps.zones import CORRIDOR, LOCALIZABLE, OPEN, ZONES, ZoneShare
from ambinav.reports.number_text import metres2, percent
from ambinav.runtime.errors import InputError
from ambinav.sensing.robot_radius import robot_radius as robot_radius
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sight import Sight, look
from ambinav.studies.audit.aliasing import AliasingFindings
from ambinav.studies.audit.ambiguous_regions import AmbiguousRegion, find_ambiguous_regions
from ambinav.studies.audit.cause import Cause, cause_of
from ambinav.studies.audit.lost_routes import LostRoutes
from ambinav.studies.audit.post_search import PostSearch
from ambinav.studies.audit.verdict import Verdict

_HEADING_MATTERS = 0.1
"""Difference in level between headings from which a best one is reported."""
_WORTH_TELLING = 0.005
"""Share of the free floor from which what does not count is reported."""


@dataclass(frozen=True, eq=False)
class Finding:
    """A bad region and the scan there.

    Attributes:
        place: The region.
        sight: The scan at the place's point; at its most ambiguous heading if that matters.
    """

    place: AmbiguousRegion
    sight: Sight

    @property
    def cause(self) -> Cause:
        """Why it is ambiguous."""
        return cause_of(self.sight, self.place.direction)


@dataclass(frozen=True, eq=False)
class Audit:
    """The result of an audit: the floor where a scanner cannot localize the robot.

    Attributes:
        amap: The ambiguity map, its floor judged for this robot.
        environment: The building.
        scanner: The scanner.
        heading: Heading of the figures: "mean", "best", "worst" or radians.
        reach: Floor that the robot reaches.
        shares: Share of the floor that counts, and area, of each zone, in the order of ZONES.
        findings: The worst places, the worst first.
        regions: Number of all such places, listed or not.
        extents: Length of each place in metres, by zone, the longest first.
        aliasing: Aliased pairs, or None if not requested.
        helps: Posts that would help, or None if they were not searched for.
        lost: Forecasts of routes, or None if they were not asked for
            (`ambinav.studies.audit.lost_routes`).
        verdict: Recommendation (`ambinav.studies.audit.advise.advise`); None: not requested.
    """

    amap: AmbiguityMap
    environment: Environment
    scanner: RangeScanner
    heading: str | float
    reach: Reach
    shares: tuple[ZoneShare, ...]
    findings: tuple[Finding, ...]
    regions: int
    extents: Mapping[str, tuple[float, ...]]
    aliasing: AliasingFindings | None = None
    helps: PostSearch | None = None
    lost: LostRoutes | None = None
    verdict: Verdict | None = None

    @property
    def parts(self) -> JudgedFloor:
        """Floor masks: explored and reached floor counts."""
        return self.amap.judged

    @property
    def area(self) -> float:
        """Area that counts, square metres: explored and reachable."""
        return self.parts.area(self.parts.counted)

    @property
    def summary(self) -> str:
        """Summary of the result in a few plain sentences."""
        robot = f"a robot of radius {self.reach.radius:.2f} m"
        free, unexplored = self.amap.free_area, self.parts.area(self.parts.unexplored)
        if not self.area and not unexplored:
            reasons = "; ".join(self._left_out_sentence(free))
            return (
                f"None of the {metres2(free)} of free floor of {self.environment.name} can be "
                f"judged for {robot}. {reasons}"
            )
        if not self.area:
            return (
                f"Of the {metres2(free)} of free floor of {self.environment.name} {robot} can "
                "reach "
                f"{metres2(unexplored)}, all of it unexplored: half of the beams of "
                f"{self.scanner.name} or more end in unknown space, so it cannot be judged."
            )
        sentences = [
            f"With {self.scanner.name} {robot} can tell its position well on "
            f"{percent(self.shares[LOCALIZABLE].share)} of the {metres2(self.area)} of explored "
            f"floor that it can reach in {self.environment.name}."
        ]
        corridor, open_floor = self.shares[CORRIDOR], self.shares[OPEN]
        if corridor.area:
            sentences.append(
                f"On {percent(corridor.share)} ({metres2(corridor.area)}) it can drift along a "
                "wall or corridor without noticing."
            )
        if open_floor.area:
            sentences.append(
                f"On {percent(open_floor.share)} ({metres2(open_floor.area)}) the scan constrains "
                "its position in no direction."
            )
        if self.amap.has_theta and self.heading == "mean":
            best, worst = (
                self.amap.zone_shares(name, self.parts.counted) for name in ("best", "worst")
            )
            sentences.append(
                "Zones are those of half or more of the headings: at the best heading of each "
                "place the robot can tell its position well on "
                f"{percent(best[LOCALIZABLE].share)}, at the worst heading on "
                f"{percent(worst[LOCALIZABLE].share)}."
            )
        sentences += [*self._left_out_sentence(free), self._worst_sentence()]
        return " ".join(sentences)

    def _left_out_sentence(self, free: float) -> list[str]:
        """Explain in one sentence which free floor does not count; empty if it is negligible."""
        reasons = [
            f"{metres2(area)} {why}"
            for cells, why in (
                (self.parts.unexplored, "are unexplored (half of the beams or more end in unknown "
                 "space)"),
                (self.parts.cut_off, "cannot be reached by the robot"),
                (self.parts.beside_walls, "are too close to walls for this robot"),
                (self.parts.outside, "are outside of the building or at the border of the map"),
            )
            if (area := self.parts.area(cells)) >= _WORTH_TELLING * free
        ]  # fmt: skip
        if not reasons:
            return []
        listed = reasons[0]
        if len(reasons) > 1:
            listed = f"{', '.join(reasons[:-1])} and {reasons[-1]}"
        return [f"Of the {metres2(free)} of free floor, {listed}: not counted."]

    def _worst_sentence(self) -> str:
        """Describe the worst region in one sentence."""
        if not self.regions:
            return "There is no bad place of notable size."
        if not self.findings:
            several = f"are {self.regions} bad places" if self.regions > 1 else "is one bad place"
            return f"There {several} of notable size, not listed here."
        worst = self.findings[0].place
        kind = "an open area" if worst.zone == "open" else "a corridor effect"
        where = f"over {metres2(worst.area)} around x = {worst.x:.1f} m, y = {worst.y:.1f} m."
        if self.regions > 1:
            return f"The worst of {self.regions} places is {kind} {where}"
        return f"The only bad place is {kind} {where}"


def audit(
    amap: AmbiguityMap,
    environment: Environment,
    scanner: RangeScanner,
    *,
    places: int = 10,
    heading: str | float = "mean",
    aliasing: AliasingFindings | None = None,
    reach: Reach | None = None,
    lost: LostRoutes | None = None,
) -> Audit:
    """Find the worst regions of a map and scan each of them.

    Only explored, reachable floor counts.

    Args:
        amap: The ambiguity map of this environment for this scanner.
        environment: Building of the map.
        scanner: Scanner of the map.
        places: Maximum number of places to list, 0 or more.
        heading: "mean", "best", "worst" or radians, if the heading matters.
        aliasing: Aliased pairs to report, see `ambinav.studies.audit.aliasing.find_aliasing`.
        reach: Floor that the robot reaches (`ambinav.geometry.collision.reach.find_reach`); None:
            the floor that a disc of `robot_radius(scanner)` reaches in the largest piece.
        lost: Forecasts of routes to report, see `ambinav.find_lost_routes`.

    Raises:
        InputError: a negative number of places, no such heading, a robot that fits nowhere, or
            no cell of the map on floor that it reaches.

    Warns:
        InputWarning: see `find_reach`.
    """
    check_kind(amap, AmbiguityMap, "amap")
    check_kind(environment, Environment, "environment")
    check_kind(scanner, RangeScanner, "scanner", "give a RangeScanner, such as of from_preset")
    if places < 0:
        raise InputError(f"places: {places} is negative; give 0 or more.")
    if reach is None:
        reach = find_reach(environment, robot_radius(scanner))
    amap = amap.for_robot(reach)
    amap.judged.check_reached(amap.spacing)
    regions = find_ambiguous_regions(amap, None, heading)
    findings = tuple(
        Finding(place, _scan_at(environment, scanner, place)) for place in regions[:places]
    )
    return Audit(
        amap=amap,
        environment=environment,
        scanner=scanner,
        heading=heading,
        reach=reach,
        shares=amap.zone_shares(heading, amap.judged.counted),
        findings=findings,
        regions=len(regions),
        extents={
            name: tuple(sorted((p.length for p in regions if p.zone == name), reverse=True))
            for name in ZONES
        },
        aliasing=aliasing,
        lost=lost,
    )


def _scan_at(environment: Environment, scanner: RangeScanner, place: AmbiguousRegion) -> Sight:
    """Scan at a region: at its worst heading, or along the weak direction if all are equal."""
    heading = place.worst_heading
    if heading is None:
        heading = place.direction or 0.0
    return look(environment, scanner, place.x, place.y, heading)


def places_text(count: int, longest: float | None) -> str:
    """Format a number of places with the length of the longest, metres; empty if there are none."""
    return "" if longest is None else f"{count} ({longest:.1f} m)"


def degrees(angle: float) -> str:
    """Format an angle in radians as whole degrees."""
    return f"{math.degrees(angle):z.0f}°"


def axis_degrees(axis: float | None) -> str:
    """Format an axis in degrees, without sense, as whole degrees from 0 to 179."""
    return "none" if axis is None else f"{round(axis) % 180}°"


def heading_words(place: AmbiguousRegion) -> str:
    """Describe how much the heading matters in a region; empty if the map has no headings."""
    if not place.by_heading:
        return ""
    levels = sorted(level for _, level in place.by_heading)
    if levels[-1] - levels[0] < _HEADING_MATTERS:
        return f"Turning helps little: level {levels[0]:.2f} at best, {levels[-1]:.2f} at worst."
    return (
        f"Best heading {degrees(place.best_heading or 0.0)} (level {levels[0]:.2f}), "
        f"worst {degrees(place.worst_heading or 0.0)} (level {levels[-1]:.2f})."
    )
