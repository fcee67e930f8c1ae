"""Greedy placement of k obstacles, one after the other, by their true effect on the map.

Greedy is lazy (Minoux 1978): what a candidate gains is looked at again only once it may be the
best. That is exact where gains only ever shrink as obstacles are added (submodular). Here they need
not: two posts may turn a floor good that neither does alone. So the candidates that come next are
looked at again too, a gain is kept as it is only where the obstacle that was chosen changed nothing
that it depends on, and how often gains grow is measured
(`ambinav.studies.design.place.submodularity`). In the end each obstacle is taken away and put
where it then helps most, as long as that gains anything: what two of them do together greedy does
not foresee.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.errors import InputError
from ambinav.studies.design.place.candidates import Candidate, Kind, apart
from ambinav.studies.design.place.effect import Badness, Change, Effects

REVIEWED: Final = 8
"""Number of next best candidates that are evaluated again before one is selected."""
EXCHANGED: Final = 16
"""Number of candidates that finally are tried instead of each obstacle,"""
ROUNDS: Final = 3
"""at most this number of times."""
NOTHING: Final = 0.05
"""Bad floor, square metres or metres of routes, that is printed as 0.0 where there is less."""
LEAST: Final = 1e-6
"""Least gain of cost for an exchange."""


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
    rows: tuple[NDArray[np.int64], ...]
    fixed: tuple[NDArray[np.int64], ...]

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

    @property
    def order(self) -> NDArray[np.int64]:
        """Numbers of the candidates, best first."""
        return np.argsort([-gain.cost for gain in self.gains], kind="stable")


@dataclass(frozen=True, eq=False)
class Placed:
    """A placed obstacle.

    Attributes:
        number: Index of the candidate.
        candidate: The obstacle and its position.
        alone: Badness that it removes if it is the only one.
        gain: Badness that it removes after those before it.
        after: Badness after its placement.
    """

    number: int
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
        exchanged: Number of obstacles moved in the end.
        compared: Gains of candidates that were looked at again, before and after another obstacle
            was put up: pairs of costs.
        effects: The building with them.
        crowded: Whether there are fewer than were asked for because no further place is apart from
            theirs, not because no further one helps.
    """

    before: Badness
    placed: tuple[Placed, ...]
    looked: int
    exchanged: int
    compared: tuple[tuple[float, float], ...]
    effects: Effects
    crowded: bool = False

    @property
    def after(self) -> Badness:
        """Badness with all obstacles."""
        return self.placed[-1].after if self.placed else self.before


def try_alone(
    effects: Effects,
    candidates: Sequence[Candidate],
    report: Callable[[float], None] = lambda share: None,
) -> Trials:
    """Try each candidate in the current building."""
    gains, rows, fixed = [], [], []
    for k, candidate in enumerate(candidates):
        change = effects.tried([candidate.obstacle])
        gains.append(change.gain)
        rows.append(change.rows)
        fixed.append(change.fixed)
        report((k + 1) / len(candidates))
    return Trials(tuple(candidates), tuple(gains), tuple(rows), tuple(fixed))


def place(
    effects: Effects,
    trials: Trials,
    count: int,
    passage: float,
    report: Callable[[float], None] = lambda share: None,
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
        report: Called with the share done.
        least: Bad floor that the last one is to take away; what then takes away less is left out.

    Raises:
        InputError: `count` is below 1.
    """
    if count < 1:
        raise InputError(f"number of obstacles: {count}; give 1 or more.")
    search = _Search(effects, trials, passage)
    numbers: list[int] = []
    while len(numbers) < count:
        best = search.best()
        if best is None:
            break
        search.put(best)
        numbers.append(best)
        report(0.5 * len(numbers) / count)
    crowded = len(numbers) < count and not search.left.any()
    numbers, exchanged, tried = _exchange(effects, trials, numbers, passage)
    report(0.9)
    placed, now, chained = _place_in_order(effects, trials, numbers)
    useful = [k for k, obstacle in enumerate(placed, start=1) if obstacle.gain.bad >= least]
    enough = max(useful, default=0)
    if enough < len(placed):
        placed, now, more = _place_in_order(
            effects, trials, [obstacle.number for obstacle in placed[:enough]]
        )
        chained += more
    report(1.0)
    return Placement(
        effects.badness,
        placed,
        len(trials.candidates) + search.looked + tried + chained,
        exchanged,
        tuple(search.compared),
        now,
        crowded and enough == len(numbers),
    )


def place_each(
    effects: Effects,
    trials: Trials,
    most: Mapping[Kind, int],
    prices: Mapping[Kind, float],
    passage: float,
) -> Iterator[tuple[int, ...]]:
    """Yield placements of 1, 2, ... obstacles, each the best for its number that is found.

    The next obstacle is the one that gains most for its price; then each is put where it helps most
    beside the others, as in `place`. Ends where none is allowed or helps, or no bad floor is left.

    Args:
        effects: The building, in which the candidates were tried; it is left as it is.
        trials: The candidates, each alone.
        most: Number of obstacles of each kind, at most.
        prices: Price of an obstacle of each kind, above zero.
        passage: Metres to be left between two of them.
    """
    search = _Search(effects, trials, passage, most, prices)
    numbers: list[int] = []
    while search.effects.badness.bad > 0.0 and (best := search.best()) is not None:
        search.put(best)
        numbers.append(best)
        yield tuple(_exchange(effects, trials, numbers, passage)[0])


class _Search:
    """The state of lazy greedy, by gain per price where kinds have prices."""

    def __init__(
        self,
        effects: Effects,
        trials: Trials,
        passage: float,
        most: Mapping[Kind, int] | None = None,
        prices: Mapping[Kind, float] | None = None,
    ) -> None:
        self.effects, self.trials, self.passage = effects.copy(), trials, passage
        self.gains = [gain.cost for gain in trials.gains]
        kinds = [candidate.kind for candidate in trials.candidates]
        self.most = dict(most) if most is not None else dict.fromkeys(kinds, len(kinds))
        # Only their ratios count.
        least = min(prices.values()) if prices else 1.0
        self.prices = np.array([prices[kind] / least if prices else 1.0 for kind in kinds])
        self.left = np.array([self.most[kind] > 0 for kind in kinds], dtype=np.bool_)
        self.stale = np.zeros(len(self.gains), dtype=np.bool_)
        self.compared: list[tuple[float, float]] = []
        self.looked = 0

    def best(self) -> int | None:
        """Return the candidate with the largest gain; None if none gains anything."""
        if not self.left.any():
            return None
        while True:
            costs = np.where(self.left, np.divide(self.gains, self.prices), -np.inf)
            order = np.argsort(-costs, kind="stable")[: int(self.left.sum())]
            outdated = [i for i in order[:REVIEWED].tolist() if self.stale[i]]
            if not outdated:
                break
            for i in outdated:
                gain = self.effects.tried([self.trials.candidates[i].obstacle]).gain.cost
                self.compared.append((self.gains[i], gain))
                self.gains[i], self.stale[i] = gain, False
                self.looked += 1
        best = int(order[0])
        return best if self.gains[best] > 0.0 else None

    def put(self, number: int) -> None:
        """Place a candidate."""
        chosen = self.trials.candidates[number]
        change = self.effects.tried([chosen.obstacle])
        self.effects.put(change)
        self.looked += 1
        self.most[chosen.kind] -= 1
        touched = _changed_poses(self.effects, self.trials, [number], change)
        for i in np.flatnonzero(self.left).tolist():
            other = self.trials.candidates[i]
            self.left[i] = (
                i != number and self.most[other.kind] > 0 and apart(other, chosen, self.passage)
            )
            self.stale[i] |= bool(touched[self.trials.rows[i]].any())


def _exchange(
    effects: Effects, trials: Trials, numbers: list[int], passage: float
) -> tuple[list[int], int, int]:
    """Move each obstacle to where one of its kind helps most beside the others.

    Return also how many moved and how many candidates were tried.
    """
    numbers, moved, tried = list(numbers), 0, 0
    settled: dict[int, list[int]] = {}
    for _ in range(ROUNDS if len(numbers) > 1 else 0):
        before = moved
        for k in range(len(numbers)):
            others = numbers[:k] + numbers[k + 1 :]
            if settled.get(k) == others:
                continue
            settled[k] = others
            now = effects.copy()
            change = now.tried([trials.candidates[i].obstacle for i in others])
            now.put(change)
            touched = _changed_poses(now, trials, others, change)
            allowed = [
                i
                for i in trials.order.tolist()
                if i not in others
                and trials.candidates[i].kind == trials.candidates[numbers[k]].kind
                and all(apart(trials.candidates[i], trials.candidates[j], passage) for j in others)
            ]
            # Its present position comes first, so that it stays there if others are only equal.
            rivals = [numbers[k], *(i for i in allowed[:EXCHANGED] if i != numbers[k])]
            tried += 1
            gains = []
            for i in rivals:
                if touched[trials.rows[i]].any():
                    gains.append(now.tried([trials.candidates[i].obstacle]).gain.cost)
                    tried += 1
                else:
                    gains.append(trials.gains[i].cost)
            best = int(np.argmax(gains))
            if gains[best] > gains[0] + LEAST:
                numbers[k] = rivals[best]
                moved += 1
        if moved == before:
            break
    return numbers, moved, tried


def _changed_poses(
    effects: Effects, trials: Trials, numbers: Sequence[int], change: Change
) -> NDArray[np.bool_]:
    """Return the poses whose map the candidates change, each alone or, by `change`, together."""
    touched = np.zeros(effects.radii.shape[1], dtype=np.bool_)
    for rows in (change.rows, *(trials.rows[i] for i in numbers)):
        touched[rows] = True
    return touched


def _place_in_order(
    effects: Effects, trials: Trials, numbers: Sequence[int]
) -> tuple[tuple[Placed, ...], Effects, int]:
    """Place the obstacles in the order of their gains; return the building and the trial count."""
    now, left, tried = effects.copy(), list(numbers), 0
    placed: list[Placed] = []
    while left:
        changes = {i: now.tried([trials.candidates[i].obstacle]) for i in left}
        tried += len(changes)
        best = max(left, key=lambda i: changes[i].gain.cost)
        now.put(changes[best])
        left.remove(best)
        placed.append(
            Placed(
                best, trials.candidates[best], trials.gains[best], changes[best].gain, now.badness
            )
        )
    return tuple(placed), now, tried
