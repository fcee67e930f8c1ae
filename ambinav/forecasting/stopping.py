"""When a share of runs is known well enough to stop: a confidence sequence, valid at any time.

Whoever looks at an ordinary interval after each run, and stops once it says what was asked, is
wrong more often than its level says. The intervals here hold all at once, whatever the number of
runs at which one stops (Robbins 1970, "Statistical methods related to the law of the iterated
logarithm"; Howard, Ramdas, McAuliffe & Sekhon 2021, "Time-uniform, nonparametric, nonasymptotic
confidence sequences", Annals of Statistics 49(2)). For a share p the likelihood ratio of a mixture
over all shares to p,

    M_n(p) = B(a + s, b + n - s) / B(a, b) / (p^s (1 - p)^(n - s)),        s events in n runs,

is a martingale with mean 1 if p is true, so it ever exceeds 1 / (1 - level) with a probability of
at most 1 - level (Ville's inequality). The interval holds the shares for which it does not. The
mixture is the Beta(1/2, 1/2), which is good at small shares too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from scipy.special import betaln, xlog1py, xlogy

from ambinav.drive.bootstrap import LEVEL, Interval
from ambinav.runtime.errors import InputError

PRIOR: Final = 0.5
HALVINGS: Final = 60


@dataclass(frozen=True, kw_only=True)
class StoppingRule:
    """Precision to which a share must be known before the runs may stop.

    Attributes:
        threshold: The interval must lie wholly below or above this share; None: it need not.
        width: Or it must be no wider than this; None: it need not.

    Raises:
        InputError: a number is not between 0 and 1.
    """

    threshold: float | None = None
    width: float | None = None

    def __post_init__(self) -> None:
        for name in ("threshold", "width"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < 1.0:
                raise InputError(f"{name} is {value}; give a share between 0 and 1.")

    def met(self, interval: Interval) -> bool:
        """Return whether an interval says enough."""
        apart = self.threshold is not None and side(interval, self.threshold) is not None
        return apart or (self.width is not None and interval.high - interval.low <= self.width)


def side(interval: Interval, threshold: float) -> str | None:
    """Return "below" or "above" where an interval lies on one side of a share; None if neither."""
    if interval.high < threshold:
        return "below"
    return "above" if interval.low > threshold else None


def confidence_sequence(events: int, count: int, level: float = LEVEL) -> Interval:
    """Return the interval of a share that holds for all numbers of runs at once.

    Args:
        events: Runs in which it happened.
        count: All runs; 0: the interval is all shares, without a value.
        level: Probability that the true share is in the intervals of all counts, between 0 and 1.

    Raises:
        InputError: there are more events than runs, or fewer than 0; or the level is of no use.
    """
    if not 0 <= events <= count:
        raise InputError(f"events is {events}; give 0 to count ({count}).")
    if not 0.0 < level < 1.0:
        raise InputError(f"level is {level}; give a number between 0 and 1.")
    if count == 0:
        return Interval(math.nan, 0.0, 1.0, 0)
    share = events / count
    mixture = betaln(PRIOR + events, PRIOR + count - events) - betaln(PRIOR, PRIOR)
    bound = mixture + math.log1p(-level)

    def end(outside: float) -> float:
        # The logarithm of M falls from an end to the observed share, where it is below 0.
        inside = share
        for _ in range(HALVINGS):
            middle = 0.5 * (inside + outside)
            if xlogy(events, middle) + xlog1py(count - events, -middle) > bound:
                inside = middle
            else:
                outside = middle
        return outside

    low = end(0.0) if events > 0 else 0.0
    return Interval(share, low, end(1.0) if events < count else 1.0, count)
