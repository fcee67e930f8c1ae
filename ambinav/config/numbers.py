"""Checks of single values: numbers, counts, names.

One convention holds in all files of this package: lengths are metres, and a key that ends in
`_deg` is in degrees, because people write these files. In Python angles are radians.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

SHORTEST: Final = 3
"""Letters of a part of a name by which the name is found."""

LONGEST: Final = 60
"""Characters of a value that a message shows."""


def shown(value: object) -> str:
    """Format a value for messages, in one line; a long one is cut."""
    text = " ".join(repr(value.item() if isinstance(value, np.generic) else value).split())
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def as_number(value: object, where: str) -> float:
    """Return a finite number as a float.

    A text such as "1e-3" counts as a number, because YAML 1.1 reads 1e-3 as text.

    Raises:
        InputError: anything else, NaN and infinity included.
    """
    number = math.nan
    if isinstance(value, int | float | str | np.integer | np.floating) and not isinstance(
        value, bool
    ):
        try:
            number = float(value)
        except (ValueError, OverflowError):
            number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{where} is {shown(value)}; give a finite number.")
    return number


def as_positive(value: object, where: str, unit: str = "") -> float:
    """Return a finite number above 0 as a float, or raise `InputError`.

    Args:
        value: As for `as_number`.
        where: Names it in messages.
        unit: Its unit in messages, such as "metres".
    """
    number = as_number(value, where)
    if number <= 0.0:
        raise InputError(f"{where} is {shown(value)}; give {unit or 'a number'} above 0.")
    return number


def as_nonnegative(value: object, where: str, unit: str = "") -> float:
    """Return a finite number of at least 0 as a float, or raise `InputError`; see `as_positive`."""
    number = as_number(value, where)
    if number < 0.0:
        wish = f"at least 0 {unit}" if unit else "a number of at least 0"
        raise InputError(f"{where} is {shown(value)}; give {wish}.")
    return number


def as_numbers(value: object, where: str) -> tuple[float, ...]:
    """Return a list of finite numbers as a tuple of floats, or raise `InputError`."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, list | tuple) or not value:
        raise InputError(f"{where} is {shown(value)}; give a list of numbers.")
    return tuple(as_number(item, f"{where}[{i}]") for i, item in enumerate(value))


def as_count(value: object, where: str) -> int:
    """Return a whole number of at least 1, or raise `InputError`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise InputError(f"{where} is {shown(value)}; give a whole number of at least 1.")
    return int(value)


def as_array(value: ArrayLike, where: str, wish: str) -> Floats:
    """Return a new array of float64, or raise `InputError`; `wish` says what to give instead."""
    try:
        return np.array(value, dtype=np.float64, order="C")
    except (TypeError, ValueError):
        raise InputError(f"{where} is {shown(value)}; give {wish}.") from None


def as_arrays(**values: ArrayLike) -> tuple[tuple[int, ...], list[Floats]]:
    """Return the shape that some arrays, or numbers, broadcast to, and each of them as float64.

    Args:
        values: By the names of the arguments that they are.

    Raises:
        InputError: one is no array of numbers, or their shapes do not match.
    """
    try:
        parts = [np.asarray(value, dtype=np.float64) for value in values.values()]
        return np.broadcast_shapes(*(part.shape for part in parts)), parts
    except (TypeError, ValueError) as error:
        *first, last = values
        raise InputError(
            f"{', '.join(first)} and {last} cannot be broadcast together ({error}); give "
            "numbers, or arrays of equal shapes."
        ) from error


def as_flat(**values: ArrayLike) -> tuple[tuple[int, ...], list[Floats]]:
    """Return the shape that some arrays, or numbers, broadcast to, and a flat copy of each.

    Copies, for numpy warns of writing to what broadcasting shares. Raises as `as_arrays` does.
    """
    shape, parts = as_arrays(**values)
    return shape, [np.broadcast_to(part, shape).flatten() for part in parts]


def as_degrees(radians: float) -> float:
    """Return the shortest degrees that read back as exactly these radians, if there are any."""
    degrees = math.degrees(radians)
    for candidate in (*(round(degrees, digits) for digits in range(0, 13, 3)), degrees):
        if math.radians(candidate) == radians:
            return candidate
    return degrees


def nearest(word: str, known: Iterable[str]) -> str:
    """Return what to offer for a misspelt word: those that contain it, the nearest, or else all."""
    names = sorted(known)
    part = str(word).lower()  # whatever a caller may have taken for a name
    matches = [name for name in names if part in name] if len(part) >= SHORTEST else []
    if part in names:
        matches = [part]
    elif not matches:
        matches = difflib.get_close_matches(part, names, n=3, cutoff=0.5)
    if not names:
        return "there are none"
    return ("did you mean " if matches else "choose from ") + ", ".join(matches or names)
