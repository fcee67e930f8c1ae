"""`ambinav export`: files for other programs."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import typer

from ambinav.cli import options
from ambinav.cli.running import check_writable, reporting


def _list_kinds(is_given: bool) -> None:
    if not is_given:
        return
    with reporting():
        from ambinav.export.registry import EXPORTERS

        for name in EXPORTERS.names():
            entry = EXPORTERS.get(name)
            reader = f" [{entry.reader}]" if entry.reader else ""
            typer.echo(f"{name:20} {entry.title}{reader}")
    raise typer.Exit


_complete_kind = options.completing(
    "ambinav.export.registry", lambda registry: registry.EXPORTERS.names()
)


@dataclass(frozen=True, kw_only=True)
class FloorOptions:
    """Options on the exported floor data.

    Attributes:
        layer (NAME): Layer to export. [default: the cost layer]
        zones (NAME): A zone to mark or write; repeatable. [default: corridor, open; for
            nav2-keepout open]
        threshold: Mark cells where the layer is at least this, instead of zones.
        least_area (M2): Leave out smaller zones, m². [default: 0.5]
        slowest (PERCENT): Speed at level 1, percent of full speed; Nav2's limits are at least 1.
            [default: 30]
        max_speed (M/S): Maximum speed of the robot; limits are then in m/s.
        heading (DEG): Heading of the robot, where it matters; see the how-to.
        package (NAME/FOLDER): ROS package and folder that will hold a mask, for its parameters.
        resolution (M): Cell size of the building's image, metres. [default: that of the building's
            own map, or the spacing]
    """

    PANEL: ClassVar[str] = "Masks, zones and layers"

    layer: str | None = None
    zones: Annotated[list[str] | None, typer.Option("--zone")] = None
    threshold: float | None = None
    least_area: float | None = None
    slowest: float | None = None
    max_speed: float | None = None
    heading: float | None = None
    package: str | None = None
    resolution: float | None = None


@dataclass(frozen=True, kw_only=True)
class RouteOptions:
    """Options on exported routes, drives and route graphs.

    Attributes:
        routes (FILE): A route written by `ambinav plan`; repeatable.
        step (M): Distance between the poses of a path, metres. [default: 0.05]
        drives (FILE): A drive.csv of a comparison, or a trajectory .tum; repeatable.
        weight: Weight of the layer in a cost. [default: 5]
        robot_radius (M): Radius of a round robot. [default: 0.2]
        milestones (N): Milestones of the roadmap. [default: 500]
        seed (N): Seed of the roadmap. [default: 0]
    """

    PANEL: ClassVar[str] = "Routes, drives and graphs"

    routes: Annotated[list[Path] | None, typer.Option("--route")] = None
    step: float | None = None
    drives: Annotated[list[Path] | None, typer.Option("--drive")] = None
    weight: Annotated[float | None, typer.Option("--weight", "-w")] = None
    robot_radius: float | None = None
    milestones: int | None = None
    seed: int | None = None


@options.documented
def export(
    map_file: options.StoredMap,
    kind: Annotated[str, typer.Option("--to", autocompletion=_complete_kind)],
    output: Annotated[Path, typer.Option("--output", "-o")],
    floor: FloorOptions,
    along: RouteOptions,
    overwrite: bool = False,
    as_json: options.AsJson = False,
    list_kinds: Annotated[
        bool, typer.Option("--list-kinds", callback=_list_kinds, is_eager=True)
    ] = False,
) -> None:
    """Write files for other programs: Nav2, Autoware, GIS, Foxglove, NumPy.

    Example: `ambinav export office.zarr --to nav2-speed -o speed_mask.yaml`

    Parameters:
        kind (KIND): Kind of file; see --list-kinds.
        output (OUT): File to write, with further files beside it; for a drive a folder.
        overwrite: Replace existing files.
        list_kinds: Show the kinds and exit.
    """
    with reporting():
        from ambinav.export.formats.exporting import export_map, prepare
        from ambinav.export.options import ExportOptions

        settings: dict[str, Any] = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in {**vars(floor), **vars(along)}.items()
            if value is not None
        }
        chosen = ExportOptions(**settings)
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
