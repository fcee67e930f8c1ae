"""A difference as data: contents of diff.json and source of the written reports."""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np
from pydantic import Field

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import ZONES
from ambinav.plotting.style import ZONE_COLOURS
from ambinav.reports.fields import Metres, Part, Share, SquareMetres
from ambinav.runtime.array_types import Floats
from ambinav.studies.diff.difference import Difference
from ambinav.studies.diff.provenance import ParameterPart
from ambinav.studies.diff.regions import NOTABLE, LevelChange, RegionPart
from ambinav.studies.diff.registration import COUNTED, STATES
from ambinav.studies.diff.walls import total_length
from ambinav.version import __version__

FORMAT: Final = "ambinav-diff/1"
WALLS: Final = 10
"""Stretches of wall that are listed, of either kind."""
UNLIKE: Final = 0.4
"""Share of the walls that either map has for itself, from which the two may not fit together."""


Stretch = tuple[Metres, Metres, Metres, Metres]


class MapPart(Part):
    """One of the two maps."""

    source: str
    environment: str
    scanner: str
    created: str = Field(description="ISO 8601, UTC")
    spacing_m: Metres
    headings: int | None = Field(description="null where the heading does not matter")
    robot_radius_m: Metres = Field(description="floor that this robot reaches counts")
    counted_area_m2: SquareMetres = Field(description="explored, reachable floor")
    own_layers: tuple[str, ...] = Field(description="layers that the other map lacks")


class LatticePart(Part):
    """The cells on which both maps are read."""

    spacing_m: Metres
    bounds_m: tuple[Metres, Metres, Metres, Metres] = Field(description="xmin, ymin, xmax, ymax")
    resampled: bool = Field(description="whether a map is read between its own cells")


class ZonePart(Part):
    """A zone before and after."""

    zone: str
    before_m2: SquareMetres
    after_m2: SquareMetres
    before_share: Share = Field(description="of the first map's explored, reachable floor")
    after_share: Share = Field(description="of the second map's")
    new_m2: SquareMetres = Field(description="in this zone after, and not before")
    lost_m2: SquareMetres = Field(description="in this zone before, and not after")
    colour: str


class TransitionPart(Part):
    """The floor in one state before, by its state after."""

    before: str
    after: str
    area_m2: SquareMetres
    share: Share = Field(description="of the floor that counts in either map")


class LevelPart(Part):
    """Level after less level before, on floor that counts in both maps."""

    area_m2: SquareMetres = Field(description="of that floor")
    mean_change: LevelChange
    largest_rise: LevelChange = Field(description="0 where nothing rises")
    largest_fall: LevelChange = Field(description="0 where nothing falls, else negative")
    notable: float = Field(
        default=NOTABLE, description="from this change a cell is worse or better"
    )
    worse_m2: SquareMetres
    better_m2: SquareMetres


class WallsPart(Part):
    """Walls that only one of the maps has."""

    tolerance_m: Metres = Field(description="a wall may be so far off and still be the same")
    new_m: Metres = Field(description="length of all that only the second map has")
    gone_m: Metres = Field(description="length of all that only the first map has")
    before_m: Metres = Field(description="length of all walls of the first map")
    after_m: Metres = Field(description="length of all walls of the second map")
    new: tuple[Stretch, ...] = Field(description="ax, ay, bx, by; the longest first")
    gone: tuple[Stretch, ...]


class Document(Part):
    """The whole difference."""

    format: Literal["ambinav-diff/1"] = "ambinav-diff/1"
    ambinav_version: str = __version__
    summary: str
    identical: bool = Field(description="every layer, wall and parameter is the same")
    first: MapPart
    second: MapPart
    lattice: LatticePart
    new_floor_m2: SquareMetres = Field(description="counts in the second map only")
    gone_floor_m2: SquareMetres = Field(description="counts in the first map only")
    zones: tuple[ZonePart, ...]
    changed_zone_m2: SquareMetres = Field(description="counts in both, in another zone")
    transitions: tuple[TransitionPart, ...] = Field(description="without those of no floor")
    level: LevelPart | None = Field(description="null where no floor counts in both maps")
    regions: tuple[RegionPart, ...] = Field(description="those that matter most first")
    regions_in_all: int
    walls: WallsPart
    parameters: tuple[ParameterPart, ...]


def document(result: Difference, places: int) -> Document:
    """Collect the figures of a difference, rounded, with units in the names.

    Args:
        result: The difference.
        places: Regions to list at most.
    """
    before, after, cell = result.before, result.after, result.lattice.cell_area
    table = _table(result)
    own_layers = result.layers
    areas = [float(read.counted.sum()) * cell for read in (before, after)]
    made = Document(
        summary="",
        identical=result.identical,
        first=_map(result.first, result.parts[0].radius, areas[0], own_layers[0]),
        second=_map(result.second, result.parts[1].radius, areas[1], own_layers[1]),
        lattice=LatticePart.of(result.lattice),
        new_floor_m2=table[COUNTED:, :COUNTED].sum(),
        gone_floor_m2=table[:COUNTED, COUNTED:].sum(),
        zones=_zones(table),
        changed_zone_m2=table[:COUNTED, :COUNTED].sum() - np.trace(table[:COUNTED, :COUNTED]),
        transitions=_transitions(table),
        level=_level(result.rise[before.counted & after.counted], cell),
        regions=result.regions[:places],
        regions_in_all=len(result.regions),
        walls=WallsPart(
            tolerance_m=result.wall_tolerance,
            new_m=total_length(result.new_walls),
            gone_m=total_length(result.gone_walls),
            before_m=_wall_length(result.first),
            after_m=_wall_length(result.second),
            new=_longest(result.new_walls),
            gone=_longest(result.gone_walls),
        ),
        parameters=result.parameters,
    )
    return made.model_copy(update={"summary": summary(made)})


def summary(report: Document) -> str:
    """Summarize the difference in a few sentences."""
    if report.identical:
        return "The maps are identical: every layer, wall and parameter is the same."
    sentences = []
    level, walls = report.level, report.walls
    if walls.gone_m > UNLIKE * walls.before_m and walls.new_m > UNLIKE * walls.after_m:
        sentences.append(
            f"More than {UNLIKE:.0%} of the walls of either map are not in the other: these may be "
            "different buildings, or maps of one that lie elsewhere or are turned in their frame."
        )
    floor = report.new_floor_m2 + report.gone_floor_m2
    moved = level is not None and (level.largest_rise > 0.0 or level.largest_fall < 0.0)
    if not (floor or report.changed_zone_m2 or moved):
        sentences.append("No floor, zone or level differs.")
    if level is None:
        sentences.append("No floor counts in both maps.")
    elif moved or report.changed_zone_m2:
        sentences.append(
            f"On the {level.area_m2:,.1f} m² that count in both maps the level changes by "
            f"{level.mean_change:+.3f} in the mean: {level.worse_m2:,.1f} m² are worse by "
            f"{level.notable:g} or more, {level.better_m2:,.1f} m² better; "
            f"{report.changed_zone_m2:,.1f} m² are in another zone."
        )
    if floor:
        sentences.append(
            f"{report.new_floor_m2:,.1f} m² of floor are new, {report.gone_floor_m2:,.1f} m² gone."
        )
    if walls.new_m or walls.gone_m:
        sentences.append(f"{walls.new_m:,.1f} m of wall are new, {walls.gone_m:,.1f} m gone.")
    else:
        sentences.append(f"Walls are the same within {walls.tolerance_m:g} m.")
    count = len(report.parameters)
    sentences.append(
        f"{count} parameter{' differs' if count == 1 else 's differ'}."
        if count
        else "All parameters are the same."
    )
    return " ".join(sentences)


def _map(amap: AmbiguityMap, radius: float, area: float, own_layers: tuple[str, ...]) -> MapPart:
    attrs = amap.dataset.attrs
    return MapPart(
        source=amap.source,
        environment=str(attrs["environment"]),
        scanner=str(attrs["scanner"]),
        created=str(attrs.get("created", "")),
        spacing_m=amap.spacing,
        headings=amap.dataset.sizes["theta"] if amap.has_theta else None,
        robot_radius_m=radius,
        counted_area_m2=area,
        own_layers=own_layers,
    )


def _wall_length(amap: AmbiguityMap) -> float:
    segments = amap.segments
    return float(segments.lengths[segments.walls].sum())


def _table(result: Difference) -> Floats:
    """Return square metres of each state before (rows) and after (columns)."""
    size = len(STATES)
    codes = result.before.state.astype(np.intp) * size + result.after.state
    counts = np.bincount(codes.ravel(), minlength=size * size)
    return np.asarray(counts.reshape(size, size) * result.lattice.cell_area, dtype=np.float64)


def _zones(table: Floats) -> tuple[ZonePart, ...]:
    before, after = table.sum(axis=1), table.sum(axis=0)
    totals = [float(areas[:COUNTED].sum()) or math.inf for areas in (before, after)]
    return tuple(
        ZonePart(
            zone=name,
            before_m2=before[code],
            after_m2=after[code],
            before_share=before[code] / totals[0],
            after_share=after[code] / totals[1],
            new_m2=after[code] - table[code, code],
            lost_m2=before[code] - table[code, code],
            colour=ZONE_COLOURS[code],
        )
        for code, name in enumerate(ZONES)
    )


def _transitions(table: Floats) -> tuple[TransitionPart, ...]:
    table = table.copy()
    table[COUNTED:, COUNTED:] = 0.0
    total = max(float(table.sum()), 1e-12)
    return tuple(
        TransitionPart(before=STATES[row], after=STATES[column], area_m2=area, share=area / total)
        for (row, column), area in np.ndenumerate(table)
        if area > 0.0
    )


def _level(rise: Floats, cell: float) -> LevelPart | None:
    rise = rise[np.isfinite(rise)]
    if not rise.size:
        return None
    return LevelPart(
        area_m2=rise.size * cell,
        mean_change=float(rise.mean()),
        largest_rise=max(float(rise.max()), 0.0),
        largest_fall=min(float(rise.min()), 0.0),
        worse_m2=float((rise >= NOTABLE).sum()) * cell,
        better_m2=float((rise <= -NOTABLE).sum()) * cell,
    )


def _longest(stretches: Floats) -> tuple[Stretch, ...]:
    rows = [(float(a), float(b), float(c), float(d)) for a, b, c, d in stretches]
    rows.sort(key=lambda row: -math.hypot(row[2] - row[0], row[3] - row[1]))
    return tuple(rows[:WALLS])
