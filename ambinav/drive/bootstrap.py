"""Intervals by the bootstrap: what could have come out with other seeds.

The percentile interval of Efron and Tibshirani, "An Introduction to the Bootstrap" (1993),
section 13.3: runs are drawn with replacement, and the statistic of each draw is taken. Of paired
runs the pairs are drawn, so that what both routes have in common cancels.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambinav.errors import InputError

DRAWS = 4000
LEVEL = 0.95
# Draws at once: this many numbers are held at a time.
AT_ONCE = 4_000_000

Floats = NDArray[np.float64]
Statistic = Literal["mean", "median"]
STATISTICS: dict[str, Callable[..., Floats]] = {"mean": np.mean, "median": np.median}


@dataclass(frozen=True)
class Interval:
    """A figure and its interval.

    Attributes:
        value: Of the runs as they are; nan if none of them has a value.
        low: Lower end; nan likewise.
        high: Upper end.
        count: Of how many runs.
    """

    value: float
    low: float
    high: float
    count: int

    def __str__(self) -> str:
        """Value and interval."""
        return f"{self.value:.3g} [{self.low:.3g}, {self.high:.3g}]"


def bootstrap(
    values: ArrayLike,
    rng: np.random.Generator,
    *,
    statistic: Statistic = "mean",
    level: float = LEVEL,
    draws: int = DRAWS,
) -> Interval:
    """A statistic of independent runs.

    Args:
        values: One a run, shape (R,); nan: the run has none and is left out. Truth values count
            as 0 and 1, so that their mean is a share.
        rng: The source of randomness.
        statistic: The name "mean" or "median".
        level: Of the interval, between 0 and 1.
        draws: How often to draw.

    Raises:
        InputError: the values are not one row, or another argument is of no use.
    """
    rows = _row(values, "values")[:, None]
    return _interval(rows[~np.isnan(rows[:, 0])], rng, statistic, level, draws, None)


def paired(
    ours: ArrayLike,
    theirs: ArrayLike,
    rng: np.random.Generator,
    *,
    compare: Literal["difference", "ratio"] = "difference",
    statistic: Statistic = "mean",
    level: float = LEVEL,
    draws: int = DRAWS,
) -> Interval:
    """How a statistic differs between two routes, driven with the same seeds.

    Args:
        ours: One a run, shape (R,); a pair with a nan is left out.
        theirs: The same seeds in the same order, shape (R,).
        rng: The source of randomness.
        compare: The difference ours - theirs, or the ratio ours / theirs, of the statistics. A
            ratio with 0 below is inf, of 0 by 0 it is 1.
        statistic: The name "mean" or "median".
        level: Of the interval.
        draws: How often to draw.

    Raises:
        InputError: not equally many values, or another argument is of no use.
    """
    a, b = _row(ours, "ours"), _row(theirs, "theirs")
    if len(a) != len(b):
        raise InputError(
            f"ours has {len(a)} runs and theirs {len(b)}; pairs need the same seeds in both."
        )
    if compare not in ("difference", "ratio"):
        raise InputError(f"compare is {compare!r}; choose difference or ratio.")
    rows = np.column_stack([a, b])
    return _interval(
        rows[~np.isnan(rows).any(axis=1)], rng, statistic, level, draws, compare == "ratio"
    )


def _row(values: ArrayLike, name: str) -> Floats:
    row = np.asarray(values, dtype=np.float64)
    if row.ndim != 1:
        raise InputError(f"{name} has the shape {row.shape}; give one value a run.")
    return row


def _interval(
    rows: Floats,
    rng: np.random.Generator,
    statistic: str,
    level: float,
    draws: int,
    ratio: bool | None,
) -> Interval:
    """The interval over the rows, shape (R, 1) or (R, 2); `ratio` says how columns compare."""
    if statistic not in STATISTICS:
        raise InputError(f"statistic is {statistic!r}; choose from {', '.join(STATISTICS)}.")
    if not 0.0 < level < 1.0:
        raise InputError(f"level is {level}; give a number between 0 and 1.")
    if draws < 1:
        raise InputError(f"draws is {draws}; give at least 1.")
    count = len(rows)
    if count == 0:
        return Interval(math.nan, math.nan, math.nan, 0)
    of = STATISTICS[statistic]
    drawn = []
    step = max(1, AT_ONCE // rows.size)
    for low in range(0, draws, step):
        index = rng.integers(0, count, size=(min(step, draws - low), count))
        drawn.append(_compared(of(rows[index], axis=1), ratio))
    # Inverted, not interpolated: an end is one of the draws, so that infinite ratios do no harm.
    ends = np.quantile(
        np.concatenate(drawn), [0.5 - level / 2, 0.5 + level / 2], method="inverted_cdf"
    )
    value = _compared(of(rows, axis=0)[None], ratio)[0]
    return Interval(float(value), float(ends[0]), float(ends[1]), count)


def _compared(values: Floats, ratio: bool | None) -> Floats:
    """One figure a row, of shape (N, 1) or (N, 2)."""
    if ratio is None:
        return values[:, 0]
    if not ratio:
        return np.asarray(values[:, 0] - values[:, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        out = values[:, 0] / values[:, 1]
    return np.where((values == 0.0).all(axis=1), 1.0, out)
