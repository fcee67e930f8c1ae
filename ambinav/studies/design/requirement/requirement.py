"""A requirement: a condition on the zones of judged floor that the changed building must meet."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ambinav.maps.zones import CORRIDOR, LOCALIZABLE, OPEN
from ambinav.reports.conditions import Condition, Quantities, parse_condition
from ambinav.runtime.errors import InputError
from ambinav.studies.audit.figures import QUANTITIES

Areas: TypeAlias = Sequence[float] | NDArray[np.float64]
"""Square metres in each zone, in the order of `ZONES`."""
BAD: Final = (CORRIDOR, OPEN)
OPTION: Final = "requirement"
_ZONES: Final = {
    "bad": BAD, "corridor": (CORRIDOR,), "open": (OPEN,), "localizable": (LOCALIZABLE,),
}  # fmt: skip


def _read(codes: Sequence[int], unit: str) -> Callable[[Areas], float]:
    def read(areas: Areas) -> float:
        area, total = float(sum(areas[code] for code in codes)), float(sum(areas))
        # Without any floor nothing is met.
        return math.nan if total == 0.0 else 100.0 * area / total if unit == "%" else area

    return read


FIGURES: Final[Quantities] = {
    name: replace(
        QUANTITIES[name],
        read=_read(_ZONES[name.removesuffix(" area")], QUANTITIES[name].unit),
        where=lambda areas: "",
    )
    for zone in _ZONES
    for name in (zone, f"{zone} area")
}
"""The audit's figures that the areas of its zones (in the order of `ZONES`) decide."""


@dataclass(frozen=True)
class Requirement:
    """A requirement on the zones of the judged floor.

    Attributes:
        condition: Condition that must hold; its quantity reads the areas of the zones.
    """

    condition: Condition

    @classmethod
    def parse(cls, text: str) -> Requirement:
        """Read a requirement such as "bad < 2 %".

        Raises:
            InputError: it cannot be read, is about another figure, holds always or never, or asks
                for bad floor, or for less localizable floor.
        """
        listed = f"a requirement is about {', '.join(FIGURES)}"
        condition = parse_condition(text, FIGURES, OPTION, listed)
        good = condition.quantity.name.startswith("localizable")
        operator = condition.limit.operator
        if good != operator.startswith(">"):
            turned = operator.translate(str.maketrans("<>", "><"))
            limit = replace(condition.limit, operator=turned)
            raise InputError(
                f'{OPTION}: "{condition}" asks for {"less" if good else "more"} '
                f"{'localizable' if good else 'bad'} floor; a requirement says what must hold, "
                f'e.g. "{replace(condition, limit=limit)}".'
            )
        return cls(condition)

    def __str__(self) -> str:
        """Return the requirement as it is written."""
        return str(self.condition)

    def value(self, areas: Areas) -> float:
        """Return the figure for areas of the zones, square metres, in its unit."""
        value = self.condition.quantity.read(areas)
        assert value is not None
        return value

    def holds(self, areas: Areas) -> bool:
        """Return whether it holds for areas of the zones, square metres, shape (zones,)."""
        return self.condition.limit.holds(self.value(areas))

    def distance(self, areas: Areas) -> float:
        """Return a figure that is the less the better the areas are for the requirement."""
        value = self.value(areas)
        return value if self.condition.limit.operator.startswith("<") else -value


def bad_area(areas: Areas) -> float:
    """Return the area of corridor and open zones, square metres."""
    return float(sum(areas[code] for code in BAD))
