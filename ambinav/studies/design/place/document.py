"""A placement as data: contents of report.json and source of the written reports."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import shapely
from pydantic import Field

from ambinav.geometry.environment import Environment
from ambinav.reports.fields import Part
from ambinav.reports.pages import counted
from ambinav.studies.design.improved import ImprovedPart, most_improved
from ambinav.studies.design.place.aged import AgedPart
from ambinav.studies.design.place.candidates import PlaceRules
from ambinav.studies.design.place.exact import CoveragePart, OptimumPart
from ambinav.studies.design.place.greedy import NOTHING
from ambinav.studies.design.place.placed_part import (
    BuildingDocument,
    PlacedPart,
    Rounded,
    head_of,
    placed_geojson,
)
from ambinav.studies.design.place.study import Remedy
from ambinav.studies.design.place.submodularity import FEW, Violations

FORMAT: Final = "ambinav-design-place/1"

REFLECTORS_WEIGH: Final = (
    "A reflector weighs as a wall of its width does, as for localizers that weigh beams. A robot "
    "that detects reflectors and knows their places gains more: for it use `ambinav design "
    "reflectors`."
)
SOLVER_LACKING: Final = "OR-Tools is not installed: pip install 'ambinav[design]'."


class BadPart(Part):
    """Bad area, or length of routes, and level on the floor that counts."""

    bad: Rounded = Field(description="corridor and open zones, in `unit`")
    level: Rounded = Field(
        description="sum of the level over what was bad at first, in `unit`: the smaller the better"
    )


class ObstaclePart(PlacedPart):
    """A placed obstacle, in the order of placement."""

    reflective: bool
    alone: Rounded = Field(description="bad floor that it takes away if it is the only one")
    gain: Rounded = Field(description="bad floor that it takes away after those before it")
    left: Rounded = Field(description="bad floor that is left then")


class RulesPart(Part):
    """Kind of the obstacles and the rules for their positions."""

    kind: str
    radius_m: float | None = Field(description="of a post")
    width_m: float | None = Field(description="of a panel or a tag")
    bottom_m: float | None = Field(description="above the floor; null: the building is a plan")
    top_m: float | None = Field(
        description="above the floor; null: the building is a plan, or up to its height"
    )
    min_passage_m: float
    on_walls: bool
    free_standing: bool
    candidates: int = Field(description="places that were tried")


class GrowthPart(Part):
    """Gain of an obstacle: bad floor plus a quarter of the level on it, in `unit`."""

    without: Rounded = Field(description="without the other obstacle")
    beside: Rounded = Field(description="beside it")


class GainsPart(Part):
    """Test of submodularity by samples: gains that only shrink as obstacles are added."""

    samples: int
    grown: int = Field(description="samples in which a gain grew beside another obstacle")
    largest: GrowthPart | None = Field(description="the one that grew most; null: none grew")
    typical: GrowthPart | None = Field(description="medians over all samples; null: no sample")


class Document(BuildingDocument):
    """The whole report."""

    format: str = FORMAT
    regions: tuple[str, ...]
    unit: str = Field(description="of bad floor: m2, or m of routes")
    summary: str
    before: BadPart
    after: BadPart
    asked: int = Field(description="obstacles that were asked for")
    obstacles: tuple[ObstaclePart, ...]
    improved: tuple[ImprovedPart, ...] = Field(
        description="the three places where most floor becomes good, the largest first"
    )
    rules: RulesPart
    effects_computed: int = Field(description="how often an obstacle's effect was computed")
    exchanged: int = Field(description="obstacles put elsewhere, or moved, once all were chosen")
    gains: GainsPart | None = Field(description="null: not measured")
    optima: tuple[OptimumPart, ...]
    coverage: CoveragePart | None
    aged: AgedPart | None = Field(description="null: not requested")
    remarks: tuple[str, ...]
    parameters: dict[str, Any] = Field(description="of the map")
    geojson: dict[str, Any] = Field(description="the obstacles, as placement.geojson holds them")


def document(study: Remedy, requested: int) -> Document:
    """Collect the figures of the report."""
    rules, placement = study.rules, study.placement
    obstacles = obstacle_parts(study)
    gains = study.violations
    return Document(
        **head_of(study.environment, study.scanner, study.reach),
        regions=tuple(region.title for region in study.regions),
        unit=study.unit,
        summary=_summary(study),
        before=BadPart.of(placement.before),
        after=BadPart.of(placement.after),
        asked=requested,
        obstacles=obstacles,
        improved=_improved(study),
        rules=rules_part(rules, len(study.trials.candidates), study.environment),
        effects_computed=placement.looked,
        exchanged=placement.exchanged,
        gains=None if gains is None else _gains(gains),
        optima=study.optima,
        coverage=study.coverage,
        aged=study.aged,
        remarks=tuple(_remarks(study, requested)),
        parameters=study.amap.parameters,
        geojson=obstacles_geojson(study),
    )


def _improved(study: Remedy) -> tuple[ImprovedPart, ...]:
    """Return the places of the floor that was asked for that improve most; none on routes."""
    if not study.chosen or study.unit == "m":
        return ()
    shapes = [region.shape for region in study.regions if region.shape is not None]
    within = shapely.union_all(shapes) if shapes else None
    return most_improved(study.amap, study.after, study.parts, within)


def rules_part(rules: PlaceRules, candidates: int, environment: Environment) -> RulesPart:
    """Return the rules for obstacles of a kind, with the number of places that were tried."""
    return RulesPart.of(
        rules,
        radius_m=rules.radius if rules.kind == "post" else None,
        width_m=None if rules.kind == "post" else rules.width,
        bottom_m=None if environment.space is None else rules.bottom,
        top_m=rules.top,
        free_standing=rules.free_standing and rules.kind != "tag",
        candidates=candidates,
    )


def obstacle_parts(study: Remedy, left: Sequence[float] | None = None) -> tuple[ObstaclePart, ...]:
    """Return the placed obstacles in order.

    Args:
        study: What was placed.
        left: Bad floor left after each; None: as the placement has it.
    """
    if left is None:
        left = [placed.after.bad for placed in study.placement.placed]
    before = (study.placement.before.bad, *left)
    return tuple(
        ObstaclePart.of(
            placed.candidate,
            number=number,
            reflective=placed.candidate.obstacle.reflective,
            alone=placed.alone.bad,
            gain=before[number - 1] - before[number],
            left=before[number],
        )
        for number, placed in enumerate(study.placement.placed, start=1)
    )


def obstacles_geojson(study: Remedy) -> dict[str, Any]:
    """Return the obstacles as GeoJSON, readable by the page of `ambinav serve`."""
    placed = enumerate(study.placement.placed, start=1)
    gains = [{"number": k, "gain": round(step.gain.bad, 4) + 0.0} for k, step in placed]
    return placed_geojson(study.chosen, gains)


def amount(value: float, unit: str) -> str:
    """Format an area or a length of routes."""
    return f"{value:,.1f} {'m²' if unit == 'm2' else 'm'}"


def _summary(study: Remedy) -> str:
    placement, rules = study.placement, study.rules
    before, after = placement.before.bad, placement.after.bad
    where = " and ".join(region.title for region in study.regions)
    if not placement.placed:
        return (
            f"No {rules.kind} ({rules.size_text}) helps {study.scanner.name} in "
            f"{study.environment.name}: bad floor of {where} stays {amount(before, study.unit)}."
        )
    share = f" ({(before - after) / before:.0%} less)" if before >= NOTHING else ""
    return (
        f"{counted(len(placement.placed), rules.kind)} ({rules.size_text}) for "
        f"{study.scanner.name} in {study.environment.name}: bad floor of {where} goes from "
        f"{amount(before, study.unit)} to {amount(after, study.unit)}{share}."
    )


def _gaining_together(study: Remedy) -> list[str]:
    """Return numbers of obstacles that gain more after the earlier ones than alone."""
    placed = enumerate(study.placement.placed, start=1)
    return [
        str(number)
        for number, obstacle in placed
        if obstacle.gain.bad - obstacle.alone.bad >= NOTHING
    ]


def enough_text(study: Remedy, requested: int) -> str:
    """Explain why fewer obstacles than requested are placed."""
    kind, placed = study.rules.kind, len(study.placement.placed)
    nothing = f"takes away less than {NOTHING:g} {amount(0.0, study.unit).split()[1]}"
    if not placed:
        return f"None of {requested} {kind}s was put up: each {nothing} of bad floor."
    if study.placement.crowded:
        return (
            f"{placed} of {requested} {kind}s: no further place leaves "
            f"{study.rules.min_passage:g} m to theirs."
        )
    which = f"{placed} of {requested} {kind}s {'suffices' if placed == 1 else 'suffice'}: "
    if study.placement.after.bad < NOTHING:
        return which + "no bad floor is left."
    return which + f"a further one {nothing} of bad floor."


def _remarks(study: Remedy, requested: int) -> list[str]:
    """Return further remarks for the report."""
    remarks, placed = [], len(study.placement.placed)
    kind, unit = study.rules.kind, study.unit
    if placed < requested:
        remarks.append(enough_text(study, requested))
    if study.rules.reflective and study.rules.kind != "tag":
        remarks.append("They reflect, and the scanner's intensity channel sees it.")
    if study.rules.reflective:
        remarks.append(REFLECTORS_WEIGH)
    gains = study.violations
    if gains is not None and gains.samples:
        if gains.grown:
            most = gains.largest
            remarks.append(
                f"Gains are not submodular here: in {gains.grown} of "
                f"{counted(gains.samples, 'sample')} a {kind} gained more beside another one than "
                f"without it, at most {amount(gains.beside[most], unit)} instead of "
                f"{amount(gains.without[most], unit)}. Greedy then has no bound on how far it is "
                "from the optimum."
            )
        elif helped := _gaining_together(study):
            remarks.append(
                f"Gains are not submodular here: {kind}{'s' if len(helped) > 1 else ''} "
                f"{', '.join(helped)} {'gain' if len(helped) > 1 else 'gains'} more after those "
                "before than alone. "
                "Greedy then has no bound on how far it is from the optimum."
            )
        else:
            remarks.append(
                f"In none of {counted(gains.samples, 'sample')} did a {kind} gain more beside "
                "another one than without it: "
                + (
                    "gains look submodular here."
                    if gains.samples >= FEW
                    else "too few to say more."
                )
            )
    if gains is not None and not gains.samples:
        remarks.append(
            "No two of the candidates that were sampled change the same floor: their gains add up. "
            "Candidates closer together, for a part of the floor, may do more together."
        )
    if gains is not None and study.coverage is None and placed:
        remarks.append(f"Maximum coverage was not solved: {SOLVER_LACKING}")
    return remarks


def _gains(gains: Violations) -> GainsPart:
    def growth(without: float, beside: float) -> GrowthPart:
        return GrowthPart(without=without, beside=beside)

    most = gains.largest if gains.grown else None
    return GainsPart(
        samples=gains.samples,
        grown=gains.grown,
        largest=None if most is None else growth(gains.without[most], gains.beside[most]),
        typical=growth(*gains.typical) if gains.samples else None,
    )
