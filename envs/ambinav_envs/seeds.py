"""Checks of seeds given by users."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence

import numpy as np

from ambinav.runtime.errors import InputError


def as_seed(value: object, where: str = "seed") -> int | None:
    """Return a checked seed; None stays None.

    Raises:
        InputError: it is no whole number from 0 on.
    """
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
        raise InputError(f"{where} is {reprlib.repr(value)}; give a whole number from 0 on.")
    return int(value)


def as_seeds(value: object, count: int) -> list[int | None]:
    """Return a seed for each of `count` robots: s + i for a given s, None for none.

    Raises:
        InputError: there are more or fewer, or one of them is no whole number from 0 on.
    """
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if not isinstance(value, Sequence) or isinstance(value, str):
        first = as_seed(value)
        return [None if first is None else first + i for i in range(count)]
    if len(value) != count:
        raise InputError(f"seed holds {len(value)} seeds; give one, or one for each of {count}.")
    return [as_seed(item, f"seed[{i}]") for i, item in enumerate(value)]
