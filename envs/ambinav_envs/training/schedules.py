"""Hyperparameters that change over the training."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ambinav.config import as_number
from ambinav.runtime.errors import InputError

ENDS = ("from", "to")


@dataclass
class LinearSchedule:
    """A number that changes linearly over a training.

    Stable-Baselines3 counts what remains by the steps of one call of `learn`; here the share of the
    whole training is set from outside, since that may be given in minutes.

    Attributes:
        start: At the beginning.
        end: At the end.
        share: How much of the training is done, 0 to 1.
    """

    start: float
    end: float
    share: float = 0.0

    def __call__(self, remaining: float) -> float:
        """Return the present value."""
        return self.start + (self.end - self.start) * min(self.share, 1.0)


def schedule_of(value: Any, where: str) -> Any:
    """Return a `LinearSchedule` for a mapping {from, to}; any other value unchanged.

    Raises:
        InputError: a key is missing or unknown, or a value is no number.
    """
    if not isinstance(value, Mapping):
        return value
    if set(value) != set(ENDS):
        raise InputError(f"{where} is {dict(value)!r}; give a number, or a mapping of from and to.")
    return LinearSchedule(*(as_number(value[end], f"{where}.{end}") for end in ENDS))
