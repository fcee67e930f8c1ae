"""The figures of a method: shares and means over its episodes, with intervals and differences."""

from __future__ import annotations

import csv
import io
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from ambinav.drive.bootstrap import Interval, grouped_weights, paired_share, percentiles, share
from ambinav.reports.table import Cell, Cells, Figure, csv_cells
from ambinav.runtime.array_types import Bools, Floats

if TYPE_CHECKING:
    from ambinav_envs.evaluation import Episodes


PERCENT: Final = 100.0

Parts = tuple[Floats, Floats]


def mean_parts(values: Floats) -> Parts:
    """Return numerator and denominator of a mean over the episodes that have a value (not nan)."""
    is_given = ~np.isnan(values)
    return np.where(is_given, values, 0.0), is_given.astype(np.float64)


def _percent(which: Bools) -> Parts:
    return mean_parts(np.where(which, PERCENT, 0.0))


def _ended(outcome: str) -> Callable[[Episodes], Parts]:
    def parts(episodes: Episodes) -> Parts:
        from ambinav_envs.simulation.layout import OUTCOMES

        return _percent(episodes.ended(OUTCOMES.index(outcome)))

    return parts


def _seconds(episodes: Episodes) -> Parts:
    return mean_parts(np.where(np.isnan(episodes.length_ratio), np.nan, episodes.seconds))


@dataclass(frozen=True)
class EpisodeFigure(Figure):
    """A figure of a method.

    Attributes:
        parts: Two numbers an episode: the figure is the sum of the first over that of the second.
        is_share: True for a share of episodes, in percent.
    """

    parts: Callable[[Episodes], Parts]
    is_share: bool = False


FIGURES: Final = (
    EpisodeFigure("arrived", "arrived", "%", _ended("arrived"), is_share=True, digits=1),
    EpisodeFigure("missed", "missed", "%", _ended("missed"), is_share=True, digits=1),
    EpisodeFigure("collided", "collided", "%", _ended("collided"), is_share=True, digits=1),
    EpisodeFigure("timeout", "timeout", "%", _ended("timeout"), is_share=True, digits=1),
    EpisodeFigure(
        "lost", "ever lost", "%", lambda e: _percent(e.was_lost), is_share=True, digits=1
    ),
    EpisodeFigure("error", "error", "m", lambda e: mean_parts(e.error_mean), digits=3),
    EpisodeFigure("error_max", "largest error", "m", lambda e: mean_parts(e.error_max), digits=3),
    EpisodeFigure("length", "length ratio", "", lambda e: mean_parts(e.length_ratio), digits=3),
    EpisodeFigure(
        "exposure", "exposure per metre", "", lambda e: (e.exposure, e.travelled), digits=3
    ),
    EpisodeFigure("seconds", "time", "s", _seconds, digits=1),
)
"""Length ratio and time are means of the episodes that arrived. Exposure per metre is that of all
episodes together by the metres of all of them, as in `Episodes.summary`."""

TASK_FIGURES: Final = (
    EpisodeFigure("spl", "SPL", "", lambda e: mean_parts(e.spl), digits=3),
    EpisodeFigure(
        "lost_at_end",
        "lost at the end",
        "%",
        lambda e: _percent(e.lost_at_end),
        is_share=True,
        digits=1,
    ),
    EpisodeFigure(
        "lost_time", "time lost", "%", lambda e: (100.0 * e.lost_seconds, e.seconds), digits=1
    ),
    EpisodeFigure("return", "return", "", lambda e: mean_parts(e.reward), digits=2),
)
"""Figures that make numbers of other papers comparable: `Episodes.spl`, how an episode ends for the
localizer, the seconds lost of all episodes together by those of all of them, and the undiscounted
sum of the rewards (see `returns`)."""
ALL_FIGURES: Final = FIGURES + TASK_FIGURES


@dataclass(frozen=True)
class Row(Cells[EpisodeFigure]):
    """All figures of a method in one setting.

    Attributes:
        setting: Name of the setting.
        method: Name of the method.
        episodes: Number of episodes.
        cells: In the order of `ALL_FIGURES`.
        score: See `normalized`; None: nobody was there to normalize by.
    """

    setting: str
    method: str
    episodes: int
    cells: tuple[Cell[EpisodeFigure], ...]
    score: Interval | None = None

    def to_plain(self) -> dict[str, Any]:
        """Return the figures and their differences to the baseline for JSON."""
        return {
            "figures": {cell.figure.key: plain(cell.value) for cell in self.cells},
            "differences": {cell.figure.key: plain(cell.difference) for cell in self.cells},
        }


def ratios(above: Floats, below: Floats) -> Floats:
    """Divide numerators by denominators; nan where the denominator is 0."""
    out = np.full(np.shape(below), np.nan)
    np.divide(above, below, out=out, where=below > 0.0)
    return out


def draws(setting: str, building: NDArray[np.str_], seed: int) -> Iterator[Floats]:
    """Return how often each bootstrap draw holds each episode; see `grouped_weights`.

    The draws are the same every time.

    Args:
        setting: Its name.
        building: Building of each episode, shape (E,).
        seed: Seed of the bootstrap.
    """
    return grouped_weights(building, np.random.default_rng([seed, zlib.crc32(setting.encode())]))


def make_rows(
    setting: str, episodes: Mapping[str, Episodes], baseline: str | None, seed: int
) -> tuple[Row, ...]:
    """Return the rows of a setting.

    Args:
        setting: Its name.
        episodes: The episodes of each method, the same ones in the same order.
        baseline: Method that the others are compared with; None, or one that is not there: none.
        seed: Seed of the bootstrap. All methods of a setting have the same draws, so that a row
            does not depend on what else is in the table.
    """
    base = None if baseline is None else episodes.get(baseline)
    theirs = {
        name: None if base is None or driven is base else base for name, driven in episodes.items()
    }
    columns = {name: _columns(driven, theirs[name]) for name, driven in episodes.items()}
    sums: dict[str, list[Floats]] = {name: [] for name in episodes}
    keys = [driven.building for driven in episodes.values()]
    for weights in draws(setting, keys[0], seed) if keys else ():
        for name in episodes:
            sums[name].append(weights @ columns[name])
    return tuple(
        Row(
            setting,
            name,
            len(driven),
            _cells(columns[name], np.concatenate(sums[name], axis=1), driven.building),
        )
        for name, driven in episodes.items()
    )


def _columns(ours: Episodes, theirs: Episodes | None) -> Floats:
    """Return the terms of each figure's ratio of sums: shape (1, E, 2 F), or (3, E, 2 F).

    The other two layers are ours and theirs in the episodes in which both have a value.
    """
    parts = np.array([figure.parts(ours) for figure in ALL_FIGURES])
    layers = [parts]
    if theirs is not None:
        their_parts = np.array([figure.parts(theirs) for figure in ALL_FIGURES])
        in_both = ((parts[:, 1] > 0.0) & (their_parts[:, 1] > 0.0))[:, None]
        layers += [np.where(in_both, parts, 0.0), np.where(in_both, their_parts, 0.0)]
    return np.array([np.vstack(list(layer)).T for layer in layers])


def _cells(
    columns: Floats, drawn: Floats, building: NDArray[np.str_]
) -> tuple[Cell[EpisodeFigure], ...]:
    """Compute the figures from the columns and their sums in each draw, (1 or 3, D, 2 F).

    Shares have score intervals, with the buildings as groups, and all others those of the draws.
    """
    totals = columns.sum(axis=1, keepdims=True)
    value, sampled = (ratios(sums[..., ::2], sums[..., 1::2]) for sums in (totals, drawn))
    counts = np.count_nonzero(columns[..., 1::2], axis=1)
    cells = []
    for k, figure in enumerate(ALL_FIGURES):
        if figure.is_share:
            happened = columns[..., 2 * k] > 0.0
            difference = None
            if len(columns) > 1:
                difference = paired_share(*happened[1:], group=building).scaled(PERCENT)
            interval = share(happened[0], group=building).scaled(PERCENT)
            cells.append(Cell(figure, interval, difference))
            continue
        interval = percentiles(value[0, 0, k], sampled[0, :, k], counts[0, k])
        difference = None
        if len(columns) > 1:
            gap, drawn_gap = (values[1, :, k] - values[2, :, k] for values in (value, sampled))
            difference = percentiles(gap[0], drawn_gap, counts[1, k])
        cells.append(Cell(figure, interval, difference))
    return tuple(cells)


SCORE: Final = "normalized_score"
"""Key of `Row.score` in files."""
COLUMNS: Final = (
    "setting", "method", "figure", "unit", "episodes", "counted", "value", "low", "high",
    "difference", "difference_low", "difference_high",
)  # fmt: skip


def to_csv(rows: Sequence[Row]) -> str:
    """Return one line a figure; cells without a value are empty."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        for cell in row.cells:
            texts = [text for part in (cell.value, cell.difference) for text in csv_cells(part)]
            writer.writerow(
                [row.setting, row.method, cell.figure.key, cell.figure.unit, row.episodes,
                 cell.value.count, *texts]
            )  # fmt: skip
        if row.score is not None:
            texts = [*csv_cells(row.score), *csv_cells(None)]
            writer.writerow(
                [row.setting, row.method, SCORE, "", row.episodes, row.score.count, *texts]
            )
    return out.getvalue()


def plain(interval: Interval | None) -> dict[str, float | int | None] | None:
    """Convert an interval for JSON."""
    if interval is None or interval.count == 0:
        return None
    return {
        "value": interval.value, "low": interval.low, "high": interval.high,
        "count": interval.count,
    }  # fmt: skip
