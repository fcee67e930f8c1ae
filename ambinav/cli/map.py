"""`ambinav map`: compute the ambiguity map only."""

from __future__ import annotations

import json
import time
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ambinav.cli import options
from ambinav.cli.beacon_options import BeaconOptions
from ambinav.cli.limits import not_negative
from ambinav.cli.map_options import BuildingOptions, MapOptions
from ambinav.cli.running import check_map_output, note, progress_bars, reporting
from ambinav.cli.space_options import SpaceOptions
from ambinav.cli.tile_options import TileOptions
from ambinav.cli.volume_options import VolumeOptions

if TYPE_CHECKING:
    from ambinav.maps.ambiguity_map import AmbiguityMap


@options.documented
def build(
    map_file: options.MapFile,
    scanner: options.Scanner,
    output: Annotated[str, typer.Option("--output", "-o")],
    building: BuildingOptions,
    map_options: MapOptions,
    space: SpaceOptions,
    tiling: TileOptions,
    flying: VolumeOptions,
    beacons: BeaconOptions,
    robot_radius: Annotated[float, not_negative("0.2")] = 0.0,
    as_json: options.AsJson = False,
) -> None:
    """Compute a building's ambiguity map for a scanner and store it.

    MAP may also be a mesh (.ply, .stl, .obj, .glb), an OctoMap (.bt, .ot) or a point cloud
    (.las, .laz, .e57, .pcd, .xyz, .txt, .ply).

    Example: `ambinav map office.yaml --scanner hokuyo-urg-04lx -o office.zarr`

    For a flying robot: `ambinav map office.ifc --in-space --heights 0.5:1.9:0.35 -s rplidar-a1
    -o building.zarr`

    Parameters:
        output (OUT.zarr): The map to write, a folder or a URL such as s3://maps/office.zarr; an
            older map there is replaced, except with --tile at a URL.
        robot_radius (M): Leave out poses where a disc of this radius would touch a wall; sensors
            are never inside a wall.
    """
    with reporting():
        space.check()
        flying.check(space, tiling)
        beacons.check(heights=flying.heights is not None, tile=tiling.tile is not None)
        tiling.check(output)
        if tiling.tile is None or "://" not in output:
            check_map_output(output)
        if flying.heights is not None:
            flying.build(
                map_file, scanner, building, map_options, space, robot_radius, output, as_json
            )
            return
        environment, chosen = map_options.load(map_file, scanner, building, space, robot_radius)
        if tiling.tile is not None:
            settings = map_options.settings(environment, chosen, robot_radius)
            tiling.build(environment, settings, output, as_json)
            return
        beacons.check_suited(environment, chosen)
        start = time.perf_counter()
        with progress_bars(as_json) as bars:
            amap = map_options.build(environment, chosen, bars("ambiguity"), robot_radius)
            amap = beacons.add(amap, environment)
        seconds = time.perf_counter() - start
        amap.save(output)
        note_unjudged(amap)
        if as_json:
            names = {"environment": environment.name, "scanner": chosen.name}
            figures = {"output": output, **names, **_figures(amap)}
            typer.echo(json.dumps({**figures, "seconds": round(seconds, 3)}, indent=2))
        else:
            typer.echo(repr(amap))
            typer.echo(f"map: {output}")


def note_unjudged(amap: AmbiguityMap) -> None:
    """Print why no floor is judged, if none is."""
    from ambinav.maps.judged_floor import REASONS
    from ambinav.reports.number_text import metres2

    areas = [*amap.judged.areas().values()]
    if not areas[0] and amap.free_area:
        area_reasons = zip(areas[1:], REASONS[1:], strict=True)
        reasons = ", ".join(f"{metres2(area)} {reason}" for area, reason in area_reasons if area)
        note(f"none of the {metres2(amap.free_area)} of free floor is judged: {reasons}.")


def _figures(amap: AmbiguityMap) -> dict[str, Any]:
    """Return the figures of a map for --json."""
    from ambinav.maps import schema

    parts = amap.judged
    return {
        "cells": int(amap.dataset["free"].sum()),
        "impossible_poses": amap.impossible_poses,
        "free_area_m2": round(amap.free_area, 2),
        "robot_radius_m": parts.radius,
        **{name: round(area, 2) for name, area in parts.areas().items()},
        "layers": list(schema.added(amap.dataset)),
        "cost_layer": amap.cost_layer,
        "headings": amap.dataset.sizes["theta"] if amap.has_theta else None,
        "zones": [
            {"zone": s.zone, "share": round(s.share, 4), "area_m2": round(s.area, 2)}
            for s in amap.zone_shares(mask=parts.counted)
        ],
    }
