"""Moves of placed obstacles to better positions between those that were tried at first."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from ambinav.runtime.progress import Progress, silent
from ambinav.studies.design.place.candidates import Candidate, Kind, apart
from ambinav.studies.design.place.gains import Gains
from ambinav.studies.design.place.positions import Positions

FINEST: Final = 0.1
"""Obstacles are moved by no less than this, metres,"""
COARSEST: Final = 1.5
"""and first by this, or by half of the distance between the positions that were tried before."""
AROUND: Final = 1.5
"""They are moved to positions within this many steps,"""
ROUNDS: Final = 4
"""at most this number of times by each step."""
LEAST: Final = 1e-6
"""Least gain of cost for a move or an exchange."""


class Moves:
    """Moves of obstacles, by steps that become finer.

    Args:
        positions: Allowed positions of each kind, and the distance between those that were tried.
        passage: Metres to be left between two obstacles.
    """

    def __init__(self, positions: Mapping[Kind, tuple[Positions, float]], passage: float) -> None:
        self.positions, self.passage = positions, passage
        self._near: dict[tuple[Candidate, float], tuple[Candidate, ...]] = {}

    def improve(
        self, gains: Gains, chosen: Sequence[Candidate], progress: Progress = silent
    ) -> tuple[Candidate, ...]:
        """Return the obstacles where none gains by a move, in the same order.

        Without any bad floor left they stay where they are.
        """
        chosen, steps = list(chosen), tuple(self._steps())
        if not gains.beside(chosen).effects.badness.bad > 0.0:
            steps = ()
        for number, step in enumerate(steps, start=1):
            for _ in range(ROUNDS):
                before = list(chosen)
                for k, candidate in enumerate(before):
                    chosen[k] = self._best(gains, candidate, chosen[:k] + chosen[k + 1 :], step)
                if chosen == before:
                    break
            progress(number / len(steps))
        return tuple(chosen)

    def _steps(self) -> Iterator[float]:
        """Yield steps from half of the distance between the positions that were tried at first."""
        step = max(COARSEST, *(distance / 2.0 for _, distance in self.positions.values()))
        while step >= FINEST:
            yield step
            step /= 2.0

    def _best(
        self, gains: Gains, candidate: Candidate, others: Sequence[Candidate], step: float
    ) -> Candidate:
        """Return the best position around an obstacle; its own unless another gains."""
        key = candidate, step
        if key not in self._near:
            allowed, _ = self.positions[candidate.kind]
            self._near[key] = allowed.near(candidate, AROUND * step, step)
        beside = gains.beside(others)
        rivals = [
            rival
            for rival in self._near[key]
            if all(apart(rival, other, self.passage) for other in others)
        ]
        return best_of(candidate, rivals, beside.gain)


def best_of(
    candidate: Candidate, rivals: Sequence[Candidate], gain: Callable[[Candidate], float]
) -> Candidate:
    """Return the rival that gains most; the candidate itself unless one gains more."""
    every = [candidate, *rivals]
    values = [gain(each) for each in every]
    best = int(np.argmax(values))
    return every[best] if values[best] > values[0] + LEAST else candidate
