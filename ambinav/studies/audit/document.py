"""The audit as data: contents of report.json and source of the written reports."""

from __future__ import annotations

import json
import math
from typing import Any, Literal

import numpy as np
from pydantic import Field

from ambinav.maps import schema
from ambinav.maps.zones import MEANINGS, ZONES
from ambinav.plotting.style import ZONE_COLOURS
from ambinav.reports.fields import Degrees, Metres, Part, Share, SquareMetres
from ambinav.sensing.preset_summary import field_of_view
from ambinav.sensing.sight import Sight
from ambinav.studies.audit.aliasing_part import FLOOR_ALIASING, AliasingPart, aliasing_part
from ambinav.studies.audit.ambiguous_regions import AmbiguousRegion
from ambinav.studies.audit.audit import Audit, Finding, heading_words
from ambinav.studies.audit.lost_routes import LostPart, lost_part
from ambinav.studies.audit.post_search import PostsPart, posts_part
from ambinav.studies.audit.verdict import VerdictPart, verdict_part

FORMAT = "ambinav-audit/5"

FLOOR_ZONES = "floor-zones"
FLOOR_LEVEL = "floor-level"
FLOOR_BEST = "floor-best"
FLOOR_WORST = "floor-worst"
"""Pictures of the floor; files end in the format."""


class EnvironmentPart(Part):
    """The building that was audited."""

    name: str
    source: str
    sha256: str
    bounds_m: tuple[Metres, Metres, Metres, Metres] = Field(description="xmin, ymin, xmax, ymax")
    free_area_m2: SquareMetres = Field(description="area of the free cells of the map")
    segments: int = Field(description="number of wall and frontier segments")
    notes: tuple[str, ...] = Field(description="what was repaired or left out in the input")


class ScannerPart(Part):
    """The scanner of the audit."""

    name: str
    description: str
    kind: str
    beams: int
    aperture_deg: Degrees = Field(description="field of view, cones included")
    max_range_m: Metres
    source: str = Field(description="where the scanner's figures come from")
    yaml: str = Field(description="the whole scanner, as a file that --scanner takes")


class FloorPart(Part):
    """The floor that counts, and the robot it is judged for."""

    robot_radius_m: Metres = Field(description="of the disc that covers the robot")
    from_m: tuple[Metres, Metres] | None = Field(
        description="x and y that the robot sets out from; null: in the largest piece of floor"
    )
    counted_area_m2: SquareMetres = Field(
        description="explored, and the robot's centre can get there: what all shares are of"
    )
    unexplored_area_m2: SquareMetres = Field(
        description="reached, but half of the beams or more end in unknown space"
    )
    unreachable_area_m2: SquareMetres = Field(description="free, but the centre cannot get there")
    beside_walls_area_m2: SquareMetres = Field(
        description="of that, nearer to a wall than the robot's radius"
    )
    cut_off_area_m2: SquareMetres = Field(description="of that, wide enough but cut off")
    outside_area_m2: SquareMetres = Field(
        description="outside of the building: a page's margin, or reached where the map ends"
    )
    free_area_m2: SquareMetres = Field(description="all of these: the free cells of the map")
    impossible_poses: int | None = Field(
        default=None,
        description="poses without a value in free cells: the robot stands there only at other "
        "headings; null where an older version wrote the document",
    )
    counted_share: Share = Field(description="of the free floor")
    unexplored_share: Share = Field(description="of the free floor")
    unreachable_share: Share = Field(description="of the free floor")
    outside_share: Share = Field(description="of the free floor")


class ZonePart(Part):
    """Area and share of a zone on the explored, reachable floor."""

    zone: str
    share: Share = Field(description="of the explored, reachable floor")
    area_m2: SquareMetres
    places: int = Field(description="bad places where this zone prevails, listed or not")
    longest_place_m: Metres | None = Field(
        description="the longest of them: longer side of its smallest rectangle; null without one"
    )
    share_best_heading: Share | None = Field(
        description="share if the robot always took the least ambiguous heading; "
        "null where the heading does not matter"
    )
    share_worst_heading: Share | None = Field(description="the same for the most ambiguous one")
    meaning: str
    colour: str


class HeadingPart(Part):
    """Figures of all floor at one heading of the robot."""

    heading_deg: Degrees
    level: Share = Field(
        description="mean over the explored, reachable floor where the robot can stand at it"
    )
    shares: dict[str, Share] = Field(description="share of that floor in each zone")


class SightPart(Part):
    """The scan at a place."""

    heading_deg: Degrees
    beams: int
    without_echo: int
    at_unknown_space: int
    surfaces: int = Field(description="planes that echoes come from")
    directions: int = Field(description="directions along which these planes run")
    sentence: str


class SeenWallPart(Part):
    """The part of a wall that the scanner sees."""

    x0_m: Metres
    y0_m: Metres
    x1_m: Metres
    y1_m: Metres
    distance_m: Metres


class CausePart(Part):
    """Cause of a place's ambiguity."""

    sentence: str
    walls: tuple[SeenWallPart, ...] = Field(
        description="walls along the weak direction, at most one on either side"
    )


class PlacePart(Part):
    """A region where the robot may get lost."""

    number: int
    zone: str
    x_m: Metres
    y_m: Metres
    length_m: Metres
    width_m: Metres
    area_m2: SquareMetres
    direction_deg: Degrees | None = Field(
        description="the robot slides unseen along it; from x, counter-clockwise, 0 to 180"
    )
    level: Share = Field(description="mean ambiguity level of the region")
    major_radius_m: Metres
    minor_radius_m: Metres
    best_heading_deg: Degrees | None
    worst_heading_deg: Degrees | None
    level_by_heading: tuple[tuple[Degrees, Share], ...] = Field(
        description="heading and level at (x, y); empty where the heading does not matter"
    )
    headings: str = Field(description="the same in words")
    severity_m2: SquareMetres = Field(description="level times area: the ranking")
    cause: CausePart
    sees: SightPart
    picture: str


class LayerPart(Part):
    """A layer of another measure that was added to the map."""

    name: str
    title: str
    unit: str
    source: str
    worse: Literal["high", "low"] = Field(description="which end means badly localized")
    picture: str


class Document(Part):
    """The whole audit."""

    format: Literal["ambinav-audit/5"] = "ambinav-audit/5"
    created: str = Field(description="ISO 8601, UTC; when the map was built")
    ambinav_version: str
    verdict: VerdictPart | None = Field(description="what to do; null: nobody asked")
    summary: str
    headings: str = Field(description="which headings the figures are for")
    environment: EnvironmentPart
    scanner: ScannerPart
    floor: FloorPart
    zones: tuple[ZonePart, ...]
    by_heading: tuple[HeadingPart, ...] = Field(
        description="empty where the heading does not matter"
    )
    places: tuple[PlacePart, ...] = Field(description="the worst first")
    places_in_all: int
    layers: tuple[LayerPart, ...] = ()
    aliasing: AliasingPart | None = Field(
        default=None, description="perceptual aliasing; null: not asked for"
    )
    helps: PostsPart | None = Field(
        default=None, description="posts that would help; null: none were sought"
    )
    lost: LostPart | None = Field(
        default=None, description="routes that lose robots; null: not asked for, or not known"
    )
    pictures: tuple[str, ...]
    parameters: dict[str, Any]
    versions: dict[str, Any]


def document(audit: Audit, image_format: str = "png") -> Document:
    """Collect an audit's figures, rounded, with units in the names.

    Names of pictures end in the picture format.
    """
    attrs = audit.amap.dataset.attrs
    return Document(
        created=str(attrs.get("created", "")),
        ambinav_version=str(attrs.get("ambinav_version", "")),
        verdict=None if audit.verdict is None else verdict_part(audit.verdict),
        summary=audit.summary,
        headings=_headings(audit),
        environment=EnvironmentPart.of(
            audit.environment,
            source=str(audit.environment.source or ""),
            sha256=audit.environment.checksum,
            free_area_m2=audit.amap.free_area,
            segments=len(audit.environment.segments),
            notes=(*audit.environment.notes, *audit.reach.notes),
        ),
        scanner=ScannerPart.of(
            audit.scanner,
            aperture_deg=math.degrees(field_of_view(audit.scanner)),
            yaml=audit.scanner.to_yaml(),
        ),
        floor=_floor(audit),
        zones=_zones(audit),
        by_heading=_by_heading(audit),
        places=tuple(_place(finding, image_format) for finding in audit.findings),
        places_in_all=audit.regions,
        layers=_layers(audit, image_format),
        aliasing=None if audit.aliasing is None else aliasing_part(audit.aliasing, image_format),
        helps=None if audit.helps is None else posts_part(audit.helps),
        lost=None if audit.lost is None else lost_part(audit.lost),
        pictures=tuple(f"{name}.{image_format}" for name in floor_pictures(audit)),
        parameters=audit.amap.parameters | {"cost_layer": audit.amap.cost_layer},
        versions=json.loads(attrs.get("versions", "{}")),
    )


def floor_pictures(audit: Audit) -> tuple[str, ...]:
    """Return the names of the pictures of all floor."""
    by_heading = (FLOOR_BEST, FLOOR_WORST) if audit.amap.has_theta else ()
    layers = map(layer_picture, schema.added(audit.amap.dataset))
    aliasing = (FLOOR_ALIASING,) if audit.aliasing is not None and audit.aliasing.pairs else ()
    return (FLOOR_ZONES, *by_heading, FLOOR_LEVEL, *aliasing, *layers)


def layer_picture(name: str) -> str:
    """Return the name of an added layer's picture."""
    return f"floor-layer-{name}"


def place_picture(number: int) -> str:
    """Return the name of a place's picture."""
    return f"place-{number:02d}"


def _headings(audit: Audit) -> str:
    if not audit.amap.has_theta:
        return "all alike"
    if audit.heading == "mean":
        return "all: zones of half or more of the headings, means of the other layers"
    if isinstance(audit.heading, str):
        return f"{audit.heading} over all headings"
    return f"{math.degrees(audit.heading):.0f} degrees"


def _floor(audit: Audit) -> FloorPart:
    parts, free = audit.parts, audit.amap.free_area
    areas = {
        name: parts.area(getattr(parts, name))
        for name in ("counted", "unexplored", "unreachable", "outside")
    }
    return FloorPart(
        robot_radius_m=audit.reach.radius,
        from_m=audit.reach.start,
        beside_walls_area_m2=parts.area(parts.beside_walls),
        cut_off_area_m2=parts.area(parts.cut_off),
        free_area_m2=free,
        impossible_poses=audit.amap.impossible_poses,
        **{f"{name}_area_m2": area for name, area in areas.items()},
        **{f"{name}_share": area / free for name, area in areas.items()},
    )


def _zones(audit: Audit) -> tuple[ZonePart, ...]:
    best: list[float | None] = [None] * len(ZONES)
    worst, counted = best, audit.parts.counted
    if audit.amap.has_theta:
        best = [share.share for share in audit.amap.zone_shares("best", counted)]
        worst = [share.share for share in audit.amap.zone_shares("worst", counted)]
    return tuple(
        ZonePart(
            zone=name,
            share=audit.shares[code].share,
            area_m2=audit.shares[code].area,
            places=len(audit.extents[name]),
            longest_place_m=next(iter(audit.extents[name]), None),
            share_best_heading=best[code],
            share_worst_heading=worst[code],
            meaning=MEANINGS[code],
            colour=ZONE_COLOURS[code],
        )
        for code, name in enumerate(ZONES)
    )


def _by_heading(audit: Audit) -> tuple[HeadingPart, ...]:
    """Return figures for the headings possible anywhere on the floor that counts."""
    if not audit.amap.has_theta:
        return ()
    data = audit.amap.dataset
    zone, level = (data[name].transpose("theta", "y", "x").values for name in ("zone", "level"))
    parts = []
    for k, heading in enumerate(data["theta"].values.tolist()):
        stands = audit.parts.counted & audit.amap.possible[:, :, k]
        if not stands.any():
            continue
        counts = np.bincount(zone[k][stands], minlength=len(ZONES))
        parts.append(
            HeadingPart(
                heading_deg=math.degrees(heading),
                level=float(level[k][stands].mean()),
                shares=dict(zip(ZONES, (counts / counts.sum()).tolist(), strict=True)),
            )
        )
    return tuple(parts)


def _layers(audit: Audit, image_format: str) -> tuple[LayerPart, ...]:
    data = audit.amap.dataset
    return tuple(
        LayerPart(
            name=name,
            title=data[name].attrs["long_name"],
            unit=data[name].attrs["units"],
            source=data[name].attrs["source"],
            worse=data[name].attrs["worse"],
            picture=f"{layer_picture(name)}.{image_format}",
        )
        for name in schema.added(data)
    )


def _place(finding: Finding, image_format: str) -> PlacePart:
    place: AmbiguousRegion = finding.place
    return PlacePart.of(
        place,
        direction_deg=_axis(place.direction),
        level_by_heading=tuple((math.degrees(a), level) for a, level in place.by_heading),
        headings=heading_words(place),
        cause=_cause(finding),
        sees=_sight(finding.sight),
        picture=f"{place_picture(place.number)}.{image_format}",
    )


def _cause(finding: Finding) -> CausePart:
    cause = finding.cause
    return CausePart(
        sentence=cause.sentence,
        walls=tuple(
            SeenWallPart(
                x0_m=wall.start[0], y0_m=wall.start[1], x1_m=wall.end[0], y1_m=wall.end[1],
                distance_m=wall.distance,
            )
            for wall in cause.walls
        ),
    )  # fmt: skip


def _sight(sight: Sight) -> SightPart:
    return SightPart.of(
        sight,
        heading_deg=math.degrees(sight.theta),
        without_echo=sight.silent,
        at_unknown_space=int(sight.frontier.sum()),
    )


def _axis(angle: float | None) -> float | None:
    """Round degrees and keep them in [0, 180)."""
    return None if angle is None else round(math.degrees(angle), 1) % 180.0
