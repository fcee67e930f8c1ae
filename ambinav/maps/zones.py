"""The four zones of an ambiguity map: their codes, names, meanings and shares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

ZONES: Final = ("localizable", "transition", "corridor", "open")
"""Names of the zones; the position in the tuple is the code in a map's `zone` layer."""

LOCALIZABLE: Final = 0
TRANSITION: Final = 1
CORRIDOR: Final = 2
OPEN: Final = 3
BAD: Final = (CORRIDOR, OPEN)
"""Codes of the zones that leave a robot lost."""
NOT_FREE: Final = 255
"""Code of a cell that no robot can stand in: wall, obstacle, unknown space."""

UNEXPLORED: Final = 0.5
"""Share of the beams in unknown space from which on it is the map that ends, not the building:
the floor is drawn hatched and makes no bad place."""

UNEXPLORED_MEANING: Final = (
    "half of the beams or more end in unknown space: there the map ends, not the building"
)

MEANINGS: Final = (
    "the scan changes whichever way the robot moves: position is well determined",
    "the border between zones: neither clearly determined nor clearly lost",
    "the scan stays the same along one direction: the robot can slide along a wall or corridor "
    "without noticing",
    "the scan stays the same in every direction: nothing useful is in range",
)
"""Meaning of each zone in plain words, in the order of ZONES."""


@dataclass(frozen=True)
class ZoneShare:
    """Share of the floor that lies in a zone.

    Attributes:
        zone: Name of the zone.
        area: Square metres.
        share: Share of all the floor that counts, in [0, 1].
    """

    zone: str
    area: float
    share: float
