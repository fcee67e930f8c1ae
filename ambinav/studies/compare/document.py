"""A comparison as data: contents of report.json and source of the written reports."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any, Literal

from pydantic import SerializerFunctionWrapHandler, model_serializer

from ambinav.config import ConfigModel
from ambinav.drive.bootstrap import Interval
from ambinav.forecasting.forecast import Forecast
from ambinav.reports.table import Cell
from ambinav.routes.bad_floor import BadFloor
from ambinav.studies.compare.plans import Plan
from ambinav.studies.compare.scenario import ALL_PAIRS, Scenario
from ambinav.studies.compare.scenario_file import ScenarioBundle
from ambinav.studies.compare.tables import RouteFigure, Row, judge
from ambinav.studies.compare.verdict_text import (
    baseline_sentence,
    criterion_text,
    floor_sentence,
    headline,
    sentence,
)
from ambinav.version import __version__


class IntervalPart(ConfigModel):
    """A figure with its 95 % interval; null where there is none, or where it is infinite."""

    value: float | None
    low: float | None
    high: float | None
    runs: int


class FigurePart(ConfigModel):
    """A figure of a route."""

    unit: str
    value: IntervalPart
    difference: IntervalPart | None
    ratio: IntervalPart | None


class PlannedPart(ConfigModel):
    """Planned figures of a route, metres; over all pairs: sums, and the longest stretches."""

    length_m: float
    corridor_m: float
    longest_corridor_m: float
    open_m: float
    longest_open_m: float
    unexplored_m: float


class CausePart(ConfigModel):
    """Stretch of a route on which robots are forecast to get lost."""

    probability: float
    start_m: float
    end_m: float
    x_m: float
    y_m: float
    kind: str
    direction_rad: float
    """Along it the error is largest; from the x axis, counter-clockwise, 0 to pi."""


class ForecastPart(ConfigModel):
    """Forecast of a route; over all pairs the mean probability alone."""

    lost_probability: float
    localizer: str
    """Calibrated class of localizer."""
    text: str
    largest_error_m: float | None
    """Root mean square of the position's error, of robots that are not lost."""
    causes: tuple[CausePart, ...]


class RowPart(ConfigModel):
    """A route of a pair."""

    pair: str
    route: str
    runs: int
    figures: dict[str, FigurePart]
    planned: PlannedPart
    forecast: ForecastPart | None = None
    """Absent where the localizer has no calibrated class, or a policy drives."""

    @model_serializer(mode="wrap")
    def _without_absent(self, plain: SerializerFunctionWrapHandler) -> dict[str, Any]:
        part: dict[str, Any] = plain(self)
        if self.forecast is None:
            del part["forecast"]
        return part


class VerdictPart(ConfigModel):
    """The comparison of a route with the baseline of its pair; see `criterion`."""

    route: str
    outcome: Literal["met", "not met", "easy"]
    effect: Literal["better", "worse", "mixed", "none"]
    length_ratio: float
    parts: dict[str, bool]
    text: str


class PairPart(ConfigModel):
    """A pair in words: the result of all its routes, and of each."""

    headline: str
    baseline: str
    text: str
    routes: tuple[VerdictPart, ...]


class PlanPart(ConfigModel):
    """A route as it was planned."""

    pair: str
    route: str
    planner: str
    seed: int | None
    length_m: float
    duration_s: float | None = None
    exposure_m: float
    bad_metres_m: float
    corridor_m: float
    longest_corridor_m: float
    open_m: float
    longest_open_m: float
    unexplored_m: float
    file: str
    differs: str = ""
    """Differences of a policy's scanner and robot from those that it was trained with."""


class LocalizerPart(ConfigModel):
    """The localizer: its name in words, and its limitations with this scanner."""

    name: str
    note: str | None


class Document(ConfigModel):
    """The whole comparison."""

    format: Literal["ambinav-compare/1"] = "ambinav-compare/1"
    created: str
    ambinav_version: str
    name: str
    baseline: str
    environment: dict[str, Any]
    scanner: dict[str, Any]
    localizer: LocalizerPart
    criterion: str
    verdicts: dict[str, PairPart]
    plans: tuple[PlanPart, ...]
    rows: tuple[RowPart, ...]
    pictures: dict[str, tuple[str, ...]]
    overview: str
    drives: tuple[str, ...]
    parameters: dict[str, Any]


def document(
    loaded: ScenarioBundle,
    plans: Sequence[Plan],
    files: Sequence[str],
    rows: Sequence[Row],
    pictures: dict[str, tuple[str, ...]],
    overview: str,
    drives: Sequence[str] = (),
) -> Document:
    """Collect a comparison's figures.

    Args:
        loaded: The scenario.
        plans: The routes.
        files: Files of the saved routes.
        rows: The table.
        pictures: Names of the pictures' files by pair.
        overview: Name of the picture of all pairs.
        drives: Folders with drives for other programs.
    """
    scenario = loaded.scenario
    return Document(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        ambinav_version=__version__,
        name=scenario.name,
        baseline=scenario.baseline,
        environment={
            "name": loaded.environment.name,
            "sha256": loaded.environment.checksum,
            "notes": list(loaded.environment.notes),
        },
        scanner={
            "name": loaded.scanner.name,
            "beams": loaded.scanner.beams,
            "max_range_m": loaded.scanner.max_range,
            "yaml": loaded.scanner.to_yaml(),
        },
        localizer=LocalizerPart(
            name=scenario.chosen_localizer.title,
            note=scenario.chosen_localizer.note(loaded.scanner),
        ),
        criterion=criterion_text(),
        verdicts={pair: _judged(rows, pair) for pair in pairs_of(rows)},
        plans=tuple(
            PlanPart(
                pair=plan.pair,
                route=plan.name,
                planner=plan.route.planner,
                seed=plan.route.seed,
                length_m=round(plan.route.length, 3),
                duration_s=plan.route.duration,
                exposure_m=round(plan.route.exposure, 3),
                bad_metres_m=round(plan.route.bad_metres, 3),
                **_floor(BadFloor.of(plan.route)),
                file=file,
                differs="" if plan.driver is None else plan.driver.differs,
            )
            for plan, file in zip(plans, files, strict=True)
        ),
        rows=tuple(
            RowPart(
                pair=row.pair,
                route=row.route,
                runs=row.runs,
                figures={cell.figure.key: _figure(cell) for cell in row.cells},
                planned=PlannedPart(length_m=round(row.planned, 3), **_floor(row.floor)),
                forecast=_forecast(row.forecasts),
            )
            for row in rows
        ),
        pictures=pictures,
        overview=overview,
        drives=tuple(drives),
        parameters=_parameters(scenario),
    )


def pairs_of(rows: Sequence[Row]) -> list[str]:
    """Return the names of the pairs in order; the rows over all pairs come last."""
    names = list(dict.fromkeys(row.pair for row in rows))
    return sorted(names, key=lambda name: name == ALL_PAIRS)


def _judged(rows: Sequence[Row], pair: str) -> PairPart:
    """Return the verdicts on a pair's routes."""
    pair_rows = [row for row in rows if row.pair == pair]
    base = next(row for row in pair_rows if row.is_baseline)
    verdicts = {row.route: judge(row, base) for row in pair_rows if row is not base}
    floors = {row.route: row.floor for row in pair_rows}
    lost, error, walls = (base[key].value.value for key in ("lost", "error_p95", "collided"))
    return PairPart(
        headline=headline(verdicts, base.route),
        baseline=base.route,
        text=" ".join(
            (
                baseline_sentence(base.runs, lost / 100.0, error, walls / 100.0, base.route),
                floor_sentence(base.floor),
            )
        ),
        routes=tuple(
            VerdictPart(
                route=route,
                outcome=verdict.outcome,
                effect=verdict.effect,
                length_ratio=round(verdict.length, 4),
                parts={
                    "lost": verdict.lost_met,
                    "error": verdict.error_met,
                    "length": verdict.length_met,
                    "walls": verdict.walls_met,
                },
                text=" ".join(
                    (
                        sentence(verdict, route, base.route),
                        floor_sentence(floors[route], base.floor),
                    )
                ),
            )
            for route, verdict in verdicts.items()
        ),
    )


def _figure(cell: Cell[RouteFigure]) -> FigurePart:
    return FigurePart(
        unit=cell.figure.unit,
        value=_interval(cell.value),
        difference=None if cell.difference is None else _interval(cell.difference),
        ratio=None if cell.ratio is None else _interval(cell.ratio),
    )


def _forecast(forecasts: Sequence[Forecast]) -> ForecastPart | None:
    """Return the forecast of a route, or the mean of several."""
    if not forecasts:
        return None
    mean = sum(forecast.lost_probability for forecast in forecasts) / len(forecasts)
    first, single = forecasts[0], len(forecasts) == 1
    return ForecastPart(
        lost_probability=round(mean, 6),
        localizer=first.localizer.name,
        text=first.sentence if single else "",
        largest_error_m=round(float(first.expected_error.max()), 3) if single else None,
        causes=tuple(
            CausePart.model_validate(cause.plain) for cause in (first.causes if single else ())
        ),
    )


def _floor(floor: BadFloor) -> dict[str, Any]:
    """Return metres on bad floor as the report has them."""
    return {name: round(f, 3) for name, f in floor.figures.items()}


def _interval(interval: Interval) -> IntervalPart:
    value, low, high = (
        float(f"{f:.6g}") if math.isfinite(f) else None
        for f in (interval.value, interval.low, interval.high)
    )
    return IntervalPart(value=value, low=low, high=high, runs=interval.count)


def _parameters(scenario: Scenario) -> dict[str, Any]:
    """Return all parameters that the figures depend on, with default values."""
    space_options = asdict(scenario.space).items()
    third = {
        name: value for name, value in space_options if value is not None and value is not False
    }
    return {
        **({"space": third} if third else {}),
        "map": scenario.map.model_dump(),
        "robot": asdict(scenario.robot),
        "planning": scenario.planning.model_dump(),
        "routes": [part.model_dump(exclude_none=True) for part in scenario.routes],
        "pairs": [part.model_dump() for part in scenario.pairs],
        "drive": scenario.drive.model_dump(),
        "odometry": asdict(scenario.odometry),
        "people": asdict(scenario.people),
        "obstacles": scenario.obstacles.model_dump(),
        "localizer": scenario.chosen_localizer.plain,
        "follower": asdict(scenario.follower),
    }
