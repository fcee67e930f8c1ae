"""Confidence intervals by the bootstrap, and of shares, over random seeds.

The percentile interval of Efron and Tibshirani, "An Introduction to the Bootstrap" (1993),
section 13.3: runs are drawn with replacement, and the statistic of each draw is taken. Of paired
runs the pairs are drawn, so that what both routes have in common cancels.

A share of runs, and a difference of shares, has a score interval, see `shares`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambinav.drive import shares
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

DRAWS = 4000
LEVEL = 0.95
# Draws at once: this many numbers are held at a time.
AT_ONCE = 4_000_000

Statistic = Literal["mean", "median"]
STATISTICS: dict[str, Callable[..., Floats]] = {"mean": np.mean, "median": np.median}


@dataclass(frozen=True)
class Interval:
    """Figure and its confidence interval.

    Attributes:
        value: Value of the runs as they are; nan if none of them has a value.
        low: Lower end; nan likewise, and of the mean or median of a single run.
        high: Upper end.
        count: Number of the runs.
    """

    value: float
    low: float
    high: float
    count: int

    def scaled(self, factor: float) -> Interval:
        """Return the interval in another unit: values are multiplied by `factor` (above 0)."""
        return Interval(factor * self.value, factor * self.low, factor * self.high, self.count)

    def __str__(self) -> str:
        """Return value and interval as text."""
        return f"{self.value:.3g} [{self.low:.3g}, {self.high:.3g}]"


def bootstrap(
    values: ArrayLike,
    rng: np.random.Generator,
    *,
    statistic: Statistic = "mean",
    level: float = LEVEL,
    draws: int = DRAWS,
) -> Interval:
    """Compute a statistic of independent runs, with its interval.

    Args:
        values: One a run, shape (R,); nan: the run has none and is left out. Of truth values the
            mean is a share, with the interval of `share`.
        rng: The source of randomness.
        statistic: The name "mean" or "median".
        level: Level of the interval, between 0 and 1.
        draws: How often to draw.

    Raises:
        InputError: the values are not one row, or another argument is of no use.
    """
    if np.asarray(values).dtype == np.bool_ and statistic == "mean":
        return share(values, level)
    rows = _row(values, "values")[:, None]
    return _interval(rows[~np.isnan(rows[:, 0])], rng, statistic, level, draws, None)


def share(
    values: ArrayLike, level: float = LEVEL, *, group: NDArray[np.generic] | None = None
) -> Interval:
    """Compute the share of runs in which something happened, with Wilson's interval.

    Runs of one route with other seeds are independent; runs on several routes or in several
    buildings are so only as far as these are drawn anew, and else come in groups.

    Args:
        values: A truth value a run, shape (R,).
        level: Level of the interval, between 0 and 1.
        group: Group of each run, shape (R,), any values; None: runs are independent.

    Raises:
        InputError: the values are not one row, or the level is of no use.
    """
    happened = _row(values, "values")
    _check_level(level)
    if not len(happened):
        return Interval(math.nan, math.nan, math.nan, 0)
    value = float(happened.mean())
    ends = shares.wilson(value, shares.evidence_of(happened, group, level))
    return Interval(value, *ends, len(happened))


def paired_share(
    ours: ArrayLike,
    theirs: ArrayLike,
    level: float = LEVEL,
    *,
    group: NDArray[np.generic] | None = None,
) -> Interval:
    """Compute the difference of two shares of the same runs, with Tango's interval.

    Args:
        ours: A truth value a run, shape (R,).
        theirs: The same runs in the same order, shape (R,).
        level: Level of the interval, between 0 and 1.
        group: As for `share`.

    Raises:
        InputError: not equally many values, or the level is of no use.
    """
    a, b = _pair(ours, theirs)
    _check_level(level)
    if not len(a):
        return Interval(math.nan, math.nan, math.nan, 0)
    apart = a - b
    gained, lost = float((apart > 0.0).mean()), float((apart < 0.0).mean())
    ends = shares.tango(gained, lost, shares.evidence_of(apart, group, level))
    return Interval(gained - lost, *ends, len(a))


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
    """Compare a statistic of two routes that were driven with the same seeds.

    Args:
        ours: One a run, shape (R,); a pair with a nan is left out.
        theirs: The same seeds in the same order, shape (R,).
        rng: The source of randomness.
        compare: The difference ours - theirs, or the ratio ours / theirs, of the statistics. A
            ratio with 0 below is inf, of 0 by 0 it is 1.
        statistic: The name "mean" or "median". The difference of means of truth values is one of
            shares, with the interval of `paired_share`.
        level: Level of the interval.
        draws: How often to draw.

    Raises:
        InputError: not equally many values, or another argument is of no use.
    """
    are_shares = all(np.asarray(values).dtype == np.bool_ for values in (ours, theirs))
    if are_shares and (compare, statistic) == ("difference", "mean"):
        return paired_share(ours, theirs, level)
    a, b = _pair(ours, theirs)
    if compare not in ("difference", "ratio"):
        raise InputError(f"compare is {compare!r}; choose difference or ratio.")
    rows = np.column_stack([a, b])
    return _interval(
        rows[~np.isnan(rows).any(axis=1)], rng, statistic, level, draws, compare == "ratio"
    )


def _pair(ours: ArrayLike, theirs: ArrayLike) -> tuple[Floats, Floats]:
    a, b = _row(ours, "ours"), _row(theirs, "theirs")
    if len(a) != len(b):
        raise InputError(
            f"ours has {len(a)} runs and theirs {len(b)}; pairs need the same seeds in both."
        )
    return a, b


def _check_level(level: float) -> None:
    if not 0.0 < level < 1.0:
        raise InputError(f"level is {level}; give a number between 0 and 1.")


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
    """Compute the interval over rows, (R, 1) or (R, 2); `ratio` selects the comparison."""
    if statistic not in STATISTICS:
        raise InputError(f"statistic is {statistic!r}; choose from {', '.join(STATISTICS)}.")
    _check_level(level)
    if draws < 1:
        raise InputError(f"draws is {draws}; give at least 1.")
    count = len(rows)
    if count == 0:
        return Interval(math.nan, math.nan, math.nan, 0)
    of = STATISTICS[statistic]
    drawn = [
        _compared(of(rows[rng.integers(0, count, size=(made, count))], axis=1), ratio)
        for made in at_once(draws, rows.size)
    ]
    value = _compared(of(rows, axis=0)[None], ratio)[0]
    if count == 1:
        # A single run says nothing about the spread.
        return Interval(float(value), math.nan, math.nan, 1)
    return percentiles(value, np.concatenate(drawn), count, level)


def at_once(draws: int, size: int) -> Iterator[int]:
    """Yield batch sizes of draws that keep few enough numbers in memory.

    Args:
        draws: How many there are to be.
        size: Numbers that a draw holds.
    """
    step = max(1, AT_ONCE // max(size, 1))
    for low in range(0, draws, step):
        yield min(step, draws - low)


def percentiles(value: float, drawn: Floats, count: int, level: float = LEVEL) -> Interval:
    """Return the percentile interval of a figure.

    Args:
        value: Value of the runs as they are.
        drawn: Values of each draw; nan where a draw has none, which is left out.
        count: Number of the runs.
        level: Level of the interval.
    """
    drawn = drawn[~np.isnan(drawn)]
    if count == 0 or len(drawn) == 0:
        return Interval(math.nan, math.nan, math.nan, int(count))
    # Inverted, not interpolated: an end is one of the draws, so that infinite ratios do no harm.
    ends = np.quantile(drawn, [0.5 - level / 2, 0.5 + level / 2], method="inverted_cdf")
    return Interval(float(value), float(ends[0]), float(ends[1]), int(count))


def grouped_weights(
    group: NDArray[np.generic], rng: np.random.Generator, draws: int = DRAWS
) -> Iterator[Floats]:
    """Draw how often each resample contains each run, where runs come in groups.

    Runs of one group have something in common (a building's walls), so they say less than as many
    of groups of their own. Davison and Hinkley, "Bootstrap Methods and their Application" (1997),
    section 3.8: groups are drawn with replacement, then runs in each of them. Where there is one
    group alone the interval is about that one.

    Args:
        group: Group of each run, shape (R,); any values.
        rng: The source of randomness.
        draws: How often to draw.

    Yields:
        Whole numbers, shape (D, R), of `draws` draws together.
    """
    _, number = np.unique(group, return_inverse=True)
    members = [np.flatnonzero(number == k) for k in range(number.max(initial=-1) + 1)]
    count = len(members)
    for made in at_once(draws, len(number)):
        weights = np.zeros((made, len(number)))
        copies = rng.multinomial(count, np.full(count, 1.0 / count), size=made)
        for k, rows in enumerate(members):
            # The copies of a group draw their runs one by one: all of them at once.
            even = np.full(len(rows), 1.0 / len(rows))
            weights[:, rows] = rng.multinomial(len(rows) * copies[:, k], even)
        yield weights


def _compared(values: Floats, ratio: bool | None) -> Floats:
    """Return one figure per row, of shape (N, 1) or (N, 2)."""
    if ratio is None:
        return values[:, 0]
    if not ratio:
        return np.asarray(values[:, 0] - values[:, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        out = values[:, 0] / values[:, 1]
    return np.where((values == 0.0).all(axis=1), 1.0, out)
