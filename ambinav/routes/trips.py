"""Trips between named places, as the user's file lists them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Annotated, Any, Final, TypeAlias

from pydantic import BeforeValidator

from ambinav.config import (
    ConfigModel,
    Number,
    Text,
    checked,
    fault,
    nearest,
    parse_yaml,
    read_text,
    row,
)
from ambinav.runtime.errors import InputError

EXAMPLE: Final = "places: {dock: [1.5, 2.0], shelf: [8.0, 5.5]}"
LONGEST_NAME: Final = 40
"""Characters of a name, so that it can be drawn."""


def _places(value: Any) -> Any:
    """Check that a value has named places."""
    if not isinstance(value, Mapping) or len(value) < 2:
        raise fault(value, f"name two places or more, e.g. `{EXAMPLE}`")
    for name in value:
        if not isinstance(name, str):
            raise fault(
                name, "a name is a text; put it in quotes, for YAML reads yes, on and 1 otherwise"
            )
        if not (name.strip() and name.isprintable() and len(name) <= LONGEST_NAME):
            raise fault(name, f"give a name of 1 to {LONGEST_NAME} printable characters")
    return value


def _trips(value: Any) -> Any:
    """Check that a value is a list of trips."""
    if not isinstance(value, list | tuple) or not value:
        raise fault(value, "give a list of trips, such as `- [dock, shelf]`, or leave the key out")
    return tuple(value)


Position: TypeAlias = Annotated[
    tuple[Number, Number], row(2, "give x and y in metres, e.g. [1.5, 2.0]")
]
Ends: TypeAlias = Annotated[
    tuple[Text, Text], row(2, "give the names of two places, e.g. [dock, shelf]")
]


@dataclass(frozen=True)
class Trip:
    """A trip that robots make.

    Attributes:
        start: Name of the place where it starts.
        goal: Name of the place where it ends.
        start_at: x and y of the start, metres, map frame.
        goal_at: Likewise of the goal.
    """

    start: str
    goal: str
    start_at: tuple[float, float]
    goal_at: tuple[float, float]

    @property
    def title(self) -> str:
        """Both names."""
        return f"{self.start} to {self.goal}"


class PlacesFile(ConfigModel):
    """Named places, and the trips between them.

    Attributes:
        places: x and y of each place, metres, map frame, by name.
        trips: Start and goal of each trip; None: from each place to each other one.
    """

    places: Annotated[dict[str, Position], BeforeValidator(_places)]
    trips: Annotated[tuple[Ends, ...], BeforeValidator(_trips)] | None = None


def read_trips(path: str | Path) -> tuple[Trip, ...]:
    """Read a file of places and trips.

    Raises:
        InputError: it cannot be read, has an unknown key, names fewer than two places, or a trip
            is from or to a place that it does not name, leads nowhere or is listed twice.
    """
    path = Path(path)
    plain = parse_yaml(read_text(path), str(path), f"write a line such as `{EXAMPLE}`")
    listed = checked(PlacesFile, plain, str(path))
    trips = listed.trips or tuple(permutations(listed.places, 2))
    previous = set()
    for number, trip in enumerate(listed.trips or ()):
        where = f"{path}: trips[{number}]"
        for name in trip:
            if name not in listed.places:
                offer = nearest(name, tuple(listed.places))
                raise InputError(f"{where}: {name!r} is not a place; {offer}.")
        if trip[0] == trip[1] or trip in previous:
            problem = "leads nowhere" if trip[0] == trip[1] else "is listed twice"
            raise InputError(f"{where}: {trip[0]} to {trip[1]} {problem}; leave it out.")
        previous.add(trip)
    for start, goal in trips:
        if listed.places[start] == listed.places[goal]:
            raise InputError(
                f"{path}: places: {start} and {goal} are at the same position; move one."
            )
    return tuple(Trip(a, b, listed.places[a], listed.places[b]) for a, b in trips)
