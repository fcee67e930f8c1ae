"""Search of places for reflectors so that a robot can navigate by them on most floor.

One reflector alone is of no use: a room needs several. So greedy search adds, from several seeds,
as many as complete the floor that the seed is seen from, and keeps those that complete most floor
for each reflector. Then each is taken away once and put where it helps most, and so are pairs that
the same floor sees. The best of a few first additions is kept. Aliasing and precision take
longer to judge, and seldom decide: where they do, reflectors are exchanged once more, by all
criteria.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.layers.reflectors.positioning import Positioning, Site
from ambinav.layers.reflectors.targets import Targets
from ambinav.runtime.array_types import Bools, Floats, Ints, Ints32
from ambinav.runtime.kernels import kernel
from ambinav.runtime.progress import Progress, silent
from ambinav.runtime.threads import run_rows
from ambinav.studies.design.place.candidates import Candidate

Singles = NDArray[np.float32]

ROUNDS: Final = 4
"""Rounds of exchanges, at most."""
STARTS: Final = 8
"""First additions that are tried."""
SEEDS: Final = 24
"""Seeds of groups that are tried for each addition."""
PAIRS: Final = 40
"""Pairs that are exchanged, at most,"""
FIRST: Final = 12
"""and candidates for the first of each pair."""
EXCHANGED: Final = 24
"""Reflectors that are exchanged by all criteria, at most,"""
JUDGED: Final = 8
"""and candidates that are judged instead of each."""
WORTH: Final = attrgetter("worth")
"""Value of a state."""
PARTIAL: Final = 0.25
"""Worth of floor from which all reflectors needed are in view, beside 1 for good floor."""
IN_THE_END: Final = 0.01
"""The same once all reflectors are placed."""
LEAST: Final = 1e-6
"""Least gain, square metres."""


@dataclass(frozen=True, eq=False)
class State:
    """Chosen candidates and what they achieve.

    Attributes:
        chosen: Their numbers.
        positioning: Navigation by them and the reflectors that the building has.
        worth: What is maximized, square metres.
    """

    chosen: tuple[int, ...]
    positioning: Positioning
    worth: float


class Search:
    """Search among candidates.

    Attributes:
        views: Whether each candidate is in view, shape (C, P, H).
        crowded: Whether two candidates are too near to each other, shape (C, C).

    Args:
        site: The building and its poses.
        counted: Which points count, shape (P,).
        present: Reflectors that the building has.
        candidates: C candidates.
        separation: Metres between two of them, at least.
    """

    def __init__(
        self,
        site: Site,
        counted: Bools,
        present: Targets,
        candidates: Sequence[Candidate],
        separation: float,
    ) -> None:
        self.site, self.counted, self.candidates = site, counted, tuple(candidates)
        outlines = np.array([candidate.obstacle.outline for candidate in candidates])
        pairs = shapely.STRtree(outlines).query(outlines, "dwithin", separation)
        self.crowded = np.zeros((len(outlines), len(outlines)), dtype=np.bool_)
        self.crowded[pairs[0], pairs[1]] = True
        new = Targets.of_outlines(outlines)
        self._present, self._targets = len(present), present.and_of(new)
        self._seen = site.views(present)
        # One candidate after the other, each with all of its views side by side.
        self.views = np.ascontiguousarray(site.views(new).transpose(2, 0, 1))
        # Where the robot cannot stand at a heading it needs none.
        self._stands = np.ascontiguousarray(site.possible)

    def state(self, chosen: Sequence[int]) -> State:
        """Judge some candidates by all criteria."""
        which = np.array([*range(self._present), *(self._present + i for i in chosen)])
        seen = np.concatenate([self._seen, self.views[list(chosen)].transpose(1, 2, 0)], axis=2)
        positioning = self.site.positioning(self._targets.among(which.astype(np.int64)), seen)
        completed = _completed(positioning.count, positioning.rules.needed)[self.counted]
        good = positioning.good[self.counted]
        value = float(good.sum() + IN_THE_END * completed.mean(axis=1).sum())
        return State(tuple(chosen), positioning, value * self.site.lattice.cell_area)

    def place(self, count: int, progress: Progress = silent) -> tuple[int, ...]:
        """Place at most `count` reflectors; return their numbers, those that help most first.

        Fewer are placed if all floor that counts is good, or no candidate helps.
        """
        starts = self._additions((), count)[:STARTS]
        none, placed = self._count(()), [tuple[int, ...]()]
        for number, start in enumerate(starts, start=1):
            chosen = self._exchanged(self._completed_greedily(start, count), PARTIAL)
            placed.append(self._exchanged(chosen, IN_THE_END))
            progress(0.6 * number / len(starts))
        most = max(placed, key=lambda chosen: self._completes(none, chosen, IN_THE_END))
        # The best by number in view, and the best by all criteria so far.
        ends = [self.state(self._exchanged_pairs(most)), max(map(self.state, placed), key=WORTH)]
        state = max(map(self._exchanged_by_all, ends), key=WORTH)
        progress(0.9)
        while len(state.chosen) < count and not state.positioning.good[self.counted].all():
            rivals = self._best_candidates(state.chosen, state.positioning)
            better = self._best(state.chosen, rivals)
            if better is None or better.worth <= state.worth + LEAST:
                break
            state = better
        return self._order(state.chosen)

    def _completed_greedily(self, chosen: tuple[int, ...], count: int) -> tuple[int, ...]:
        """Add the best additions to a choice until there are so many, or none gains."""
        while len(chosen) < count and (more := self._additions(chosen, count - len(chosen))):
            chosen += more[0]
        return chosen

    def _count(self, chosen: Sequence[int]) -> Ints32:
        """Count the reflectors in view, shape (P, H)."""
        new = self.views[list(chosen)].sum(axis=0, dtype=np.int32)
        return np.asarray(self._seen.sum(axis=2, dtype=np.int32) + new)

    def _allowed(self, chosen: Sequence[int]) -> Ints:
        """Return the candidates that are apart from the chosen ones."""
        return np.flatnonzero(~self.crowded[:, list(chosen)].any(axis=1))

    def _short(self, count: Ints32) -> Ints:
        """Return the places that count and see too few reflectors."""
        few = (count < self.site.rules.needed) & self._stands
        return np.flatnonzero(self.counted & few.any(axis=1))

    def _gains(
        self, count: Ints32, allowed: Ints, partial: float = PARTIAL, where: Ints | None = None
    ) -> Floats:
        """Return what one more candidate gains by the number in view, points.

        Args:
            count: Reflectors in view, shape (P, H).
            allowed: The candidates, shape (A,).
            partial: Worth of floor that sees enough at all headings but some, beside 1.
            where: Places that count; None: those that see too few.

        Returns:
            Shape (A,).
        """
        gains = np.empty(len(allowed))
        short = self._short(count) if where is None else where
        value = _completed(np.arange(self.site.rules.needed + 1), self.site.rules.needed)
        run_rows(
            _gain, len(allowed), self.views, allowed, short, count, self._stands,
            partial / count.shape[1] * value, gains, least=4,
        )  # fmt: skip
        return gains

    def _additions(self, chosen: tuple[int, ...], most: int) -> list[tuple[int, ...]]:
        """Return additions of one or several, those first that gain most for each reflector.

        One for each seed, besides the best single one; none if nothing gains.
        """
        allowed, count = self._allowed(chosen), self._count(chosen)
        gains = self._gains(count, allowed)
        if not len(gains) or not gains.max() > LEAST:
            return []

        def share(group: tuple[int, ...]) -> float:
            return self._completes(count, group) / len(group)

        additions: list[tuple[int, ...]] = [(int(allowed[np.argmax(gains)]),)]
        most = min(most, self.site.rules.needed)
        for seed in self._seeds(allowed, count) if most > 1 else ():
            additions += sorted(self._groups(seed, chosen, count, most), key=share)[-1:]
        return sorted(additions, key=share, reverse=True)

    def _seeds(self, allowed: Ints, count: Ints32) -> list[int]:
        """Return candidates that are seen from much floor that sees too few, each from other."""
        short = self._short(count)
        views: Singles = np.asarray(self.views[allowed][:, short].any(axis=2), dtype=np.float32)
        left: Singles = np.ones(len(short), dtype=np.float32)
        seeds = []
        for _ in range(min(SEEDS, len(allowed))):
            best = int(np.argmax(views @ left))
            seeds.append(int(allowed[best]))
            left = left * (1.0 - 0.5 * views[best])
        return seeds

    def _groups(
        self, seed: int, chosen: tuple[int, ...], count: Ints32, most: int
    ) -> Iterator[tuple[int, ...]]:
        """Yield the seed with one more, two more and so on, for the floor that it is seen from."""
        group: tuple[int, ...] = (seed,)
        where = self._short(count)
        where = where[self.views[seed, where].any(axis=1)]
        while len(group) < most:
            allowed = self._allowed((*chosen, *group))
            if not len(allowed):
                return
            now = count + self.views[list(group)].sum(axis=0, dtype=np.int32)
            # Here to see more of them is what counts.
            gains = self._gains(now, allowed, 1.0, where)
            group = *group, int(allowed[np.argmax(gains)])
            yield group

    def _completes(self, count: Ints32, group: tuple[int, ...], partial: float = PARTIAL) -> float:
        """Return how many more places see enough with a group, and a little for all it gains."""
        needed = self.site.rules.needed
        after = count + self.views[list(group)].sum(axis=0, dtype=np.int32)
        done = len(self._short(count)) - len(self._short(after))
        nearer = (_completed(after, needed) - _completed(count, needed))[self.counted]
        return done + partial * float(nearer.mean(axis=1).sum())

    def _exchanged(self, chosen: tuple[int, ...], partial: float) -> tuple[int, ...]:
        """Return a choice of which none gains by an exchange, by the number in view."""
        for _ in range(ROUNDS):
            before = chosen
            for k in before:
                others = tuple(i for i in chosen if i != k)
                allowed = self._allowed(others)
                gains = self._gains(self._count(others), allowed, partial)
                best = int(np.argmax(gains))
                if gains[best] > gains[allowed == k][0] + LEAST:
                    chosen = *others, int(allowed[best])
            if chosen == before:
                break
        return chosen

    def _exchanged_pairs(self, chosen: tuple[int, ...]) -> tuple[int, ...]:
        """Return a choice of which no pair that the same floor sees gains by an exchange.

        Among the first pairs: those that most floor sees.
        """
        which = list(chosen)
        views: Singles = np.asarray(self.views[which][:, self.counted].any(axis=2), np.float32)
        common = {
            (a, b): float(np.dot(views[k], views[m]))
            for (k, a), (m, b) in itertools.combinations(enumerate(which), 2)
        }
        pairs = sorted(filter(common.get, common), key=lambda pair: -common[pair])[:PAIRS]
        for pair in pairs:
            if not set(pair) <= set(chosen):
                continue
            others = tuple(i for i in chosen if i not in pair)
            best = max(self._pairs_beside(others), key=lambda each: each[1], default=None)
            now = self._completes(self._count(others), pair, IN_THE_END)
            if best is not None and best[1] > now + LEAST:
                chosen = self._exchanged((*others, *best[0]), IN_THE_END)
        return chosen

    def _pairs_beside(self, others: tuple[int, ...]) -> Iterator[tuple[tuple[int, int], float]]:
        """Yield pairs of candidates, the second the best beside the first, and their gains."""
        count, allowed = self._count(others), self._allowed(others)
        gains = self._gains(count, allowed, 1.0)
        for i in np.argsort(-gains, kind="stable")[:FIRST].tolist():
            first = int(allowed[i])
            second = self._allowed((*others, first))
            if len(second):
                after = self._gains(count + self.views[first], second, IN_THE_END)
                pair = first, int(second[np.argmax(after)])
                yield pair, self._completes(count, pair, IN_THE_END)

    def _exchanged_by_all(self, state: State) -> State:
        """Exchange reflectors by all criteria where enough are in view, but that is no use."""
        number = unchanged = 0
        while number < EXCHANGED and unchanged < len(state.chosen):
            positioning, chosen = state.positioning, list(state.chosen)
            vain = self.counted & positioning.enough & ~positioning.good
            if not vain.any():
                break
            # Those that most of this floor sees, one after the other.
            seen = self.views[chosen][:, vain].sum(axis=(1, 2))
            k = chosen[int(np.argsort(-seen, kind="stable")[unchanged])]
            others = tuple(i for i in chosen if i != k)
            best = self._best(others, self._best_candidates(others, positioning))
            number, unchanged = number + 1, unchanged + 1
            if best is not None and best.worth > state.worth + LEAST:
                state, unchanged = best, 0
        return state

    def _best_candidates(self, chosen: tuple[int, ...], positioning: Positioning) -> list[int]:
        """Return candidates that gain most by the number in view, or are seen from vain floor."""
        allowed = self._allowed(chosen)
        if not len(allowed):
            return []
        gains = self._gains(self._count(chosen), allowed)
        vain = self.counted & positioning.enough & ~positioning.good
        seen = self.views[np.ix_(allowed, np.flatnonzero(vain))].mean(axis=2).sum(axis=1)
        order = np.argsort(-(gains + seen), kind="stable")[:JUDGED]
        return [int(i) for i in allowed[order]]

    def _best(self, chosen: tuple[int, ...], rivals: Sequence[int]) -> State | None:
        """Return the best state with one of the rivals by all criteria; None without any."""
        states = [self.state((*chosen, i)) for i in rivals]
        return max(states, key=WORTH, default=None)

    def _order(self, chosen: tuple[int, ...]) -> tuple[int, ...]:
        """Return a choice in the order in which each gains most after those before it."""
        done: tuple[int, ...] = ()
        left = list(chosen)
        while left:
            gains = self._gains(self._count(done), np.array(left))
            done = *done, left.pop(int(np.argmax(gains)))
        return done


def _completed(count: NDArray[np.integer], needed: int) -> Floats:
    """Return the worth of floor with so many reflectors in view, 1 if there are enough.

    A square: to complete a room is worth more than to begin another.
    """
    return np.asarray(np.minimum(count / needed, 1.0) ** 2)


@kernel
def _gain(low, high, views, allowed, short, count, stands, partial, gains):
    """Write the gain of each candidate: places that it completes, and its partial worth.

    Args:
        low: First candidate.
        high: One past the last.
        views: Whether each candidate is in view, shape (C, P, H).
        allowed: The candidates in question, shape (A,).
        short: Places that see too few, shape (S,).
        count: Reflectors in view, shape (P, H).
        stands: Whether the robot can stand there, shape (P, H).
        partial: Worth of a pose with 0, 1, ... reflectors in view, up to those needed.
        gains: Written, shape (A,).
    """
    needed = partial.size - 1
    for a in range(low, high):
        total = 0.0
        for p in short:
            complete = True
            for h in range(count.shape[1]):
                seen = min(count[p, h], needed)
                after = min(seen + views[allowed[a], p, h], needed)
                total += partial[after] - partial[seen]
                complete &= after == needed or not stands[p, h]
            total += complete
        gains[a] = total
