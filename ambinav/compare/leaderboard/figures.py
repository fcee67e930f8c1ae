"""The figures of a method: shares and means over its episodes, with intervals and differences."""

from __future__ import annotations

import csv
import io
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from ambinav.compare.intervals import csv_cells, interval_text
from ambinav.drive.bootstrap import Interval, bootstrap, paired

if TYPE_CHECKING:
    from ambinav_envs.evaluation import Episodes

Floats = NDArray[np.float64]

SHORT_WAY: Final = 0.5
"""Exposure per metre is told of episodes in which the robot drove at least so many metres."""


def _percent(which: NDArray[np.bool_]) -> Floats:
    return np.where(which, 100.0, 0.0)


def _ended(outcome: str) -> Callable[[Episodes], Floats]:
    def values(episodes: Episodes) -> Floats:
        from ambinav_envs.simulation.layout import OUTCOMES

        return _percent(episodes.ended(OUTCOMES.index(outcome)))

    return values


def _per_metre(episodes: Episodes) -> Floats:
    way = episodes.travelled
    return np.where(way >= SHORT_WAY, episodes.exposure / np.maximum(way, SHORT_WAY), np.nan)


def _seconds(episodes: Episodes) -> Floats:
    return np.where(np.isnan(episodes.length_ratio), np.nan, episodes.seconds)


@dataclass(frozen=True)
class Figure:
    """A figure of a method.

    Attributes:
        key: Name in files.
        title: Heading of a column.
        unit: Of what is shown.
        digits: After the point, for readers.
        values: One an episode in that unit, nan where an episode has none.
    """

    key: str
    title: str
    unit: str
    digits: int
    values: Callable[[Episodes], Floats]


FIGURES: Final = (
    Figure("arrived", "arrived", "%", 1, _ended("arrived")),
    Figure("missed", "missed", "%", 1, _ended("missed")),
    Figure("collided", "collided", "%", 1, _ended("collided")),
    Figure("timeout", "timeout", "%", 1, _ended("timeout")),
    Figure("lost", "ever lost", "%", 1, lambda e: _percent(e.was_lost)),
    Figure("error", "error", "m", 3, lambda e: e.error_mean),
    Figure("error_max", "largest error", "m", 3, lambda e: e.error_max),
    Figure("length", "length ratio", "", 3, lambda e: e.length_ratio),
    Figure("exposure", "exposure per metre", "", 3, _per_metre),
    Figure("seconds", "time", "s", 1, _seconds),
)
"""Length ratio and time are those of episodes that arrived."""


@dataclass(frozen=True)
class Cell:
    """One figure of one method.

    Attributes:
        figure: Which.
        value: Over the episodes.
        difference: To the baseline, episode by episode; None for the baseline itself.
    """

    figure: Figure
    value: Interval
    difference: Interval | None


@dataclass(frozen=True)
class Row:
    """All figures of a method in one setting.

    Attributes:
        setting: Name of the setting.
        method: Name of the method.
        episodes: How many.
        cells: In the order of `FIGURES`.
    """

    setting: str
    method: str
    episodes: int
    cells: tuple[Cell, ...]

    def __getitem__(self, key: str) -> Cell:
        """The figure with a key."""
        return next(cell for cell in self.cells if cell.figure.key == key)


def make_rows(
    setting: str, found: Mapping[str, Episodes], baseline: str | None, seed: int
) -> tuple[Row, ...]:
    """The rows of a setting.

    Args:
        setting: Its name.
        found: The episodes of each method, the same ones in the same order.
        baseline: Method that the others are compared with; None, or one that is not there: none.
        seed: Of the bootstrap; each interval has random numbers of its own, so that it does not
            depend on what else is in the table.
    """
    base = None if baseline is None else found.get(baseline)
    rows = []
    for method, episodes in found.items():
        theirs = None if episodes is base else base
        key = [seed, zlib.crc32(setting.encode()), zlib.crc32(method.encode())]
        cells = tuple(
            _cell(figure, episodes, theirs, [*key, zlib.crc32(figure.key.encode())])
            for figure in FIGURES
        )
        rows.append(Row(setting, method, len(episodes), cells))
    return tuple(rows)


def _cell(figure: Figure, ours: Episodes, theirs: Episodes | None, key: list[int]) -> Cell:
    rng = np.random.default_rng(key)
    values = figure.values(ours)
    value = bootstrap(values, rng)
    if theirs is None:
        return Cell(figure, value, None)
    return Cell(figure, value, paired(values, figure.values(theirs), rng))


COLUMNS: Final = (
    "setting", "method", "figure", "unit", "episodes", "counted", "value", "low", "high",
    "difference", "difference_low", "difference_high",
)  # fmt: skip


def to_csv(rows: Sequence[Row]) -> str:
    """One line a figure; empty where there is nothing to tell."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        for cell in row.cells:
            told = [text for part in (cell.value, cell.difference) for text in csv_cells(part)]
            writer.writerow(
                [row.setting, row.method, cell.figure.key, cell.figure.unit, row.episodes,
                 cell.value.count, *told]
            )  # fmt: skip
    return out.getvalue()


def plain(interval: Interval | None) -> dict[str, float | int | None] | None:
    """An interval as JSON has it."""
    if interval is None or interval.count == 0:
        return None
    return {
        "value": interval.value, "low": interval.low, "high": interval.high,
        "count": interval.count,
    }  # fmt: skip


def value_text(cell: Cell, *, brief: bool = False) -> str:
    """The figure with its interval, for readers; brief: whole percents."""
    return interval_text(cell.value, 0 if brief and cell.figure.unit == "%" else cell.figure.digits)


def difference_text(cell: Cell) -> str:
    """The difference to the baseline with its interval and signs; bold where it does not hold 0."""
    if cell.difference is None:
        return ""
    text = interval_text(cell.difference, cell.figure.digits, "+")
    return f"**{text}**" if is_shown(cell.difference) else text


def is_shown(difference: Interval) -> bool:
    """Whether the interval does not hold 0."""
    return bool(difference.low > 0.0 or difference.high < 0.0)
