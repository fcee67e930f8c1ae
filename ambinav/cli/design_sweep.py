"""`ambinav design sweep`: which setting of a scanner is best for a building or a route."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar, cast

from ambinav.cli import options
from ambinav.cli.checks import conflict, naming_options
from ambinav.cli.limits import Natural, at_least
from ambinav.cli.map_options import (
    AmbiguityRadius,
    BuildingOptions,
    MapOptions,
    MapStd,
    ReachOptions,
    Spacing,
    check_radius,
)
from ambinav.cli.printing import finish, show, table
from ambinav.cli.region_options import RegionOptions, check_one
from ambinav.cli.running import check_report, progress_bars, reporting
from ambinav.cli.space_options import SpaceOptions
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav.studies.design.sweep.document import Document
    from ambinav.studies.design.sweep.figures import Criterion
    from ambinav.studies.design.sweep.sweep import SweepResult


@dataclass(frozen=True, kw_only=True)
class SweptOptions(RegionOptions):
    """Options on the region where the settings are evaluated.

    Attributes:
        heading (DEG): The robot keeps this heading, degrees in the map frame; not with --route.
            [default: 0 if yaw is varied, otherwise all headings]
        headings (N): Number of headings, weighted equally; not with --route. [default: 8, if no
            heading is kept]
        places (N): Evaluate at most this many places, evenly spread; 0: all places.
        seed (N): Seed of the choice of places.
    """

    PANEL: ClassVar[str] = "Region"

    heading: float | None = None
    headings: Annotated[int | None, at_least(1)] = None
    places: Natural = 1000
    seed: Natural = 0

    def check(self) -> None:
        """Refuse an invalid heading, a second choice of headings, and a seed without effect.

        Raises:
            InputError: one is given.
        """
        check_one(self.polygon, self.route)
        if self.heading is not None:
            if not math.isfinite(self.heading):
                raise InputError(
                    f"--heading: {self.heading} is not a heading; give degrees, e.g. 90."
                )
            reason = "is a number of headings, and --heading keeps one"
            conflict("--headings", self.headings is not None, reason)
        conflict("--seed", self.seed != 0 and self.places == 0, "has no effect on all places")


@options.documented
def sweep(
    map_file: options.MapFile,
    scanner: options.Scanner,
    vary: list[str],
    *,
    output: options.ReportFolder = None,
    part: str | None = None,
    by: str = "mean",
    where: SweptOptions,
    building: BuildingOptions,
    space: SpaceOptions,
    spacing: Spacing = 0.1,
    radius: AmbiguityRadius = 0.5,
    map_std: MapStd = None,
    robot: ReachOptions,
    pictures: options.Pictures = "png",
    as_json: options.AsJson = False,
) -> None:
    """Vary a scanner, and report the setting with which a robot is least lost.

    Varies aperture, orientation, height, number of beams, range or accuracy; evaluates a map, a
    polygon or a route. With --extrude, --in-space or a mesh for MAP, scanners see in space.

    Example: `ambinav design sweep office.yaml -s hokuyo-urg-04lx --vary aperture=60:360:30 -o out`

    Parameters:
        vary (NAME=FIRST:LAST:STEP): Property to vary: aperture, yaw (degrees), beams, max_range,
            std, resolution (metres), in space also height (metres) and pitch (degrees, positive
            looks down); or NAME=A,B,C. Several make a grid.
        part (NAME|N): Part to vary of a scanner with several: its sensor's name, or its number.
            [default: the only one]
        by (mean|p95|worst|bad): The best setting has the lowest mean, 95th percentile or worst
            level, or the smallest share of corridor and open.
    """
    with reporting():
        from ambinav.studies.design.sweep.document import document
        from ambinav.studies.design.sweep.figures import CRITERIA
        from ambinav.studies.design.sweep.report import STUDY, write_report
        from ambinav.studies.design.sweep.sweep import sweep_scanner
        from ambinav.studies.design.sweep.vary import Variation

        map_options = MapOptions(spacing=spacing, radius=radius, map_std=map_std)
        check_radius(radius, spacing)
        if by not in CRITERIA:
            raise InputError(f"--by: {by!r} is unknown; choose from {', '.join(CRITERIA)}.")
        where.check()
        space.check()
        if where.route is not None and not robot == ReachOptions():
            raise InputError(
                "--robot-radius, --start: all floor of a route counts; leave them out with --route."
            )
        check_report(STUDY, output, pictures)
        with naming_options("vary"):
            variations = [Variation.parse(text) for text in vary]
        region = where.region()
        environment, chosen = map_options.load(
            map_file, scanner, building, space, robot.robot_radius or 0.0
        )
        with (
            progress_bars(as_json) as bars,
            naming_options("vary", "part", **{"from": "--start: from"}),
        ):
            result = sweep_scanner(
                environment,
                chosen,
                variations,
                region,
                part=part,
                criterion=cast("Criterion", by),
                heading=None if where.heading is None else math.radians(where.heading),
                headings=where.headings,
                spacing=spacing,
                radius=radius,
                map_std=map_std,
                robot_radius=robot.robot_radius,
                start=robot.start,
                places=where.places,
                seed=where.seed,
                progress=bars("settings"),
            )
        if output is not None:
            report = write_report(result, environment, output, pictures)
        else:
            report = document(result)
        finish(report, lambda report: _show(report, result), STUDY.page(output), as_json=as_json)


_SHOWN = 10
"""Settings that are printed."""


def _show(report: Document, result: SweepResult) -> None:
    from ambinav.studies.design.sweep.text import Words, share_text, values_text, varied_text

    levels, shares = Words(result).formats
    settings = [(values_text(result, i), report.settings[i], "") for i in result.order[:_SHOWN]]
    present = tuple(map(varied_text, report.present.values.values()))
    fits = ("fits on",) if result.fits_unevenly else ()
    rows = (
        (
            *cells,
            *map(levels, (part.mean, part.p95, part.worst)),
            shares(part.bad),
            *(share_text(part.standing or 0.0) for _ in fits),
            remark,
        )
        for cells, part, remark in (*settings, (present, report.present, "present"))
    )
    columns = (*report.best.values, "mean", "p95", "worst", "bad", *fits, "")
    show(report.summary, "", table(columns, rows))
    if len(result.order) > _SHOWN:
        show(f"the best {_SHOWN} of {len(result.order)} different settings")
