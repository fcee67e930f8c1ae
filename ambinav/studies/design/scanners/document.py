"""The comparison of scanners as data: contents of report.json and source of the reports."""

from __future__ import annotations

import csv
import io
import math
from typing import Any, Final, Literal

from pydantic import Field

from ambinav.maps.zones import CORRIDOR, OPEN
from ambinav.reports.fields import Part
from ambinav.reports.number_text import metres2
from ambinav.reports.pages import listed
from ambinav.sensing.preset_summary import field_of_view
from ambinav.studies.design.scanners.compare import (
    LayerPart,
    ScannerRow,
    ScannerTable,
    UnusablePart,
    bad_area,
)
from ambinav.studies.design.scanners.route_figures import SOURCE
from ambinav.version import __version__

FORMAT: Final = "ambinav-design-scanners/1"


class EnvironmentPart(Part):
    """The building and the floor that counts in it."""

    name: str
    source: str
    sha256: str
    robot_radius_m: float = Field(description="of the disc that covers the robot")
    from_m: tuple[float, float] | None = Field(
        description="x and y that the robot sets out from; null: in the largest piece of floor"
    )
    reached_m2: float = Field(description="where the centre of the robot can get to, exactly")
    notes: tuple[str, ...] = Field(description="what was repaired or left out in the input")


class ScannerPart(Part):
    """One scanner."""

    number: int = Field(description="from the least bad area on")
    name: str
    description: str
    kind: str
    beams: int
    aperture_deg: float = Field(description="field of view, cones included")
    max_range_m: float
    headings: int | None = Field(description="of its map; null where the heading does not matter")
    counted_area_m2: float = Field(description="explored by this scanner, and reached")
    unexplored_area_m2: float = Field(
        description="reached, but half of the beams or more end in unknown space"
    )
    corridor_area_m2: float
    open_area_m2: float
    bad_area_m2: float = Field(description="corridor and open zones of the floor that counts")
    bad_share: float | None = Field(description="of that floor; null where there is none")
    bad_area_best_heading_m2: float | None = Field(
        description="at the least ambiguous heading of every place; null where all are alike"
    )
    bad_area_worst_heading_m2: float | None
    bad_area_common_m2: float = Field(
        description="on the floor that counts for every scanner of the table"
    )
    longest_open_m: float | None = Field(description="stretch of a route; null without routes")
    longest_corridor_m: float | None
    longest_bad_m: float | None = Field(description="stretch in either zone")
    bad_route_share: float | None = Field(description="of all metres of the routes")
    mean_error_m: float | None = Field(
        description="expected error of the position, mean over all metres of the routes"
    )
    worst_error_m: float | None = Field(description="the largest of it")
    price: float | None = Field(description="as the user says; null: not said")
    power_w: float | None
    on_front: bool | None = Field(
        description="nobody dominates it in the first front; null: it is not in that front"
    )
    dominated_by: str | None = Field(description="in the first front; null: by none")
    build_seconds: float | None = Field(
        description="time that its map took; null where it was opened from the store"
    )
    layers: dict[str, LayerPart]
    lacking: dict[str, str] = Field(description="layers that it cannot have, and why")
    source: str = Field(description="where the scanner's figures come from")
    yaml: str = Field(description="the whole scanner, as a file that --scanner takes")


class FrontPointPart(Part):
    """A scanner in a front."""

    name: str
    bad_area_m2: float
    value: float
    dominated_by: str | None


class FrontPart(Part):
    """A Pareto front: bad area against one other figure; less is better for both."""

    against: str
    title: str
    unit: str
    points: tuple[FrontPointPart, ...]


class RoutesPart(Part):
    """The routes, the localizer and the odometry of the expected errors."""

    sampled: bool = Field(description="shortest ones between random places, not given")
    metres: float
    points_m: tuple[tuple[tuple[float, float], ...], ...] = Field(
        description="x and y of the poses of each route"
    )
    error_model: str
    error_source: str


class Document(Part):
    """The whole comparison."""

    format: Literal["ambinav-design-scanners/1"] = "ambinav-design-scanners/1"
    ambinav_version: str
    summary: str
    remarks: tuple[str, ...]
    environment: EnvironmentPart
    scanners: tuple[ScannerPart, ...]
    unusable: tuple[UnusablePart, ...]
    fronts: tuple[FrontPart, ...] = Field(description="the first is the one that the table marks")
    routes: RoutesPart | None
    parameters: dict[str, Any] = Field(description="of the maps")


def document(table: ScannerTable) -> Document:
    """Collect a comparison's figures, with units in the names."""
    every = table.amap.parameters
    # Parameters common to all scanners; the others belong to one scanner.
    shared: dict[str, Any] = {
        name: every[name] for name in ("spacing", "radius", "map_std") if name in every
    }
    return Document(
        ambinav_version=__version__,
        summary=summary(table),
        remarks=table.remarks,
        environment=EnvironmentPart.of(
            table.environment,
            source=str(table.environment.source or ""),
            sha256=table.environment.checksum,
            robot_radius_m=table.reach.radius,
            from_m=table.reach.start,
            reached_m2=float(table.reach.floor.area),
            notes=(*table.environment.notes, *table.reach.notes),
        ),
        scanners=tuple(
            _scanner(number, row, table) for number, row in enumerate(table.rows, start=1)
        ),
        unusable=table.unusable,
        fronts=tuple(
            FrontPart.of(
                front,
                against=front.key,
                points=tuple(
                    FrontPointPart.of(point, value=point.against) for point in front.points
                ),
            )
            for front in table.fronts
        ),
        routes=_routes(table),
        parameters=shared,
    )


def table_csv(report: Document) -> str:
    """Format the scanners as CSV, one line each; empty where there is no figure."""
    left_out = {"description", "source", "yaml", "layers", "lacking"}
    rows = []
    for scanner in report.scanners:
        row = scanner.model_dump(exclude=left_out)
        row |= {f"layer_{name}": layer.mean for name, layer in scanner.layers.items()}
        row["lacking"] = " ".join(sorted(scanner.lacking))
        row["unusable"] = ""
        rows.append(row)
    rows += [{"name": scanner.name, "unusable": scanner.reason} for scanner in report.unusable]
    names = dict.fromkeys(name for row in rows for name in row)
    out = io.StringIO()
    table = csv.DictWriter(out, fieldnames=list(names), restval="", lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return out.getvalue()


def summary(table: ScannerTable) -> str:
    """Summarize the result in a few sentences."""
    usable = [row for row in table.rows if row.parts.counted.any()]
    count = len(table.rows) + len(table.unusable)
    scanners = "1 scanner was" if count == 1 else f"{count} scanners were"
    sentences = [
        f"{scanners} compared in {table.environment.name} on a robot of radius "
        f"{table.reach.radius:.2f} m."
    ]
    if not usable:
        return f"{sentences[0]} No floor is explored and reached, so nothing can be said."
    best, last = usable[0], usable[-1]
    tied = [row.name for row in usable if row.bad_area <= best.bad_area]
    least = f"{metres2(best.bad_area)} of {metres2(best.counted_area)}" if best.bad_area else "none"
    if len(tied) > 3:
        leaves = f"{len(tied)} of them leave"
    else:
        leaves = f"{listed(tied)} {'leaves' if len(tied) == 1 else 'leave'}"
    most = f"; {last.name} the most: {metres2(last.bad_area)}" if last.name not in tied else ""
    sentences.append(f"{leaves} the robot the least floor where it can get lost: {least}{most}.")
    front = table.front
    if front is not None and len(front.points) > 1:
        names = [point.name for point in front.best]
        verb = "is" if len(names) == 1 else "are"
        sentences.append(
            f"By bad area and {front.title}, {listed(names)} {verb} not dominated by any other."
        )
    if table.unusable:
        names = [scanner.name for scanner in table.unusable]
        sentences.append(f"There are no figures of {listed(names)}.")
    return " ".join(sentences)


def _scanner(number: int, row: ScannerRow, table: ScannerTable) -> ScannerPart:
    scanner, parts, routes = row.scanner, row.parts, row.routes
    counted = row.counted_area
    place = None if table.front is None else table.front.point(row.name)
    return ScannerPart.of(
        scanner,
        number=number,
        aperture_deg=math.degrees(field_of_view(scanner)),
        headings=row.headings,
        counted_area_m2=counted,
        unexplored_area_m2=parts.area(parts.unexplored),
        corridor_area_m2=row.shares[CORRIDOR].area,
        open_area_m2=row.shares[OPEN].area,
        bad_area_m2=row.bad_area,
        bad_share=row.bad_area / counted if counted else None,
        bad_area_best_heading_m2=None if row.best is None else bad_area(row.best),
        bad_area_worst_heading_m2=None if row.worst is None else bad_area(row.worst),
        bad_area_common_m2=table.common_bad_area(row),
        longest_open_m=None if routes is None else routes.floor.longest_open,
        longest_corridor_m=None if routes is None else routes.floor.longest_corridor,
        longest_bad_m=None if routes is None else routes.longest_bad,
        bad_route_share=None
        if routes is None
        else (routes.floor.corridor + routes.floor.open) / routes.metres,
        mean_error_m=None if routes is None else routes.mean_error,
        worst_error_m=None if routes is None else routes.worst_error,
        price=row.cost.price,
        power_w=row.cost.power,
        on_front=None if place is None else place.dominated_by is None,
        dominated_by=None if place is None else place.dominated_by,
        build_seconds=row.build_seconds,
        layers=dict(row.layers),
        lacking=dict(row.lacking),
        yaml=scanner.to_yaml(),
    )


def _routes(table: ScannerTable) -> RoutesPart | None:
    if not table.routes:
        return None
    return RoutesPart(
        sampled=table.sampled,
        metres=sum(
            float(route.steering.lengths(route.poses[:-1], route.poses[1:]).sum())
            for route in table.routes
        ),
        points_m=tuple(tuple((x, y) for x, y, _ in route.poses.tolist()) for route in table.routes),
        error_model=table.model.text,
        error_source=SOURCE,
    )
