"""`ambinav audit`: the report on a building and a scanner."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from ambinav.cli import options
from ambinav.cli.beacon_options import BeaconOptions
from ambinav.cli.forecast_options import LocalizerOptions
from ambinav.cli.gate import AuditGate
from ambinav.cli.limits import Natural, at_least
from ambinav.cli.map_options import BuildingOptions, MapOptions, ReachOptions
from ambinav.cli.printing import finish, show, table
from ambinav.cli.running import check_map_output, check_report, note, one_bar, reporting
from ambinav.cli.space_options import SpaceOptions
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Stages

if TYPE_CHECKING:
    from ambinav.geometry.collision.reach import Reach
    from ambinav.geometry.environment import Environment
    from ambinav.maps.ambiguity_map import AmbiguityMap
    from ambinav.reports.conditions import Condition
    from ambinav.routes.trips import Trip
    from ambinav.sensing.scanner import RangeScanner
    from ambinav.studies.audit.document import Document
    from ambinav.studies.audit.drawing import Draw
    from ambinav.studies.audit.lost_routes import LostRoutes


@dataclass(frozen=True, kw_only=True)
class ReportOptions:
    """Optional parts of the report besides the zones.

    Attributes:
        places (N): Number of the worst places to list.
        aliasing: Search for aliased regions; this takes long in large buildings. [default: up to
            6000 poses]
        keep (OUT.zarr): Store the map too, as `ambinav map` does, in a folder or at a URL; an older
            map there is replaced. [default: not stored]
        posts (N): Report where N posts would help most; 0: never. [default: 3 if they can help more
            than another scanner or other routes]
        no_advice: Leave out the verdict and the trials of remedies for it.
    """

    PANEL: ClassVar[str] = "Report"

    places: Natural = 10
    aliasing: Annotated[bool | None, typer.Option("--aliasing/--no-aliasing")] = None
    keep: Annotated[str | None, typer.Option("--save-map")] = None
    posts: Annotated[int | None, at_least(0)] = None
    no_advice: bool = False
    pictures: options.Pictures = "png"

    def check(self, output: Path) -> None:
        """Check what can be checked before the long work.

        Raises:
            InputError: a value cannot be used, or nothing can be written where it is to be.
        """
        from ambinav.studies.audit.report import STUDY

        if self.posts and self.no_advice:
            raise InputError(
                "--posts: posts are part of the advice, which --no-advice leaves out; give only "
                "one of the two."
            )
        check_report(STUDY, output, self.pictures)
        if self.keep is not None:
            from ambinav.maps.address import Address

            check_map_output(self.keep)
            folder, report_path = Address.of(self.keep).folder, output.absolute()
            map_path = None if folder is None else folder.absolute()
            if map_path is not None and (
                map_path.is_relative_to(report_path) or report_path.is_relative_to(map_path)
            ):
                raise InputError(
                    f"--save-map: {self.keep} and the report's folder {output} must not contain "
                    "each other; choose another place for the map."
                )


@dataclass(frozen=True, kw_only=True)
class TripOptions(LocalizerOptions):
    """Options on the routes that are forecast, and on the robot that drives them.

    Attributes:
        trips (FILE): Named places and trips between them that are forecast (.yaml: places, trips).
            [default: 40 pairs of places, drawn from the floor]
    """

    trips: Path | None = None

    def read(self) -> tuple[Trip, ...]:
        """Check the names and read the trips, before any work; () without a file.

        Raises:
            InputError: a value or the file cannot be used.
        """
        from ambinav.routes.trips import read_trips

        self.check()
        return () if self.trips is None else read_trips(self.trips)

    def forecaster(
        self, trips: tuple[Trip, ...], environment: Environment, reach: Reach
    ) -> Callable[[AmbiguityMap], LostRoutes | None]:
        """Find the routes of the trips; return what forecasts them, or sampled ones, on a map.

        It raises an `InputError` where trips have no forecast, and gives None, with a note, where
        sampled routes have none.

        Raises:
            InputError: a place is inside a wall or outside of the building, or no route leads to
                it.
        """
        from ambinav.routes.trip_routes import trip_routes
        from ambinav.studies.audit.lost_routes import find_lost_routes

        routes = trip_routes(environment, reach, trips, str(self.trips)) if trips else ()

        def find(amap: AmbiguityMap) -> LostRoutes | None:
            try:
                return find_lost_routes(
                    amap, environment, reach, trips=trips, routes=routes, **self.names
                )
            except InputError as error:
                if trips:
                    raise InputError(f"{self.trips}: {error}") from error
                note(f"the audit has no forecasts of routes: {error}")
                return None

        return find


@options.documented
def audit(
    map_file: options.MapFile,
    scanner: options.Scanner,
    output: Annotated[Path, typer.Option("--output", "-o")],
    building: BuildingOptions,
    map_options: MapOptions,
    space: SpaceOptions,
    robot: ReachOptions,
    report_options: ReportOptions,
    forecasts: TripOptions,
    gate: AuditGate,
    beacons: BeaconOptions,
    as_json: options.AsJson = False,
    quiet: options.Quiet = False,
) -> None:
    """Report where a building leaves a scanner lost, and what to do about it.

    Shares refer to floor that is explored and that the robot can reach; all other floor is listed
    separately.

    Writes report.html (self-contained), report.md, report.json and the pictures.

    Example: `ambinav audit office.yaml --scanner hokuyo-urg-04lx -o out --fail-if "open > 2 %"`

    With trips that robots make: `ambinav audit office.yaml -s turtlebot3-lds -o out --trips
    places.yaml --odometry poor --localizer amcl`

    Parameters:
        output (DIR): Folder for the report; an earlier report there is replaced.
    """
    from ambinav.studies.audit.drawing import drawing

    with reporting(), contextlib.ExitStack() as stack:
        from ambinav.studies.audit.report import STUDY

        space.check()
        beacons.check()
        conditions = gate.conditions(output)
        report_options = replace(
            report_options, aliasing=gate.aliasing(conditions, report_options.aliasing)
        )
        report_options.check(output)
        trips = forecasts.read()
        environment, chosen = map_options.load(
            map_file, scanner, building, space, robot.robot_radius or 0.0
        )
        beacons.check_suited(environment, chosen)

        # Before the long work, so that a start or a place inside a wall is refused at once.
        reach = robot.reach(environment, chosen)
        find_lost = forecasts.forecaster(trips, environment, reach)
        draw = stack.enter_context(drawing())
        with one_bar(
            as_json or quiet, _stages(map_options, environment, chosen, report_options)
        ) as stage:
            built = map_options.build(environment, chosen, stage("ambiguity"))
            amap = beacons.add(built, environment).for_robot(reach)
            report = _examine(
                amap, environment, chosen, reach, find_lost, bool(trips), report_options, output,
                conditions, stage, draw,
            )  # fmt: skip
        finish(report, _show, STUDY.page(output), as_json=as_json, quiet=quiet)
        if report_options.keep is not None and not (as_json or quiet):
            typer.echo(f"map: {report_options.keep}")
        gate.judge(conditions, report, map_file, as_json=as_json or quiet)


def _examine(
    amap: AmbiguityMap,
    environment: Environment,
    scanner: RangeScanner,
    reach: Reach,
    find_lost: Callable[[AmbiguityMap], LostRoutes | None],
    has_trips: bool,
    report_options: ReportOptions,
    output: Path,
    conditions: tuple[Condition, ...],
    stage: Stages,
    draw: Draw,
) -> Document:
    """Examine the map and write the report and, if requested, the map."""
    from ambinav.studies.audit.advise import advise
    from ambinav.studies.audit.aliasing import find_aliasing
    from ambinav.studies.audit.audit import Audit
    from ambinav.studies.audit.audit import audit as examine
    from ambinav.studies.audit.gate_check import GateCheck
    from ambinav.studies.audit.report import write_audit

    aliasing = None
    if report_options.aliasing is not False:
        seeking = stage("aliasing")
        aliasing = find_aliasing(amap, environment, report_options.aliasing, progress=seeking)
    result = examine(
        amap, environment, scanner, places=report_options.places, aliasing=aliasing, reach=reach
    )

    forecasting, advising = stage("routes"), stage("advice")

    def forecast(result: Audit) -> Audit:
        result = replace(result, lost=find_lost(result.amap))
        forecasting(1.0)
        return result

    def advised(result: Audit, go_on: Callable[[], None]) -> Audit:
        def report(share: float) -> None:
            go_on()
            advising(share)

        # Meanwhile the pictures are drawn, which need neither forecasts nor advice.
        if not has_trips:
            result = forecast(result)
        go_on()
        gate = GateCheck(conditions, result) if conditions else None
        return advise(result, posts=report_options.posts, gate=gate, progress=report)

    if report_options.no_advice or has_trips:  # trips may have no forecast: before all is written
        result = forecast(result)
    report = write_audit(
        result, output, stage("pictures"), report_options.pictures,
        None if report_options.no_advice else advised, draw,
    )  # fmt: skip
    if report_options.keep is not None:
        amap.save(report_options.keep)
    return report


def _stages(
    map_options: MapOptions,
    environment: Environment,
    scanner: RangeScanner,
    report_options: ReportOptions,
) -> dict[str, float]:
    """Return the steps of an audit with their approximate durations, seconds."""
    return {
        "ambiguity": map_options.estimate(environment, scanner).seconds,
        "aliasing": 0.0 if report_options.aliasing is False else 0.5,
        "pictures": 0.5 + 0.25 * report_options.places,
        "routes": 1.5,
        "advice": 0.0 if report_options.no_advice else 1.5,
    }


def _show(report: Document) -> None:
    from rich.text import Text

    from ambinav.maps.judged_floor import unreachable_label
    from ambinav.reports.number_text import metres2, percent

    floor = report.floor

    def share_of(share: float) -> str:
        """Format a share of the floor that counts."""
        return percent(share if floor.counted_area_m2 else None)

    rows = [(zone.zone, metres2(zone.area_m2), share_of(zone.share), "") for zone in report.zones]
    rows += [
        (label, metres2(area), of_counted, percent(of_free))
        for label, area, of_counted, of_free in (
            ("explored, reachable", floor.counted_area_m2, share_of(1.0), floor.counted_share),
            ("unexplored", floor.unexplored_area_m2, "", floor.unexplored_share),
            (
                unreachable_label(floor.robot_radius_m),
                floor.unreachable_area_m2,
                "",
                floor.unreachable_share,
            ),
            ("outside of the building", floor.outside_area_m2, "", floor.outside_share),
            ("free", floor.free_area_m2, "", 1.0),
        )
    ]
    if report.verdict is not None:
        show(Text(report.verdict.sentence, style="bold"), "")
    columns = "floor", "area", "of explored, reachable", "of free"
    show(report.summary, "", table(columns, rows, left=("floor",)))
    _show_advice(report)
    _show_places(report)
    _show_lost(report)
    _show_aliasing(report)
    _show_help(report)


def _show_advice(report: Document) -> None:
    from ambinav.reports.number_text import metres2
    from ambinav.studies.audit.verdict import CHOICE

    if report.verdict is None or not report.verdict.tried:
        return
    tried = table(
        ("tried", "bad floor after", "95 % interval", "pays"),
        (
            (
                change.title,
                metres2(change.after_m2),
                f"{metres2(change.after_low_m2)} to {metres2(change.after_high_m2)}"
                if change.places
                else "",
                "yes" if change.pays else "",
            )
            for change in report.verdict.tried
        ),
        left=("tried", "pays"),
    )
    choice = "" if not report.verdict.advice else CHOICE
    show("", f"bad floor now: {metres2(report.verdict.bad_m2)}", tried, choice)


def _show_places(report: Document) -> None:
    from ambinav.reports.number_text import metres2
    from ambinav.studies.audit.audit import axis_degrees, places_text

    places = [
        f"{zone.zone} {places_text(zone.places, zone.longest_place_m)}"
        for zone in report.zones
        if zone.places
    ]
    if places:
        show("", f"places (the longest): {', '.join(places)}")
    worst = (
        (
            str(place.number),
            place.zone,
            f"{place.x_m:.1f}, {place.y_m:.1f} m",
            f"{place.length_m:.1f} x {place.width_m:.1f} m",
            metres2(place.area_m2),
            axis_degrees(place.direction_deg),
            f"{place.level:.2f}",
        )
        for place in report.places
    )
    if report.places:
        columns = "place", "zone", "x, y", "extent", "area", "direction", "level"
        show("", table(columns, worst, left=("zone",)))


def _show_lost(report: Document) -> None:
    from ambinav.reports.number_text import percent
    from ambinav.studies.audit.lost_routes import MEASURED

    if report.lost is None:
        return
    rows = (
        (
            route.start_text,
            route.goal_text,
            f"{route.length_m:.1f} m",
            percent(route.lost_probability),
            route.measured_text,
            "" if route.x_m is None else f"{route.x_m:.1f}, {route.y_m:.1f} m",
            route.kind or "",
        )
        for route in report.lost.routes
    )
    show("", report.lost.text)
    if report.lost.routes:
        columns = "from x, y", "to x, y", "length", "lost", "measured", "mostly near", "error"
        show("", table(columns, rows, left=("error",)), MEASURED)


def _show_aliasing(report: Document) -> None:
    from ambinav.reports.number_text import metres2, percent

    aliasing = report.aliasing
    if aliasing and aliasing.poses and not aliasing.sought:
        show("", f"aliasing: not sought among {aliasing.poses:,} poses; add --aliasing")
    if aliasing and aliasing.sought and aliasing.share is not None and not aliasing.pairs:
        share = percent(aliasing.share)
        show("", f"aliasing: no two separate regions; {share} of the aliased poses are elsewhere")
    if aliasing and aliasing.pairs:
        pairs = (
            (
                pair.letter,
                f"{pair.x_m:.1f}, {pair.y_m:.1f} m",
                f"{pair.other_x_m:.1f}, {pair.other_y_m:.1f} m",
                f"{pair.turn_deg:z.0f}°",
                metres2(pair.area_m2),
                f"{pair.likeness:.2f}",
            )
            for pair in aliasing.pairs
        )
        columns = "letter", "x, y", "aliased with x, y", "turned by", "area", "likeness"
        show("", table(columns, pairs, left=("letter",)))
        for row in aliasing.repetitions:
            show(row.sentence)


def _show_help(report: Document) -> None:
    from ambinav.reports.number_text import metres2

    if report.helps is None:
        return
    if report.helps.reason:
        show("", f"what would help: {report.helps.reason}")
    posts = (
        (
            str(post.number),
            f"{post.x_m:.1f}, {post.y_m:.1f} m",
            "at a wall" if post.on_wall else "free",
            metres2(post.gain),
            metres2(post.left),
        )
        for post in report.helps.posts
    )
    if report.helps.posts:
        columns = "post", "x, y", "position", "removes", "bad floor left"
        show("", table(columns, posts, left=("position",)))
