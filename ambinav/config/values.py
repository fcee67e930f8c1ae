"""Annotation types that state allowed values, with ambinav's own error messages.

    beams: Count
    gate: Positive
    speed: Annotated[float, number(least=-1.0, most=0.0)]

They work in a `ConfigModel` and in a dataclass that calls `check_fields`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Final, TypeAlias

import numpy as np
from pydantic import AfterValidator, BeforeValidator

from ambinav.config.numbers import as_number, nearest, shown
from ambinav.runtime.errors import InputError


class FaultError(ValueError):
    """Fault of a value, described without the value's name: "is 3; give 0 to 1"."""


def fault(value: object, wish: str) -> FaultError:
    """Return the error of a value.

    Args:
        value: As it was given.
        wish: What to do instead.
    """
    return FaultError(f"is {shown(value)}; {wish}")


def check_kind(
    value: object, kind: type | tuple[type, ...], name: str, remedy: str | None = None
) -> None:
    """Check that an argument is of a kind.

    Args:
        value: The argument.
        kind: A class, or several.
        name: Its name in messages.
        remedy: What to do, as in "give one that `load_environment` returns"; None: to give an
            instance of the (first) class.

    Raises:
        InputError: it is something else.
    """
    if not isinstance(value, kind):
        made_of = kind if isinstance(kind, type) else kind[0]
        remedy = remedy or f"give an instance of {made_of.__name__}"
        raise InputError(f"{name} is {shown(value)}; {remedy}.")


def check_generator(rng: object) -> None:
    """Check that an argument `rng` is a numpy Generator, or raise `InputError`."""
    check_kind(rng, np.random.Generator, "rng", "give a numpy Generator, such as default_rng(1)")


def number(
    *, above: float | None = None, least: float | None = None, most: float | None = None
) -> BeforeValidator:
    """Return a validator of a finite number in limits, also as text such as "1e-3" (YAML 1.1).

    Args:
        above: It is greater than this.
        least: It is at least this.
        most: It is at most this.
    """
    wish = _allowed_text("number", above, least, most)

    def check(value: Any) -> float:
        try:
            parsed = as_number(value, "")
        except InputError:
            raise fault(value, wish) from None
        if above is not None and parsed <= above:
            raise fault(value, wish)
        if (least is not None and parsed < least) or (most is not None and parsed > most):
            raise fault(value, wish)
        return parsed

    return BeforeValidator(check)


def integer(*, least: int = 1, most: int | None = None) -> BeforeValidator:
    """Return a validator of a whole number within limits.

    Args:
        least: It is at least this.
        most: It is at most this.
    """
    wish = _allowed_text("whole number", None, least, most)

    def check(value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int | np.integer):
            raise fault(value, wish)
        if value < least or (most is not None and value > most):
            raise fault(value, wish)
        return int(value)

    return BeforeValidator(check)


def row(count: int, wish: str) -> BeforeValidator:
    """Return a validator of a list, a tuple or an array of `count` values.

    Args:
        count: How many.
        wish: What to give instead of another.
    """

    def check(value: Any) -> Any:
        plain = value.tolist() if isinstance(value, np.ndarray) else value
        if not isinstance(plain, list | tuple) or len(plain) != count:
            raise fault(plain, wish)
        return tuple(plain)

    return BeforeValidator(check)


def _numbers(value: Any) -> Any:
    plain = value.tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(plain, Iterable) or isinstance(plain, str | bytes | Mapping):
        raise fault(plain, "give a list of numbers")
    numbers = tuple(plain)
    if not numbers:
        raise fault(plain, "give a list of numbers")
    return numbers


some_numbers: Final = BeforeValidator(_numbers)
"""Validator of a list, a tuple or an array of at least one value."""


def choice(names: Iterable[str]) -> BeforeValidator:
    """Return a validator of a name; for an unknown one, the nearest are suggested."""
    allowed = tuple(names)

    def check(value: Any) -> str:
        if not isinstance(value, str) or value not in allowed:
            raise fault(value, nearest(str(value), allowed))
        return value

    return BeforeValidator(check)


def _switch(value: Any) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise fault(value, "give true or false")
    return bool(value)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise fault(value, "give a text (in quotes)")
    return value.strip()


def _allowed_text(noun: str, above: float | None, least: float | None, most: float | None) -> str:
    """Describe in words which value to give."""
    if above is not None:
        return f"give a {noun} above {above:g}" + ("" if most is None else f", at most {most:g}")
    if least is not None and most is not None:
        return f"give {'' if noun == 'number' else f'a {noun} from '}{least} to {most}"
    if least is not None:
        return f"give a {noun} of at least {least}"
    return "give a finite number" if most is None else f"give a {noun} of at most {most}"


Number: TypeAlias = Annotated[float, number()]
Numbers: TypeAlias = Annotated[tuple[Number, ...], some_numbers]
Positive: TypeAlias = Annotated[float, number(above=0)]
NonNegative: TypeAlias = Annotated[float, number(least=0)]
Share: TypeAlias = Annotated[float, number(least=0, most=1)]
Count: TypeAlias = Annotated[int, integer()]
Switch: TypeAlias = Annotated[bool, BeforeValidator(_switch)]
Text: TypeAlias = Annotated[str, BeforeValidator(_text)]
Degrees: TypeAlias = Annotated[float, number(), AfterValidator(math.radians)]
"""Degrees in files, radians in Python."""
MountDegrees: TypeAlias = Annotated[
    tuple[Number, Number, Degrees], row(3, "give three numbers [x, y, yaw_deg]")
]
"""x and y in metres, and yaw: degrees in files, radians in Python."""
