"""Spaces as plain values for policy files, and comparison of two spaces."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ambinav.runtime.array_types import Floats32
from ambinav.runtime.errors import InputError

Plain = dict[str, Any]

MOST_PARTS: Final = 64
"""Maximum number of parts of an observation described by a file."""
MOST_NUMBERS: Final = 1 << 20
"""Maximum number of values of an observation."""

REMEDIES: Mapping[str, str] = {
    "window": "make it with the policy's window, window_cells and window_spacing",
    "waypoint": "make it with waypoint=true",
    "scan": "give the scanner that the policy was trained with",
}
"""Remedy for a part that does not fit."""


def described(space: spaces.Space[Any]) -> Plain:
    """Describe a space by plain numbers.

    Returns:
        For a Dict `{"parts": {name: {"size", "low", "high"}}}`, for a Box `{"size", "low",
        "high"}`, for a Discrete `{"count"}`. Limits that all numbers share are one number.

    Raises:
        InputError: it is something else, or a part is no row of numbers.
    """
    if isinstance(space, spaces.Dict):
        return {"parts": {name: described(part) for name, part in space.spaces.items()}}
    if isinstance(space, spaces.Discrete):
        return {"count": int(space.n)}
    if isinstance(space, spaces.Box) and len(space.shape) == 1:
        low, high = _limits(space.low), _limits(space.high)
        return {"size": int(space.shape[0]), "low": low, "high": high}
    raise InputError(
        f"the space {space} is none that a policy file can hold; use a Dict of rows, one row, or a "
        "Discrete."
    )


def space_of(plain: object) -> spaces.Space[Any]:
    """Rebuild the space from the output of `described`, float32 where it is a Box.

    Raises:
        InputError: it describes no space, or one larger than `MOST_NUMBERS`.
    """
    if not isinstance(plain, Mapping):
        raise InputError(f"a space is a {type(plain).__name__}; give a mapping.")
    if set(plain) == {"parts"} and isinstance(plain["parts"], Mapping) and plain["parts"]:
        parts = plain["parts"]
        if len(parts) > MOST_PARTS:
            raise InputError(f"there are {len(parts)} parts, more than {MOST_PARTS}.")
        sizes = [part.get("size") for part in parts.values() if isinstance(part, Mapping)]
        if sum(size for size in sizes if isinstance(size, int)) > MOST_NUMBERS:
            raise InputError(f"the parts have more than {MOST_NUMBERS:,} numbers.")
        return spaces.Dict(OrderedDict((name, _box_of(part, name)) for name, part in parts.items()))
    if set(plain) == {"count"}:
        return spaces.Discrete(_size(plain["count"], "count"))
    return _box_of(plain, "the space")


def _box_of(plain: object, name: str) -> spaces.Box:
    if not isinstance(plain, Mapping) or set(plain) != {"size", "low", "high"}:
        raise InputError(f"{name[:80]!r} is not a row of numbers with size, low and high.")
    size = _size(plain["size"], name)
    low = _limits_of(plain["low"], size, -np.inf, name)
    high = _limits_of(plain["high"], size, np.inf, name)
    if not (low <= high).all():
        raise InputError(f"{name[:80]!r} has a low limit above the high one.")
    return spaces.Box(low, high, (size,), np.float32)


def _size(value: object, name: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= MOST_NUMBERS:
        raise InputError(
            f"{name[:80]!r} has the size {str(value)[:80]}; give 1 to {MOST_NUMBERS:,}."
        )
    return value


def _limits_of(value: object, size: int, none: float, name: str) -> Floats32:
    values: list[Any] = value if isinstance(value, list) else [value] * size
    if len(values) != size:
        raise InputError(f"{name[:80]!r} has {len(values)} limits for {size} numbers.")
    for limit in values:
        number = isinstance(limit, int | float) and not isinstance(limit, bool)
        if limit is not None and not (number and -_GREATEST <= limit <= _GREATEST):
            raise InputError(
                f"{name[:80]!r} has the limit {str(limit)[:80]}, which is not a number."
            )
    return np.array([none if limit is None else limit for limit in values], dtype=np.float32)


def _limits(values: NDArray[Any]) -> float | list[float | None] | None:
    """Convert limits for JSON: None for no limit, and float32 without spurious digits."""
    limits = [
        float(str(value)) if np.isfinite(value) else None for value in values.astype(np.float32)
    ]
    return limits[0] if limits and len(set(limits)) == 1 else limits


def misfit(trained: Plain, space: spaces.Space[Any]) -> str | None:
    """Describe which required observations an environment's space lacks; None if it fits.

    Parts that the policy does not know are no harm. One that wants a single row takes all parts,
    one after the other, as in `gymnasium.spaces.flatten`.

    Args:
        trained: Output of `described`.
        space: Space of the environment's observations.
    """
    offered = described(space)
    if "parts" not in trained:
        sizes = (
            [part["size"] for part in offered["parts"].values()]
            if "parts" in offered
            else [offered["size"]]
        )
        if sum(sizes) == trained["size"]:
            return None
        return (
            f"it wants one row of {trained['size']} numbers and the environment's parts make "
            f"{sum(sizes)}; make the environment as the policy's card says"
        )
    parts = offered.get("parts", {})
    for name, part in trained["parts"].items():
        remedy = REMEDIES.get(name, "make the environment as the policy's card says")
        if name not in parts:
            parts_text = ", ".join(parts) or "one row"
            return f"it wants the part {name!r}, and the environment has {parts_text}; {remedy}"
        if parts[name]["size"] != part["size"]:
            return (
                f"the part {name!r} has {parts[name]['size']} numbers and the policy wants "
                f"{part['size']}; {remedy}"
            )
    return None


def action_misfit(trained: Plain, space: spaces.Space[Any]) -> str | None:
    """Describe which actions of a policy an environment does not accept; None if it fits."""
    offered = described(space)
    if offered.get("count") == trained.get("count") and offered.get("size") == trained.get("size"):
        return None
    return f"it gives {_action(trained)} and the environment takes {_action(offered)}; {_REMEDY}"


_GREATEST = float(np.finfo(np.float32).max)
_REMEDY = "make the environment with the policy's `discrete`, `declare` and `belief`"


def _action(plain: Plain) -> str:
    if "count" in plain:
        return f"one of {plain['count']} actions"
    return f"{plain['size']} numbers"
