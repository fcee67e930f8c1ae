"""`ambinav design scanners`: which scanner suits a building."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from ambinav.cli import options
from ambinav.cli.limits import Count, Natural, above_zero, not_negative
from ambinav.cli.map_options import LONG_SECONDS, BuildingOptions, MapOptions, ReachOptions
from ambinav.cli.printing import finish, show, table
from ambinav.cli.running import check_report, note, progress_bars, reporting
from ambinav.cli.space_options import SpaceOptions
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rich.table import Table

    from ambinav.geometry.environment import Environment
    from ambinav.routes.route import Route
    from ambinav.sensing.scanner import RangeScanner
    from ambinav.studies.design.scanners.document import Document, ScannerPart
    from ambinav.studies.design.scanners.route_figures import ErrorModel


@dataclass(frozen=True, kw_only=True)
class RouteOptions:
    """Options on the routes and the localizer of the expected errors.

    Attributes:
        route (FILE): A route written by `ambinav plan` (.csv, .geojson, .json); repeatable.
            [default: shortest routes between random places]
        pairs (N): Number of routes to sample; 0: no figures of routes.
        seed (N): Seed of the sampled routes.
        odometry_scale (X): Scale of the odometry errors; 1: AMCL's defaults.
        localizer_beams (N): Number of beams that the localizer uses.
    """

    PANEL: ClassVar[str] = "Routes"

    route: list[Path] | None = None
    pairs: Natural = 20
    seed: Natural = 0
    odometry_scale: Annotated[float, not_negative("0.25", "a number")] = 0.25
    localizer_beams: Count = 60

    def routes(self) -> list[tuple[str, Route]] | None:
        """Return the given routes with their files; None if none is given.

        Raises:
            InputError: one cannot be read.
        """
        from ambinav.routes.files import load_route

        return [(str(path), load_route(path)) for path in self.route] if self.route else None

    def model(self) -> ErrorModel:
        """Return odometry and localizer."""
        from ambinav.drive.noise import OdometryNoise
        from ambinav.studies.design.scanners.route_figures import ErrorModel

        return ErrorModel(
            odometry=OdometryNoise(scale=self.odometry_scale), beams=self.localizer_beams
        )


@dataclass(frozen=True, kw_only=True)
class ComparedSpaceOptions(SpaceOptions):
    """Options that make a building three-dimensional and set the default scanner height.

    Attributes:
        scanner_height (M): Height of scanners whose files give none, metres above the floor.
            [default: 0.3]
    """

    scanner_height: Annotated[float | None, above_zero("0.3")] = None

    @property
    def height(self) -> float:
        """Height of scanners that specify none, metres."""
        from ambinav.studies.design.scanners.mounting import HEIGHT

        return HEIGHT if self.scanner_height is None else self.scanner_height

    def carrier(self, scanners: Sequence[RangeScanner]) -> RangeScanner:
        """Return all scanners mounted on one robot of the largest required width and height."""
        from ambinav.sensing.scanner import RangeScanner
        from ambinav.studies.design.scanners.mounting import mounted

        return RangeScanner.mixed(*(mounted(scanner, self.height) for scanner in scanners))


@options.documented
def scanners(
    map_file: options.MapFile,
    scanner: Annotated[
        list[str] | None, typer.Option("--scanner", "-s", autocompletion=options.complete_preset)
    ] = None,
    every: Annotated[bool, typer.Option("--all")] = False,
    costs: Path | None = None,
    output: options.ReportFolder = None,
    *,
    building: BuildingOptions,
    map_options: MapOptions,
    space: ComparedSpaceOptions,
    robot: ReachOptions,
    on_routes: RouteOptions,
    pictures: options.Pictures = "png",
    as_json: options.AsJson = False,
) -> None:
    """Compare scanners in a building: bad area, routes, and what they cost.

    The same robot carries each scanner along the same routes. A scanner that cannot be used is
    reported, and the others are compared. Maps are stored, so an interrupted run resumes quickly.
    With --extrude, --in-space or a mesh for MAP, planar and 3D scanners are compared in one table.

    Example: `ambinav design scanners office.yaml --all --costs prices.csv -o scanners`

    Parameters:
        scanner (PRESET|FILE): A preset (see `ambinav presets`) or a scanner .yaml file; repeatable.
        every: Compare all presets.
        costs (FILE): Table of scanner, price, power (.csv), or a .yaml mapping. [default: none]
    """
    with reporting():
        import numpy as np

        from ambinav.layers.registry import chosen_layers
        from ambinav.studies.design.scanners.compare import compare_scanners, distinct
        from ambinav.studies.design.scanners.costs import read_costs
        from ambinav.studies.design.scanners.document import document
        from ambinav.studies.design.scanners.report import STUDY, write_report

        space.check()
        check_report(STUDY, output, pictures)
        chosen = _scanner_names(scanner or [], every)
        chosen_layers(map_options.named_layers, None)
        candidates = distinct(chosen)
        if len(candidates) < len(chosen):
            note(f"{len(chosen)} scanners are given; {len(candidates)} of them are different.")
        table_of_costs = None if costs is None else read_costs(costs)
        routes = on_routes.routes()
        environment, _ = replace(map_options, layers=None).load(
            map_file, space.carrier(candidates), building, space, robot.robot_radius or 0.0
        )
        if every and environment.space is None:
            candidates = _without_third_dimension(candidates, scanner or [])
        with progress_bars(as_json) as bars:
            compared = compare_scanners(
                environment,
                candidates,
                spacing=map_options.spacing,
                radius=map_options.radius,
                headings=map_options.headings,
                map_std=map_options.map_std,
                layers=map_options.named_layers,
                robot_radius=robot.robot_radius,
                start=robot.start,
                routes=routes,
                pairs=on_routes.pairs,
                rng=np.random.default_rng(on_routes.seed),
                model=on_routes.model(),
                costs=table_of_costs,
                height=space.height,
                store=options.store_of(
                    map_options.no_store, _announcement(map_options, environment, candidates)
                ),
                progress=bars(f"{len(candidates)} scanners"),
            )
            if output is not None:
                report = write_report(compared, output, bars("report"), pictures)
            else:
                report = document(compared)
        finish(report, _show, STUDY.page(output), as_json=as_json)


def _scanner_names(chosen: list[str], every: bool) -> list[str]:
    """Return the names of presets and files.

    Raises:
        InputError: there is none.
    """
    from ambinav.sensing.presets import preset_names

    if not (chosen or every):
        raise InputError(
            "--scanner: none is given; name some with --scanner, or take all presets with --all."
        )
    # A preset that is also named is compared once.
    return [*chosen, *(name for name in preset_names() if name not in chosen)] if every else chosen


def _without_third_dimension(
    scanners: Sequence[RangeScanner], chosen: list[str]
) -> tuple[RangeScanner, ...]:
    """Return the named scanners, and of the presets those that scan in the plane."""
    from ambinav.sensing.scanner import RangeScanner

    named_scanners = {RangeScanner.load(name).name for name in chosen}
    left_out = [
        scanner.name
        for scanner in scanners
        if scanner.name not in named_scanners and bool(scanner.upright[:, 1].any())
    ]
    if left_out:
        note(
            f"{', '.join(left_out)} look up and down and are left out of a plan; --extrude M, or "
            "--in-space for the heights of an .ifc file, compares them too."
        )
    return tuple(scanner for scanner in scanners if scanner.name not in left_out)


def _announcement(
    map_options: MapOptions, environment: Environment, scanners: Sequence[RangeScanner]
) -> Callable[[], None]:
    """Return a function that announces the total duration, if it is long, once."""

    @cache
    def announce() -> None:
        if not 0.0 < map_options.spacing <= map_options.radius:
            return  # which `build_map` refuses
        seconds = sum(map_options.estimate(environment, scanner).seconds for scanner in scanners)
        if seconds >= LONG_SECONDS:
            note(
                f"{len(scanners)} maps take about {max(seconds / 60.0, 1.0):.0f} minutes, "
                "minus those that the store already has; a wider --spacing takes less."
            )

    return announce


def _show(report: Document) -> None:
    show(report.summary, *report.remarks, "", _table(report))
    if report.fronts:
        show(f"* not dominated by bad area and {report.fronts[0].title}")
    notes = [f"{row.name}: {row.reason}" for row in report.unusable]
    notes += [why for scanner in report.scanners for why in scanner.lacking.values()]
    if notes:
        show(*notes)


def _table(report: Document) -> Table:
    """Format the scanners as a table of at most 80 columns, with units in the titles."""
    columns: list[tuple[str, Callable[[ScannerPart], str]]] = [
        ("", lambda row: "*" if row.on_front else ""),
        ("scanner", lambda row: row.name),
        ("beams", lambda row: str(row.beams)),
        ("range\nm", lambda row: f"{row.max_range_m:g}"),
        ("bad\nm²", lambda row: f"{row.bad_area_m2:,.1f}"),
        ("bad\n%", lambda row: "-" if row.bad_share is None else f"{100 * row.bad_share:.1f}"),
    ]
    if report.routes is not None:
        columns += [
            ("longest\nopen m", lambda row: f"{row.longest_open_m:.1f}"),
            ("error\nmean m", lambda row: f"{row.mean_error_m:.3f}"),
        ]
    if any(row.price is not None for row in report.scanners):
        columns.append(("price", lambda row: "-" if row.price is None else f"{row.price:g}"))
    if any(row.power_w is not None for row in report.scanners):
        columns.append(("power\nW", lambda row: "-" if row.power_w is None else f"{row.power_w:g}"))
    titles = [title for title, _ in columns]
    rows = ([read(row) for _, read in columns] for row in report.scanners)
    return table(titles, rows, left=("", "scanner"), no_wrap=titles, collapse_padding=True)
