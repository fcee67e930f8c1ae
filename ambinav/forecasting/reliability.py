"""Reliability of forecasts: how many robots got lost where about as many were forecast to.

Routes in buildings that a fit left out are sorted by their forecast, and the share of robots that
got lost on those of each bin is measured (the reliability diagram of Murphy 1973).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.config import Count, Share, check_fields
from ambinav.drive.bootstrap import share
from ambinav.runtime.array_types import Floats, Ints

EDGES: Final = (0.0, 0.005, 0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0)
"""Forecasts at the borders of the bins."""
DIGITS: Final = 4
"""Digits after the point of the shares in a bin."""


@dataclass(frozen=True, kw_only=True)
class ReliabilityBin:
    """Routes whose forecasts are alike, and the share of robots that got lost on them.

    Attributes:
        forecast_low: Smallest forecast.
        forecast_high: Largest forecast.
        routes: Number of routes in buildings that the fit left out.
        lost: Share of the robots that got lost on them.
        lost_low: Lower end of its 95 % interval.
        lost_high: Upper end.

    Raises:
        InputError: a share is not within 0 and 1, or the routes are no number.
    """

    forecast_low: Share
    forecast_high: Share
    routes: Count
    lost: Share
    lost_low: Share
    lost_high: Share

    def __post_init__(self) -> None:
        check_fields(self, "reliability")

    @property
    def sentence(self) -> str:
        """The share and its interval in words."""
        return (
            f"Of {self.routes} routes forecast like this ({100.0 * self.forecast_low:g} to "
            f"{100.0 * self.forecast_high:g} %) in buildings left out of the fit, "
            f"{100.0 * self.lost:.1f} % of the robots got lost ({100.0 * self.lost_low:.1f} to "
            f"{100.0 * self.lost_high:.1f} %)."
        )


def reliability_of(
    forecasts: Floats, lost: Ints, runs: Ints, buildings: NDArray[np.str_]
) -> tuple[ReliabilityBin, ...]:
    """Measure the reliability of forecasts; bins with fewer than two buildings are left out.

    Args:
        forecasts: Probability of each route by a fit without its building, shape (K,).
        lost: Runs that got lost, shape (K,).
        runs: Of how many, shape (K,).
        buildings: Building of each route, shape (K,); the intervals are over buildings.
    """
    bins = []
    number = np.searchsorted(EDGES[1:-1], forecasts, side="right")
    for k, (low, high) in enumerate(pairwise(EDGES)):
        part = number == k
        if len(np.unique(buildings[part])) < 2:
            continue
        happened = [np.arange(n) < m for m, n in zip(lost[part], runs[part], strict=True)]
        measured = share(np.concatenate(happened), group=np.repeat(buildings[part], runs[part]))
        bins.append(
            ReliabilityBin(
                forecast_low=low,
                forecast_high=high,
                routes=int(part.sum()),
                lost=round(measured.value, DIGITS),
                lost_low=round(measured.low, DIGITS),
                lost_high=round(measured.high, DIGITS),
            )
        )
    return tuple(bins)


def bin_at(bins: Sequence[ReliabilityBin], probability: float) -> ReliabilityBin | None:
    """Return the bin of a forecast; None: there is none."""
    return next(
        (each for each in reversed(bins) if each.forecast_low <= probability <= each.forecast_high),
        None,
    )
