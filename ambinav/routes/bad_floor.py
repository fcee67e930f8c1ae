"""Metres in the two zones where robots get lost, and the longest stretch of each, as text.

The two are kept apart because they are not equally dangerous. In corridor a scan leaves one
direction free, and what is beside the robot or at the corridor's end fixes it again; in an open
zone it says nothing, and the error grows in every direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

from ambinav.routes.route import Route

IN_BRACKETS = "in brackets: the longest stretch"
"""Explanation of `stretch_text` for readers."""
NOTABLE = 0.05
"""Metres on unexplored floor that are worth a word."""


@dataclass(frozen=True)
class BadFloor:
    """Metres of one or several routes on bad floor; see `Route` for the figures.

    Attributes:
        corridor: In corridor.
        longest_corridor: The longest stretch in it.
        open: In open zones.
        longest_open: The longest stretch in them.
        unexplored: Where the map is unexplored or outside, so no zone is known.
    """

    corridor: float
    longest_corridor: float
    open: float
    longest_open: float
    unexplored: float = 0.0

    @classmethod
    def of(cls, route: Route) -> BadFloor:
        """Compute the bad floor of a route."""
        return cls(
            route.corridor_metres,
            route.longest_corridor,
            route.open_metres,
            route.longest_open,
            route.unexplored_metres,
        )

    @classmethod
    def joined(cls, parts: Sequence[BadFloor]) -> BadFloor:
        """Combine several routes: sums of metres, and the longest of all their stretches."""
        return cls(
            sum(part.corridor for part in parts),
            max((part.longest_corridor for part in parts), default=0.0),
            sum(part.open for part in parts),
            max((part.longest_open for part in parts), default=0.0),
            sum(part.unexplored for part in parts),
        )

    @property
    def figures(self) -> dict[str, float]:
        """Figures by their names in files, metres."""
        return {f"{field.name}_m": getattr(self, field.name) for field in fields(self)}

    def corridor_text(self) -> str:
        """Return metres in corridor, and in brackets the longest stretch."""
        return stretch_text(self.corridor, self.longest_corridor)

    def open_text(self) -> str:
        """Return metres in open zones, and in brackets the longest stretch."""
        return stretch_text(self.open, self.longest_open)


def stretch_text(metres: float, longest: float) -> str:
    """Format metres in a zone and the longest stretch of them: "12.3 (8.1)"."""
    return f"{metres:.1f} ({longest:.1f})"


def unexplored_note(floor: BadFloor, who: str = "") -> str:
    """Describe how much of a route lies on unexplored floor; empty below 5 cm.

    Args:
        floor: Bad floor of the route.
        who: Name of the route; empty: the sentence leaves it out.
    """
    if floor.unexplored < NOTABLE:
        return ""
    of = f"{who}: " if who else ""
    return f"{of}{floor.unexplored:.1f} m on unexplored floor, not counted"
