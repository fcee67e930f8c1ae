"""The four zones of an ambiguity map: their codes, names, colours and meanings.

Blue, orange, red and white are the scheme of Ruiz-Mayor, Crespo and Trivino (2017). The shades
are chosen so that they stay apart for every common kind of colour blindness, and in grey print:
the lightness falls from white over orange and blue to red.
"""

from __future__ import annotations

from typing import Final

ZONES: Final = ("localizable", "transition", "corridor", "open")
"""Names of the zones; the position in the tuple is the code in a map's `zone` layer."""

LOCALIZABLE: Final = 0
TRANSITION: Final = 1
CORRIDOR: Final = 2
OPEN: Final = 3
NOT_FREE: Final = 255
"""Code of a cell that no robot can stand in: wall, obstacle, unknown space."""

COLOURS: Final = ("#5B9FCC", "#FFFFFF", "#FDB92E", "#B5172B")
"""Fill of each zone, in the order of ZONES."""

UNEXPLORED: Final = 0.5
"""Where this share of the beams ends in unknown space, it is the map that ends, not the building:
the floor is drawn hatched and makes no bad place."""

SOLID_COLOUR: Final = "#858585"
"""Fill of what is not free and known to be solid: walls, obstacles, the inside of blocks."""
UNREACHABLE_COLOUR: Final = "#B2B2B2"
"""Fill of free floor that a robot cannot reach."""
UNKNOWN_COLOUR: Final = "#E1E1E1"
"""Fill of what is not known. The three greys differ by steps of 18 % in lightness."""
UNEXPLORED_COLOUR: Final = "#A88FC4"
"""Stripes, on `UNKNOWN_COLOUR`, of free floor that is not explored: a pattern, for whoever tells
no colours apart."""
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
"""What each zone tells, in plain words, in the order of ZONES."""
