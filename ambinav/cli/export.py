"""`ambinav export`: files for other programs."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import typer

from ambinav.cli import options
from ambinav.cli.running import check_writable, reporting


def _list_kinds(wanted: bool) -> None:
    if not wanted:
        return
    with reporting():
        from ambinav.export.registry import EXPORTERS

        for name in EXPORTERS.names():
            entry = EXPORTERS.get(name)
            reader = f" [{entry.reader}]" if entry.reader else ""
            typer.echo(f"{name:20} {entry.title}{reader}")
    raise typer.Exit


def _complete_kind(begun: str) -> list[str]:
    """Return the formats that complete a partly typed name in the shell."""
    from ambinav.export.registry import EXPORTERS

    return [name for name in EXPORTERS.names() if name.startswith(begun)]


@dataclass(frozen=True, kw_only=True)
class FloorOptions:
    """Options on the exported floor data."""

    PANEL: ClassVar[str] = "Masks, zones and layers"

    layer: Annotated[
        str | None,
        typer.Option(
            "--layer", metavar="NAME", help="Layer to export.", show_default="the cost layer"
        ),
    ] = None
    zones: Annotated[
        list[str] | None,
        typer.Option(
            "--zone",
            metavar="NAME",
            help="A zone to mark or write; repeatable.",
            show_default="corridor, open; for nav2-keepout open",
        ),
    ] = None
    threshold: Annotated[
        float | None,
        typer.Option(
            "--threshold", help="Mark cells where the layer is at least this, instead of zones."
        ),
    ] = None
    least_area: Annotated[
        float | None,
        typer.Option(
            "--least-area", metavar="M2", help="Leave out smaller zones, m².", show_default="0.5"
        ),
    ] = None
    slowest: Annotated[
        float | None,
        typer.Option(
            "--slowest",
            metavar="PERCENT",
            help="Speed at level 1, percent of full speed.",
            show_default="30",
        ),
    ] = None
    max_speed: Annotated[
        float | None,
        typer.Option(
            "--max-speed", metavar="M/S", help="Maximum speed of the robot; limits are then in m/s."
        ),
    ] = None
    heading: Annotated[
        float | None,
        typer.Option(
            "--heading",
            metavar="DEG",
            help="Heading of the robot, where it matters; see the how-to.",
        ),
    ] = None
    resolution: Annotated[
        float | None,
        typer.Option(
            "--resolution",
            metavar="M",
            help="Cell size of the building's image, metres.",
            show_default="that of the building's own map, or the spacing",
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class RouteOptions:
    """Options on exported routes, drives and route graphs."""

    PANEL: ClassVar[str] = "Routes, drives and graphs"

    routes: Annotated[
        list[Path] | None,
        typer.Option(
            "--route", metavar="FILE", help="A route written by `ambinav plan`; repeatable."
        ),
    ] = None
    step: Annotated[
        float | None,
        typer.Option(
            "--step",
            metavar="M",
            help="Distance between the poses of a path, metres.",
            show_default="0.05",
        ),
    ] = None
    drives: Annotated[
        list[Path] | None,
        typer.Option(
            "--drive",
            metavar="FILE",
            help="A drive.csv of a comparison, or a trajectory .tum; repeatable.",
        ),
    ] = None
    weight: Annotated[
        float | None,
        typer.Option("--weight", "-w", help="Weight of the layer in a cost.", show_default="5"),
    ] = None
    robot_radius: Annotated[
        float | None,
        typer.Option(
            "--robot-radius", metavar="M", help="Radius of a round robot.", show_default="0.2"
        ),
    ] = None
    milestones: Annotated[
        int | None,
        typer.Option(
            "--milestones", metavar="N", help="Milestones of the roadmap.", show_default="500"
        ),
    ] = None
    seed: Annotated[
        int | None,
        typer.Option("--seed", metavar="N", help="Seed of the roadmap.", show_default="0"),
    ] = None


@options.grouped
def export(
    map_file: options.StoredMap,
    kind: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="KIND",
            help="Kind of file; see --list-kinds.",
            show_default=False,
            autocompletion=_complete_kind,
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="OUT",
            help="File to write, with further files beside it; for a drive a folder.",
            show_default=False,
        ),
    ],
    floor: FloorOptions,
    along: RouteOptions,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace existing files.")] = False,
    as_json: options.AsJson = False,
    list_kinds: Annotated[
        bool,
        typer.Option(
            "--list-kinds", callback=_list_kinds, is_eager=True, help="Show the kinds and exit."
        ),
    ] = False,
) -> None:
    """Write files for other programs: Nav2, Autoware, GIS, Foxglove, NumPy.

    Example: `ambinav export office.zarr --to nav2-speed -o speed_mask.yaml`
    """
    with reporting():
        from ambinav.export.formats.exporting import export_map, prepare
        from ambinav.export.options import ExportOptions

        given: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in {**vars(floor), **vars(along)}.items()
            if value is not None
        }
        chosen = ExportOptions(**given)
        exporter, _ = prepare(kind, output, chosen, overwrite)
        check_writable(output)
        from ambinav.maps.ambiguity_map import AmbiguityMap

        amap = AmbiguityMap.open(map_file)
        files = export_map(amap, kind, output, chosen, overwrite=overwrite)
        if as_json:
            result = {
                "map": map_file,
                "kind": kind,
                "title": exporter.title,
                "files": [{"path": str(path), "bytes": path.stat().st_size} for path in files],
            }
            typer.echo(json.dumps(result, indent=2))
        else:
            for path in files:
                typer.echo(f"{kind}: {path}")
