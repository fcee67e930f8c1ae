"""A requirement: a condition on judged floor, or on lost robots, that changes must meet."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Protocol, TypeAlias

from ambinav.maps.zones import BAD, CORRIDOR, LOCALIZABLE, OPEN
from ambinav.reports.conditions import Condition, Quantities, Quantity, parse_condition
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.studies.audit.figures import QUANTITIES

Areas: TypeAlias = Sequence[float] | Floats
"""Square metres in each zone, in the order of `ZONES`."""
OPTION: Final = "requirement"
_ZONES: Final = {
    "bad": BAD, "corridor": (CORRIDOR,), "open": (OPEN,), "localizable": (LOCALIZABLE,),
}  # fmt: skip


class Changed(Protocol):
    """A changed building, as far as requirements ask for it."""

    @property
    def areas(self) -> Floats:
        """Judged floor in each zone, square metres, shape (zones,)."""

    @property
    def lost(self) -> Floats | None:
        """Share of robots that get lost on each trip, shape (T,); None: there are no trips."""


def _read(codes: Sequence[int], unit: str) -> Callable[[Changed], float]:
    def read(changed: Changed) -> float:
        areas = changed.areas
        area, total = float(sum(areas[code] for code in codes)), float(sum(areas))
        # Without any floor nothing is met.
        return math.nan if total == 0.0 else 100.0 * area / total if unit == "%" else area

    return read


def _lost(changed: Changed) -> float:
    return math.nan if changed.lost is None else 100.0 * float(changed.lost.max())


LOST: Final = "lost"
LEAST_LOST: Final = 0.5
"""Least limit on lost robots, %: with none lost of 1024 drives the interval ends at 0.49 %."""
FIGURES: Final[Quantities] = {
    name: replace(
        QUANTITIES[name],
        read=_read(_ZONES[name.removesuffix(" area")], QUANTITIES[name].unit),
        where=lambda changed: "",
    )
    for zone in _ZONES
    for name in (zone, f"{zone} area")
} | {LOST: Quantity(LOST, "%", "share of robots that get lost on the worst trip", _lost)}
"""Figures of requirements: those of an audit that the areas of zones decide, and lost robots."""


@dataclass(frozen=True)
class Requirement:
    """A requirement on the zones of the judged floor, or on lost robots.

    Attributes:
        condition: Condition that must hold; its quantity reads a changed building.
    """

    condition: Condition

    @classmethod
    def parse(cls, text: str) -> Requirement:
        """Read a requirement such as "bad < 2 %" or "lost < 5 %".

        Raises:
            InputError: it cannot be read, is about another figure, holds always or never, or asks
                for bad floor, for less localizable floor or for more lost robots.
        """
        listed = f"a requirement is about {', '.join(FIGURES)}"
        condition = parse_condition(text, FIGURES, OPTION, listed)
        good = condition.quantity.name.startswith("localizable")
        operator = condition.limit.operator
        if good != operator.startswith(">"):
            turned = operator.translate(str.maketrans("<>", "><"))
            limit = replace(condition.limit, operator=turned)
            lost = condition.quantity.name == LOST
            amount = "lost robots" if lost else f"{'localizable' if good else 'bad'} floor"
            raise InputError(
                f'{OPTION}: "{condition}" asks for {"less" if good else "more"} {amount}; a '
                f'requirement says what must hold, e.g. "{replace(condition, limit=limit)}".'
            )
        if condition.quantity.name == LOST and not LEAST_LOST <= condition.limit.number < 100.0:
            raise InputError(
                f'{OPTION}: "{condition}": drives can confirm a limit from {LEAST_LOST:g} % to '
                f'below 100 %; write e.g. "{LOST} < 5 %".'
            )
        return cls(condition)

    def __str__(self) -> str:
        """Return the requirement as it is written."""
        return str(self.condition)

    @property
    def most_lost(self) -> float | None:
        """Share of robots that may get lost; None: the requirement is about floor."""
        is_lost = self.condition.quantity.name == LOST
        return self.condition.limit.number / 100.0 if is_lost else None

    def value(self, changed: Changed) -> float:
        """Return the figure of a changed building in its unit."""
        value = self.condition.quantity.read(changed)
        assert value is not None
        return value

    def holds(self, changed: Changed) -> bool:
        """Return whether it holds for a changed building; lost robots by their forecast."""
        return self.condition.limit.holds(self.value(changed))

    def distance(self, changed: Changed) -> float:
        """Return a figure that is the less the nearer a building comes to the requirement."""
        value = self.value(changed)
        return value if self.condition.limit.operator.startswith("<") else -value


def bad_area(areas: Areas) -> float:
    """Return the area of corridor and open zones, square metres."""
    return float(sum(areas[code] for code in BAD))
