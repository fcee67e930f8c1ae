"""Figures of a scanner over a region: mean, 95th percentile and worst level, zones."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from ambinav.drive.bootstrap import Interval
from ambinav.maps.zones import BAD, CORRIDOR, OPEN, ZONES
from ambinav.runtime.array_types import Bytes, Floats, Floats32

Criterion = Literal["mean", "p95", "worst", "bad"]

CRITERIA: Final[dict[str, str]] = {
    "mean": "mean level",
    "p95": "95th percentile of the level",
    "worst": "worst level",
    "bad": "share of corridor and open",
}
"""Criteria to rank settings by, all better when low."""
PERCENTILE: Final = 0.95
_NORMAL: Final = 1.959964
"""Half width of an interval in standard errors: 95 % of a normal distribution."""


@dataclass(frozen=True)
class Figures:
    """One scanner over a region.

    Attributes:
        mean: Level in the mean; nan if the robot can stand nowhere with it.
        p95: 95 % of the region have at most this level.
        worst: Highest level of all places.
        zones: Share of each zone, by name.
        standing: Share of the region where the robot can stand with the scanner: the other figures
            are of that.
    """

    mean: float
    p95: float
    worst: float
    zones: dict[str, float]
    standing: float

    @property
    def bad(self) -> float:
        """Share of corridor and open zones."""
        return self.zones[ZONES[CORRIDOR]] + self.zones[ZONES[OPEN]]

    def of(self, criterion: Criterion) -> float:
        """Return the figure of a name."""
        return float(getattr(self, criterion))


def figures(level: Floats32, zone: Bytes, weight: Floats) -> Figures:
    """Compute the figures of a scanner.

    Args:
        level: Shape (K, H), nan where the robot cannot stand.
        zone: Codes of zones, shape (K, H).
        weight: Weight of each place, shape (K,), shared evenly by the headings at which it
            can.
    """
    each = _spread(level, weight)
    counted = each > 0.0
    values = level[counted].astype(np.float64)
    share = each[counted] / max(float(each.sum()), 1e-300)
    if not len(values):
        return Figures(math.nan, math.nan, math.nan, dict.fromkeys(ZONES, math.nan), 0.0)
    order = np.argsort(values)
    below = np.searchsorted(np.cumsum(share[order]), PERCENTILE - 1e-9)
    zones = np.bincount(zone[counted], weights=share, minlength=len(ZONES))
    return Figures(
        mean=float(values @ share),
        p95=float(values[order[min(int(below), len(order) - 1)]]),
        worst=float(values.max()),
        zones=dict(zip(ZONES, zones.tolist(), strict=True)),
        standing=min(float(each.sum() / weight.sum()), 1.0),
    )


def per_place(level: Floats32, zone: Bytes, criterion: Criterion) -> Floats | None:
    """Return the contribution of each place to a mean figure, shape (K,); else None.

    In the mean over the headings at which the robot can stand; nan where there is none.
    """
    if criterion == "mean":
        values = level.astype(np.float64)
    elif criterion == "bad":
        values = np.isin(zone, BAD).astype(np.float64)
    else:
        return None
    each = _spread(level, np.ones(len(level)))
    total = np.where(each > 0.0, values * each, 0.0).sum(axis=1)
    return np.where(each.any(axis=1), total, np.nan)


def difference(
    ours: Floats, theirs: Floats, weight: Floats, of: int, among: int | None = None
) -> Interval:
    """Compute the difference of two means over places, ours less theirs, with its interval.

    Each mean is over the places that have a value.

    The interval is that of a random sample without replacement of `of` places (Cochran 1977,
    "Sampling Techniques", section 2.8); ours is spread evenly, which makes it no wider. Errors are
    of the difference at each place, so that what both have in common cancels, and where one has
    no value those of a ratio (section 2.11). It closes where all places are there.

    Args:
        ours: Shape (K,), nan where there is none.
        theirs: Values of the other setting, likewise.
        weight: Weight of the places, shape (K,).
        of: Number of places that these represent.
        among: Number of sampled places; None: K.
    """
    (mean, errors), (other, others) = _mean(ours, weight), _mean(theirs, weight)
    count = int((np.isfinite(ours) | np.isfinite(theirs)).sum())
    value = mean - other
    if math.isnan(value):
        return Interval(math.nan, math.nan, math.nan, 0)
    left = max(1.0 - (among or len(ours)) / of, 0.0)
    error = math.sqrt(left * float(((errors - others) ** 2).sum()) * count / max(count - 1, 1))
    if left and count < 2:
        error = math.inf
    return Interval(value, value - _NORMAL * error, value + _NORMAL * error, count)


def _mean(values: Floats, weight: Floats) -> tuple[float, Floats]:
    """Compute the mean over places with a value, nan if none has, and the error of each, (K,)."""
    finite = np.isfinite(values)
    if not finite.any():
        return math.nan, np.zeros(len(values))
    share = np.where(finite, weight, 0.0) / weight[finite].sum()
    mean = float(share[finite] @ values[finite])
    return mean, share * np.where(finite, values - mean, 0.0)


def _spread(level: Floats32, weight: Floats) -> Floats:
    """Return the weight of each place and heading, (K, H)."""
    finite = np.isfinite(level)
    return np.where(finite, (weight / np.maximum(finite.sum(axis=1), 1))[:, None], 0.0)
