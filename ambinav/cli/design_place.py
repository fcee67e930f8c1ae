"""`ambinav design place`: where posts, panels or tags help most."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

import typer

from ambinav.cli import options
from ambinav.cli.map_options import BuildingOptions, MapOptions, ReachOptions
from ambinav.cli.region_options import PolygonFile, check_one, route_region
from ambinav.cli.running import above_zero, check_writable, progress_bars, reporting
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav.sensing.scanner import RangeScanner
    from ambinav.studies.design.place.candidates import Kind, PlaceRules
    from ambinav.studies.design.place.document import Document
    from ambinav.studies.design.region import Region


@dataclass(frozen=True, kw_only=True)
class ObstacleOptions:
    """Options on the obstacles and their positions."""

    PANEL: ClassVar[str] = "Obstacles"

    posts: Annotated[
        int | None,
        typer.Option("--posts", metavar="N", help="Place N round posts.", show_default=False),
    ] = None
    panels: Annotated[
        int | None,
        typer.Option("--panels", metavar="N", help="Place N flat panels.", show_default=False),
    ] = None
    tags: Annotated[
        int | None,
        typer.Option(
            "--tags",
            metavar="N",
            help="Place N reflectors flat on walls; for scanners that measure intensities.",
            show_default=False,
        ),
    ] = None
    post_radius: Annotated[
        float, typer.Option("--radius", metavar="M", help="Radius of a post, metres.")
    ] = 0.1
    width: Annotated[
        float, typer.Option("--width", metavar="M", help="Width of a panel or a tag, metres.")
    ] = 0.6
    min_passage: Annotated[
        float,
        typer.Option(
            "--min-passage",
            metavar="M",
            help="Passages at least this wide are not made narrower than this, metres.",
        ),
    ] = 0.9
    where: Annotated[
        bool | None,
        typer.Option(
            "--on-walls/--free-standing",
            help="Only on walls, or only free-standing.",
            show_default="both",
        ),
    ] = None
    candidates: Annotated[
        int,
        typer.Option("--candidates", metavar="N", help="Maximum number of candidate positions."),
    ] = 200
    seed: Annotated[
        int,
        typer.Option("--seed", metavar="N", help="Seed of the samples on which gains are tested."),
    ] = 0

    def kind(self) -> tuple[Kind, int]:
        """Return the kind and number of the obstacles.

        Raises:
            InputError: not exactly one of them is asked for, or a number is out of its range.
        """
        every: tuple[tuple[Kind, int | None], ...] = (
            ("post", self.posts), ("panel", self.panels), ("tag", self.tags)
        )  # fmt: skip
        requested = [(kind, count) for kind, count in every if count is not None]
        if len(requested) != 1:
            raise InputError(
                "--posts, --panels, --tags: "
                + (
                    "none of them is given"
                    if not requested
                    else f"{len(requested)} of them are given"
                )
                + "; give one, such as --posts 3."
            )
        (kind, count), = requested  # fmt: skip
        if count < 1:
            raise InputError(f"--{kind}s: {count} is no number of {kind}s; give 1 or more.")
        if self.seed < 0:
            raise InputError(f"--seed: {self.seed} is negative; give 0 or more.")
        if kind == "tag" and self.where is False:
            raise InputError("--free-standing: a tag is flat on a wall; leave this out.")
        return kind, count

    def rules(self, scanner: RangeScanner | None = None) -> PlaceRules:
        """Return the placement rules; obstacles reflect if the scanner sees reflectors.

        Raises:
            InputError: a number is out of its range.
        """
        from ambinav.studies.design.place.candidates import PlaceRules

        kind, _ = self.kind()
        return PlaceRules(
            kind=kind,
            radius=self.post_radius,
            width=self.width,
            min_passage=self.min_passage,
            on_walls=self.where is not False,
            free_standing=self.where is not True,
            reflective=scanner is not None and len(scanner.intensity_beams) > 0,
            most=self.candidates,
        )


@dataclass(frozen=True, kw_only=True)
class WhereBadOptions:
    """Options on the regions where bad floor counts."""

    PANEL: ClassVar[str] = "Region"

    polygon: PolygonFile = None
    route: Annotated[
        list[Path] | None,
        typer.Option(
            "--route",
            metavar="FILE",
            help="Count metres of this route, written by `ambinav plan` (.csv, .geojson, .json); "
            "repeatable.",
            show_default="all floor that the robot reaches",
        ),
    ] = None

    def regions(self) -> list[Region]:
        """Return the regions; empty: the whole map.

        Raises:
            InputError: both are given, or a file cannot be read.
        """
        from ambinav.studies.design.region import Region

        check_one(self.polygon, self.route)
        if self.polygon is not None:
            return [Region.of_file(self.polygon)]
        return [route_region(path) for path in self.route or ()]


@options.grouped
def place(
    map_file: options.MapFile,
    scanner: options.Scanner,
    *,
    obstacles: ObstacleOptions,
    output: options.ReportFolder = None,
    bad: WhereBadOptions,
    building: BuildingOptions,
    making: MapOptions,
    robot: ReachOptions,
    pictures: options.Pictures = "png",
    as_json: options.AsJson = False,
) -> None:
    """Find where posts, panels or tags reduce bad floor most, with no passage closed.

    Selects them greedily, one by one, by their true effect on the map; the report states how far
    this is from the optimum of small cases. The map is kept in the store.

    Example: `ambinav design place office.yaml --scanner turtlebot3-lds --posts 3 -o help`
    """
    with reporting():
        making.check()
        above_zero(robot.robot_radius, "--robot-radius", "0.2")
        options.check_pictures(pictures)
        _, count = obstacles.kind()
        obstacles.rules()
        if output is not None:
            from ambinav.studies.design.place.report import FOLDER

            check_writable(output)
            FOLDER.check(output)
        regions = bad.regions()
        environment, chosen = making.load(map_file, scanner, building)
        import numpy as np

        from ambinav.geometry.collision.reach import find_reach
        from ambinav.sensing.robot_radius import robot_radius
        from ambinav.studies.design.place.document import document
        from ambinav.studies.design.place.study import place_obstacles

        reach = find_reach(environment, robot.robot_radius or robot_radius(chosen), robot.start)
        with progress_bars(as_json) as bars:
            amap = making.build(environment, chosen, bars("ambiguity"))
            study = place_obstacles(
                environment,
                chosen,
                amap,
                obstacles.rules(chosen),
                count,
                reach,
                regions,
                np.random.default_rng(obstacles.seed),
                bars,
            )
            if output is None:
                report = document(study, count)
            else:
                from ambinav.studies.design.place.report import write_report

                report = write_report(study, count, output, bars("report"), pictures)
        if as_json:
            typer.echo(report.model_dump_json(indent=2))
        else:
            _show(report, output)


def _show(report: Document, output: Path | None) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    unit = "m²" if report.unit == "m2" else "m"
    console = Console(highlight=False)
    console.print(Text(report.summary))
    for remark in report.remarks:
        console.print(Text(remark))
    table = Table(box=None, pad_edge=False)
    for title in (
        "no.",
        "kind",
        "x (m)",
        "y (m)",
        "stands",
        "gain alone",
        "gain",
        "bad floor left",
    ):
        justify: Literal["left", "right"] = "left" if title in ("kind", "stands") else "right"
        table.add_column(title, justify=justify, no_wrap=True)
    for obstacle in report.obstacles:
        turned = "" if obstacle.direction_deg is None else f" at {obstacle.direction_deg:.0f}°"
        table.add_row(
            str(obstacle.number),
            f"{obstacle.kind}{turned}",
            f"{obstacle.x_m:.2f}",
            f"{obstacle.y_m:.2f}",
            "at a wall" if obstacle.on_wall else "free",
            *(f"{value:,.1f} {unit}" for value in (obstacle.alone, obstacle.gain, obstacle.left)),
        )
    if report.obstacles:
        console.print("", table, sep="\n")
    for small in report.optima:
        reached = (
            "none takes away any bad floor"
            if small.share is None
            else f"greedy reaches {small.share:.1%} of the best"
        )
        console.print(
            Text(
                f"of {small.candidates} candidates, all {small.subsets} subsets of {small.count} "
                f"tried: {reached}"
            )
        )
    if output is not None:
        console.print("", Text(f"report: {output / 'report.html'}"), sep="\n", soft_wrap=True)
