"""`ambinav design place`: where posts, panels or tags help most."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Final

import typer

from ambinav.cli import options
from ambinav.cli.checks import conflict, naming_options
from ambinav.cli.limits import Natural
from ambinav.cli.map_options import BuildingOptions, MapOptions, ReachOptions
from ambinav.cli.printing import finish, show, table
from ambinav.cli.region_options import KeepOut, PolygonFile, check_one, keep_out_zones, route_region
from ambinav.cli.running import check_report, progress_bars, reporting
from ambinav.cli.space_options import SpaceOptions
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav.sensing.scanner import RangeScanner
    from ambinav.studies.design.place.candidates import Kind, PlaceRules
    from ambinav.studies.design.place.document import Document
    from ambinav.studies.design.place.placed_part import PlacedPart
    from ambinav.studies.design.region import Region


_ANY: Final = ("post", "panel", "tag")
_ABOUT: Final[dict[str, tuple[tuple[Kind, ...], str]]] = {
    "post_radius": (("post",), "--radius"), "width": (("panel", "tag"), "--width"),
    "min_passage": (_ANY, "--min-passage"), "bottom": (_ANY, "--bottom"), "top": (_ANY, "--top"),
    "where": (_ANY, "--on-walls/--free-standing"), "candidates": (_ANY, "--candidates"),
    "keep_out": (_ANY, "--keep-out"),
}  # fmt: skip
"""The kinds of obstacles that a field is about, and its option."""
OBSTACLE_COLUMNS: Final = ("no.", "kind", "x (m)", "y (m)", "position")
UNUSED_LAYERS: Final = "has no effect here: floor is judged by its zones"


@dataclass(frozen=True, kw_only=True)
class PositionOptions:
    """Options on the size of obstacles and on their positions.

    Attributes:
        post_radius (M): Radius of a post, metres.
        width (M): Width of a panel or a tag, metres.
        min_passage (M): Passages at least this wide are not made narrower than this, metres.
        where: Only on walls, or only free-standing. [default: both]
        candidates (N): Maximum number of candidate positions of a kind.
    """

    PANEL: ClassVar[str] = "Obstacles"

    post_radius: Annotated[float, typer.Option("--radius")] = 0.1
    width: float = 0.6
    min_passage: float = 0.9
    where: Annotated[bool | None, typer.Option("--on-walls/--free-standing")] = None
    candidates: int = 200

    def check(self, kind: Kind, count: int) -> None:
        """Check the number of obstacles of a kind, and where they may be.

        Raises:
            InputError: there are none, or tags are to be free-standing.
        """
        if count < 1:
            raise InputError(
                f"--{kind}s: {count} is not a valid number of {kind}s; give 1 or more."
            )
        if kind == "tag" and self.where is False:
            raise InputError("--free-standing: a tag is flat on a wall; leave this out.")

    def check_used(self, kinds: Collection[Kind]) -> None:
        """Refuse options on kinds of obstacles that are not added.

        Raises:
            InputError: such an option is given.
        """
        reason = f"is not about {' or '.join(kinds)}s" if kinds else "is about new obstacles"
        for field in fields(self):
            about, option = _ABOUT.get(field.name, ((), ""))
            is_given = getattr(self, field.name) != field.default
            conflict(option, is_given and bool(about) and not {*about} & {*kinds}, reason)

    def rules_of(self, kind: Kind, scanner: RangeScanner | None = None) -> PlaceRules:
        """Return the placement rules; obstacles reflect if the scanner sees reflectors.

        Raises:
            InputError: a number is out of its range.
        """
        from ambinav.studies.design.place.candidates import PlaceRules

        with naming_options("radius", "width", "min_passage"):
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
class SpacePositionOptions(PositionOptions):
    """Options on the size and heights of obstacles and on their positions.

    Attributes:
        bottom (M): Height of their lower edge above the floor, metres, in a building in space.
        top (M): Height of their upper edge likewise. [default: the height of the building]
    """

    bottom: float = 0.0
    top: float | None = None

    def rules_of(self, kind: Kind, scanner: RangeScanner | None = None) -> PlaceRules:
        """Return the placement rules, see `PositionOptions.rules_of`."""
        return replace(super().rules_of(kind, scanner), bottom=self.bottom, top=self.top)


@dataclass(frozen=True, kw_only=True)
class ObstacleOptions(SpacePositionOptions):
    """Options on the obstacles and their positions.

    Attributes:
        candidates (N): Maximum number of candidate positions.
        posts (N): Place N round posts.
        panels (N): Place N flat panels.
        tags (N): Place N reflectors flat on walls; for scanners that measure intensities.
        aged (N): Report also what the obstacles remove in N buildings with displaced walls and
            moved furniture.
        examine: Report also how far greedy search is from the optimum of small cases.
        seed (N): Seed of the aged buildings, and of the samples of `--examine`.
    """

    candidates: int = 400
    posts: int | None = None
    panels: int | None = None
    tags: int | None = None
    keep_out: KeepOut = None
    aged: Natural = 0
    examine: bool = False
    seed: Natural = 0

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
        self.check(kind, count)
        self.check_used([kind])
        drawn = self.aged > 0 or self.examine
        conflict("--seed", self.seed != 0 and not drawn, "is for --aged and --examine")
        return kind, count


@dataclass(frozen=True, kw_only=True)
class WhereBadOptions:
    """Options on the regions where bad floor counts.

    Attributes:
        route (FILE): Count metres of this route, written by `ambinav plan` (.csv, .geojson, .json);
            repeatable. [default: all floor that the robot reaches]
    """

    PANEL: ClassVar[str] = "Region"

    polygon: PolygonFile = None
    route: list[Path] | None = None

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


@options.documented
def place(
    map_file: options.MapFile,
    scanner: options.Scanner,
    *,
    obstacles: ObstacleOptions,
    output: options.ReportFolder = None,
    bad: WhereBadOptions,
    building: BuildingOptions,
    map_options: MapOptions,
    space: SpaceOptions,
    robot: ReachOptions,
    pictures: options.Pictures = "png",
    as_json: options.AsJson = False,
) -> None:
    """Find where posts, panels or tags reduce bad floor most, with no passage closed.

    Selects them greedily, one by one, by their true effect on the map, then moves each to where it
    helps most. The map is kept in the store.

    Example: `ambinav design place office.yaml --scanner turtlebot3-lds --posts 3 -o help`
    """
    with reporting():
        import numpy as np

        from ambinav.studies.design.place.document import document
        from ambinav.studies.design.place.report import STUDY, write_report
        from ambinav.studies.design.place.study import checked_rules, place_obstacles

        space.check()
        conflict("--layers", map_options.layers is not None, UNUSED_LAYERS)
        kind, count = obstacles.kind()
        obstacles.rules_of(kind)
        check_report(STUDY, output, pictures)
        regions, zones = bad.regions(), keep_out_zones(obstacles.keep_out)
        environment, chosen = map_options.load(
            map_file, scanner, building, space, robot.robot_radius or 0.0
        )
        reach = robot.reach(environment, chosen)
        rules = obstacles.rules_of(kind, chosen)
        checked_rules(environment, chosen, rules, count, reach, aged=obstacles.aged, keep_out=zones)
        with progress_bars(as_json) as bars:
            amap = map_options.build(environment, chosen, bars("ambiguity"))
            study = place_obstacles(
                environment,
                chosen,
                amap,
                rules,
                count,
                reach,
                regions,
                np.random.default_rng(obstacles.seed),
                bars,
                examine=obstacles.examine,
                aged=obstacles.aged,
                keep_out=zones,
            )
            if output is None:
                report = document(study, count)
            else:
                report = write_report(study, count, output, bars("report"), pictures)
        finish(report, _show, STUDY.page(output), as_json=as_json)


def obstacle_cells(obstacle: PlacedPart) -> tuple[str, ...]:
    """Return the cells of `OBSTACLE_COLUMNS`."""
    heading = obstacle.direction_deg
    return (
        str(obstacle.number),
        obstacle.kind if heading is None else f"{obstacle.kind} at {heading:z.0f}°",
        f"{obstacle.x_m:.2f}",
        f"{obstacle.y_m:.2f}",
        "at a wall" if obstacle.on_wall else "free",
    )


def _show(report: Document) -> None:
    unit = "m²" if report.unit == "m2" else "m"
    show(report.summary, *report.remarks)
    rows = (
        (
            *obstacle_cells(obstacle),
            *(f"{value:,.1f} {unit}" for value in (obstacle.alone, obstacle.gain, obstacle.left)),
        )
        for obstacle in report.obstacles
    )
    if report.obstacles:
        columns = (*OBSTACLE_COLUMNS, "gain alone", "gain", "bad floor left")
        show("", table(columns, rows, left=("kind", "position"), no_wrap=columns))
    if report.aged is not None:
        aged = report.aged
        show(
            f"in {aged.buildings} aged buildings: {aged.gain:,.1f} {unit} of {aged.before:,.1f} "
            f"{unit} taken away in the mean, {aged.gain_low:,.1f} {unit} at the 10th percentile"
        )
    for small in report.optima:
        reached = (
            "none takes away any bad floor"
            if small.share is None
            else f"greedy reaches {small.share:.1%} of the best"
        )
        show(
            f"of {small.candidates} candidates, all {small.subsets} subsets of {small.count} "
            f"tried: {reached}"
        )
