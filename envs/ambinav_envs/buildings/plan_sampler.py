"""Choices of a building's drawing: drawn from a seed, or the middle of each for the plain one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

Item = TypeVar("Item")


class PlanSampler:
    """What varies from one building of a family to the next.

    Everything is made of uniform numbers in [0, 1), whose sequence NumPy keeps from version to
    version.

    Args:
        rng: The source of randomness; None: every number is the middle of its range, everything
            that is more likely than not happens, and of several things the first is taken.
    """

    def __init__(self, rng: np.random.Generator | None) -> None:
        self._rng = rng

    def between(self, low: float, high: float) -> float:
        """A number of [low, high)."""
        share = 0.5 if self._rng is None else float(self._rng.random())
        return low + share * (high - low)

    def count(self, low: int, high: int) -> int:
        """A whole number from low to high, both included."""
        return min(int(self.between(low, high + 1)), high)

    def happens(self, chance: float) -> bool:
        """Whether something with this probability happens."""
        return self.between(0.0, 1.0) < chance

    def one_of(self, items: Sequence[Item]) -> Item:
        """One of some things."""
        return items[0 if self._rng is None else self.count(0, len(items) - 1)]

    def shuffled(self, items: Sequence[Item]) -> list[Item]:
        """The things in any order; as they are for the plain building."""
        rest, out = list(items), []
        while rest:
            out.append(rest.pop(0 if self._rng is None else self.count(0, len(rest) - 1)))
        return out
