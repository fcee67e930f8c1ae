"""The acceptance criterion of a route or method against the baseline, fixed before results."""

from __future__ import annotations

from dataclasses import dataclass

from ambinav.reports.conditions import Limit


@dataclass(frozen=True)
class AcceptanceCriterion:
    """Conditions that must all be met.

    Attributes:
        lost: Share of the baseline's lost rate that may be left.
        error: Share of its error that may be left.
        extra: Share of its length that a route may be longer.
        easy: Metres: below this error, with none lost or collided, there is nothing to gain.
        walls: Share of runs that walls may end; figures of what is left say little.
    """

    lost: float = 1.0 / 3.0
    error: float = 0.5
    extra: float = 0.1
    easy: float = 0.15
    walls: float = 0.5

    def lost_met(self, ours: float, baseline: float) -> bool:
        """Return whether few enough are lost; none may be if the baseline loses none."""
        return Limit("<=", self.lost * baseline).holds(ours)

    def error_met(self, ours: float, baseline: float) -> bool:
        """Return whether the error is small enough."""
        return Limit("<=", self.error * baseline).holds(ours)

    def walls_met(self, ours: float) -> bool:
        """Return whether enough runs are not ended by walls."""
        return Limit("<=", self.walls).holds(ours)

    def length_met(self, ratio: float) -> bool:
        """Return whether the route is short enough, given its length over the baseline's."""
        return Limit("<=", 1.0 + self.extra).holds(ratio)
