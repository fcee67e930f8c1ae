"""Gains of obstacles beside others, each computed once."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cached_property

import shapely

from ambinav.studies.design.place.candidates import Candidate
from ambinav.studies.design.place.effect import Effects


class Gains:
    """Gains of obstacles in a building, as `Badness.cost`.

    What an obstacle gains depends on those near it alone. So a gain is computed once for each set
    of near ones, whatever stands elsewhere.

    Args:
        effects: The building without obstacles; it is left as it is.
    """

    def __init__(self, effects: Effects) -> None:
        self.effects = effects
        self.looked = 0
        self.by_pair: dict[tuple[Candidate, frozenset[Candidate]], float] = {}

    def beside(self, chosen: Iterable[Candidate]) -> Beside:
        """Return the gains beside some obstacles."""
        return Beside(self, tuple(chosen))


class Beside:
    """Gains of obstacles beside others, see `Gains`."""

    def __init__(self, gains: Gains, chosen: tuple[Candidate, ...]) -> None:
        self._gains, self._chosen = gains, chosen

    @cached_property
    def effects(self) -> Effects:
        """The building with the others."""
        effects = self._gains.effects
        if self._chosen:
            effects = effects.copy()
            effects.put(effects.tried([other.obstacle for other in self._chosen]))
            self._gains.looked += 1
        return effects

    def near(self, candidate: Candidate) -> frozenset[Candidate]:
        """Return those of the others that change the map of the same poses as an obstacle."""
        away = 2.0 * self._gains.effects.reach
        outline = candidate.obstacle.outline
        return frozenset(
            other
            for other in self._chosen
            if shapely.dwithin(outline, other.obstacle.outline, away)
        )

    def gain(self, candidate: Candidate) -> float:
        """Return what an obstacle gains beside the others."""
        key = candidate, self.near(candidate)
        cached = self._gains.by_pair
        if key not in cached:
            cached[key] = self.effects.tried([candidate.obstacle]).gain.cost
            self._gains.looked += 1
        return cached[key]
