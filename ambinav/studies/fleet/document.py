"""The results of a fleet as data: of one site and scanner, and of all."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from pydantic import Field

from ambinav.maps.zones import CORRIDOR, OPEN, ZONES
from ambinav.reports.fields import Metres, Part, Share, SquareMetres, rounded
from ambinav.studies.audit.document import Document as AuditDocument

RESULT: Literal["ambinav-fleet-result/1"] = "ambinav-fleet-result/1"
FORMAT: Literal["ambinav-fleet/1"] = "ambinav-fleet/1"
FILE = "fleet.json"
"""The document of all, in the output."""
BAD = (ZONES[CORRIDOR], ZONES[OPEN])
"""Zones that leave a robot lost."""
_REMEDIES: Final = {
    "none": "Plan around it, or use another kind of sensor: no tested change helps",
    "unknown": "Map the building first",
}
"""Advice by decision, where no change is advised."""


class RunPart(Part):
    """Figures that differ from run to run."""

    created: str = Field(description="ISO 8601, UTC")
    seconds: Annotated[float, rounded(3)]
    peak_memory_mb: Annotated[float, rounded(0)] = Field(
        description="largest memory of the process until then, 1e6 bytes"
    )


class Result(Part):
    """The audit of a site for a scanner, or why there is none."""

    format: Literal["ambinav-fleet-result/1"] = RESULT
    site: str
    scanner: str
    building: str = Field(description="as in the table of sites, or relative to the folder")
    status: Literal["done", "failed"]
    error: str = Field(default="", description="why it failed, a sentence")
    digest: str = Field(description="of all that decides the figures")
    mean_level: Share | None = Field(
        default=None, description="mean level of the explored, reachable floor"
    )
    audit: AuditDocument | None = Field(
        default=None, description="without pictures; null: it failed"
    )
    run: RunPart


class FleetFigures(Part):
    """The figures of a site for a scanner: a row of figures.parquet."""

    site: str
    scanner: str
    building: str
    status: str
    error: str
    free_m2: SquareMetres | None = None
    counted_m2: SquareMetres | None = Field(
        default=None, description="explored, reachable floor: what all shares are of"
    )
    localizable_share: Share | None = None
    transition_share: Share | None = None
    corridor_share: Share | None = None
    open_share: Share | None = None
    bad_m2: SquareMetres | None = Field(
        default=None, description="corridor and open zones; null: no floor could be judged"
    )
    bad_share: Share | None = None
    mean_level: Share | None = None
    places: int | None = Field(default=None, description="number of bad places")
    worst_zone: str | None = Field(default=None, description="of the worst place")
    worst_x_m: Metres | None = None
    worst_y_m: Metres | None = None
    worst_area_m2: SquareMetres | None = None
    worst_length_m: Metres | None = None
    decision: str | None = Field(default=None, description="kind of the first advice")
    advice: str | None = Field(
        default=None, description="the first advice, in the imperative; null: nothing to do"
    )
    bad_after_m2: SquareMetres | None = Field(
        default=None, description="bad floor when the advice is followed"
    )
    sentence: str | None = Field(default=None, description="the verdict in a sentence")
    digest: str


class NeedPart(Part):
    """An advice, and where it is the first one."""

    scanner: str
    advice: str
    sites: tuple[str, ...]
    bad_m2: SquareMetres = Field(description="bad floor of these sites")
    removed_m2: SquareMetres = Field(description="of that, removed when it is followed")


class MixPart(Part):
    """A few kinds of scanners for all sites, each site with the one that leaves least bad floor."""

    scanners: dict[str, tuple[str, ...]] = Field(description="the sites that each of them serves")
    bad_m2: SquareMetres = Field(description="bad floor of all sites")
    worst_share: Share = Field(description="largest share of bad floor at a site")


class FleetDocument(Part):
    """The whole fleet."""

    format: Literal["ambinav-fleet/1"] = FORMAT
    ambinav_version: str
    summary: str
    spacing_m: Metres
    radius_m: Metres
    robot_radius_m: Metres | None = Field(description="null: each scanner's own")
    needs: tuple[NeedPart, ...] = Field(description="the largest removed area first")
    mixes: tuple[MixPart, ...] = Field(
        default=(),
        description="the best set of one scanner, of two, and so on, each of which serves all "
        "sites that were audited for several scanners; none for a fleet with one scanner",
    )
    figures: tuple[FleetFigures, ...] = Field(description="by site and scanner")


def figures_of(result: Result) -> FleetFigures:
    """Return the figures of a result."""
    about = {name: getattr(result, name) for name in ("site", "scanner", "building", "status")}
    audit = result.audit
    if audit is None:
        return FleetFigures(**about, error=result.error, digest=result.digest)
    shares: dict[str, Any] = {}
    if audit.floor.counted_area_m2 > 0.0:  # else nobody knows how bad it is
        shares = {f"{zone.zone}_share": zone.share for zone in audit.zones}
        bad = [zone for zone in audit.zones if zone.zone in BAD]
        shares["bad_m2"] = sum(zone.area_m2 for zone in bad)
        shares["bad_share"] = sum(zone.share for zone in bad)
    worst = audit.places[0] if audit.places else None
    verdict = audit.verdict
    first = verdict.advice[0] if verdict is not None and verdict.advice else None
    return FleetFigures(
        **about,
        error="",
        free_m2=audit.floor.free_area_m2,
        counted_m2=audit.floor.counted_area_m2,
        **shares,
        mean_level=result.mean_level,
        places=audit.places_in_all,
        worst_zone=None if worst is None else worst.zone,
        worst_x_m=None if worst is None else worst.x_m,
        worst_y_m=None if worst is None else worst.y_m,
        worst_area_m2=None if worst is None else worst.area_m2,
        worst_length_m=None if worst is None else worst.length_m,
        decision=None if verdict is None else verdict.decision,
        advice=_REMEDIES.get(verdict.decision if verdict else "") if not first else first.title,
        bad_after_m2=None if first is None else first.after_m2,
        sentence=None if verdict is None else verdict.sentence,
        digest=result.digest,
    )
