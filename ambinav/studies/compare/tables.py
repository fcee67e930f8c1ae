"""The table of a comparison: figures of each route, with intervals and paired differences."""

from __future__ import annotations

import csv
import io
import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from ambinav.drive.bootstrap import Interval, Statistic, bootstrap, paired
from ambinav.drive.metrics import Metrics
from ambinav.forecasting.forecast import Forecast
from ambinav.reports.table import Cell, Cells, Figure, csv_cells
from ambinav.routes.bad_floor import BadFloor
from ambinav.routes.route import Route
from ambinav.studies.compare.criterion import Change, Verdict
from ambinav.studies.compare.plans import Plan
from ambinav.studies.compare.results import Results, joined_metrics
from ambinav.studies.compare.scenario import ALL_PAIRS


@dataclass(frozen=True)
class RouteFigure(Figure):
    """A figure of a route.

    Attributes:
        source: Field of `Metrics`.
        scale: The field times this is what is shown.
        statistic: Over the runs.
        has_ratio: Whether the ratio to the baseline is given as well.
    """

    source: str
    scale: float = 1.0
    statistic: Statistic = "mean"
    has_ratio: bool = False


FIGURES: Final = (
    RouteFigure("lost", "lost", "%", "lost", 100.0, digits=0, has_ratio=True),
    RouteFigure("collided", "collided", "%", "collided", 100.0, digits=0, has_ratio=True),
    RouteFigure("arrived", "arrived", "%", "arrived", 100.0, digits=0),
    RouteFigure("error_p95", "95th percentile of the error", "m", "position_p95", has_ratio=True),
    RouteFigure(
        "error_p95_median", "the same, median run", "m", "position_p95", statistic="median",
        has_ratio=True,
    ),
    RouteFigure("error_rmse", "RMSE", "m", "position_rmse", has_ratio=True),
    RouteFigure("error_along", "RMSE along", "m", "weak_rmse"),
    RouteFigure("error_across", "RMSE across", "m", "strong_rmse"),
    RouteFigure("heading_rmse", "heading RMSE", "°", "heading_rmse", 180.0 / math.pi, digits=1),
    RouteFigure("nees", "NEES", "", "nees", 1.0, digits=1),
    RouteFigure("exposure", "exposure", "m", "exposure", 1.0, digits=1, has_ratio=True),
    RouteFigure("length", "length", "m", "length", 1.0, digits=1, has_ratio=True),
    RouteFigure("seconds", "time", "s", "seconds", 1.0, digits=0),
)  # fmt: skip


@dataclass(frozen=True)
class Row(Cells[RouteFigure]):
    """All figures of a route.

    Attributes:
        pair: Name of the pair, or `ALL_PAIRS`.
        route: Name of the route.
        runs: How many.
        planned: Length of the route as planned, metres; over all pairs their sum.
        floor: Metres of the route as planned in corridor and in open zones; over all pairs their
            sums, and the longest stretches of all.
        cells: The figures in the order of `FIGURES`.
        forecasts: Forecast of the route; over all pairs one for each. () where there is none, and
            over all pairs where one lacks.
    """

    pair: str
    route: str
    runs: int
    planned: float
    floor: BadFloor
    cells: tuple[Cell[RouteFigure], ...]
    forecasts: tuple[Forecast, ...] = ()

    @property
    def forecast_lost(self) -> float:
        """Forecast of the share of lost robots, %; over all pairs the mean; nan without one."""
        shares = [100.0 * forecast.lost_probability for forecast in self.forecasts]
        return sum(shares) / len(shares) if shares else math.nan

    @property
    def forecast_text(self) -> str:
        """Format `forecast_lost`; "" without one."""
        return f"{self.forecast_lost:.1f}" if self.forecasts else ""


def make_rows(
    plans: Sequence[Plan],
    results: Sequence[Results],
    baseline: str,
    seed: int,
    forecasts: Sequence[Forecast | None] = (),
) -> tuple[Row, ...]:
    """Return the rows of all pairs, then those of the routes common to all pairs.

    Args:
        plans: The routes.
        results: Results of their drives, in the same order.
        baseline: Name of the route that the others are compared with. A pair that lacks it is
            compared with its first.
        seed: Seed of the bootstrap; each interval has random numbers of its own, so that it does
            not depend on what else is in the table.
        forecasts: Of the routes, in the same order; None where there is none. (): there are none.
    """
    groups: dict[str, dict[str, Metrics]] = {}
    planned: dict[tuple[str, str], list[tuple[Route, Forecast | None]]] = {}
    for plan, result, forecast in zip(
        plans, results, forecasts or [None] * len(plans), strict=True
    ):
        groups.setdefault(plan.pair, {})[plan.name] = result.metrics
        for pair in (plan.pair, ALL_PAIRS):
            planned.setdefault((pair, plan.name), []).append((plan.route, forecast))
    if len(groups) > 1:
        first, *others = groups.values()
        everywhere = [name for name in first if all(name in other for other in others)]
        if everywhere:
            groups[ALL_PAIRS] = {
                name: joined_metrics([group[name] for group in (first, *others)])
                for name in everywhere
            }
    rows = []
    for pair, group in groups.items():
        against = baseline if baseline in group else next(iter(group))
        for name, measured in group.items():
            theirs = None if name == against else group[against]
            key = [seed, zlib.crc32(pair.encode()), zlib.crc32(name.encode())]
            cells = tuple(
                _cell(figure, measured, theirs, [*key, zlib.crc32(figure.key.encode())])
                for figure in FIGURES
            )
            routes, made = zip(*planned[pair, name], strict=True)
            length = sum(route.length for route in routes)
            floor = BadFloor.joined([BadFloor.of(route) for route in routes])
            forecasts_of_route = () if None in made else made
            rows.append(Row(pair, name, len(measured), length, floor, cells, forecasts_of_route))
    return tuple(rows)


def _cell(
    figure: RouteFigure, ours: Metrics, theirs: Metrics | None, key: list[int]
) -> Cell[RouteFigure]:
    rng = np.random.default_rng(key)
    plain = getattr(ours, figure.source)
    value = bootstrap(plain, rng, statistic=figure.statistic).scaled(figure.scale)
    if theirs is None:
        return Cell(figure, value, None)
    other = getattr(theirs, figure.source)
    difference = paired(plain, other, rng, statistic=figure.statistic).scaled(figure.scale)
    ratio = None
    if figure.has_ratio:
        ratio = paired(plain, other, rng, compare="ratio", statistic=figure.statistic)
    return Cell(figure, value, difference, ratio)


COLUMNS: Final = (
    "pair", "route", "figure", "unit", "runs", "value", "low", "high",
    "difference", "difference_low", "difference_high", "ratio", "ratio_low", "ratio_high",
)  # fmt: skip


def to_csv(rows: Sequence[Row]) -> str:
    """Format one line for each figure; empty where there is no value, inf for a ratio to zero.

    Figures of a route as planned have no intervals; their names begin with `planned`. Nor has
    `forecast_lost`, which is there for routes with a forecast.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for row in rows:
        for cell in row.cells:
            figures = [
                f for part in (cell.value, cell.difference, cell.ratio) for f in csv_cells(part)
            ]
            figure = cell.figure
            writer.writerow([row.pair, row.route, figure.key, figure.unit, row.runs, *figures])
        base = next(other for other in rows if other.pair == row.pair and other.is_baseline)
        for (key, ours), theirs in zip(
            row.floor.figures.items(), base.floor.figures.values(), strict=True
        ):
            difference = "" if row is base else f"{ours - theirs:.6g}"
            figures = [f"{ours:.6g}", "", "", difference, *[""] * 5]
            name = f"planned_{key.removesuffix('_m')}"
            writer.writerow([row.pair, row.route, name, "m", row.runs, *figures])
        if row.forecasts:
            figures = [f"{row.forecast_lost:.6g}", *[""] * 8]
            writer.writerow([row.pair, row.route, "forecast_lost", "%", row.runs, *figures])
    return out.getvalue()


def judge(row: Row, baseline: Row) -> Verdict:
    """Judge a route against the baseline of its pair by the intervals of the table.

    Raises:
        ValueError: the row is the baseline itself.
    """
    return Verdict(
        row.runs,
        _judged(row["lost"], baseline["lost"]),
        _judged(row["error_p95"], baseline["error_p95"]),
        _judged(row["collided"], baseline["collided"]),
        row.planned / baseline.planned,
    )


def _judged(ours: Cell[RouteFigure], theirs: Cell[RouteFigure]) -> Change:
    if ours.difference is None or ours.ratio is None:
        raise ValueError("the baseline changes nothing")
    return Change(
        _unscaled(ours, ours.value),
        _unscaled(theirs, theirs.value),
        _unscaled(ours, ours.difference),
        ours.ratio,
    )


def _unscaled(cell: Cell[RouteFigure], interval: Interval) -> Interval:
    scale = cell.figure.scale
    return Interval(
        interval.value / scale, interval.low / scale, interval.high / scale, interval.count
    )
