"""Intervals over episodes in buildings: buildings are drawn first, then episodes in each of them.

Episodes of one building have its walls in common, so they say less than as many of buildings of
their own. The bootstrap for such groups is that of Davison and Hinkley, "Bootstrap Methods and
their Application" (1997), section 3.8: both stages with replacement. Where there is one building
alone the interval is about that building.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.drive.bootstrap import DRAWS, LEVEL, Interval

AT_ONCE: Final = 4_000_000
"""Draws are made in blocks of so many numbers at most."""

Floats = NDArray[np.float64]


def episode_weights(
    buildings: NDArray[np.str_], rng: np.random.Generator, draws: int = DRAWS
) -> Iterator[Floats]:
    """How often each draw holds each episode.

    Args:
        buildings: The building of each episode, shape (E,).
        rng: The source of randomness.
        draws: How many.

    Yields:
        Whole numbers, shape (D, E), of `draws` draws together.
    """
    _, group = np.unique(buildings, return_inverse=True)
    members = [np.flatnonzero(group == k) for k in range(group.max(initial=-1) + 1)]
    count, step = len(members), max(1, AT_ONCE // max(len(group), 1))
    for low in range(0, draws, step):
        made = min(step, draws - low)
        weights = np.zeros((made, len(group)))
        copies = rng.multinomial(count, np.full(count, 1.0 / count), size=made)
        for k, rows in enumerate(members):
            # The copies of a building draw their episodes one by one: all of them at once.
            even = np.full(len(rows), 1.0 / len(rows))
            weights[:, rows] = rng.multinomial(len(rows) * copies[:, k], even)
        yield weights


def interval_of(value: float, drawn: Floats, count: int) -> Interval:
    """The percentile interval of a figure.

    Args:
        value: Of the episodes as they are.
        drawn: Of each draw; nan where a draw has none, which is left out.
        count: Of how many episodes.
    """
    drawn = drawn[~np.isnan(drawn)]
    if count == 0 or len(drawn) == 0:
        return Interval(math.nan, math.nan, math.nan, int(count))
    ends = np.quantile(drawn, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2], method="inverted_cdf")
    return Interval(float(value), float(ends[0]), float(ends[1]), int(count))


def ratios(above: Floats, below: Floats) -> Floats:
    """Above by below; nan where nothing is below."""
    out = np.full(np.shape(below), np.nan)
    np.divide(above, below, out=out, where=below > 0.0)
    return out
