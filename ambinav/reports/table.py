"""Tables of figures: each with an interval and its difference from a baseline."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from ambinav.drive.bootstrap import Interval


@dataclass(frozen=True)
class Figure:
    """A reported figure of a route, a method or a policy.

    Attributes:
        key: Name in files.
        title: Heading of a column.
        unit: Unit of the shown value: %, m, °, s or nothing.
        digits: Decimals for readers.
    """

    key: str
    title: str
    unit: str
    digits: int = field(default=2, kw_only=True)


Kind = TypeVar("Kind", bound=Figure)


@dataclass(frozen=True)
class Cell(Generic[Kind]):
    """One figure in a row.

    Attributes:
        figure: The figure.
        value: Over the runs or episodes, in the figure's unit.
        difference: To the baseline, pair by pair; None for the baseline itself.
        ratio: To the baseline; None likewise, and where it says nothing.
    """

    figure: Kind
    value: Interval
    difference: Interval | None
    ratio: Interval | None = None


class Cells(Generic[Kind]):
    """Common part of all rows of figures."""

    cells: tuple[Cell[Kind], ...]

    def __getitem__(self, key: str) -> Cell[Kind]:
        """Return the figure with a key."""
        return next(cell for cell in self.cells if cell.figure.key == key)

    @property
    def is_baseline(self) -> bool:
        """True if this row is the baseline of the others."""
        return self.cells[0].difference is None


def is_shown(difference: Interval) -> bool:
    """Return whether a difference is significant: its interval does not contain 0."""
    return bool(difference.low > 0.0 or difference.high < 0.0)


def value_text(cell: Cell[Kind], *, brief: bool = False) -> str:
    """Format the figure with its interval; brief: whole percents."""
    return interval_text(cell.value, 0 if brief and cell.figure.unit == "%" else cell.figure.digits)


def difference_text(cell: Cell[Kind], *, bold: bool = False) -> str:
    """Format the difference from the baseline with its interval and signs."""
    if cell.difference is None:
        return ""
    text = interval_text(cell.difference, cell.figure.digits, "+")
    return f"**{text}**" if bold and is_shown(cell.difference) else text


def ratio_text(cell: Cell[Kind]) -> str:
    """Format the ratio to the baseline with its interval."""
    return "" if cell.ratio is None else interval_text(cell.ratio, 2)


def interval_text(interval: Interval, digits: int, sign: str = "") -> str:
    """Format value and interval: "3.1 [2.0, 4.5]", "3.1" without one, "-" without a value.

    Args:
        interval: The figure.
        digits: Number of decimals.
        sign: "+" to show signs.
    """
    if math.isnan(interval.value):
        return "-"
    value, low, high = (
        f"{round(f, digits) + 0.0:{sign}.{digits}f}"
        for f in (interval.value, interval.low, interval.high)
    )
    if math.isnan(interval.low):
        return value
    return f"{value} [{low}, {high}]".replace("inf", "∞")


def csv_cells(interval: Interval | None) -> list[str]:
    """Return value, low and high end for a CSV line; empty where there is no value."""
    if interval is None:
        return ["", "", ""]
    three = (interval.value, interval.low, interval.high)
    return ["" if math.isnan(f) else f"{f:.6g}" for f in three]
