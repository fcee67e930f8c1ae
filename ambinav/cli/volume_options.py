"""Option of `ambinav map` for flying robots: a map at each of several heights, as one volume."""

from __future__ import annotations

import functools
import json
import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import typer

from ambinav.cli import options
from ambinav.cli.checks import conflict
from ambinav.cli.map_options import BuildingOptions, MapOptions
from ambinav.cli.running import note, progress_bars
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav.cli.space_options import SpaceOptions
    from ambinav.cli.tile_options import TileOptions
    from ambinav.maps.ambiguity_volume import AmbiguityVolume

MOST = 1000
"""Heights at the most."""


@dataclass(frozen=True, kw_only=True)
class VolumeOptions:
    """Options on a volume for flying robots.

    Attributes:
        heights (FIRST:LAST:STEP): Map the building at each of these heights of a flying robot, z in
            the map frame, metres, or at A,B,C in equal steps; the result is a volume for `ambinav
            plan --space r3`, and --robot-radius that of a sphere around the robot (default: the
            scanner's robot_radius, or 0.2). [default: a map of a robot on the floor]
    """

    PANEL: ClassVar[str] = "Flying robots"

    heights: str | None = None

    def check(self, space: SpaceOptions, tiling: TileOptions) -> None:
        """Check the heights, and refuse options for robots on the floor.

        Raises:
            InputError: a value or a combination of options cannot be used.
        """
        if self.heights is not None:
            highest, numbers = self.values()[-1], self.heights.split(":")
            if len(numbers) > 1 and not math.isclose(highest, float(numbers[1]), abs_tol=1e-6):
                note(f"--heights: the steps end at {highest:g} m, not at {float(numbers[1]):g} m.")
            floor = "is for a robot on the floor, and --heights for one that flies"
            conflict("--scanner-height", space.scanner_height is not None, floor)
            conflict("--tile", tiling.tile is not None, floor)

    def values(self) -> list[float]:
        """Return the heights, metres.

        Raises:
            InputError: the option is neither a range nor a list, or has fewer than two heights.
        """
        text = self.heights or ""
        is_range = ":" in text
        try:
            numbers = [float(part) for part in text.split(":" if is_range else ",")]
        except ValueError:
            numbers = []
        if is_range:
            first, last, step = numbers if len(numbers) == 3 else (0.0, 0.0, 0.0)
            count = (last - first) / step if step else math.nan
            numbers = []
            if math.isfinite(count) and 0.0 < count < MOST:
                numbers = [first + step * k for k in range(math.floor(count + 1e-6) + 1)]
        if not 2 <= len(numbers) <= MOST:
            raise InputError(
                f"--heights: {text!r} is not a row of two or more heights; give "
                "FIRST:LAST:STEP, e.g. 0.5:1.9:0.35, or 0.5,1.2,1.9."
            )
        return numbers

    def build(
        self,
        map_file: Path,
        scanner: str,
        building: BuildingOptions,
        map_options: MapOptions,
        space: SpaceOptions,
        robot_radius: float,
        output: str,
        as_json: bool,
    ) -> None:
        """Build the volume, write it and print its figures.

        Raises:
            InputError: the building is a plan, see `build_volume`, or nothing can be written.
        """
        from ambinav.map_building.volume import build_volume
        from ambinav.sensing.robot_radius import robot_radius as own_radius
        from ambinav.sensing.scanner import RangeScanner

        carried = RangeScanner.load(scanner)
        radius = robot_radius or own_radius(carried)
        # The floor of a mesh is found for a robot that stands on it before it takes off.
        rise = max(2.0 * radius - float(carried.upright[:, 0].max()), 0.0)
        environment, _ = map_options.load(map_file, carried.raised(rise), building, space, radius)
        if environment.space is None:
            raise InputError(
                f"--heights: {map_file} is a plan, without heights; give --extrude with the height "
                "of its walls, e.g. 2.5, or for an .ifc file --in-space."
            )
        heights = self.values()
        announce = functools.cache(lambda: map_options.announce(environment, carried, len(heights)))
        start = time.perf_counter()
        with progress_bars(as_json) as bars:
            volume = build_volume(
                environment, carried, heights, map_options.spacing, robot_radius=radius,
                progress=bars("ambiguity"), store=options.store_of(map_options.no_store, announce),
                **map_options.arguments(carried),
            )  # fmt: skip
        seconds = time.perf_counter() - start
        volume.save(output)
        if as_json:
            document = {"output": output, **_figures(volume), "seconds": round(seconds, 3)}
            typer.echo(json.dumps(document, indent=2))
            return
        typer.echo(repr(volume))
        for row in _figures(volume)["heights"]:
            level = "no level" if row["mean"] is None else f"mean {row['mean']:.3f}"
            typer.echo(f"z = {row['z_m']:g} m: {row['free_area_m2']:.1f} m² free, {level}")
        typer.echo(f"volume: {output}")


def _figures(volume: AmbiguityVolume) -> dict[str, Any]:
    """Return the figures of a volume for --json."""
    import numpy as np

    attrs, cost = volume.dataset.attrs, volume.dataset[volume.cost_layer].values
    levels, rows, columns = volume.free.shape
    return {
        "environment": attrs["environment"],
        "scanner": attrs["scanner"],
        "size": {"heights": levels, "rows": rows, "columns": columns},
        "spacing_m": volume.spacing,
        "robot_radius_m": volume.robot_radius,
        "layers": list(volume.layers),
        "cost_layer": volume.cost_layer,
        "triangles": len(volume.surfaces),
        "heights": [
            {
                "z_m": float(z),
                "cells": int(free.sum()),
                "free_area_m2": round(float(free.sum()) * volume.spacing**2, 2),
                "mean": None if np.isnan(cost[k]).all() else round(float(np.nanmean(cost[k])), 4),
            }
            for k, (z, free) in enumerate(zip(volume.heights, volume.free, strict=True))
        ],
    }
