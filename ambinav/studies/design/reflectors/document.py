"""A layout of reflectors as data: contents of report.json and source of the written reports."""

from __future__ import annotations

import math
from typing import Annotated, Any, Final

from pydantic import Field

from ambinav.reports.fields import Part, rounded
from ambinav.studies.design.improved import ImprovedPart, largest_places
from ambinav.studies.design.place.placed_part import (
    BuildingDocument,
    PlacedPart,
    head_of,
    placed_geojson,
)
from ambinav.studies.design.reflectors.study import GOOD, Coverage, ReflectorLayout

FORMAT: Final = "ambinav-design-reflectors/1"

Area = Annotated[float, rounded(2)]


class CoveragePart(Part):
    """Floor that counts on which a robot navigates by reflectors, square metres."""

    enough_m2: Area = Field(description="enough reflectors are in view")
    unique_m2: Area = Field(description="and no wrong pose shows the same")
    good_m2: Area = Field(description="and the position is precise enough")
    good_share: Annotated[float, rounded(4)] = Field(description="of all floor that counts")
    std_m: Annotated[float, rounded(4)] | None = Field(
        description="median standard deviation of the position, where enough are in view"
    )


class ReflectorPart(PlacedPart):
    """A new reflector, in the order of installation."""

    after: CoveragePart = Field(description="with it and those before it")


class NeedsPart(Part):
    """Needs of the robot."""

    needed: int = Field(description="reflectors in view at a time")
    max_range_m: float | None = Field(description="null: the range of the sensor")
    max_incidence_deg: float
    tolerance_m: float
    max_std_m: float


class Document(BuildingDocument):
    """The whole report."""

    format: str = FORMAT
    summary: str
    floor_m2: Area = Field(description="all floor that counts")
    present: int = Field(description="reflectors that the building has")
    asked: int = Field(description="new reflectors that were asked for, at most")
    tried: int = Field(description="places that were tried")
    before: CoveragePart
    after: CoveragePart = Field(description="of the changed building, computed anew")
    reflectors: tuple[ReflectorPart, ...] = Field(description="the new ones")
    improved: tuple[ImprovedPart, ...] = Field(
        description="the three places where the robot can navigate on most new floor, the largest "
        "first"
    )
    needs: NeedsPart
    remarks: tuple[str, ...]
    parameters: dict[str, Any] = Field(description="of the map")
    geojson: dict[str, Any] = Field(description="the new reflectors, as reflectors.geojson")


def document(layout: ReflectorLayout, requested: int) -> Document:
    """Collect the figures of the report."""
    before, after = layout.maps
    won = layout.parts.counted & (before != GOOD) & (after == GOOD)
    return Document(
        **head_of(layout.environment, layout.scanner, layout.reach),
        summary=_summary(layout),
        floor_m2=layout.before.floor,
        present=layout.present,
        asked=requested,
        tried=layout.tried,
        before=_coverage(layout.before),
        after=_coverage(layout.after),
        reflectors=tuple(
            ReflectorPart.of(step.candidate, number=number, after=_coverage(step.after))
            for number, step in enumerate(layout.steps, start=1)
        ),
        improved=largest_places(layout.amap, won, layout.parts),
        needs=NeedsPart.of(layout.rules, max_incidence_deg=layout.rules.max_incidence),
        remarks=tuple(_remarks(layout, requested)),
        parameters=layout.amap.parameters,
        geojson=placed_geojson(
            layout.chosen, [{"number": k + 1} for k in range(len(layout.steps))]
        ),
    )


def _coverage(coverage: Coverage) -> CoveragePart:
    return CoveragePart.of(
        coverage,
        good_share=coverage.good / coverage.floor,
        std_m=None if math.isnan(coverage.std) else coverage.std,
    )


def _summary(layout: ReflectorLayout) -> str:
    before, after, count = layout.before, layout.after, len(layout.steps)
    where = f"{layout.scanner.name} navigates in {layout.environment.name} on"
    present = f"{layout.present} reflector{'' if layout.present == 1 else 's'}"
    if not count and not layout.present:
        return (
            f"There are no reflectors in {layout.environment.name}: by those {layout.scanner.name} "
            "navigates nowhere."
        )
    if not count:
        return (
            f"By {present} {where} {before.good:,.1f} of {before.floor:,.1f} m² "
            f"({before.good / before.floor:.0%})."
        )
    new = f"{count} new reflector{'' if count == 1 else 's'}"
    new += f" and {layout.present} present" if layout.present else ""
    return (
        f"By {new} {where} {after.good:,.1f} of {after.floor:,.1f} m² "
        f"({after.good / after.floor:.0%})"
        f"{f', before on {before.good:,.1f} m²' if layout.present else ''}."
    )


def _remarks(layout: ReflectorLayout, requested: int) -> list[str]:
    """Return why floor is left on which the robot cannot navigate, and why fewer are placed."""
    after, rules = layout.after, layout.rules
    remarks = []
    few, alike = after.floor - after.enough, after.enough - after.unique
    vague = after.unique - after.good
    reasons = (
        (few, f"fewer than {rules.needed} reflectors are in view"),
        (alike, "another pose shows the same reflectors"),
        (vague, f"the position is less certain than {rules.max_std:g} m"),
    )
    left = [f"on {area:,.1f} m² {reason}" for area, reason in reasons if area >= 0.05]
    if left:
        remarks.append(f"Elsewhere it cannot: {', '.join(left)}.")
    if layout.steps and after.good <= layout.before.good:
        more = "give more of them, or a smaller --needed"
        if after.enough <= layout.before.enough:
            more += "; few beams meet a thin one from afar: a larger --radius or more beams help"
        remarks.append(
            f"The new reflectors add no floor on which it can navigate; where {rules.needed} must "
            f"be in view, {more}."
        )
    if len(layout.steps) < requested:
        why = "no floor is left" if not left else "no further place helps"
        if left and len(layout.steps) == layout.tried:
            why = "there are no more places; give more --candidates"
        remarks.append(f"{len(layout.steps)} of {requested} new reflectors: {why}.")
    return remarks
