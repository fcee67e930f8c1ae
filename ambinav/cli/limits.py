"""Limits of numbers, stated where an option is declared.

    spacing: Annotated[float, above_zero("0.1")] = 0.1

`options.documented` checks them before a command runs; None passes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Final

from ambinav.runtime.errors import InputError

LARGEST: Final = 1e9
"""No amount is larger: squares and counts of it stay finite."""


@dataclass(frozen=True)
class Limit:
    """Limit of a number.

    Attributes:
        allows: Returns whether a number keeps to it.
        fault: What is said of another number.
        remedy: What to do instead.
        most: Largest number.
    """

    allows: Callable[[float], bool]
    fault: str
    remedy: str
    most: float = LARGEST

    def check(self, value: float | None, option: str) -> None:
        """Check the value of an option.

        Raises:
            InputError: it is outside of the limit.
        """
        if value is None or (self.allows(value) and value <= self.most):
            return
        too_large = "is too large" if value < math.inf else "is not finite"
        fault = too_large if self.allows(value) else self.fault
        number = value if isinstance(value, int) else f"{value:g}"
        raise InputError(f"{option}: {number} {fault}; {self.remedy}.")


def above_zero(example: str, unit: str = "metres") -> Limit:
    """Return the limit of a finite number above zero."""
    return Limit(lambda value: value > 0.0, "is not above zero", f"give {unit}, e.g. {example}")


def not_negative(example: str, unit: str = "metres") -> Limit:
    """Return the limit of a finite number that is not negative."""
    return Limit(lambda value: value >= 0.0, "is not zero or above", f"give {unit}, e.g. {example}")


def at_least(least: int) -> Limit:
    """Return the limit of a count."""
    fault = "is too few" if least else "is negative"
    return Limit(lambda value: value >= least, fault, f"give {least} or more", math.inf)


Count = Annotated[int, at_least(1)]
Natural = Annotated[int, at_least(0)]
