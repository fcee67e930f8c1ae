"""Reading YAML strictly: every complaint names the file, the field, the value and the remedy.

One convention holds in all files of this package: lengths are metres, and a key that ends in
`_deg` is in degrees, because people write these files. In Python angles are radians.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, cast

import numpy as np
import yaml

from ambinav.errors import InputError


def read_text(path: Path) -> str:
    """Return the text of a file in UTF-8.

    Raises:
        InputError: there is no such file, it is a folder, or it is not text.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(
            f"{path}: byte {error.start} is not UTF-8 text; save the file as UTF-8."
        ) from error
    except OSError as error:
        raise InputError(
            f"{path}: the file cannot be read ({error.strerror}); check the path."
        ) from error


def parse_yaml(text: str, where: str, example: str) -> object:
    """Parse YAML text into plain Python values.

    Args:
        text: The text.
        where: Names it in messages.
        example: Where to find one, told if it is empty.

    Raises:
        InputError: the text is not YAML, or holds nothing.
    """
    try:
        plain = yaml.safe_load(text)
    except yaml.MarkedYAMLError as error:
        line = f"line {error.problem_mark.line + 1}: " if error.problem_mark else ""
        raise InputError(
            f"{where}: {line}not valid YAML ({error.problem}); correct the file there."
        ) from error
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{where}: not valid YAML ({reason}); correct the file.") from error
    if plain is None:
        raise InputError(f"{where}: the file is empty; {example}.")
    return cast(object, plain)


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
        raise InputError(f"{where} is {value!r}; give a finite number.")
    return number


def as_numbers(value: object, where: str) -> tuple[float, ...]:
    """Return a list of finite numbers as a tuple of floats, or raise `InputError`."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, list | tuple) or not value:
        raise InputError(f"{where} is {value!r}; give a list of numbers.")
    return tuple(as_number(item, f"{where}[{i}]") for i, item in enumerate(value))


def as_count(value: object, where: str) -> int:
    """Return a whole number of at least 1, or raise `InputError`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise InputError(f"{where} is {value!r}; give a whole number of at least 1.")
    return int(value)


def as_degrees(radians: float) -> float:
    """Return the shortest degrees that read back as exactly these radians, if there are any."""
    degrees = math.degrees(radians)
    for candidate in (*(round(degrees, digits) for digits in range(0, 13, 3)), degrees):
        if math.radians(candidate) == radians:
            return candidate
    return degrees


def nearest(word: str, known: Iterable[str]) -> str:
    """Return what to offer for a misspelt word: the nearest ones, or else all of them."""
    names = sorted(known)
    found = difflib.get_close_matches(word.lower(), names, n=3, cutoff=0.5)
    return ("did you mean " if found else "choose from ") + ", ".join(found or names)


class Fields:
    """A YAML mapping whose keys are all known; each getter checks one field.

    Args:
        plain: What the YAML parser gave.
        where: How messages name the place, such as "robot.yaml: parts[0].sensor".
        known: The keys that may occur.

    Raises:
        InputError: it is not a mapping, or a key is unknown.
    """

    def __init__(self, plain: object, where: str, known: tuple[str, ...]) -> None:
        """Check the keys, so that a misspelt one is reported as such and not as missing."""
        if not isinstance(plain, dict):
            raise InputError(
                f"{where} is {plain!r}; give a mapping with the fields {', '.join(known)}."
            )
        for key in plain:
            if key not in known:
                raise InputError(
                    f"{where}: the field {key!r} is unknown; {nearest(str(key), known)}."
                )
        self.where = where
        self._plain: dict[str, Any] = plain

    def __contains__(self, key: str) -> bool:
        """Whether the field is given."""
        return key in self._plain

    def raw(self, key: str) -> object:
        """Return the field as the parser gave it, or raise `InputError` if it is missing."""
        if key not in self._plain:
            raise InputError(f"{self.where}: the field {key!r} is missing; add it.")
        return cast(object, self._plain[key])

    def place(self, key: str) -> str:
        """Return how messages name this field."""
        return f"{self.where}: {key}"

    def text(self, key: str, default: str) -> str:
        """Return a text field."""
        value = self._plain.get(key, default)
        if not isinstance(value, str):
            raise InputError(f"{self.place(key)} is {value!r}; give a text (in quotes).")
        return value.strip()

    def number(self, key: str, default: float | None = None) -> float:
        """Return a finite number; without a default the field must be given."""
        if default is not None and key not in self._plain:
            return default
        return as_number(self.raw(key), self.place(key))

    def angle(self, key: str, default: float | None = None) -> float:
        """Return a field in degrees as radians; the default is in degrees too."""
        return math.radians(self.number(key, default))

    def count(self, key: str) -> int:
        """Return a whole number of at least 1."""
        return as_count(self.raw(key), self.place(key))

    def mount(self, key: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
        """Return [x, y, yaw_deg] as x, y in metres and yaw in radians."""
        if key not in self._plain:
            return default
        return as_mount(self.raw(key), self.place(key))


def as_mount(value: object, where: str) -> tuple[float, float, float]:
    """Return [x, y, yaw_deg] as x, y in metres and yaw in radians, or raise `InputError`."""
    numbers = as_numbers(value, where)
    if len(numbers) != 3:
        raise InputError(f"{where} is {value!r}; give three numbers [x, y, yaw_deg].")
    return numbers[0], numbers[1], math.radians(numbers[2])
