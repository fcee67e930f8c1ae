"""A part of a fleet, for machines without a scheduler between them: array jobs, CI matrices."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from ambinav.runtime.errors import InputError
from ambinav.studies.fleet.unit import Unit


@dataclass(frozen=True)
class Batch:
    """One of several equal parts.

    Attributes:
        number: Its number, from 1.
        count: How many parts there are.
    """

    number: int
    count: int

    @classmethod
    def parse(cls, text: str, option: str = "--batch") -> Batch:
        """Read a part as it is given, e.g. "3/20".

        Raises:
            InputError: it is none.
        """
        match = re.fullmatch(r"\s*(\d+)\s*/\s*(\d+)\s*", text, re.ASCII)
        number, count = (int(part) for part in match.groups()) if match else (0, 0)
        if not 1 <= number <= count:
            raise InputError(
                f"{option}: {text!r} is not a part of a fleet; give its number, from 1, and how "
                "many there are, e.g. 3/20."
            )
        return cls(number, count)

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"

    def of(self, units: Sequence[Unit]) -> tuple[Unit, ...]:
        """Return its units, the same for any order of all: every unit is in one part.

        Each part has about as many of each scanner; neighbours in the list of sites, which tend to
        take as long, are in different parts.
        """
        ordered = sorted(units, key=lambda unit: (unit.label, unit.site.name))
        return tuple(ordered[self.number - 1 :: self.count])
