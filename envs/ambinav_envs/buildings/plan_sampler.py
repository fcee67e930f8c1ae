"""Random choices of a building's drawing: from a seed, or the middle of each range."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np

Item = TypeVar("Item")


class PlanSampler:
    """Source of the random choices that distinguish the buildings of a family.

    Everything is made of uniform numbers in [0, 1), whose sequence NumPy keeps from version to
    version.

    Args:
        rng: The source of randomness; None: every number is the middle of its range, everything
            that is more likely than not happens, and of several things the first is taken.
    """

    def __init__(self, rng: np.random.Generator | None) -> None:
        self._rng = rng

    def between(self, low: float, high: float) -> float:
        """Draw a number from [low, high)."""
        share = 0.5 if self._rng is None else float(self._rng.random())
        return low + share * (high - low)

    def count(self, low: int, high: int) -> int:
        """Draw an integer from low to high, both included."""
        return min(int(self.between(low, high + 1)), high)

    def happens(self, chance: float) -> bool:
        """Draw a Boolean that is true with this probability."""
        return self.between(0.0, 1.0) < chance

    def one_of(self, items: Sequence[Item]) -> Item:
        """Draw one of the items."""
        return items[0 if self._rng is None else self.count(0, len(items) - 1)]

    def shuffled(self, items: Sequence[Item]) -> list[Item]:
        """Return the items in random order; in their own order for the plain building."""
        remaining, out = list(items), []
        while remaining:
            out.append(remaining.pop(0 if self._rng is None else self.count(0, len(remaining) - 1)))
        return out
