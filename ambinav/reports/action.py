"""A recommended action for the reader of a report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MOST: Final = 3
"""Actions that a report begins with."""


@dataclass(frozen=True)
class Action:
    """A recommended action.

    Attributes:
        title: Title in the imperative.
        text: Why and how, in a sentence or two.
        place: Number of the place of an audit that it is about; None: of no one place.
        pair: Name of the pair of a comparison that it is about.
    """

    title: str
    text: str
    place: int | None = None
    pair: str | None = None
