"""Test of submodularity of gains, on sampled pairs and triples of obstacles.

For a submodular gain, what a candidate adds to a larger set is no more than what it adds to a
smaller one. Lazy greedy is then exact, and greedy reaches 1 - 1/e (63 %) of the optimum at least
(Nemhauser, Wolsey, Fisher 1978). Nothing makes the bad floor of a map so.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ambinav.runtime.array_types import Floats
from ambinav.runtime.progress import Progress, silent
from ambinav.studies.design.place.effect import Effects
from ambinav.studies.design.place.greedy import NOTHING, Trials

PAIRS: Final = 24
TRIPLES: Final = 8
POOL: Final = 40
"""Number of candidates with the largest single gains, from which samples are drawn."""
FEW: Final = 8
"""Least samples for a conclusion if no gain grew."""


@dataclass(frozen=True)
class Violations:
    """Gains (`Badness.cost`) of a candidate alone and beside one more obstacle.

    Attributes:
        without: Gain of a candidate in each of S samples, square metres or metres of routes,
            shape (S,).
        beside: Gain beside one more obstacle that changes some of the same floor.
    """

    without: Floats
    beside: Floats

    @property
    def samples(self) -> int:
        """Number of compared samples."""
        return len(self.without)

    @property
    def grown(self) -> int:
        """Number of gains that grew by `NOTHING` or more; a submodular gain never grows."""
        return int((self.beside - self.without >= NOTHING).sum())

    @property
    def largest(self) -> int:
        """Index of the sample whose gain grew most; there is at least one sample."""
        return int(np.argmax(self.beside - self.without))

    @property
    def typical(self) -> tuple[float, float]:
        """Medians of the gain without and beside; there is at least one sample."""
        return float(np.median(self.without)), float(np.median(self.beside))


def measured(
    effects: Effects,
    trials: Trials,
    passage: float,
    rng: np.random.Generator,
    progress: Progress = silent,
) -> Violations:
    """Compare gains with and without another obstacle.

    Args:
        effects: The building, in which the candidates were tried.
        trials: The candidates, each alone.
        passage: Metres to be left between two.
        rng: Draws the samples.
        progress: Called with the share done.
    """
    pool = trials.order[:POOL]
    pool = pool[[trials.gains[i].cost > 0.0 for i in pool.tolist()]]
    pairs: list[tuple[float, float]] = []

    def gain(*numbers: int) -> float:
        return trials.gain_together(effects, numbers).cost

    for k in range(PAIRS + TRIPLES):
        progress(k / (PAIRS + TRIPLES))
        size = 2 if k < PAIRS else 3
        if len(pool) < size:
            break
        drawn = rng.choice(pool, size, replace=False).tolist()
        if not _interact(trials, drawn, passage):
            continue
        *others, last = drawn
        if size == 2:
            without = trials.gains[last].cost
            beside = gain(*drawn) - trials.gains[others[0]].cost
        else:
            both = gain(*others)
            without = gain(others[0], last) - trials.gains[others[0]].cost
            beside = gain(*drawn) - both
        pairs.append((without, beside))
    progress(1.0)
    return Violations(*np.reshape(pairs, (-1, 2)).T)


def _interact(trials: Trials, drawn: list[int], passage: float) -> bool:
    """Return whether the last candidate shares poses with each other one, and all fit together."""
    last = trials.rows[drawn[-1]]
    return all(
        bool(np.isin(last, trials.rows[i], assume_unique=True).any()) for i in drawn[:-1]
    ) and trials.have_room(drawn, passage)
