"""Maps of 3D buildings: their cost, and what a scanner that looks up and down gains.

The house is `mesh3d/aws_small_house_visual.ply` of the recorded data, with a VLP-16 half a metre
above the floor.
"""

from __future__ import annotations

import json
import math
import time
from typing import Any

import numba
import numpy as np
import shapely
from harness import arguments, data_file, option, report, table, timed

from ambinav.buildings.mesh.floor import floor_environment
from ambinav.buildings.mesh.read import read_mesh
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments, edges_of
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.sensing import RangeScanner, RangeSensor
from ambinav.sensing.layout import Part

HEIGHT, RADIUS = 0.6, 0.2
"""Radius of the robot, metres."""


def built(env: Environment, scanner: RangeScanner, **options: Any) -> tuple[AmbiguityMap, float]:
    """Build a map; return it and the seconds."""
    seconds, amap = timed(lambda: build_map(env, scanner, store=False, **options))
    return amap, seconds


def house_rows(processes: int) -> list[tuple[object, ...]]:
    """Map the house for a planar laser, and for a VLP-16 with some and with all of its beams."""
    start = time.perf_counter()
    path = data_file("mesh3d/aws_small_house_visual.ply")
    with read_mesh(path, processes=processes) as mesh:
        env = floor_environment(mesh, HEIGHT, RADIUS)
        read = time.perf_counter() - start
        lidar = RangeScanner.from_preset("velodyne-vlp-16")
        planar = RangeScanner.from_preset("rplidar-a2").raised(0.5)
        # Compiles, and starts the processes.
        built(env, lidar, spacing=0.5)
        rows = [("read the mesh, find its floor", "", "", f"{read:.1f}", "", "")]
        for name, scanner, beams in (
            ("rplidar-a2", planar, None),
            ("velodyne-vlp-16", lidar, None),
            ("velodyne-vlp-16, all beams", lidar, lidar.beams),
        ):
            amap, seconds = built(env, scanner, spacing=0.1, max_beams=beams)
            level = amap.dataset["level"].values
            poses = int(amap.dataset["free"].sum())
            used = scanner.beams if beams else _used(amap)
            mean, worst = np.nanmean(level), np.nanquantile(level, 0.99)
            rows.append((name, poses, used, f"{seconds:.1f}", f"{mean:.3f}", f"{worst:.3f}"))
    return rows


def corridor(heights: bool) -> Environment:
    """Return a corridor of 40 x 2 m, bare, or with ceiling beams and shelves at 1.5 m."""
    free = shapely.box(0.0, 0.0, 40.0, 2.0)
    xy = edges_of(free)
    plan = Environment(Segments(xy, np.zeros(len(xy), dtype=np.uint8)), free, name="corridor")
    solids = [
        Solid(shapely.box(x, 0.0, x + 0.2, 2.0), 2.3, 2.6)
        for x in (2.1, 5.3, 7.9, 11.6, 14.2, 17.7, 20.4, 24.1, 26.6, 30.2, 33.0, 36.7)
    ]
    solids += [
        Solid(shapely.box(x, 1.7, x + 1.1, 2.0), 1.4, 1.5)
        for x in (4.0, 9.2, 16.0, 22.1, 28.9, 35.0)
    ]
    walls = np.tile((0.0, 2.6), (len(xy), 1))
    return plan.in_space(
        Prisms(xy, walls, solids=solids if heights else (), floor=0.0, ceiling=2.6)
    )


def corridor_rows() -> list[tuple[object, ...]]:
    """Return the mean level in the corridor's middle, by layout; all sensors have one range."""
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    planar = RangeScanner.planar(sensor, 60, math.tau, z=0.5)
    scanners = {"planar, 60 beams": planar}
    for name in ("velodyne-vlp-16", "ouster-os1-32", "livox-mid-360"):
        layout = RangeScanner.from_preset(name).parts[0].layout
        scanners[f"as {name}"] = RangeScanner((Part(sensor, layout),))
    rows = []
    for name, scanner in scanners.items():
        table_rows = []
        for heights in (False, True):
            amap, _ = built(corridor(heights), scanner, spacing=0.1)
            table_rows.append(float(np.nanmean(amap.dataset["level"].values[:, 60:-60])))
        rows.append((name, *(f"{level:.3f}" for level in table_rows)))
    return rows


def _used(amap: AmbiguityMap) -> int:
    return int(json.loads(amap.dataset.attrs["parameters"])["beams_used"])


def main() -> None:
    """Measure as the command line says, and report."""
    args = arguments(__doc__, threads=2, processes=option(2, "of Embree"))
    numba.set_num_threads(args.threads)
    house = house_rows(args.processes)
    body = "\n\n".join(
        [
            f"{args.threads} threads and {args.processes} processes of Embree; spacing 0.1 m, "
            "radius 0.5 m.",
            "## The house",
            "One build each after a warm-up at 0.5 m. Levels are over all free poses.",
            table(("map", "poses", "beams", "s", "mean level", "99 % level"), house),
            "## What the plane cannot tell",
            "Mean level in the middle 28 m of a corridor of 40 x 2 m, bare, and with 12 beams "
            "under its ceiling (2.3 to 2.6 m) and 6 shelves (1.4 to 1.5 m). All scanners are half "
            "a metre above the floor and have one sensor of 4 m; layouts as of the presets.",
            table(("layout", "bare", "beams and shelves"), corridor_rows()),
        ]
    )  # fmt: skip
    report("Maps in space", ("ambinav", "numba", "embreex", "numpy"), body, args.out)


if __name__ == "__main__":
    main()
