"""`ambinav diff`: the difference of two ambiguity maps."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ambinav.cli import options
from ambinav.cli.checks import option_name
from ambinav.cli.gate import DiffGate
from ambinav.cli.limits import Natural, above_zero
from ambinav.cli.map_options import BuildingOptions, MapOptions, ReachOptions
from ambinav.cli.printing import finish, show, table
from ambinav.cli.running import check_report, note, progress_bars, reporting
from ambinav.cli.space_options import SpaceOptions
from ambinav.runtime.errors import InputError
from ambinav.runtime.input_suggestions import STORE, kind_of_path
from ambinav.runtime.progress import Progress

if TYPE_CHECKING:
    from ambinav.maps.ambiguity_map import AmbiguityMap
    from ambinav.studies.diff.document import Document

AS_MADE = {"spacing": "--spacing", "radius": "--ambiguity-radius", "headings": "--headings"}
"""Settings that a building takes from the map that it is compared with."""

_MAP = "An ambiguity map, a folder or a URL, or with --scanner a building."


@options.documented
def diff(
    first: Annotated[str, typer.Argument(metavar="A", help=_MAP, show_default=False)],
    second: Annotated[str, typer.Argument(metavar="B", help=_MAP, show_default=False)],
    *,
    output: options.ReportFolder = None,
    scanner: Annotated[str | None, typer.Option("--scanner", "-s")] = None,
    scanner_b: str | None = None,
    building: BuildingOptions,
    map_options: MapOptions,
    space: SpaceOptions,
    robot: ReachOptions,
    wall_tolerance: Annotated[float | None, above_zero("0.1")] = None,
    places: Natural = 10,
    pictures: options.Pictures = "png",
    gate: DiffGate,
    as_json: options.AsJson = False,
) -> None:
    """Report what changed from A to B: zones, level, walls, parameters.

    A and B are maps, or buildings whose maps are built first, in the same map frame. The options on
    building and map are for buildings; beside a map, its own cells, radius and headings are taken.

    Example: `ambinav diff before.zarr after.zarr -o changes --fail-if "new open area > 1 m2"`

    Parameters:
        scanner (PRESET|FILE): Scanner of both maps, if A and B are buildings. [default: none: A and
            B are maps]
        scanner_b (PRESET|FILE): Scanner of B, if it is another one. [default: as --scanner]
        wall_tolerance (M): Distance up to which two walls are considered the same, metres.
            [default: two cells of the occupancy map, at least 0.1]
        places (N): Number of changed regions to list.
    """
    with reporting():
        from ambinav.studies.diff.difference import difference
        from ambinav.studies.diff.document import document
        from ambinav.studies.diff.report import STUDY, write_report

        space.check()
        conditions = gate.conditions(output)
        check_report(STUDY, output, pictures)
        scanners = scanner, scanner_b or scanner
        _check_scanners((first, second), scanners, scanner_b)
        if _is_map(first) and _is_map(second):
            _refuse_building_options(building, map_options, space)
        for place, other_place in ((first, second), (second, first)):
            if _is_map(place) and not _is_map(other_place):
                map_options = _as_made(place, map_options)
        with progress_bars(as_json) as bars:
            amaps = [
                _open(path, scanner_name, building, map_options, space, bars(f"map {letter}"))
                for path, scanner_name, letter in zip((first, second), scanners, "AB", strict=True)
            ]
        first_map, second_map = (_for_robot(amap, robot) for amap in amaps)
        result = difference(first_map, second_map, wall_tolerance=wall_tolerance)
        report = document(result, places)
        if output is not None:
            write_report(result, report, output, pictures)
        finish(report, _show, STUDY.page(output), as_json=as_json)
        gate.judge(conditions, report, second, as_json=as_json)


def _is_map(place: str) -> bool:
    return "://" in place or kind_of_path(Path(place)) == STORE


def _check_scanners(
    paths: tuple[str, str], scanners: tuple[str | None, str | None], scanner_b: str | None
) -> None:
    """Check that a scanner is given for buildings, and for buildings only.

    Raises:
        InputError: they do not.
    """
    for path, scanner_name in zip(paths, scanners, strict=True):
        if not _is_map(path) and scanner_name is None:
            raise InputError(
                f"{path}: this is not an ambiguity map; give a building with --scanner PRESET, or "
                "a map made by `ambinav map`."
            )
    if scanners[0] is not None and all(map(_is_map, paths)):
        raise InputError(
            f"--scanner: {scanners[0]} is for buildings, but {paths[0]} and {paths[1]} are maps; "
            "leave it out."
        )
    if scanner_b is not None and _is_map(paths[1]):
        raise InputError(
            f"--scanner-b: {scanner_b} is for a building, but {paths[1]} is a map; leave it out."
        )


def _refuse_building_options(*groups: BuildingOptions | MapOptions | SpaceOptions) -> None:
    """Refuse options on map building if both inputs are maps.

    Raises:
        InputError: one is given.
    """
    for group in groups:
        for field in fields(group):
            # Maps are always read without the store.
            if field.name != "no_store" and getattr(group, field.name) != field.default:
                name = "ambiguity_radius" if field.name == "radius" else field.name
                raise InputError(
                    f"{option_name(name)}: this is for buildings, but A and B are "
                    "maps that are made already; leave it out."
                )


def _as_made(place: str, map_options: MapOptions) -> MapOptions:
    """Return the options of a map for a building that is compared with it, where none is given.

    Raises:
        InputError: the map cannot be read.
    """
    from ambinav.maps.ambiguity_map import AmbiguityMap

    made = AmbiguityMap.open(place).parameters
    taken_over = {
        field.name: made[field.name]
        for field in fields(map_options)
        if field.name in AS_MADE
        and getattr(map_options, field.name) == field.default
        and made[field.name] != field.default
    }
    if taken_over:
        texts = ", ".join(f"{AS_MADE[name]} {value}" for name, value in taken_over.items())
        note(f"the building is mapped as {place} is, with {texts}.")
    return replace(map_options, **taken_over)


def _open(
    path: str,
    scanner: str | None,
    building: BuildingOptions,
    map_options: MapOptions,
    space: SpaceOptions,
    progress: Progress,
) -> AmbiguityMap:
    """Read a map, or build the map of a building.

    Raises:
        InputError: it cannot be read or made.
    """
    from ambinav.maps.ambiguity_map import AmbiguityMap

    if scanner is None or _is_map(path):
        return AmbiguityMap.open(path)
    environment, chosen = map_options.load(Path(path), scanner, building, space)
    made = map_options.build(environment, chosen, progress)
    made.source = path
    return made


def _for_robot(amap: AmbiguityMap, robot: ReachOptions) -> AmbiguityMap:
    """Judge a map's floor for the robot of the options, or for its own if none is given.

    Raises:
        InputError: the robot fits nowhere, or not at its start.
    """
    if robot.robot_radius is None and robot.start is None:
        return amap
    from ambinav.geometry.collision.reach import find_reach

    radius = robot.robot_radius or amap.judged.radius
    return amap.for_robot(find_reach(amap.environment, radius, robot.start))


def _show(report: Document) -> None:
    show(report.summary)
    if report.identical:
        return
    for name, part, letter in (("A", report.first, "B"), ("B", report.second, "A")):
        if part.own_layers:
            show(f"layers of {name} that {letter} lacks: {', '.join(part.own_layers)}")
    zones = (
        (
            zone.zone,
            *(f"{area:,.1f} m²" for area in (zone.before_m2, zone.after_m2)),
            *(f"{share:.1%}" for share in (zone.before_share, zone.after_share)),
            *(f"{area:,.1f} m²" for area in (zone.new_m2, zone.lost_m2)),
        )
        for zone in report.zones
    )
    columns: tuple[str, ...] = "zone", "A", "B", "share A", "share B", "new", "lost"
    show("", table(columns, zones, left=("zone",)))
    if report.regions:
        regions = (
            (
                str(region.number), region.kind, f"{region.x_m:.1f}, {region.y_m:.1f} m",
                f"{region.area_m2:,.1f} m²", f"{region.change:+.2f}", region.before, region.after,
            )
            for region in report.regions
        )  # fmt: skip
        columns = "no.", "kind", "x, y", "area", "change", "A", "B"
        show("", table(columns, regions, left=("kind", "A", "B")))
    if report.parameters:
        columns = "parameter", "A", "B"
        rows = ((each.name, each.before, each.after) for each in report.parameters)
        show("", table(columns, rows, left=columns, fold=True))
