"""Models of mappings with known keys, for files and for dataclasses of parameters."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields
from functools import cache
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from pydantic_core import ErrorDetails

from ambinav.config.numbers import nearest, shown
from ambinav.config.values import FaultError, fault
from ambinav.runtime.errors import InputError

Model = TypeVar("Model", bound=BaseModel)
Made = TypeVar("Made")


class ConfigModel(BaseModel):
    """Mapping of a file with known keys only; `checked` makes one from plain values."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _check_type_and_keys(cls, plain: Any) -> Any:
        if isinstance(plain, cls):
            return plain
        if not isinstance(plain, Mapping):
            raise _no_mapping(plain, cls.model_fields)
        check_keys(plain, cls.model_fields)
        for name, value in plain.items():
            kind = cls.model_fields[name].annotation
            kinds = {kind, *(get_args(kind) if get_origin(kind) in (Union, UnionType) else ())}
            # Pydantic takes true for 1.
            if isinstance(value, bool) and kinds & {int, float} and bool not in kinds:
                raise InputError(f"{name} is {value}; give a number")
        return plain


def checked(model: type[Model], plain: object, where: str) -> Model:
    """Validate plain values as a model.

    Args:
        model: Which.
        plain: As a parser gave them.
        where: Names them in messages: the file, and perhaps the place in it.

    Raises:
        InputError: a key is unknown or missing, or a value of no use.
    """
    try:
        return model.model_validate(plain)
    except ValidationError as error:
        raise InputError(_error_text(error, where)) from error


def check_keys(plain: Mapping[Any, Any], allowed: Iterable[str]) -> None:
    """Check that all keys are known.

    Raises:
        InputError: a key is unknown; the nearest known ones are offered.
    """
    names = list(allowed)
    for key in plain:
        if key not in names:
            raise InputError(f"the key {key!r} is unknown; {nearest(str(key), names)}.")


def from_mapping(kind: type[Made], plain: object) -> Made:
    """Make a dataclass, which checks its own values, from a mapping; return others as they are.

    Raises:
        InputError: a key is unknown or missing, or what the dataclass refuses.
    """
    if isinstance(plain, kind):
        return plain
    model_fields = fields(kind)  # type: ignore[arg-type]
    names = [field.name for field in model_fields]
    if not isinstance(plain, Mapping):
        raise _no_mapping(plain, names)
    check_keys(plain, names)
    for field in model_fields:
        left_out = field.default is MISSING and field.default_factory is MISSING
        if left_out and field.name not in plain:
            raise InputError(f"the key {field.name!r} is missing; add it.")
    return kind(**plain)


def of_mapping(kind: type[Any]) -> BeforeValidator:
    """Return a validator that converts a mapping to a dataclass, as `from_mapping` does."""
    return BeforeValidator(lambda plain: from_mapping(kind, plain))


def check_fields(parameters: Any, where: str = "") -> None:
    """Check a frozen dataclass by its annotations, and convert fields to their types.

    Args:
        parameters: The dataclass, from its `__post_init__`.
        where: Names it in messages.

    Raises:
        InputError: a value is of no use.
    """
    kind: Any = type(parameters)
    for name, check in _checks(kind).items():
        try:
            value = check(getattr(parameters, name))
        except ValidationError as error:
            raise InputError(_error_text(error, where, (name,))) from error
        object.__setattr__(parameters, name, value)


def require(parameters: object, name: str, good: bool, wish: str) -> None:
    """Check one field of a dataclass against the others.

    Args:
        parameters: The dataclass.
        name: The field.
        good: Whether its value is of use.
        wish: What to give instead.

    Raises:
        InputError: it is not.
    """
    if not good:
        raise InputError(f"{name} is {shown(getattr(parameters, name))}; give {wish}.")


@cache
def _checks(kind: Any) -> dict[str, Callable[[Any], Any]]:
    """Return the validator of each field of a dataclass."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: TypeAdapter(hints[field.name]).validate_python for field in fields(kind)}


def _no_mapping(plain: object, keys: Iterable[str]) -> FaultError:
    return fault(plain, f"give a mapping with the keys {', '.join(keys)}")


def _error_text(error: ValidationError, where: str, name: tuple[str, ...] = ()) -> str:
    """Describe the first error in one sentence with location, value and remedy."""
    first, place = _first_error(error, name)
    at = f"{where}: {place}" if where and place else where or place
    cause = first.get("ctx", {}).get("error")
    if isinstance(cause, FaultError):
        # The error of a list's item names the item.
        return f"{at} {cause}."
    if isinstance(cause, ValueError):
        # The parts name themselves.
        message = str(cause)
        for prefix in (place, place.rpartition(".")[2]):
            message = message.removeprefix(f"{prefix}: ") if prefix else message
        return f"{at}: {message.rstrip('.')}."
    if first["type"] == "missing":
        inside, _, key = place.rpartition(".")
        at = ": ".join(part for part in (where, inside) if part)
        return f"{at}: the key {key!r} is missing; add it."
    wish = re.sub(r"^(Input|Value|Tuple|List) should", "it should", first["msg"])
    wish = re.sub(r" after validation, not \d+$", "", wish)
    # Files have lists and mappings, whatever Python makes of them.
    wish = re.sub(r"a valid (tuple|list|set)", "a list", wish)
    wish = wish.replace("a valid dictionary", "a mapping")
    return f"{at} is {shown(first['input'])}; {wish}."


def _first_error(error: ValidationError, name: tuple[str, ...]) -> tuple[ErrorDetails, str]:
    """Return the first error, also of a nested model, and its location."""
    path: list[int | str] = list(name)
    while True:
        first = error.errors(include_url=False)[0]
        path += first["loc"]
        cause = first.get("ctx", {}).get("error")
        if not isinstance(cause, ValidationError):
            break
        error = cause
    place = ""
    for part in path:
        place += f"[{part}]" if isinstance(part, int) else f".{part}" if place else part
    # Pydantic adds the member of a union that it tried.
    return first, re.sub(r"\.(tuple|dict|str|literal|lax-or-strict|function-)[^.]*.*$", "", place)
