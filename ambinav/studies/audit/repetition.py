"""The reason why regions are aliased: equal parts of a building stand in a row."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from pydantic import Field

from ambinav.reports.fields import Degrees, Metres, Part
from ambinav.studies.audit.aliased_pairs import AliasedPair

STRAIGHT: Final = 0.2
"""Radians by which the robot may be turned in a part that is only displaced."""
WITHIN: Final = 0.25
"""Metres that a part may stand off its place in the row."""
FEWEST: Final = 3
"""Equal parts that are a row."""
FITS: Final = 4
"""Fits of a row to its parts: from two of them alone the far ones would be missed."""


class RepetitionPart(Part):
    """Equal parts of the building in a row: the reason why the regions of a letter are aliased."""

    letter: str
    period_m: Metres = Field(description="distance from each part to the next")
    direction_deg: Degrees = Field(description="direction of the row, from 0 to 180")
    count: int = Field(description="number of the parts")
    sentence: str


def find_repetitions(pairs: Sequence[AliasedPair]) -> tuple[RepetitionPart, ...]:
    """Find the row of each letter whose regions stand in one; others have no entry.

    Args:
        pairs: The pairs; those of one letter start at the same point.
    """
    rows = (
        _row(letter, [pair for pair in pairs if pair.letter == letter])
        for letter in dict.fromkeys(pair.letter for pair in pairs)
    )
    return tuple(row for row in rows if row is not None)


def _row(letter: str, pairs: Sequence[AliasedPair]) -> RepetitionPart | None:
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
    sentence = (
        f"{letter} repeats: {count} equal parts of the building stand in a row, {period:.1f} m "
        f"apart, at {direction}° from the x axis."
    )
    return RepetitionPart(
        letter=letter, period_m=period, direction_deg=direction, count=count, sentence=sentence
    )
