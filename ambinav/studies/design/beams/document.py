"""The search for fewer beams as data: contents of report.json and source of the reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import Field

from ambinav.maps.zones import ZONES
from ambinav.reports.fields import Part, rounded
from ambinav.studies.design.beams.choose import Choice, GapPart, Method, RandomPart, Subset
from ambinav.studies.design.beams.localizer import InformationPart, UpdatePart
from ambinav.studies.design.beams.loss import POINTS, Points
from ambinav.studies.design.beams.sample import MapSample
from ambinav.studies.design.beams.scanner import ScanMask
from ambinav.version import __version__

FORMAT: Final = "ambinav-design-beams/1"
HOW: Final[dict[Method, str]] = {
    "even": "spread evenly",
    "greedy": "chosen greedily",
    "exact": "the best of all subsets",
    "all": "all of them: nothing can be left out",
}


Share = Annotated[float, rounded(4)]


class LossPart(Part):
    """Loss of a map against the map of all beams, percentage points."""

    zones_points: Points = Field(description="largest change of a zone's share of the floor")
    level_points: Points = Field(description="100 times the mean absolute difference of level")


class SubsetPart(Part):
    """A subset of beams; losses are those of the worst map."""

    beams: tuple[int, ...] = Field(description="indices into the scanner's beams")
    loss: LossPart = Field(description="on the poses that beams were chosen on")
    checked: LossPart = Field(description="on other poses of the same maps")


class CurvePart(Part):
    """Loss by the number of beams: the larger part of `LossPart`, on the worst map, points."""

    method: Literal["even", "greedy"]
    beams: tuple[int, ...]
    points: tuple[Points, ...] = Field(description="on the poses that beams were chosen on")
    checked_points: tuple[Points, ...] = Field(description="on other poses")
    fewest: int | None = Field(description="within the limit on both; null: not followed so far")


class MapPart(Part):
    """A building."""

    name: str
    source: str
    places: int = Field(description="poses that beams were chosen on")
    shares: dict[str, Share] = Field(description="of each zone with all beams, on those poses")
    checked: LossPart = Field(description="of the chosen beams, on other poses")


class MaskPart(Part):
    """Readings of a LaserScan."""

    frame: str
    readings: int
    first_deg: Annotated[float, rounded(4)] = Field(description="of the first reading")
    kept: int


class Document(Part):
    """The whole search."""

    format: Literal["ambinav-design-beams/1"] = "ambinav-design-beams/1"
    ambinav_version: str = __version__
    created: str = Field(description="ISO 8601, UTC")
    summary: str
    scanner: str
    beams: int
    limit_points: float = Field(description="the stated loss")
    method: Method
    how: str
    chosen: SubsetPart
    maps: tuple[MapPart, ...]
    curves: tuple[CurvePart, ...]
    random: tuple[RandomPart, ...]
    gaps: tuple[GapPart, ...] = Field(description="for scanners of few beams")
    updates: tuple[UpdatePart, ...]
    information: InformationPart
    masks: tuple[MaskPart, ...] = Field(description="none where no part of it makes a LaserScan")
    files: tuple[str, ...]
    pictures: tuple[str, ...]
    parameters: dict[str, Any]


def document(
    choice: Choice,
    samples: Sequence[MapSample],
    sources: Sequence[str],
    updates: Sequence[UpdatePart],
    information: InformationPart,
    masks: Sequence[ScanMask],
    parameters: Mapping[str, Any],
) -> Document:
    """Collect the figures, rounded, with units in the names; `files` and `pictures` are empty.

    Args:
        choice: Result of the search.
        samples: The poses of each map that beams were chosen on.
        sources: File of each map.
        updates: Durations of the localizers' updates.
        information: Position accuracy from one scan.
        masks: Readings removed from LaserScan messages; empty if there are no such messages.
        parameters: Parameters of the search, by name.
    """
    made = Document(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        summary="",
        scanner=choice.scanner.name,
        beams=choice.scanner.beams,
        limit_points=choice.limit,
        method=choice.method,
        how=HOW[choice.method],
        chosen=_subset(choice.chosen),
        maps=tuple(
            MapPart(
                name=sample.name,
                source=source,
                places=len(sample.level),
                shares=_shares(sample),
                checked=LossPart.of(loss),
            )
            for sample, source, (_, loss) in zip(samples, sources, choice.each, strict=True)
        ),
        curves=tuple(_curve(choice, method) for method in ("even", "greedy")),
        random=choice.random,
        gaps=choice.gaps,
        updates=tuple(updates),
        information=information,
        masks=tuple(
            MaskPart.of(mask, first_deg=mask.first, kept=mask.readings - len(mask.masked))
            for mask in masks
        ),
        files=(),
        pictures=(),
        parameters=dict(parameters),
    )
    return made.model_copy(update={"summary": summary(made)})


def summary(report: Document) -> str:
    """Summarize the search in a few sentences."""
    count, maps = len(report.chosen.beams), len(report.maps)
    where = report.maps[0].name if maps == 1 else f"each of {maps} maps"
    if report.method == "all":
        return (
            f"No subset of the {report.beams} beams of {report.scanner} stays within "
            f"{report.limit_points:g} points on {where}: all are kept."
        )
    loss = report.chosen.checked
    sentences = [
        f"{count} of {report.beams} beams of {report.scanner}, {report.how}, stay within "
        f"{report.limit_points:g} percentage points on {where}: no zone's share of the "
        f"floor changes by more than {loss.zones_points:.1f} points, and the level by "
        f"{loss.level_points / POINTS:.3f} in the mean."
    ]
    fewest = {curve.method: curve.fewest for curve in report.curves}
    if report.method == "even":
        sentences.append(
            "Greedy search needs as many."
            if fewest["greedy"] == count
            else "Greedy search needs more: what it gains on the poses that it is shown, it loses "
            "on others."
        )
    elif fewest["even"] is not None:
        sentences.append(f"Evenly spread it takes {fewest['even']}.")
    if report.updates:
        shares = ", ".join(f"{update.localizer} {update.ratio:.0%}" for update in report.updates)
        sentences.append(f"Of the time of an update with all beams it takes: {shares}.")
    ratio = report.information.kept_m / max(report.information.all_m, 1e-12)
    sentences.append(
        f"Noise averages out over fewer beams: where every beam errs by itself, one scan gives the "
        f"position with a deviation {ratio:.1f} times that of all beams."
    )
    return " ".join(sentences)


def _subset(subset: Subset) -> SubsetPart:
    return SubsetPart(
        beams=subset.beams, loss=LossPart.of(subset.loss), checked=LossPart.of(subset.checked)
    )


def _curve(choice: Choice, method: Literal["even", "greedy"]) -> CurvePart:
    subsets = choice.curves[method]
    return CurvePart(
        method=method,
        beams=tuple(len(subset.beams) for subset in subsets),
        points=tuple(subset.loss.points for subset in subsets),
        checked_points=tuple(subset.checked.points for subset in subsets),
        fewest=choice.fewest[method],
    )


def _shares(sample: MapSample) -> dict[str, float]:
    shares = np.bincount(sample.zone, weights=sample.weight, minlength=len(ZONES))
    return dict(zip(ZONES, shares.tolist(), strict=True))
