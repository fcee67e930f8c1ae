"""The table of colours and line styles: a colour means the same in all pictures.

Blue, orange, red and a light tint are the scheme of Ruiz-Mayor, Crespo and Trivino (2017) for the
zones; the paper's white is tinted, so that it differs from paper. The shades stay apart for every
common kind of colour blindness and, zones and greys, in grey print; tests/plotting/test_style.py
says by how much. No drawing library is imported here, so that any can read the table.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from ambinav.runtime.errors import InputError

FORMATS: Final = ("png", "svg")
"""In which the pictures of a report can be."""


def check_format(image_format: str) -> None:
    """Check the format of pictures, or raise `InputError`."""
    if image_format not in FORMATS:
        raise InputError(f"image_format is {image_format!r}; choose from {', '.join(FORMATS)}.")


ZONE_COLOURS: Final = ("#5B9FCC", "#F7EBB5", "#FDB92E", "#B5172B")
"""Fill of each zone, in the order of `ambinav.maps.zones.ZONES`."""

SOLID: Final = "#858585"
"""Colour of solid cells: walls, obstacles, the inside of blocks."""
UNREACHABLE: Final = "#B2B2B2"
"""Free floor that a robot cannot reach."""
UNKNOWN: Final = "#E1E1E1"
"""Colour of unknown cells. The three greys differ by steps of 18 % in lightness."""
UNKNOWN_BEHIND_ANGLES: Final = "#A6A6A6"
"""The same where angles are drawn: the only cyclic scale that is perceptually uniform passes
through a near white."""
UNEXPLORED: Final = "#A88FC4"
"""Stripes, on `UNKNOWN`, of free floor that is not explored: a pattern, for whoever tells no
colours apart."""
FLOOR: Final = "#FFFFFF"
"""Free floor of which the picture says nothing else."""
WALL: Final = "#1A1A1A"
FRONTIER: Final = "#7A7A7A"
"""Edge of the map to unknown space."""
GLASS: Final = "#3D8BFF"
"""Walls of glass."""
REFLECTOR: Final = "#00E5FF"
"""Core of the dark stroke of a reflector."""
EDGE: Final = "#555555"
"""Line around the colours of a legend."""

FROM_START: Final = "#5B3A8E"
FROM_GOAL: Final = "#8FD694"
"""Floor that can be reached from the start, and from the goal; none is a colour of the zones."""

NAVIGATION: Final = ("#D3F5C9", "#E9B44C", "#9463A8", "#2F4B7C")
"""Floor where a robot navigates by reflectors, and why it cannot elsewhere: the position is not
precise, another pose is aliased, too few reflectors are in view. Each is darker than the last.
"""

ECHO: Final = "#2C7FB8"
SILENT: Final = "#D95F0E"
"""Beams that return, and beams without echo."""
SLIDE: Final = "#7B1FA2"
"""Direction in which a robot slides unseen."""

CHANGE: Final = "RdBu_r"
"""Matplotlib's name of the scale of a change: blue is better, red worse, white the same; told apart
by the colour-blind (ColorBrewer)."""
NEW: Final = "#009E73"
GONE: Final = "#9A4C95"
"""Walls that only the later or only the earlier of two maps has; gone ones are dashed too."""
NEW_FLOOR: Final = "#B9E4C9"
GONE_FLOOR: Final = "#DCC3E3"
"""Floor of the same."""

ROBOT: Final = "#111111"
ESTIMATE: Final = "#6A1B9A"
"""A robot and its trail; where it believes it is."""
GOAL_RING: Final = "#00664A"
PERSON: Final = "#F0E442"
BOX: Final = "#5D3A1A"
"""Colour of obstacles in the building that the map lacks."""

START: Final = "S"
GOAL: Final = "G"
"""Letters that mark where routes begin and end."""
SIGMAS: Final = 2.0
"""Radius of ellipses in standard deviations: 86 % of a plane normal distribution."""

# Okabe and Ito's colours, distinguished by the colour-blind too.
BLUE: Final = "#0072B2"
VERMILLION: Final = "#D55E00"
GREEN: Final = "#009E73"
PURPLE: Final = "#CC79A7"
ORANGE: Final = "#E69F00"
SKY: Final = "#56B4E9"
SERIES: Final = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)
"""Whatever has no meaning of its own: letters of aliased regions, scanners, layers."""
MARKS: Final = ("o", "s", "^", "D", "v", "P")
"""Marks that go with them."""


class Mark(NamedTuple):
    """Style of a point in a chart."""

    colour: str
    mark: str
    filled: bool = True


BASELINE: Final = Mark("#000000", "D")
"""Mark of the baseline."""
EFFECTS: Final = {
    "met": Mark(BLUE, "o"),
    "better": Mark(BLUE, "o", filled=False),
    "none": Mark("#777777", "s", filled=False),
    "mixed": Mark(PURPLE, "P", filled=False),
    "worse": Mark(VERMILLION, "X"),
}
"""Marks of the effects against the baseline."""
OUTCOMES: Final = {
    "arrived": Mark(GREEN, "o"),
    "missed": Mark(ORANGE, "P"),
    "collided": Mark(VERMILLION, "X"),
    "timeout": Mark("#999999", "s"),
    "lost": Mark("#000000", "D"),
}
"""Marks of the outcomes of episodes, and of robots that were lost at any time."""


class RouteStyle(NamedTuple):
    """Style of a route: a line of a colour and a pattern, with a rim of contrasting lightness.

    Attributes:
        colour: Colour of the line.
        casing: Colour of its rim, which keeps the line visible on all four colours of the zones.
        dashes: Lengths of dashes and gaps in line widths; empty: a full line.
    """

    colour: str
    casing: str
    dashes: tuple[float, ...]


ROUTE_COLOURS: Final = {
    "shortest": ("#000000",),
    "ambiguity": ("#3DF2B0", "#004D38"),
    "reference": ("#5B1A9A",),
    "belief": ("#FFF36B",),
    "belief-roadmap": ("#FF8AD8",),
    "clearance": ("#6B3500",),
    "policy": ("#FFFFFF",),
    "file": ("#B0E2FF",),
}
"""Colour of each kind of route (see `ambinav.plotting.routes.route_kind`); the second one is for
every second route of the kind."""
DARK: Final = frozenset({"#000000", "#004D38", "#5B1A9A", "#6B3500"})
"""Those that are cased in white; all others in black."""
DASHES: Final = ((), (4.0, 1.6), (1.4, 1.4), (5.0, 1.3, 1.3, 1.3))
"""Patterns, for the first routes of a kind and those that follow."""
FIRST_DASHES: Final = {"policy": 1, "file": 2}
"""Kinds whose routes begin with another pattern: they come from elsewhere."""


def route_style(kind: str, number: int = 0) -> RouteStyle:
    """Return the style of a route.

    Args:
        kind: A key of `ROUTE_COLOURS`.
        number: Number of earlier routes of this kind in the picture.
    """
    colours = ROUTE_COLOURS[kind]
    colour = colours[number % len(colours)]
    pattern = FIRST_DASHES.get(kind, 0) + number // len(colours)
    casing = "#FFFFFF" if colour in DARK else "#000000"
    return RouteStyle(colour, casing, DASHES[pattern % len(DASHES)])


def round_length(width: float) -> float:
    """Return 1, 2 or 5 times a power of ten, at most a quarter of `width` (both metres)."""
    target = width / 4.0
    power = 10.0 ** math.floor(math.log10(target))
    return max(m for m in (1.0, 2.0, 5.0) if m * power <= target * (1 + 1e-9)) * power
