"""Sweep of a scanner over a region: the best aperture, yaw, number of beams or range there."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import NoneType
from typing import Final

import numpy as np

from ambinav.casting.scans import GIVE_HEIGHTS, check_rays
from ambinav.config import as_count, check_kind
from ambinav.drive.bootstrap import Interval
from ambinav.geometry.collision.reach import Reach, find_reach
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import HEADINGS
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, silent
from ambinav.sensing.robot_radius import robot_radius as own_robot_radius
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.region import Region
from ambinav.studies.design.sweep.figures import (
    CRITERIA,
    Criterion,
    Figures,
    difference,
    figures,
    per_place,
)
from ambinav.studies.design.sweep.place_levels import PlaceLevels, place_levels
from ambinav.studies.design.sweep.turning import Turning, turning
from ambinav.studies.design.sweep.vary import (
    VARIABLES,
    Setting,
    Variation,
    part_number,
    present_values,
    settings,
    varied,
)
from ambinav.studies.design.views import first_twins

PLACES: Final = 1000
"""Places that a sweep looks at."""
ROUTE_HEADINGS: Final = 72
"""Headings that those of a route are rounded to: 5 degrees apart."""
UNEVEN: Final = 0.01
"""Share of the region by which settings differ in where they fit, from which it is reported."""
DIGITS: Final = 6
"""Decimals to which figures are compared, as in report.json."""


@dataclass(frozen=True)
class Outcome:
    """The result of a setting."""

    setting: Setting
    figures: Figures


@dataclass(frozen=True, eq=False)
class SweepResult:
    """The result of a sweep.

    Attributes:
        environment: Its name.
        scanner: The varied scanner.
        part: Name of the varied part.
        region: The region.
        variations: The variations.
        criterion: The figure that decides which setting is best.
        outcomes: Results of the S settings, the last variation running fastest.
        present: Result of the present scanner.
        levels: Levels of every distinct scanner at each place.
        rows: Row of `levels` of each setting, and last of the present scanner.
        headings: Headings of the robot that count, for readers.
        turning: Gain of turning the scanner from place to place, if yaw was varied and the
            robot has one heading a place; else None.
        seed: Seed of the choice of places.
        spacing: Spacing of the lattice, metres.
        robot_radius: Radius of the robot whose reach counts, metres; None: all of a route counts.
    """

    environment: str
    scanner: RangeScanner
    part: str | None
    region: Region
    variations: tuple[Variation, ...]
    criterion: Criterion
    outcomes: tuple[Outcome, ...]
    present: Outcome
    levels: PlaceLevels
    rows: tuple[int, ...]
    headings: str
    turning: Turning | None
    seed: int
    spacing: float
    robot_radius: float | None

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each variation."""
        return tuple(len(variation.values) for variation in self.variations)

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Distinct settings from the best to the worst.

        Of equals by the criterion the one of the lower mean level, else the first, as of twins.
        """
        first = np.unique(self.rows[:-1], return_index=True)[1]
        first.sort()
        values = [
            [outcome.figures.mean, outcome.figures.of(self.criterion)]
            for outcome in (self.outcomes[i] for i in first)
        ]
        # Sort by the last key first; equal settings keep their order.
        ranked = first[np.lexsort(np.round(values, DIGITS).T)]
        return tuple(int(i) for i in ranked)

    def twins(self, setting: int) -> tuple[int, ...]:
        """Return all settings with the same beams as one, itself included, ascending."""
        row = self.rows[setting]
        return tuple(i for i, other in enumerate(self.rows[:-1]) if other == row)

    @property
    def present_is_best(self) -> bool:
        """True if the present scanner has the beams of the best setting."""
        return self.rows[-1] == self.rows[self.order[0]]

    @property
    def most_standing(self) -> float:
        """Largest share of the region where the robot can stand with a setting, or as it is."""
        return max(outcome.figures.standing for outcome in (*self.outcomes, self.present))

    @property
    def fits_unevenly(self) -> bool:
        """True if settings, the present one included, differ in the floor where they fit."""
        standing = [outcome.figures.standing for outcome in (*self.outcomes, self.present)]
        return self.most_standing - min(standing) > UNEVEN

    @property
    def best_scanner(self) -> RangeScanner:
        """Scanner of the best setting; the present scanner if it has the same beams."""
        return self.scanner if self.present_is_best else self.best.setting.scanner

    @property
    def best(self) -> Outcome:
        """The best setting."""
        return self.outcomes[self.order[0]]

    def grid(self, figure: Callable[[Figures], float]) -> Floats:
        """Return a figure of all settings in the shape of the variations."""
        return np.array([figure(outcome.figures) for outcome in self.outcomes]).reshape(self.shape)

    @cached_property
    def best_interval(self) -> Interval:
        """Figure of the best setting, with the interval due to the sampling of places.

        The interval is nan where the criterion is no mean over places, and closed where all
        places were looked at.
        """
        return self._interval(self.best.figures.of(self.criterion), self.order[0], None)

    def margin(self, setting: int | None) -> Interval:
        """Return the advantage of the best setting over another one; None: the present scanner.

        With an interval as `best_interval`, place by place.
        """
        other = self.present if setting is None else self.outcomes[setting]
        theirs, ours = (outcome.figures.of(self.criterion) for outcome in (other, self.best))
        value = round(theirs, DIGITS) - round(ours, DIGITS)
        number = len(self.outcomes) if setting is None else setting
        return self._interval(value, number, self.order[0])

    def _interval(self, value: float, setting: int, less: int | None) -> Interval:
        """Return the interval of a setting's figure, or of its difference from another."""
        places = self.levels.places
        if not places.is_sample:
            return Interval(value, value, value, len(places))
        theirs = self._at_places(setting)
        if theirs is None:
            return Interval(value, math.nan, math.nan, len(places))
        ours = np.zeros(len(theirs)) if less is None else self._at_places(less)
        around = difference(theirs, np.asarray(ours), places.weight, places.of)
        return replace(around, value=value)

    @cached_property
    def as_good(self) -> tuple[int, ...]:
        """Distinct settings that the sampled places cannot tell from the best, it included.

        Where the criterion has no interval, those whose figure is the same.
        """
        return tuple(i for i in self.order if i == self.order[0] or is_open(self.margin(i)))

    def _at_places(self, setting: int) -> Floats | None:
        row = self.rows[setting]
        return per_place(self.levels.level[row], self.levels.zone[row], self.criterion)


def is_open(margin: Interval) -> bool:
    """Return whether a margin may be zero.

    Its interval contains 0, or without an interval its value is 0.
    """
    ends = (margin.value,) if math.isnan(margin.low) else (margin.low, margin.high)
    return min(ends) < 0.5 * 10.0**-DIGITS and max(ends) > -0.5 * 10.0**-DIGITS


def sweep_scanner(
    env: Environment,
    scanner: RangeScanner | str | Path,
    vary: Sequence[Variation | str],
    region: Region | None = None,
    *,
    part: str | None = None,
    criterion: Criterion = "mean",
    heading: float | None = None,
    headings: int | None = None,
    spacing: float = 0.1,
    radius: float = 0.5,
    map_std: float | None = None,
    robot_radius: float | None = None,
    start: Sequence[float] | None = None,
    places: int = PLACES,
    seed: int = 0,
    progress: Progress = silent,
) -> SweepResult:
    """Vary a scanner and evaluate each setting in a region.

    Each setting is computed as by `build_map` for that scanner, but only at the evaluated places,
    and beams common to several settings are cast once. The headings of the robot on a route are
    those of its travel, to 5 degrees. Elsewhere they are unknown, and all are weighted equally; but
    if yaw is varied the robot keeps one heading, so the yaw is a direction in the map. A setting
    that looks all around has no yaw: it has that of the present scanner. Settings with equal beams
    are computed once, and count as one (`SweepResult.twins`).

    In a map or a polygon the same floor counts as in `ambinav audit` with the present scanner:
    explored and reachable. All of a route counts.

    Args:
        env: The environment, in the plane or in space.
        scanner: The scanner as it is, a preset's name, or a scanner file.
        vary: Variations, such as "aperture=60:360:30" (see `Variation.parse`); several make a
            grid. A height or a pitch of the mount is varied in space only.
        region: The region; None: all floor that counts.
        part: The part to vary, of a scanner of several parts: its sensor's name, or its number.
        criterion: Figure that decides which setting is best: "mean", "p95", "worst" or "bad"
            (see `CRITERIA`).
        heading: Fixed heading of the robot, radians; None: see above. Not on a route.
        headings: Number of equally weighted headings, evenly from 0; None: see above. Not on a
            route.
        spacing: As for `build_map`, like the next two.
        radius: Radius of the neighbourhoods, metres.
        map_std: Deviation of the walls, metres.
        robot_radius: Radius of the disc that covers the robot, metres; None: the scanner's, or 0.2
            of one that has none. Not on a route, like the next.
        start: x and y of the robot's start, as in `find_reach`.
        places: Maximum number of evaluated places, evenly spread; 0: all places.
        seed: Seed of the choice of places.
        progress: Called with the share done, from 0 to 1.

    Raises:
        InputError: the scanner does not have what is varied, the region is empty, there are too
            many settings, an argument is out of its range, or the building and the scanner do not
            go together (`casting.scans.check_rays`).

    Warns:
        InputWarning: see `find_reach`.
    """
    check_kind(region, (Region, NoneType), "region")
    if seed < 0:
        raise InputError(f"seed is {seed}; give a whole number from 0 on.")
    if not isinstance(scanner, RangeScanner):
        scanner = RangeScanner.load(scanner)
    if criterion not in CRITERIA:
        raise InputError(f"criterion is {criterion!r}; choose from {', '.join(CRITERIA)}.")
    if not (math.isfinite(spacing) and 0.0 < spacing <= radius < math.inf):
        raise InputError(
            f"spacing is {spacing} m and radius {radius} m; give metres above 0, the radius at "
            "least one spacing."
        )
    if places:
        places = as_count(places, "places")
    region = region or Region.of_map()
    variations = _variations(env, vary)
    check_rays(env, scanner.upright[:, 0], scanner.upright[:, 1])
    grid = settings(scanner, variations, part)
    names = [variation.name for variation in variations]
    yaw = names.index("yaw") if "yaw" in names else None
    present = Setting(present_values(scanner, variations, part), scanner)
    computed = [*(_unturned(setting, names, scanner, part) for setting in grid), scanner]
    angles, text = _headings(region, yaw is not None, computed, heading, headings)
    reach = _reach(env, scanner, region, robot_radius, start)
    first = first_twins(computed)
    different = sorted(set(first))
    rows = tuple(different.index(i) for i in first)
    # Settings that differ in yaw alone share beams.
    values = [*(_without_axis(setting.values, yaw) for setting in grid), (math.inf,)]
    levels = place_levels(
        env,
        [computed[i] for i in different],
        region,
        angles,
        floor_of=scanner,
        floor_headings=headings,
        reach=reach,
        spacing=spacing,
        radius=radius,
        map_std=map_std,
        most_places=places,
        rng=np.random.default_rng(seed),
        order=sorted(range(len(different)), key=lambda row: values[different[row]]),
        progress=progress,
    )
    summed = [
        figures(level, zone, levels.places.weight)
        for level, zone in zip(levels.level, levels.zone, strict=True)
    ]
    outcomes = tuple(
        Outcome(setting, summed[row]) for setting, row in zip((*grid, present), rows, strict=True)
    )
    if not any(outcome.figures.standing for outcome in outcomes[:-1]):
        raise InputError(
            f"region {region.title}: the robot fits nowhere in it with any setting of scanner "
            f"{scanner.name!r}; check the mounts (metres) and the robot's radius."
        )
    result = SweepResult(
        environment=env.name,
        scanner=scanner,
        part=part,
        region=region,
        variations=variations,
        criterion=criterion,
        outcomes=outcomes[:-1],
        present=outcomes[-1],
        levels=levels,
        rows=rows,
        headings=text,
        turning=None,
        seed=seed,
        spacing=spacing,
        robot_radius=None if reach is None else reach.radius,
    )
    if yaw is None:
        return result
    return replace(result, turning=_compare_yaws(result, yaw))


def _variations(env: Environment, vary: Sequence[Variation | str]) -> tuple[Variation, ...]:
    """Return the variations; in a plan none of them may be of a height or a pitch."""
    variations = tuple(
        Variation.parse(variation) if isinstance(variation, str) else variation
        for variation in vary
    )
    for variation in variations:
        if env.space is None and VARIABLES[variation.name].in_space:
            raise InputError(
                f"vary {variation.name}: {env.name} is a plan, which has no heights; "
                f"{GIVE_HEIGHTS}."
            )
    return variations


def _reach(
    env: Environment,
    scanner: RangeScanner,
    region: Region,
    robot_radius: float | None,
    start: Sequence[float] | None,
) -> Reach | None:
    """Return the floor that the robot reaches; None on a route, where all floor counts."""
    if region.kind != "route":
        return find_reach(env, robot_radius or own_robot_radius(scanner), start)
    if robot_radius is not None or start is not None:
        raise InputError("robot_radius, start: all floor of a route counts; leave them out.")
    return None


def _unturned(
    setting: Setting, names: Sequence[str], scanner: RangeScanner, part: str | None
) -> RangeScanner:
    """Return the scanner of a setting, with the present yaw if it looks all around."""
    if "yaw" not in names or not setting.scanner.looks_all_around:
        return setting.scanner
    values = dict(zip(names, setting.values, strict=True))
    del values["yaw"]
    return varied(scanner, part_number(scanner, part), values)


def _compare_yaws(result: SweepResult, yaw: int) -> Turning | None:
    """Compare the best setting and those that differ from it in yaw alone."""
    best = result.best.setting
    levels = result.levels
    if levels.level.shape[2] > 1 or best.scanner.looks_all_around:
        return None
    # The first of the yaws at which the beams are the same.
    same = {
        result.rows[i]: i
        for i, outcome in reversed(list(enumerate(result.outcomes)))
        if _without_axis(outcome.setting.values, yaw) == _without_axis(best.values, yaw)
    }
    rows = sorted(same, key=same.__getitem__)
    return turning(
        tuple(result.outcomes[same[row]].setting.values[yaw] for row in rows),
        levels.level[rows, :, 0],
        levels.zone[rows, :, 0],
        levels.places.weight,
        levels.places.of,
    )


def _headings(
    region: Region,
    turned: bool,
    scanners: Sequence[RangeScanner],
    heading: float | None,
    headings: int | None,
) -> tuple[Floats, str]:
    """Return headings of the robot, radians, and their text for readers."""
    if heading is not None and headings is not None:
        raise InputError("heading: it excludes a number of headings; give one of the two.")
    if heading is not None and not math.isfinite(heading):
        raise InputError(f"heading is {heading}; give a finite angle.")
    if headings is not None:
        headings = as_count(headings, "headings")
    if region.kind == "route":
        if heading is not None or headings is not None:
            raise InputError("heading: a route has its own headings; leave it out.")
        angles = 2.0 * math.pi * np.arange(ROUTE_HEADINGS) / ROUTE_HEADINGS
        return angles, "those of the route"
    if all(scanner.looks_all_around for scanner in scanners):
        return np.zeros(1), "any: the scanner looks all around"
    if heading is None and headings is None and turned:
        heading = 0.0
    if heading is not None:
        heading_text = f"{math.degrees(heading):g}° in the map, which the robot keeps"
        return np.array([heading]), heading_text
    count = headings or HEADINGS
    return 2.0 * math.pi * np.arange(count) / count, f"{count}, weighted equally"


def _without_axis(values: tuple[float, ...], at: int | None) -> tuple[float, ...]:
    return values if at is None else values[:at] + values[at + 1 :]
