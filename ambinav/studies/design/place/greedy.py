"""Greedy placement of k obstacles, one after the other, by their true effect on the map.

Greedy is lazy (Minoux 1978): what a candidate gains is looked at again only once it may be the
best. That is exact where gains only ever shrink as obstacles are added (submodular). Here they need
not: two posts may turn a floor good that neither does alone. So the candidates that come next are
looked at again too, a gain is kept as it is only where the obstacle that was chosen changed nothing
that it depends on, and how often gains grow is measured
(`ambinav.studies.design.place.submodularity`). In the end each obstacle is taken away and put
where it then helps most, as long as that gains anything: what two of them do together greedy does
not foresee. Then each is moved to where it helps most between the candidates that were tried
(`ambinav.studies.design.place.moves`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, islice
from typing import Final

import numpy as np

from ambinav.runtime.array_types import Ints
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, silent, within
from ambinav.studies.design.place.candidates import Candidate, Kind, apart
from ambinav.studies.design.place.effect import Badness, Effects
from ambinav.studies.design.place.gains import Gains
from ambinav.studies.design.place.moves import Moves, best_of

REVIEWED: Final = 8
"""Number of next best candidates that are evaluated again before one is selected."""
EXCHANGED: Final = 16
"""Number of candidates that finally are tried instead of each obstacle,"""
ROUNDS: Final = 3
"""at most this number of times."""
NOTHING: Final = 0.05
"""Bad floor, square metres or metres of routes, that is printed as 0.0 where there is less."""


@dataclass(frozen=True, eq=False)
class Trials:
    """Effect of each candidate alone.

    Attributes:
        candidates: C of them.
        gains: Bad floor that each removes.
        rows: Poses whose map they change, rows of `Effects.radii`.
        fixed: Bad places that they turn good.
    """

    candidates: tuple[Candidate, ...]
    gains: tuple[Badness, ...]
    rows: tuple[Ints, ...]
    fixed: tuple[Ints, ...]

    def among(self, numbers: Sequence[int]) -> Trials:
        """Return the trials with the given numbers."""
        return Trials(
            tuple(self.candidates[i] for i in numbers),
            tuple(self.gains[i] for i in numbers),
            tuple(self.rows[i] for i in numbers),
            tuple(self.fixed[i] for i in numbers),
        )

    def and_of(self, other: Trials) -> Trials:
        """Return these trials, followed by others of the same building."""
        return Trials(
            self.candidates + other.candidates, self.gains + other.gains,
            self.rows + other.rows, self.fixed + other.fixed,
        )  # fmt: skip

    def have_room(self, numbers: Sequence[int], passage: float) -> bool:
        """Return whether some candidates leave a passage, metres, between any two of them."""
        pairs = combinations((self.candidates[i] for i in numbers), 2)
        return all(apart(first, second, passage) for first, second in pairs)

    def gain_together(self, effects: Effects, numbers: Sequence[int]) -> Badness:
        """Return what some candidates remove together, in the building in which they were tried."""
        return effects.tried([self.candidates[i].obstacle for i in numbers]).gain

    @property
    def order(self) -> Ints:
        """Numbers of the candidates, best first."""
        return np.argsort([-gain.cost for gain in self.gains], kind="stable")


@dataclass(frozen=True, eq=False)
class Placed:
    """A placed obstacle.

    Attributes:
        candidate: The obstacle and its position.
        alone: Badness that it removes if it is the only one.
        gain: Badness that it removes after those before it.
        after: Badness after its placement.
    """

    candidate: Candidate
    alone: Badness
    gain: Badness
    after: Badness


@dataclass(frozen=True, eq=False)
class Placement:
    """Placed obstacles with the badness before and after each.

    Attributes:
        before: Without any.
        placed: The placed obstacles in the order of choice.
        looked: Number of computed effects.
        exchanged: Number of obstacles put elsewhere in the end.
        effects: The building with them.
        crowded: Whether there are fewer than were asked for because no further place is apart from
            theirs, not because no further one helps.
    """

    before: Badness
    placed: tuple[Placed, ...]
    looked: int
    exchanged: int
    effects: Effects
    crowded: bool = False

    @property
    def after(self) -> Badness:
        """Badness with all obstacles."""
        return self.placed[-1].after if self.placed else self.before


def try_alone(
    effects: Effects, candidates: Sequence[Candidate], progress: Progress = silent
) -> Trials:
    """Try each candidate in the current building."""
    gains, rows, fixed = [], [], []
    for k, candidate in enumerate(candidates):
        change = effects.tried([candidate.obstacle])
        gains.append(change.gain)
        rows.append(change.rows)
        fixed.append(change.fixed)
        progress((k + 1) / len(candidates))
    return Trials(tuple(candidates), tuple(gains), tuple(rows), tuple(fixed))


def place(
    effects: Effects,
    trials: Trials,
    count: int,
    passage: float,
    moves: Moves | None = None,
    progress: Progress = silent,
    least: float = 0.0,
) -> Placement:
    """Place `count` obstacles where they help most; fewer if none helps or none has room.

    Which ones suffice is known only in the end: one that turns nothing good may have to stand for
    the next to do so.

    Args:
        effects: The building, in which the candidates were tried; it is left as it is.
        trials: The candidates, each alone.
        count: Number of obstacles, at least 1.
        passage: Metres to be left between two of them.
        moves: Moves them between the candidates in the end; None: they stay.
        progress: Called with the share done.
        least: Bad floor that the last one is to take away; what then takes away less is left out.

    Raises:
        InputError: `count` is below 1.
    """
    if count < 1:
        raise InputError(f"number of obstacles: {count}; give 1 or more.")
    gains = Gains(effects)
    search = _Search(gains, trials, passage)
    while len(search.chosen) < count and (best := search.best()) is not None:
        search.put((*search.chosen, best))
        progress(0.4 * len(search.chosen) / count)
    crowded = len(search.chosen) < count and not search.is_open.any()
    chosen = search.exchanged()
    progress(0.5)
    if moves is not None:
        chosen = moves.improve(gains, chosen, within(progress, 0.5, 0.9))
    placed, now = _place_in_order(gains, chosen)
    useful = [k for k, obstacle in enumerate(placed, start=1) if obstacle.gain.bad >= least]
    enough = max(useful, default=0)
    if enough < len(placed):
        placed, now = _place_in_order(gains, [obstacle.candidate for obstacle in placed[:enough]])
    progress(1.0)
    return Placement(
        effects.badness,
        placed,
        len(trials.candidates) + gains.looked,
        sum(candidate not in search.chosen for candidate in chosen),
        now,
        crowded and enough == len(chosen),
    )


def place_each(
    gains: Gains,
    trials: Trials,
    most: Mapping[Kind, int],
    prices: Mapping[Kind, float],
    passage: float,
) -> Iterator[tuple[Candidate, ...]]:
    """Yield placements of 1, 2, ... obstacles, each the best for its number that is found.

    The next obstacle is the one that gains most for its price; then each is put where it helps most
    beside the others, as in `place`. Ends where none is allowed or helps, or no bad floor is left.

    Args:
        gains: Gains in the building in which the candidates were tried.
        trials: The candidates, each alone.
        most: Number of obstacles of each kind, at most.
        prices: Price of an obstacle of each kind, above zero.
        passage: Metres to be left between two of them.
    """
    search = _Search(gains, trials, passage, most, prices)
    while search.badness.bad > 0.0 and (best := search.best()) is not None:
        search.put((*search.chosen, best))
        yield search.exchanged()


class _Search:
    """The state of lazy greedy, by gain per price where kinds have prices."""

    def __init__(
        self,
        gains: Gains,
        trials: Trials,
        passage: float,
        most: Mapping[Kind, int] | None = None,
        prices: Mapping[Kind, float] | None = None,
    ) -> None:
        self.trials, self.passage = trials, passage
        self._gains = gains
        self._latest = [gain.cost for gain in trials.gains]
        gains.by_pair |= {
            (candidate, frozenset()): gain
            for candidate, gain in zip(trials.candidates, self._latest, strict=True)
        }
        kinds = [candidate.kind for candidate in trials.candidates]
        self._most = dict(most) if most is not None else dict.fromkeys(kinds, len(kinds))
        # Only their ratios count.
        least = min(prices.values()) if prices else 1.0
        self._prices = np.array([prices[kind] / least if prices else 1.0 for kind in kinds])
        self.put(())

    @property
    def badness(self) -> Badness:
        """Badness of the building with the chosen obstacles."""
        return self._beside.effects.badness

    def put(self, chosen: Sequence[Candidate]) -> None:
        """Choose obstacles instead of those so far."""
        self.chosen = tuple(chosen)
        self._beside = self._gains.beside(self.chosen)
        count = Counter(each.kind for each in self.chosen)
        self.is_open = np.array(
            [
                self._most[each.kind] > count[each.kind]
                and all(apart(each, other, self.passage) for other in self.chosen)
                for each in self.trials.candidates
            ],
            dtype=np.bool_,
        )
        self._stale = np.ones(len(self._latest), dtype=np.bool_)

    def best(self) -> Candidate | None:
        """Return the candidate with the largest gain; None if none gains anything."""
        if not self.is_open.any():
            return None
        while True:
            costs = np.where(self.is_open, np.divide(self._latest, self._prices), -np.inf)
            order = np.argsort(-costs, kind="stable")[: int(self.is_open.sum())]
            outdated = [i for i in order[:REVIEWED].tolist() if self._stale[i]]
            if not outdated:
                break
            for i in outdated:
                self._latest[i] = self._beside.gain(self.trials.candidates[i])
                self._stale[i] = False
        best = int(order[0])
        return self.trials.candidates[best] if self._latest[best] > 0.0 else None

    def exchanged(self) -> tuple[Candidate, ...]:
        """Return the chosen obstacles, each put where one of its kind helps most."""
        chosen = list(self.chosen)
        promising = [self.trials.candidates[i] for i in self.trials.order.tolist()]
        for _ in range(ROUNDS if len(chosen) > 1 else 0):
            before = list(chosen)
            for k, candidate in enumerate(before):
                others = chosen[:k] + chosen[k + 1 :]
                rivals = (
                    rival
                    for rival in promising
                    if rival.kind == candidate.kind
                    and all(apart(rival, other, self.passage) for other in others)
                )
                beside = self._gains.beside(others)
                chosen[k] = best_of(candidate, list(islice(rivals, EXCHANGED)), beside.gain)
            if chosen == before:
                break
        return tuple(chosen)


def _place_in_order(
    gains: Gains, chosen: Sequence[Candidate]
) -> tuple[tuple[Placed, ...], Effects]:
    """Place the obstacles in the order of their gains; return the building with them too."""
    now, left = gains.effects.copy(), list(chosen)
    alone: dict[Candidate, Badness] = {}
    placed: list[Placed] = []
    while left:
        changes = [now.tried([candidate.obstacle]) for candidate in left]
        gains.looked += len(changes)
        if not placed:
            alone = {each: change.gain for each, change in zip(left, changes, strict=True)}
        best = max(range(len(left)), key=lambda i: changes[i].gain.cost)
        now.put(changes[best])
        candidate = left.pop(best)
        placed.append(Placed(candidate, alone[candidate], changes[best].gain, now.badness))
    return tuple(placed), now
