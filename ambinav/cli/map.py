"""`ambinav map`: the ambiguity map alone."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated

import typer

from ambinav.cli import options
from ambinav.cli.running import check_writable, not_negative, progress_bars, reporting


def build(
    map_file: options.MapFile,
    scanner: options.Scanner,
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="OUT.zarr",
            help="The map to write; an older map there is replaced.",
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
    robot_radius: Annotated[
        float,
        typer.Option(
            "--robot-radius",
            metavar="M",
            help="Leave out poses at which a disc of so many metres would touch a wall; sensors "
            "never stand in one.",
        ),
    ] = 0.0,
    no_store: options.NoStore = False,
    as_json: options.AsJson = False,
) -> None:
    """Compute a building's ambiguity map for a scanner and store it.

    Example: `ambinav map office.yaml --scanner hokuyo-urg-04lx -o office.zarr`
    """
    with reporting():
        options.check_numbers(spacing, radius, headings, map_std)
        not_negative(robot_radius, "--robot-radius", "0.2")
        from ambinav.maps import schema
        from ambinav.maps.store import check_target

        check_writable(output)
        check_target(output)
        names = options.layer_names(layers, scanner)
        environment, chosen = options.load(map_file, scanner, spacing, level, unit)
        start = time.perf_counter()
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
                robot_radius=robot_radius,
                no_store=no_store,
            )
        seconds = time.perf_counter() - start
        amap.save(output)
        if as_json:
            from ambinav.maps.floor_parts import FloorParts

            parts = FloorParts.of(amap)
            result = {
                "output": str(output),
                "environment": environment.name,
                "scanner": chosen.name,
                "cells": int(amap.dataset["free"].sum()),
                "free_area_m2": round(amap.free_area, 2),
                "explored_area_m2": round(parts.area(parts.counted), 2),
                "unexplored_area_m2": round(parts.area(parts.unexplored), 2),
                "layers": list(schema.added(amap.dataset)),
                "cost_layer": amap.cost_layer,
                "headings": amap.dataset.sizes["theta"] if amap.has_theta else None,
                "zones": [
                    {"zone": s.zone, "share": round(s.share, 4), "area_m2": round(s.area, 2)}
                    for s in amap.zone_shares(mask=parts.counted)
                ],
                "seconds": round(seconds, 3),
            }
            typer.echo(json.dumps(result, indent=2))
        else:
            typer.echo(repr(amap))
            typer.echo(f"map: {output}")
