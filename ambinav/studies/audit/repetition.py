"""The reason why regions are aliased: equal parts of a building stand in a row."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ambinav.studies.audit.aliased_pairs import AliasedPair

STRAIGHT: Final = 0.2
"""Radians by which the robot may be turned in a part that is only displaced."""
WITHIN: Final = 0.25
"""Metres that a part may stand off its place in the row."""
FEWEST: Final = 3
"""Equal parts that are a row."""
FITS: Final = 4
"""Fits of a row to its parts: from two of them alone the far ones would be missed."""


@dataclass(frozen=True)
class Repetition:
    """Equal parts of a building at one distance from each other.

    Attributes:
        letter: Letter of their aliased regions.
        period: Distance from each to the next, metres.
        direction: Direction of the row, radians in [0, pi), in whole degrees.
        count: Number of the parts.
    """

    letter: str
    period: float
    direction: float
    count: int

    @property
    def sentence(self) -> str:
        """The reason in words."""
        return (
            f"{self.letter} repeats: {self.count} equal parts of the building stand in a row, "
            f"{self.period:.1f} m apart, at {math.degrees(self.direction):.0f}° from the x axis."
        )


def find_repetitions(pairs: Sequence[AliasedPair]) -> tuple[Repetition, ...]:
    """Find the row of each letter whose regions stand in one; others have no entry.

    Args:
        pairs: The pairs; those of one letter start at the same point.
    """
    rows = (
        _row(letter, [pair for pair in pairs if pair.letter == letter])
        for letter in dict.fromkeys(pair.letter for pair in pairs)
    )
    return tuple(row for row in rows if row is not None)


def _row(letter: str, pairs: Sequence[AliasedPair]) -> Repetition | None:
    """Return the row with the most parts, and of equal ones that with the longest step."""
    places = np.array(
        [pairs[0].ends[0], *(pair.ends[1] for pair in pairs if abs(pair.turn) < STRAIGHT)]
    )
    best: tuple[int, float, complex] = 0, 0.0, 0j
    points = places @ np.array([1.0, 1.0j])
    for first, second in itertools.combinations(points.tolist(), 2):
        origin, step = first, second - first
        for _ in range(FITS):
            # As numbers of steps from one part: those of the row are whole, no two are the same.
            off = (points - origin) / step
            number = np.rint(off.real)
            near = np.abs(off - number) * abs(step) <= WITHIN
            numbers, parts = np.unique(number[near], return_index=True)
            if len(numbers) < FEWEST:
                break
            step, origin = np.polyfit(numbers, points[near][parts], 1)
        # A gap may be a part whose region is not listed, but not most of the row.
        if len(numbers) < FEWEST or 2 * len(numbers) <= np.ptp(numbers) + 1:
            continue
        best = max(best, (len(numbers), abs(step), step), key=lambda row: row[:2])
    count, period, step = best
    if not count:
        return None
    # A row at -0.1 degrees is one at 0 for readers, not one at 180.
    direction = round(math.degrees(float(np.angle(step)))) % 180
    return Repetition(letter, period, math.radians(direction), count)
