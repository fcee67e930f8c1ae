"""A sweep as data: contents of report.json and source of the written reports."""

from __future__ import annotations

import math
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field

from ambinav.maps.zones import ZONES
from ambinav.reports.fields import Part
from ambinav.studies.design.sweep.figures import CRITERIA
from ambinav.studies.design.sweep.sweep import Outcome, SweepResult
from ambinav.studies.design.sweep.text import Words, setting_text
from ambinav.studies.design.sweep.turning import WORTH, Turning
from ambinav.studies.design.sweep.vary import VARIABLES
from ambinav.version import __version__

FORMAT: Final = "ambinav-design-sweep/1"


def _rounded(digits: int) -> AfterValidator:
    return AfterValidator(
        lambda value: (
            None if value is None or not math.isfinite(value) else round(value, digits) + 0
        )
    )


Level = Annotated[float | None, _rounded(6)]
Share = Annotated[float | None, _rounded(6)]
Amount = Annotated[float, _rounded(3)]


class VariationPart(Part):
    """A varied variable and its values."""

    name: str
    unit: Literal["deg", "m", ""]
    values: tuple[float, ...]


class RegionPart(Part):
    """The region of the sweep."""

    kind: Literal["map", "polygon", "route"]
    title: str
    amount: Amount = Field(
        description="floor that is explored and that the robot reaches, or travel, in `unit`"
    )
    unit: Literal["m2", "m"]
    places: int = Field(description="that were looked at")
    of_places: int = Field(description="that there are")
    headings: str
    seed: int | None = Field(description="that chose the places; null where all were looked at")


class SettingPart(Part):
    """A scanner over the region."""

    values: dict[str, float | None] = Field(description="null where it is a curve over the range")
    same_beams_as: int | None = Field(
        description="number in `settings`, from 0 on, of the first one with the same beams: itself "
        "if none before has; null where no setting has (of the present scanner)"
    )
    mean: Level
    p95: Level = Field(description="95 % of the region have at most this level")
    worst: Level
    standing: Share = Field(
        description="share of the region where the robot can stand with it; all else is of that"
    )
    zones: dict[str, Share] = Field(description="share of the region")
    areas: dict[str, Amount | None] = Field(description="the same in the region's unit")
    bad: Share = Field(description="share of corridor and open")


class MarginPart(Part):
    """A figure by the criterion, or the advantage of the best setting over another one."""

    value: Level
    low: Level = Field(description="95 % interval; null where the criterion has none")
    high: Level


class TurningPart(Part):
    """One yaw for all places compared with the best yaw at each place."""

    standing: Share = Field(description="share of the region: where it can stand at each yaw")
    fixed_yaw_deg: float
    fixed_mean: Level
    turned_mean: Level
    gain: MarginPart
    fixed_bad: Share
    turned_bad: Share
    shares: dict[str, Share] = Field(description="of the region, by its best yaw in degrees")
    worth: float = Field(description="gain of the mean level from which turning is advised")
    advised: bool


class Document(Part):
    """The whole sweep."""

    format: Literal["ambinav-design-sweep/1"] = "ambinav-design-sweep/1"
    ambinav_version: str = __version__
    summary: str
    environment: str
    scanner: str
    part: str | None
    region: RegionPart
    variations: tuple[VariationPart, ...]
    criterion: str
    criterion_title: str
    best: SettingPart
    best_interval: MarginPart = Field(description="of the best setting's own figure")
    present: SettingPart
    best_text: str = Field(description="the best setting and those with the same beams")
    next_best: SettingPart | None = Field(
        description="the next with other beams; null where there is none"
    )
    margin_over_next: MarginPart | None
    margin_over_present: MarginPart = Field(description="negative where the present one is better")
    as_good: tuple[dict[str, float | None], ...] = Field(
        description="settings that the places looked at do not tell from the best, it included; "
        "of those with the same beams the first"
    )
    settings: tuple[SettingPart, ...] = Field(description="the last variation runs fastest")
    turning: TurningPart | None
    parameters: dict[str, float]
    scanner_yaml: str = Field(description="of the best setting")


def document(result: SweepResult) -> Document:
    """Collect the figures of a sweep, with units in the names."""
    places = result.levels.places
    amount = result.levels.amount
    second = result.order[1] if len(result.order) > 1 else None
    names = [variation.name for variation in result.variations]

    def part(number: int) -> SettingPart:
        return _setting(names, result.outcomes[number], amount, result.twins(number)[0])

    alike = [i for i, row in enumerate(result.rows[:-1]) if row == result.rows[-1]]
    settings = tuple(part(number) for number in range(len(result.outcomes)))

    return Document(
        summary=Words(result).summary,
        environment=result.environment,
        scanner=result.scanner.name,
        part=result.part,
        region=RegionPart(
            kind=result.region.kind,
            title=result.region.title,
            amount=amount,
            unit=result.region.unit,
            places=len(places),
            of_places=places.of,
            headings=result.headings,
            seed=result.seed if places.is_sample else None,
        ),
        variations=tuple(
            VariationPart.of(variation, unit=VARIABLES[variation.name].unit)
            for variation in result.variations
        ),
        criterion=result.criterion,
        criterion_title=CRITERIA[result.criterion],
        best=settings[result.order[0]],
        best_text=setting_text(result, result.order[0]),
        best_interval=MarginPart.of(result.best_interval),
        present=_setting(names, result.present, amount, alike[0] if alike else None),
        next_best=None if second is None else settings[second],
        margin_over_next=None if second is None else MarginPart.of(result.margin(second)),
        margin_over_present=MarginPart.of(result.margin(None)),
        as_good=tuple(settings[i].values for i in result.as_good),
        settings=settings,
        turning=None if result.turning is None else _turning(result.turning),
        parameters=_parameters(result),
        scanner_yaml=result.best_scanner.to_yaml(),
    )


def _parameters(result: SweepResult) -> dict[str, float]:
    """Return the parameters of the maps; `tau` follows from each scanner."""
    model = result.levels.model.as_dict()
    parameters = {name: value for name, value in model.items() if name != "tau"}
    parameters["spacing"] = result.spacing
    if result.robot_radius is None:
        del parameters["robot_radius"]
    else:
        parameters["robot_radius"] = result.robot_radius
    return parameters


def _setting(
    names: list[str], outcome: Outcome, amount: float, same_beams_as: int | None
) -> SettingPart:
    figures = outcome.figures
    values = (None if math.isnan(value) else value for value in outcome.setting.values)
    return SettingPart.of(
        figures,
        values=dict(zip(names, values, strict=True)),
        same_beams_as=same_beams_as,
        zones=dict(figures.zones),
        areas={name: amount * figures.standing * figures.zones[name] for name in ZONES},
    )


def _turning(turning: Turning) -> TurningPart:
    return TurningPart.of(
        turning,
        fixed_yaw_deg=turning.yaws[turning.fixed],
        gain=MarginPart.of(turning.gain),
        shares={f"{yaw:g}": share for yaw, share in zip(turning.yaws, turning.shares, strict=True)},
        worth=WORTH,
        advised=turning.is_worth_it,
    )
