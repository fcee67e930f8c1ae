"""`ambinav design sweep`: which setting of a scanner is best for a building or a route."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, cast

import typer

from ambinav.cli import options
from ambinav.cli.map_options import (
    AmbiguityRadius,
    BuildingOptions,
    MapOptions,
    MapStd,
    ReachOptions,
    Spacing,
)
from ambinav.cli.region_options import RegionOptions, check_one
from ambinav.cli.running import above_zero, check_writable, progress_bars, reporting
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav.studies.design.sweep.document import Document
    from ambinav.studies.design.sweep.figures import Criterion
    from ambinav.studies.design.sweep.sweep import SweepResult


@dataclass(frozen=True, kw_only=True)
class SweptOptions(RegionOptions):
    """Options on the region where the settings are evaluated."""

    PANEL: ClassVar[str] = "Region"

    heading: Annotated[
        float | None,
        typer.Option(
            "--heading",
            metavar="DEG",
            help="The robot keeps this heading, degrees in the map frame; not with --route.",
            show_default="0 if yaw is varied, otherwise all headings",
        ),
    ] = None
    headings: Annotated[
        int | None,
        typer.Option(
            "--headings",
            metavar="N",
            help="Number of headings, weighted equally; not with --route.",
            show_default="8, if no heading is kept",
        ),
    ] = None
    places: Annotated[
        int,
        typer.Option(
            "--places",
            metavar="N",
            help="Evaluate at most this many places, evenly spread; 0: all places.",
        ),
    ] = 1000
    seed: Annotated[
        int, typer.Option("--seed", metavar="N", help="Seed of the choice of places.")
    ] = 0

    def check(self) -> None:
        """Check what can be checked before the building is read.

        Raises:
            InputError: options do not go together, or a number is out of its range.
        """
        check_one(self.polygon, self.route)
        for name, value in (("--places", self.places), ("--seed", self.seed)):
            if value < 0:
                raise InputError(f"{name}: {value} is negative; give 0 or more.")


@options.grouped
def sweep(
    map_file: options.MapFile,
    scanner: options.Scanner,
    vary: Annotated[
        list[str],
        typer.Option(
            "--vary",
            metavar="NAME=FIRST:LAST:STEP",
            help="Property to vary: aperture, yaw (degrees), beams, max_range, std, resolution "
            "(metres); or NAME=A,B,C. Several make a grid.",
            show_default=False,
        ),
    ],
    *,
    output: options.ReportFolder = None,
    part: Annotated[
        str | None,
        typer.Option(
            "--part",
            metavar="NAME|N",
            help="Part to vary of a scanner with several: its sensor's name, or its number.",
            show_default="the only one",
        ),
    ] = None,
    by: Annotated[
        str,
        typer.Option(
            "--by",
            metavar="mean|p95|worst|bad",
            help="The best setting has the lowest mean, 95th percentile or worst level, or the "
            "smallest share of corridor and open.",
        ),
    ] = "mean",
    where: SweptOptions,
    building: BuildingOptions,
    spacing: Spacing = 0.1,
    radius: AmbiguityRadius = 0.5,
    map_std: MapStd = None,
    robot: ReachOptions,
    pictures: options.Pictures = "png",
    as_json: options.AsJson = False,
) -> None:
    """Vary a scanner, and report the setting with which a robot is least lost.

    Varies aperture, orientation, number of beams, range or accuracy; evaluates a map, a polygon or
    a route.

    Example: `ambinav design sweep office.yaml -s hokuyo-urg-04lx --vary aperture=60:360:30 -o out`
    """
    with reporting():
        making = MapOptions(spacing=spacing, radius=radius, map_std=map_std)
        making.check()
        above_zero(robot.robot_radius, "--robot-radius", "0.2")
        options.check_pictures(pictures)
        where.check()
        if where.route is not None and not robot == ReachOptions():
            raise InputError(
                "--robot-radius, --start: all floor of a route counts; leave them out with --route."
            )
        if output is not None:
            from ambinav.studies.design.sweep.report import FOLDER

            check_writable(output)
            FOLDER.check(output)
        from ambinav.studies.design.sweep.vary import Variation

        variations = [Variation.parse(text) for text in vary]
        region = where.region()
        environment, chosen = making.load(map_file, scanner, building)
        from ambinav.studies.design.sweep.document import document
        from ambinav.studies.design.sweep.sweep import sweep_scanner as swept

        with progress_bars(as_json) as bars:
            result = swept(
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
            from ambinav.studies.design.sweep.report import write_report

            report = write_report(result, environment, output, pictures)
        else:
            report = document(result)
        if as_json:
            typer.echo(report.model_dump_json(indent=2))
        else:
            _show(report, result, output)


_SHOWN = 10
"""Settings that are printed."""


def _show(report: Document, result: SweepResult, output: Path | None) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from ambinav.studies.design.sweep.text import Numbers, Words, values_text

    numbers = Words(result).numbers
    levels = Numbers(3) if numbers.percent else numbers
    shares = numbers if numbers.percent else Numbers(3, percent=True)
    console = Console(highlight=False)
    console.print(Text(report.summary))
    table = Table(box=None, pad_edge=False)
    for name in (*report.best.values, "mean", "p95", "worst", "bad", ""):
        table.add_column(name, justify="right")
    rows = [(values_text(result, i), report.settings[i], "") for i in result.order[:_SHOWN]]
    present = (
        "curve" if value is None else f"{value:.6g}" for value in report.present.values.values()
    )
    for cells, setting, remark in (*rows, (tuple(present), report.present, "present")):
        table.add_row(
            *cells,
            *(
                "-" if level is None else levels.value(level)
                for level in (setting.mean, setting.p95, setting.worst)
            ),
            "-" if setting.bad is None else shares.value(setting.bad),
            remark,
        )
    console.print("", table, sep="\n")
    if len(result.order) > _SHOWN:
        console.print(Text(f"the best {_SHOWN} of {len(result.order)} different settings"))
    if output is not None:
        console.print("", Text(f"report: {output / 'report.html'}"), sep="\n", soft_wrap=True)
