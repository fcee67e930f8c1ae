"""Conditions on the figures of a report, written as NAME OP NUMBER UNIT.

    open > 2 %        longest open stretch >= 4 m        places > 3

A name is one of the report's quantities, in any case, with spaces, hyphens or underscores; OP is
one of > >= < <=; the unit is the quantity's own.
"""

from __future__ import annotations

import difflib
import math
import re
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from ambinav.runtime.errors import InputError

ROUNDING: Final = 1e-9
"""Two shares of the same count may differ by rounding: a value on a limit is on it."""
UNITS: Final = {
    "%": "%", "percent": "%", "m": "m", "metres": "m", "meters": "m",
    "m2": "m²", "m^2": "m²", "sqm": "m²", "": "",
}  # fmt: skip
"""Units by their spellings; "" is that of a number."""
_CONVERTED: Final = {
    "mm": ("m", 1e-3), "cm": ("m", 1e-2), "dm": ("m", 0.1), "km": ("m", 1e3),
    "in": ("m", 0.0254), "inch": ("m", 0.0254), "ft": ("m", 0.3048), "feet": ("m", 0.3048),
    "mm2": ("m²", 1e-6), "cm2": ("m²", 1e-4), "dm2": ("m²", 1e-2), "a": ("m²", 1e2),
    "ha": ("m²", 1e4), "km2": ("m²", 1e6), "sqft": ("m²", 0.3048**2), "ft2": ("m²", 0.3048**2),
    "‰": ("%", 0.1), "permille": ("%", 0.1),
}  # fmt: skip
"""Units that are known but not read: the unit to write instead, and how many of it one is."""
_NAME: Final = re.compile(r"[^\W\d]+(?:[\s_-]+[^\W\d]+)*")
_OPERATOR: Final = re.compile(r">=|<=|≥|≤|>|<")
_NUMBER: Final = re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?")
_CONTINUED: Final = re.compile(r"[.,'\u2019\s]+\d")
"""Continuation of a number: a decimal comma or a thousands separator."""


@dataclass(frozen=True)
class Limit:
    """A bound on a value.

    Attributes:
        operator: ">", ">=", "<" or "<=".
        number: Bound in the value's unit.
    """

    operator: str
    number: float

    def holds(self, value: float) -> bool:
        """Return whether the value satisfies the relation; nan never does."""
        match self.operator:
            case ">":
                return value > self.number + ROUNDING
            case ">=":
                return value >= self.number - ROUNDING
            case "<":
                return value < self.number - ROUNDING
            case _:
                return value <= self.number + ROUNDING


@dataclass(frozen=True)
class Quantity:
    """A figure of a report that can be used in conditions.

    Attributes:
        name: Name in words, lower-case.
        unit: "%", "m", "m²", or "" of a number.
        meaning: Description without a full stop.
        read: Takes the report, gives the value in that unit; None where the report lacks it.
        where: Takes the report, says in a sentence where the figure comes from, or nothing.
        needs: Why the report may lack the value, and the remedy.
        least: The least value that it can take.
        most: The largest; None: 100 of a percentage, else there is none.
    """

    name: str
    unit: str
    meaning: str
    read: Callable[[Any], float | None]
    where: Callable[[Any], str] = lambda report: ""
    needs: str = ""
    least: float = 0.0
    most: float | None = None

    @property
    def range(self) -> tuple[float, float]:
        """Least and largest possible value, in its unit."""
        most = self.most if self.most is not None else 100.0 if self.unit == "%" else math.inf
        return self.least, most


Quantities = Mapping[str, Quantity]


def catalogue(*quantities: Quantity) -> Quantities:
    """Return quantities by their names."""
    return {quantity.name: quantity for quantity in quantities}


@dataclass(frozen=True)
class Condition:
    """A condition on a report.

    Attributes:
        quantity: The figure.
        limit: The bound that it is compared with.
    """

    quantity: Quantity
    limit: Limit

    def __str__(self) -> str:
        """Return the condition as it is written: `open > 2 %`."""
        unit = f" {self.quantity.unit}" if self.quantity.unit else ""
        return f"{self.quantity.name} {self.limit.operator} {self.limit.number:.10g}{unit}"


@dataclass(frozen=True)
class Outcome:
    """A condition and the value in the report.

    Attributes:
        condition: The condition.
        value: Value of the quantity, in its unit.
        where: Location of the value, a sentence or empty.
    """

    condition: Condition
    value: float
    where: str

    @property
    def holds(self) -> bool:
        """True if the condition holds, so that the gate fails."""
        return self.condition.limit.holds(self.value)

    @property
    def text(self) -> str:
        """Value and condition in a sentence."""
        quantity = self.condition.quantity
        unit = f" {quantity.unit}" if quantity.unit else ""
        verb = "holds" if self.holds else "does not hold"
        sentence = f'{quantity.name} is {self.value:.6g}{unit}: "{self.condition}" {verb}.'
        return f"{sentence} {self.where}" if self.where and self.holds else sentence


Unchecked = Sequence[tuple[Condition, str]]
"""Conditions that cannot be checked, each with a sentence on why."""


def judge(condition: Condition, report: object) -> Outcome:
    """Evaluate a condition on a report.

    Raises:
        InputError: the report lacks the value.
    """
    value = condition.quantity.read(report)
    if value is None or math.isnan(value):
        raise InputError(
            f'--fail-if: "{condition}": there is no figure for {condition.quantity.name}, '
            f"{condition.quantity.needs}."
        )
    return Outcome(condition, value, condition.quantity.where(report))


def parse_condition(
    text: str,
    quantities: Quantities,
    option: str = "--fail-if",
    others: str = "`--fail-if list` names them all",
) -> Condition:
    """Read a condition.

    Args:
        text: NAME OP NUMBER UNIT.
        quantities: Quantities that it may name.
        option: Named in messages.
        others: Says in messages where all quantities are named.

    Raises:
        InputError: it cannot be read, names no quantity, has another unit, or holds always or
            never; the message gives the position, counted from 1, or what to write instead.
    """
    name, at = _match_next(_NAME, text, 0, "the name of a figure", option)
    operator, at = _match_next(_OPERATOR, text, at, "one of > >= < <=", option)
    number, at = _match_next(_NUMBER, text, at, "a number", option)
    if _CONTINUED.match(text, at):
        raise InputError(
            f"{option}: {text!r}: at position {at + 1} the number {number} is followed by "
            f"{text[at:]!r}; write numbers as 2.5 or 1000."
        )
    unit = text[at:].strip()
    quantity = quantities.get(" ".join(re.split(r"[\s_-]+", name.lower())))
    if quantity is None:
        raise InputError(f"{option}: {text!r}: {_unknown(name, quantities, others)}")
    # Full-width and squared characters are normalized to plain ones.
    given_unit = UNITS.get(unicodedata.normalize("NFKC", unit.lower()))
    limit = Limit({"≥": ">=", "≤": "<="}.get(operator, operator), float(number))
    condition = Condition(quantity, limit)
    if not math.isfinite(limit.number):
        raise InputError(f"{option}: {text!r}: {number} is too large; give a smaller limit.")
    if given_unit is None:
        converted = _convert(condition, unit)
        if converted is not None:
            raise InputError(
                f"{option}: {text!r}: {quantity.name} is in {quantity.unit}, not in {unit}; "
                f'write "{converted}".'
            )
        start = text.index(unit, at) + 1
        offer = f"the unit {quantity.unit!r}" if quantity.unit else "nothing more"
        raise InputError(
            f"{option}: {text!r}: at position {start} stands {unit!r} where {offer} is expected; "
            f"give one condition, its limit {_in_unit(quantity)}."
        )
    if given_unit != quantity.unit:
        has = f"is in {quantity.unit}" if quantity.unit else "is a number without a unit"
        unit_text = f"not in {given_unit}" if given_unit else "and the condition gives no unit"
        raise InputError(
            f"{option}: {text!r}: {quantity.name} {has}, {unit_text}; "
            f"{_remedy(condition, given_unit, quantities)}."
        )
    _check_possible(condition, text, option)
    return condition


def _check_possible(condition: Condition, text: str, option: str) -> None:
    """Refuse a condition that is always or never true: its gate would be useless."""
    quantity, limit = condition.quantity, condition.limit
    least, most = quantity.range
    # All relations are monotone in the value, so the two ends of its range decide.
    ends = limit.holds(least), limit.holds(most)
    if ends[0] != ends[1]:
        return
    unit = f" {quantity.unit}" if quantity.unit else ""
    to = f"from {least:g} to {most:g}{unit}" if math.isfinite(most) else f"at least {least:g}{unit}"
    raise InputError(
        f'{option}: {text!r}: "{condition}" {"always" if ends[0] else "never"} holds, for '
        f"{quantity.name} is {to}; give a limit that it can cross."
    )


def _convert(condition: Condition, unit: str) -> Condition | None:
    """Return the condition in the quantity's unit; None if `unit` cannot be converted."""
    plain = unicodedata.normalize("NFKC", unit.lower()).replace("^", "").replace(" ", "")
    to, factor = _CONVERTED.get(plain, (None, 0.0))
    if to != condition.quantity.unit:
        return None
    number = float(f"{condition.limit.number * factor:.10g}")
    return Condition(condition.quantity, Limit(condition.limit.operator, number))


def _in_unit(quantity: Quantity) -> str:
    return f"in {quantity.unit}" if quantity.unit else "as a number without a unit"


def _match_next(
    pattern: re.Pattern[str], text: str, at: int, expected: str, option: str
) -> tuple[str, int]:
    """Return the next match and the index after it."""
    at += len(text[at:]) - len(text[at:].lstrip())
    match = pattern.match(text, at)
    if match is None:
        stands = f"stands {text[at:]!r}" if at < len(text) else "it ends"
        raise InputError(
            f"{option}: {text!r}: at position {at + 1} {stands} where {expected} is expected; "
            'write NAME > NUMBER UNIT, e.g. "open > 2 %".'
        )
    return match.group(), match.end()


def _unknown(name: str, quantities: Quantities, others: str) -> str:
    plain = " ".join(re.split(r"[\s_-]+", name.lower()))
    close = difflib.get_close_matches(plain, quantities, n=3, cutoff=0.5)
    close = close or [other for other in quantities if plain in other or other in plain][:3]
    offer = f"did you mean {' or '.join(map(repr, close))}? " if close else ""
    return f"{name!r} is not a figure of the report; {offer}{others}."


def _remedy(condition: Condition, unit: str, quantities: Quantities) -> str:
    """Suggest a valid condition for a limit in the wrong unit, or without one.

    The number stays what it was: as that many of the other unit it would be another limit.
    """
    quantity, limit = condition.quantity, condition.limit
    if not unit:
        as_share = ""
        if quantity.unit == "%" and 0.0 < limit.number <= 1.0:
            share = Condition(quantity, Limit(limit.operator, 100.0 * limit.number))
            as_share = f', or "{share}" if {limit.number:g} is a share of 1'
        return f'write "{condition}"{as_share}'
    words = set(quantity.name.split())
    near = [q.name for q in quantities.values() if q.unit == unit and words & set(q.name.split())]
    best = difflib.get_close_matches(quantity.name, near, n=1, cutoff=0.0)
    if best:
        return (
            f'write "{Condition(quantities[best[0]], limit)}", or give a limit {_in_unit(quantity)}'
        )
    return f"give a limit {_in_unit(quantity)}"
