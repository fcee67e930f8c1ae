"""A comparison as data: what report.json holds, and what the written reports are filled from."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any, Literal

import ambinav
from ambinav.compare.plans import Plan
from ambinav.compare.scenario import ALL_PAIRS, Part, Scenario
from ambinav.compare.scenario_file import Loaded
from ambinav.compare.tables import Cell, Row, verdict
from ambinav.drive.bootstrap import Interval

FORMAT = "ambinav-compare/1"


class IntervalPart(Part):
    """A figure with its interval of 95 %; null where there is none, or where it is infinite."""

    value: float | None
    low: float | None
    high: float | None
    runs: int


class FigurePart(Part):
    """A figure of a route."""

    unit: str
    value: IntervalPart
    difference: IntervalPart | None
    ratio: IntervalPart | None


class RowPart(Part):
    """A route of a pair."""

    pair: str
    route: str
    runs: int
    figures: dict[str, FigurePart]


class PlanPart(Part):
    """A route as it was planned."""

    pair: str
    route: str
    planner: str
    seed: int | None
    length_m: float
    exposure_m: float
    bad_metres_m: float
    file: str


class Document(Part):
    """The whole comparison."""

    format: Literal["ambinav-compare/1"] = "ambinav-compare/1"
    created: str
    ambinav_version: str
    name: str
    baseline: str
    environment: dict[str, Any]
    scanner: dict[str, Any]
    verdicts: dict[str, tuple[str, ...]]
    plans: tuple[PlanPart, ...]
    rows: tuple[RowPart, ...]
    pictures: dict[str, tuple[str, ...]]
    parameters: dict[str, Any]


def document(
    loaded: Loaded,
    plans: Sequence[Plan],
    files: Sequence[str],
    rows: Sequence[Row],
    pictures: dict[str, tuple[str, ...]],
) -> Document:
    """Gather a comparison's figures."""
    scenario = loaded.scenario
    verdicts: dict[str, list[str]] = {}
    for row in rows:
        group = [other for other in rows if other.pair == row.pair]
        named = [other for other in group if other.route == scenario.baseline]
        verdicts.setdefault(row.pair, []).append(verdict(row, (*named, *group)[0]))
    return Document(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        ambinav_version=ambinav.__version__,
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
        verdicts={pair: tuple(said) for pair, said in verdicts.items()},
        plans=tuple(
            PlanPart(
                pair=plan.pair,
                route=plan.name,
                planner=plan.route.planner,
                seed=plan.route.seed,
                length_m=round(plan.route.length, 3),
                exposure_m=round(plan.route.exposure, 3),
                bad_metres_m=round(plan.route.bad_metres, 3),
                file=file,
            )
            for plan, file in zip(plans, files, strict=True)
        ),
        rows=tuple(
            RowPart(
                pair=row.pair,
                route=row.route,
                runs=row.runs,
                figures={cell.figure.key: _figure(cell) for cell in row.cells},
            )
            for row in rows
        ),
        pictures=pictures,
        parameters=_parameters(scenario),
    )


def pairs_of(rows: Sequence[Row]) -> list[str]:
    """Names of the pairs in their order, the rows over all of them last."""
    names = list(dict.fromkeys(row.pair for row in rows))
    return sorted(names, key=lambda name: name == ALL_PAIRS)


def _figure(cell: Cell) -> FigurePart:
    return FigurePart(
        unit=cell.figure.unit,
        value=_interval(cell.value),
        difference=None if cell.difference is None else _interval(cell.difference),
        ratio=None if cell.ratio is None else _interval(cell.ratio),
    )


def _interval(interval: Interval) -> IntervalPart:
    value, low, high = (
        float(f"{f:.6g}") if math.isfinite(f) else None
        for f in (interval.value, interval.low, interval.high)
    )
    return IntervalPart(value=value, low=low, high=high, runs=interval.count)


def _parameters(scenario: Scenario) -> dict[str, Any]:
    """All that the figures depend on, defaults written out."""
    guide = scenario.guide
    return {
        "map": scenario.map.model_dump(),
        "robot": asdict(scenario.robot),
        "planning": scenario.planning.model_dump(),
        "routes": [part.model_dump(exclude_none=True) for part in scenario.routes],
        "pairs": [part.model_dump() for part in scenario.pairs],
        "drive": scenario.drive.model_dump(),
        "odometry": asdict(scenario.odometry),
        "people": asdict(scenario.people),
        "localizer": guide if isinstance(guide, str) else asdict(guide),
        "follower": asdict(scenario.follower),
    }
