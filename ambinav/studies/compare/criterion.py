"""The acceptance criterion of a route against the shortest one, fixed before any result.

What a route is to reach against the shortest of its pair, all of it at once:

- robots are lost on it at most a third as often,
- the 95th percentile of its error is at most half,
- it is planned at most 10 % longer,
- and its robots are not shown to meet walls more often, nor do most of them: a run that a wall ends
  has less time to err in, so that a lower error would prove nothing.

The verdict on it is "easy" where there was nothing to gain (on the shortest route no robot was
lost or collided, and the 95th percentile of the error is below 0.15 m), else "met" or "not met".
Apart from the criterion, the effect summarizes the paired runs: a difference is shown where its
interval of 95 % lies on one side of 0.

Figures are means over the runs: the share of runs that were lost, and the 95th percentile over the
time of each run. A few lost runs weigh much in the latter, as they should.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from ambinav.drive.bootstrap import Interval, bootstrap, paired
from ambinav.drive.metrics import Metrics
from ambinav.reports.criterion import AcceptanceCriterion
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.errors import InputError

Outcome = Literal["met", "not met", "easy"]
Effect = Literal["better", "worse", "mixed", "none"]

CRITERION: Final = AcceptanceCriterion()


@dataclass(frozen=True)
class Change:
    """A figure of a route and the same figure of the shortest route.

    Attributes:
        ours: Value for the route; shares from 0 to 1, errors in metres.
        theirs: Value for the shortest route.
        difference: Ours less theirs, of the same seeds.
        ratio: Ours by theirs; inf where theirs is 0 and ours is not, 1 where both are.
    """

    ours: Interval
    theirs: Interval
    difference: Interval
    ratio: Interval

    @property
    def less(self) -> bool:
        """True if the runs show a decrease of the figure."""
        return self.difference.high < 0.0

    @property
    def more(self) -> bool:
        """True if the runs show an increase of the figure."""
        return self.difference.low > 0.0


@dataclass(frozen=True)
class Verdict:
    """The comparison of a route with the shortest one of its pair.

    Attributes:
        runs: Number of runs of each route.
        lost: Share of runs that were lost.
        error: 95th percentile of the position's error, metres.
        collided: Share of runs that collided.
        length: Planned length by that of the shortest route.
        criterion: The acceptance criterion.
    """

    runs: int
    lost: Change
    error: Change
    collided: Change
    length: float
    criterion: AcceptanceCriterion = CRITERION

    @property
    def easy(self) -> bool:
        """True if the shortest route is so good that nothing can be gained."""
        safe = self.lost.theirs.value == 0.0 and self.collided.theirs.value == 0.0
        return safe and self.error.theirs.value < self.criterion.easy

    @property
    def lost_met(self) -> bool:
        """True if few enough runs are lost; no run may be lost if the baseline loses none."""
        return self.criterion.lost_met(self.lost.ours.value, self.lost.theirs.value)

    @property
    def error_met(self) -> bool:
        """True if the error is small enough."""
        return self.criterion.error_met(self.error.ours.value, self.error.theirs.value)

    @property
    def length_met(self) -> bool:
        """True if the route is short enough."""
        return self.criterion.length_met(self.length)

    @property
    def walls_met(self) -> bool:
        """True unless the runs show more collisions, or walls end most of them."""
        return not self.collided.more and self.criterion.walls_met(self.collided.ours.value)

    @property
    def outcome(self) -> Outcome:
        """Outcome of the criterion: "easy", "met" or "not met"."""
        if self.easy:
            return "easy"
        met = self.lost_met and self.error_met and self.length_met and self.walls_met
        return "met" if met else "not met"

    @property
    def effect(self) -> Effect:
        """Effect on lost rate, error and collisions that the runs show; "none": they show none."""
        changes = (self.lost, self.error, self.collided)
        less = any(change.less for change in changes)
        more = any(change.more for change in changes)
        if less and more:
            return "mixed"
        return "better" if less else "worse" if more else "none"

    def row(self) -> dict[str, float | int | str | bool]:
        """Return the verdict as a row of a table: names and plain values."""
        out: dict[str, float | int | str | bool] = {"runs": self.runs}
        for name in ("lost", "error", "collided"):
            change: Change = getattr(self, name)
            out[f"{name}_shortest"] = change.theirs.value
            out[f"{name}_route"] = change.ours.value
            for figure in ("difference", "ratio"):
                interval: Interval = getattr(change, figure)
                out[f"{name}_{figure}"] = interval.value
                out[f"{name}_{figure}_low"] = interval.low
                out[f"{name}_{figure}_high"] = interval.high
        out["length_ratio"] = self.length
        for part in ("lost_met", "error_met", "length_met", "walls_met"):
            out[part] = getattr(self, part)
        return out | {"outcome": self.outcome, "effect": self.effect}


def judge_route(
    ours: Metrics,
    shortest: Metrics,
    lengths: tuple[float, float],
    rng: np.random.Generator,
    criterion: AcceptanceCriterion = CRITERION,
) -> Verdict:
    """Judge a route by its runs and the runs along the shortest route with the same seeds.

    Args:
        ours: Figures of R runs along the route.
        shortest: Figures of R runs along the shortest route, the same seeds in the same order.
        lengths: Planned length of the route and of the shortest one, metres.
        rng: The source of randomness of the bootstrap.
        criterion: The acceptance criterion.

    Raises:
        InputError: not equally many runs, none at all, or a length that is not above 0.
    """
    if not len(ours):
        raise InputError("ours has no runs; drive both routes at least once.")
    if not min(lengths) > 0.0:
        raise InputError(f"lengths is {lengths}; give two lengths above 0 m.")
    return Verdict(
        len(ours),
        _change(ours.lost, shortest.lost, rng),
        _change(ours.position_p95, shortest.position_p95, rng),
        _change(ours.collided, shortest.collided, rng),
        lengths[0] / lengths[1],
        criterion,
    )


def _change(ours: Floats | Bools, theirs: Floats | Bools, rng: np.random.Generator) -> Change:
    return Change(
        bootstrap(ours, rng),
        bootstrap(theirs, rng),
        paired(ours, theirs, rng),
        paired(ours, theirs, rng, compare="ratio"),
    )
