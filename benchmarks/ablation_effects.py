"""Effects of `bench_ablation.py`, their intervals, and the verdicts of its criterion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.drive.bootstrap import DRAWS, LEVEL, Interval, grouped_weights, percentiles
from ambinav.drive.shares import Evidence, evidence_of, wilson
from ambinav.reports.table import is_shown
from ambinav_envs.evaluation import Episodes
from ambinav_envs.leaderboard.figures import FIGURES, PERCENT, ratios

Floats = NDArray[np.float64]

REWARDS: Final = ("shortest", "ambiguity", "fisher", "error")
WEIGHTS: Final = (0, 5)
MEASURES: Final = ("lost", "arrived", "collided", "length")
MAIN: Final = "halls, disturbed"
"""The setting of the main comparison."""
FEWEST: Final = 3
"""Least number of replicates for a verdict."""
MAIN_LEVEL: Final = 1.0 - 0.05 / 8
SECONDARY_LEVEL: Final = 0.99
SMALL: Final = 5.0
"""Points that the criterion calls small."""
SEED: Final = 7
TITLED: Final = {figure.key: figure for figure in FIGURES}


class Cell(NamedTuple):
    """A reward and an `ambiguity_weight`; the reward of followers, who learn nothing, is "vfh"."""

    reward: str
    weight: int

    @property
    def name(self) -> str:
        """Name of the cell in tables."""
        return f"{self.reward}, {self.weight}"


CELLS: Final = tuple(Cell(reward, weight) for weight in WEIGHTS for reward in REWARDS)

Effect = Mapping[Cell, float]
"""Factor of each cell in an effect."""


def reward_effect(reward: str, weight: int) -> Effect:
    """Return the effect of a reward at a weight, relative to the reward `shortest`."""
    return {Cell(reward, weight): 1.0, Cell(REWARDS[0], weight): -1.0}


def route_effect(reward: str) -> Effect:
    """Return the effect of the route at a reward."""
    return {Cell(reward, WEIGHTS[1]): 1.0, Cell(reward, WEIGHTS[0]): -1.0}


def combined(*weighted: tuple[float, Effect]) -> Effect:
    """Return a weighted sum of effects."""
    total: dict[Cell, float] = {}
    for factor, effect in weighted:
        for cell, count in effect.items():
            total[cell] = total.get(cell, 0.0) + factor * count
    return {cell: count for cell, count in total.items() if count}


MAIN_EFFECTS: Final[dict[str, Effect]] = {
    "reward by itself": reward_effect("ambiguity", 0),
    "reward on its route": reward_effect("ambiguity", 5),
    "route by itself": route_effect("shortest"),
    "route for its reward": route_effect("ambiguity"),
}
SHARES: Final[dict[str, Effect]] = {
    "whole": {Cell("ambiguity", 5): 1.0, Cell("shortest", 0): -1.0},
    "share of the reward": combined(
        *((0.5, reward_effect("ambiguity", weight)) for weight in WEIGHTS)
    ),
    "share of the route": combined(
        *((0.5, route_effect(reward)) for reward in ("shortest", "ambiguity"))
    ),
}
SIMPLE: Final[dict[str, Effect]] = {
    **{
        f"{reward}, at {weight}": reward_effect(reward, weight)
        for reward in REWARDS[1:]
        for weight in WEIGHTS
    },
    **{f"route, at {reward}": route_effect(reward) for reward in REWARDS},
}
INTERACTIONS: Final[dict[str, Effect]] = {
    f"{reward} x route": combined((1.0, reward_effect(reward, 5)), (-1.0, reward_effect(reward, 0)))
    for reward in REWARDS[1:]
}


@dataclass(frozen=True, eq=False)
class Found:
    """Results of the episodes of a setting with one localizer.

    Attributes:
        setting: Its name.
        localizer: Its name.
        seeds: Seeds of the complete replicates, S of them.
        cells: The episodes of each cell by seed and then by building or group of buildings that
            is not drawn; followers have one run.
    """

    setting: str
    localizer: str
    seeds: tuple[int, ...]
    cells: Mapping[Cell, Sequence[Sequence[Episodes]]]

    def parts(self, cell: Cell, key: str) -> tuple[Floats, Floats]:
        """Return numerator and denominator of a measure by run and episode: two of shape (S, E)."""
        runs = [
            [np.concatenate(parts) for parts in zip(*map(TITLED[key].parts, strata), strict=True)]
            for strata in self.cells[cell]
        ]
        above, below = np.array(runs).swapaxes(0, 1)
        return above, below

    def values(self, cell: Cell, key: str) -> Floats:
        """Return a measure of `MEASURES` by run and episode, shape (S, E); nan without a value."""
        above, below = self.parts(cell, key)
        return np.where(below > 0.0, above, np.nan)

    @cached_property
    def _weights(self) -> tuple[Floats, Floats]:
        """Counts of each seed, (D, S), and of each episode, (D, E), in each bootstrap draw."""
        rng = np.random.default_rng(SEED)
        strata = next(iter(self.cells.values()))[0]
        episodes = np.hstack(
            [np.vstack(list(grouped_weights(e.building, rng, DRAWS))) for e in strata]
        )
        count = len(self.seeds)
        seeds = rng.multinomial(count, np.full(count, 1.0 / count), size=len(episodes))
        return seeds.astype(np.float64), episodes

    def differences(self, effect: Effect, key: str) -> Floats:
        """Return an effect on a measure by seed and episode, shape (S, E); nan without a value."""
        return np.asarray(sum(count * self.values(cell, key) for cell, count in effect.items()))

    def effect(self, effect: Effect, key: str, level: float) -> Interval:
        """Return an effect on a measure with its interval, see the criterion."""
        values = self.differences(effect, key)
        return percentiles(*self._drawn(values), int((~np.isnan(values)).sum()), level)

    def ratio(self, effect: Effect, key: str, level: float) -> Interval:
        """Return the ratio of two cells with its interval, instead of their difference."""
        (ours, _), (theirs, _) = sorted(effect.items(), key=lambda term: -term[1])
        above, below = (self._drawn(self.values(cell, key)) for cell in (ours, theirs))
        rate = above[0] / below[0] if below[0] > 0.0 else math.nan
        drawn = np.divide(above[1], below[1], out=np.full(DRAWS, np.inf), where=below[1] > 0.0)
        return percentiles(rate, drawn, self.values(ours, key).size, level)

    def figure(self, cell: Cell, key: str) -> Interval:
        """Return a figure of a cell with its interval of 95 %."""
        above, below = self.parts(cell, key)
        if TITLED[key].is_share:
            happened = (above > 0.0).astype(np.float64)
            value, count = float(happened.mean()), happened.size
            ends = wilson(value, self._evidence(cell, happened))
            return Interval(value, *ends, count).scaled(PERCENT)
        return percentiles(*self._of_sums(above, below), int(np.count_nonzero(below)))

    def _evidence(self, cell: Cell, happened: Floats) -> Evidence:
        """Return the evidence of runs that come in seeds and in drawn buildings or episodes.

        What each way of grouping adds to the variance is added up (Cameron, Gelbach and Miller,
        Journal of Business and Economic Statistics 29, 2011, section 2.2); the quantile is that of
        the way with fewer groups.

        Args:
            cell: The cell.
            happened: 0 or 1 by seed and episode, shape (S, E).
        """
        runs, count = happened.shape
        strata = [part.building for part in self.cells[cell][0]]
        drawn: NDArray[np.generic] = np.concatenate(strata)
        if all(len(np.unique(names)) == 1 for names in strata):
            # Maps that are not drawn: all seeds drive the same episodes there.
            drawn = np.arange(count)
        groups = (np.repeat(np.arange(runs), count), np.tile(drawn, runs))
        parts = [evidence_of(happened.ravel(), group, LEVEL) for group in groups]
        spread_of_parts = sum(1.0 / part.runs - 1.0 / happened.size for part in parts)
        quantile = max(part.quantile for part in parts)
        return Evidence(1.0 / (1.0 / happened.size + spread_of_parts), quantile)

    def _drawn(self, values: Floats) -> tuple[float, Floats]:
        """Return the mean over the values that are not nan, and that of each draw, shape (D,)."""
        is_given = ~np.isnan(values)
        return self._of_sums(np.where(is_given, values, 0.0), is_given.astype(np.float64))

    def _of_sums(self, above: Floats, below: Floats) -> tuple[float, Floats]:
        """Return a ratio of sums over runs and episodes, and that of each draw, shape (D,)."""
        seeds, episodes = self._weights
        if len(above) != seeds.shape[1]:
            # A follower, which has no seeds.
            seeds = np.ones((DRAWS, len(above)))
        drawn = [((seeds @ part) * episodes).sum(axis=1) for part in (above, below)]
        total = ratios(np.array(above.sum()), np.array(below.sum()))
        return float(total), ratios(*drawn)


def against(differences: Floats, sign: float) -> int:
    """Count the seeds whose mean difference does not have this sign."""
    return int(np.count_nonzero(sign * np.nanmean(differences, axis=1) <= 0.0))


def is_marked(results: Found, value: Interval) -> bool:
    """Return whether an interval excludes 0 and there are enough replicates to say so."""
    return len(results.seeds) >= FEWEST and is_shown(value)


def verdict(results: Found, effect: Effect) -> str:
    """Return the criterion's verdict on an effect on being lost."""
    lost = results.effect(effect, "lost", MAIN_LEVEL)
    seeds = results.differences(effect, "lost")
    if len(results.seeds) < FEWEST:
        return "none, too few replicates"
    fallen = results.effect(effect, "arrived", 0.95).high < 0.0
    if lost.high < 0.0 and against(seeds, -1.0) <= 1 and not fallen:
        return "helps"
    if lost.low > 0.0 and against(seeds, 1.0) <= 1:
        return "harms"
    if max(-lost.low, lost.high) <= SMALL:
        return f"at most {SMALL:g} points"
    return "no difference shown"
