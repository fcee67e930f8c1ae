"""Candidate positions from which bad floor may be seen: spread over a building, or near others."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from types import NoneType
from typing import Final

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely.geometry.base import BaseGeometry

from ambinav.config import check_kind
from ambinav.geometry.environment import Environment
from ambinav.runtime.array_types import Bools, Ints
from ambinav.runtime.errors import InputError
from ambinav.studies.design.place.candidates import Candidate, PlaceRules
from ambinav.studies.design.place.passages import Passages
from ambinav.studies.design.place.sites import Points, Sites

STEP: Final = 0.25
"""Distance between candidates, metres, where that makes no more than are asked for."""
COARSER: Final = 1.1
"""Factor by which they are moved apart until there are no more than are asked for."""
MANY: Final = 4
"""Passages are checked for at most this multiple of the requested number of candidates."""
SPLIT: Final = 40
"""From so many candidates on,"""
DENSE: Final = 85
"""half are where more bad floor is in range than for this percentage of the others."""


def check_zones(keep_out: BaseGeometry | None, environment: Environment) -> None:
    """Check that polygons which no obstacle may touch meet the building.

    Raises:
        InputError: they lie beside it.
    """
    check_kind(keep_out, (BaseGeometry, NoneType), "keep_out", "give a shapely geometry")
    if keep_out is not None and not keep_out.intersects(shapely.box(*environment.bounds)):
        west, south, east, north = (f"{value:.4g}" for value in environment.bounds)
        raise InputError(
            f"--keep-out: no polygon meets {environment.name}, which lies from x {west} to {east} "
            f"and y {south} to {north}; give them in metres of the map frame."
        )


class Positions:
    """Allowed positions of obstacles in a building.

    Args:
        environment: The building.
        rules: Kind of the obstacles and rules for their positions.
        bad: Points of bad floor, shape (N, 2), metres.
        sight: Range of the scanner, metres.
        floor: Floor that the robot reaches; free-standing obstacles stand on it.
        routes: Lines that half of the passage is kept clear of on both sides, and places where the
            robot must be able to stand.
        keep_out: Polygons that no obstacle may touch; None: there are none.
        robot_radius: Radius of the robot, metres, for which narrower passages stay open too.

    Raises:
        InputError: no floor is bad, or the polygons lie beside the building.
    """

    def __init__(
        self,
        environment: Environment,
        rules: PlaceRules,
        bad: Points,
        sight: float,
        floor: BaseGeometry,
        routes: Sequence[BaseGeometry] = (),
        keep_out: BaseGeometry | None = None,
        robot_radius: float = 0.0,
    ) -> None:
        if not len(bad):
            raise InputError(
                f"{environment.name}: none of the floor that counts is bad for this scanner, so "
                "nothing can help."
            )
        self.rules = rules
        self._name, self._zones = environment.name, keep_out is not None
        widths = {rules.min_passage, min(2.0 * robot_radius, rules.min_passage)} - {0.0}
        wide, *_ = self._passages = [
            Passages(environment, width) for width in sorted(widths, reverse=True)
        ]
        self._lines = shapely.MultiLineString(list(routes))
        self._kept_out = shapely.Polygon() if keep_out is None else keep_out
        check_zones(keep_out, environment)
        shapely.prepare([self._lines, self._kept_out])
        self._bad, self._sight = cKDTree(bad), sight
        self._sites = Sites(environment, rules, floor, wide.wide)

    def spread(self) -> tuple[tuple[Candidate, ...], float]:
        """Return candidates all over the building, and the distance between them, metres.

        Half of them are spread evenly, half where most bad floor is within range, walls ignored:
        an obstacle can help no other floor. If there are few, all are spread evenly.

        Returns:
            At most `rules.most` candidates, always the same.

        Raises:
            InputError: there is none.
        """
        most = self.rules.most
        if most < SPLIT:
            return self.spread_evenly(most)
        even, step = self.spread_evenly(most - most // 2)
        least = np.percentile(self._bad_in_range(np.array([each.middle for each in even])), DENSE)

        def is_dense(points: Points) -> Bools:
            dense = self._allowed(points)
            dense[dense] = self._bad_in_range(points[dense]) >= least
            return dense

        dense, _ = self._spread(most // 2, is_dense)
        even_sites = {each.drawn for each in even}
        return (*even, *(each for each in dense if each.drawn not in even_sites)), step

    def spread_evenly(self, most: int) -> tuple[tuple[Candidate, ...], float]:
        """Return at most so many candidates, and the distance between them, metres.

        Raises:
            InputError: there is none.
        """
        allowed, step = self._spread(most, self._allowed)
        if not allowed:
            rules = self.rules
            remedy = "give a smaller --width" if rules.kind != "post" else "give a smaller --radius"
            passage = ""
            if rules.kind != "tag":
                passage = f" without narrowing a passage of {rules.min_passage:g} m"
                remedy += " or --min-passage, or allow both --on-walls and --free-standing"
            raise InputError(
                f"{self._name}: a {rules.kind} of {rules.size_text} fits nowhere within sight of "
                f"bad floor{' and off the --keep-out zones' if self._zones else ''}{passage}; "
                f"{remedy}{', or draw smaller zones' if self._zones else ''}."
            )
        return allowed, step

    def near(self, candidate: Candidate, distance: float, step: float) -> tuple[Candidate, ...]:
        """Return candidates `step` metres apart within a distance of another one, metres."""
        x, y = candidate.middle
        # The middle of an obstacle at a wall is away from where it touches it.
        reach = distance + self.rules.width

        def is_close(points: Points) -> Bools:
            close = np.hypot(points[:, 0] - x, points[:, 1] - y) <= reach
            close[close] = self._allowed(points[close])
            return close

        window = (x - reach, y - reach, x + reach, y + reach)
        return tuple(
            each
            for each in self._sites.every(step, is_close, window)
            if np.hypot(*np.subtract(each.middle, (x, y))) <= distance
            and self._is_clear(each)
            and self._stays_open(each)
        )

    def _spread(
        self, most: int, is_allowed: Callable[[Points], Bools]
    ) -> tuple[tuple[Candidate, ...], float]:
        """Return at most `most` candidates at allowed points, and the distance between them."""
        step = dense = STEP
        # Counted before they are created, since most are too close to each other.
        while sum(counts := self._sites.counts(step, is_allowed)) > MANY * most:
            dense = step
            step *= _step_factor(*counts, MANY * most)
        while True:
            seen = self._clear(step, is_allowed)
            # Checking passages takes longest.
            if len(seen) > MANY * most:
                dense = step
                step *= _step_factor(*_count_by_kind(seen), MANY * most)
                continue
            allowed = [each for each in seen if self._stays_open(each)]
            if len(allowed) > most:
                dense = step
                step *= _step_factor(*_count_by_kind(allowed), most)
                continue
            if allowed or dense == step:
                return tuple(allowed), step
            # So far apart none is left: some of those that were closer.
            seen = self._clear(dense, is_allowed)
            for nth in (max(len(seen) // (MANY * most), 1), 1):
                allowed = [each for each in seen[::nth] if self._stays_open(each)]
                if allowed:
                    break
            return tuple(allowed[:: math.ceil(len(allowed) / most) or 1]), step

    def _clear(self, step: float, is_allowed: Callable[[Points], Bools]) -> list[Candidate]:
        return [each for each in self._sites.every(step, is_allowed) if self._is_clear(each)]

    def _bad_in_range(self, points: Points) -> Ints:
        """Count the bad floor within the scanner's range of points, shape (N,)."""
        if not len(points):
            return np.empty(0, dtype=np.int64)
        return np.asarray(self._bad.query_ball_point(points, self._sight, return_length=True))

    def _allowed(self, points: Points) -> Bools:
        """Return which points see bad floor and are clear of routes and zones, shape (N,)."""
        seeing = self._bad.query(points, distance_upper_bound=self._sight)[0] <= self._sight
        beside = points[seeing]
        seeing[seeing] = ~shapely.dwithin(
            self._lines, shapely.points(beside), self.rules.min_passage / 2
        ) & ~shapely.intersects_xy(self._kept_out, beside)
        return np.asarray(seeing, dtype=np.bool_)

    def _is_clear(self, candidate: Candidate) -> bool:
        outline = candidate.obstacle.outline
        return not (
            shapely.dwithin(self._lines, outline, self.rules.min_passage / 2)
            or shapely.intersects(self._kept_out, outline)
        )

    def _stays_open(self, candidate: Candidate) -> bool:
        outline = candidate.obstacle.outline
        return all(passages.stays(outline, candidate.on_wall) for passages in self._passages)


def _count_by_kind(placed: Sequence[Candidate]) -> tuple[int, int]:
    """Count the candidates at walls and those on the floor."""
    on_walls = sum(candidate.on_wall for candidate in placed)
    return on_walls, len(placed) - on_walls


def _step_factor(on_walls: int, on_floor: int, most: int) -> float:
    """Return the step factor that leaves a given number: walls scale as 1 / f, floor as 1 / f²."""
    root = math.sqrt(on_walls**2 + 4.0 * on_floor * most)
    return max((on_walls + root) / (2.0 * most), COARSER)
