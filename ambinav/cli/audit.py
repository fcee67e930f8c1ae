"""`ambinav audit`: the report on a building and a scanner."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ambinav.cli import options
from ambinav.cli.running import above_zero, check_writable, progress_bars, reporting
from ambinav.errors import InputError

if TYPE_CHECKING:
    from ambinav.audit.document import Document


def audit(
    map_file: options.MapFile,
    scanner: options.Scanner,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            help="Folder for the report; an earlier report there is replaced.",
            show_default=False,
        ),
    ],
    level: options.Level = None,
    unit: options.Unit = None,
    spacing: options.Spacing = 0.1,
    radius: options.Radius = 0.5,
    headings: options.Headings = None,
    map_std: options.MapStd = None,
    layers: options.Layers = None,
    keep: Annotated[
        Path | None,
        typer.Option(
            "--save-map",
            metavar="OUT.zarr",
            help="Store the map too, as `ambinav map` does; an older map there is replaced.",
            show_default="not stored",
        ),
    ] = None,
    places: Annotated[
        int, typer.Option("--places", metavar="N", help="How many of the worst places to list.")
    ] = 10,
    robot_radius: options.RobotRadius = None,
    start: options.Start = None,
    aliasing: Annotated[
        bool | None,
        typer.Option(
            "--aliasing/--no-aliasing",
            help="Whether to seek places that look alike; it takes long in large buildings.",
            show_default="up to 6000 poses",
        ),
    ] = None,
    pictures: options.Pictures = "png",
    no_store: options.NoStore = False,
    as_json: options.AsJson = False,
) -> None:
    """Report where a building leaves a scanner lost: pictures, zones, the worst places.

    Shares are of floor that is explored and that the robot reaches; the rest is listed beside.

    Writes report.html (stands alone), report.md, report.json and the pictures.

    Example: `ambinav audit office.yaml --scanner hokuyo-urg-04lx -o out`
    """
    with reporting():
        options.check_numbers(spacing, radius, headings, map_std)
        above_zero(robot_radius, "--robot-radius", "0.2")
        options.check_pictures(pictures)
        if places < 0:
            raise InputError(f"--places: {places} is negative; give 0 or more.")
        from ambinav.audit.report import FOLDER

        check_writable(output)
        FOLDER.check(output)
        if keep is not None:
            from ambinav.maps.store import check_target

            check_writable(keep)
            check_target(keep)
            map_path, report_path = keep.absolute(), output.absolute()
            if map_path.is_relative_to(report_path) or report_path.is_relative_to(map_path):
                raise InputError(
                    f"--save-map: {keep} and the report's folder {output} lie one in the other; "
                    "choose another place for the map."
                )
        names = options.layer_names(layers, scanner)
        environment, chosen = options.load(map_file, scanner, spacing, level, unit)
        from ambinav.audit.audit import robot_radius as radius_of
        from ambinav.geometry.collision.reach import find_reach

        # Before the long work: a start inside a wall is told at once.
        reach = find_reach(environment, robot_radius or radius_of(chosen), start)
        with progress_bars(as_json) as bars:
            amap = options.make_map(
                environment,
                chosen,
                spacing=spacing,
                radius=radius,
                headings=headings,
                map_std=map_std,
                progress=bars("ambiguity"),
                layers=names,
                no_store=no_store,
            )
            from ambinav.audit.aliasing import find_aliasing
            from ambinav.audit.audit import audit as examine
            from ambinav.audit.report import write_report

            alikes = None
            if aliasing is not False:
                alikes = find_aliasing(
                    amap, environment, aliasing, reach=reach, report=bars("look-alikes")
                )
            found = examine(amap, environment, chosen, places=places, alikes=alikes, reach=reach)
            report = write_report(found, output, progress=bars("report"), image_format=pictures)
            if keep is not None:
                amap.save(keep)
        if as_json:
            typer.echo(report.model_dump_json(indent=2))
        else:
            _show(report, output)
            if keep is not None:
                typer.echo(f"map: {keep}")


def _show(report: Document, output: Path) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from ambinav.audit.audit import axis_degrees, metres2, percent, places_text
    from ambinav.maps.floor_parts import unreachable_label

    console = Console(highlight=False)
    zones = Table(box=None, pad_edge=False)
    for title in ("floor", "area", "of explored, reachable", "of free"):
        zones.add_column(title, justify="left" if title == "floor" else "right")
    for zone in report.zones:
        zones.add_row(zone.zone, metres2(zone.area_m2), percent(zone.share), "")
    floor = report.floor
    for label, area, of_counted, of_free in (
        ("explored, reachable", floor.counted_area_m2, "100 %", floor.counted_share),
        ("unexplored", floor.unexplored_area_m2, "", floor.unexplored_share),
        (
            unreachable_label(floor.robot_radius_m),
            floor.unreachable_area_m2,
            "",
            floor.unreachable_share,
        ),
        ("free", floor.free_area_m2, "", 1.0),
    ):
        zones.add_row(label, metres2(area), of_counted, percent(of_free))
    console.print(Text(report.summary), "", zones, sep="\n")
    places = [
        f"{zone.zone} {places_text(zone.places, zone.longest_place_m)}"
        for zone in report.zones
        if zone.places
    ]
    if places:
        console.print("", Text(f"places (the longest): {', '.join(places)}"), sep="\n")
    if report.places:
        worst = Table(box=None, pad_edge=False)
        for title in ("place", "zone", "x, y", "extent", "area", "direction", "level"):
            worst.add_column(title, justify="left" if title == "zone" else "right")
        for place in report.places:
            worst.add_row(
                str(place.number),
                place.zone,
                f"{place.x_m:.1f}, {place.y_m:.1f} m",
                f"{place.length_m:.1f} x {place.width_m:.1f} m",
                metres2(place.area_m2),
                axis_degrees(place.direction_deg),
                f"{place.level:.2f}",
            )
        console.print("", worst, sep="\n")
    if report.alikes and report.alikes.poses and not report.alikes.sought:
        left_out = f"look-alikes: not sought among {report.alikes.poses:,} poses; add --aliasing"
        console.print("", Text(left_out), sep="\n")
    if report.alikes and report.alikes.links:
        pairs = Table(box=None, pad_edge=False)
        for title in ("letter", "x, y", "looks like x, y", "turned by", "area", "likeness"):
            pairs.add_column(title, justify="left" if title == "letter" else "right")
        for link in report.alikes.links:
            pairs.add_row(
                link.letter,
                f"{link.x_m:.1f}, {link.y_m:.1f} m",
                f"{link.other_x_m:.1f}, {link.other_y_m:.1f} m",
                f"{link.turn_deg:.0f}°",
                metres2(link.area_m2),
                f"{link.likeness:.2f}",
            )
        console.print("", pairs, sep="\n")
    console.print("", Text(f"report: {output / 'report.html'}"), sep="\n", soft_wrap=True)
