"""Maps of 3D buildings: their cost, and a laser's slice of one against its 2D map.

The house is `mesh3d/aws_small_house_visual.ply` of the recorded data, with a VLP-16 half a metre
above the floor. Building 079 of Freiburg is `mesh3d/geb079.bt`, voxels of 8 cm, against the
occupancy map of the log of the same building, `maps_from_logs/freiburg-079.yaml`: recorded on
other days, in frames of their own. The two are laid over each other by their walls; then one planar
laser gets a map of each, and zones are compared on floor that both
have seen.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from pathlib import Path
from typing import Any

import numba
import numpy as np
import shapely
from harness import add_out, report, table
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from ambinav.buildings.load import load_environment
from ambinav.buildings.mesh.floor import floor_environment
from ambinav.buildings.mesh.octomap import read_octomap
from ambinav.buildings.mesh.read import read_mesh
from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments, edges_of
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import NOT_FREE, UNEXPLORED, ZONES
from ambinav.sensing import RangeScanner, RangeSensor
from ambinav.sensing.layout import Part

Points = NDArray[np.float64]

HEIGHT, RADIUS = 0.6, 0.2
"""Radius of the robot, metres."""
LASER_HEIGHT = 0.4
RANGES = (1.0, 1.5, 2.0, 4.0)
SLICE = (0.4, 1.6)
"""Heights of the voxels that walls are laid over, metres: what is lower is furniture."""
SPAN = 45.0
"""Half the edge of the pictures that are laid over each other, metres."""


def built(env: Environment, scanner: RangeScanner, **options: Any) -> tuple[AmbiguityMap, float]:
    """Build a map; return it and the seconds."""
    start = time.perf_counter()
    amap = build_map(env, scanner, store=False, **options)
    return amap, time.perf_counter() - start


def house_rows(data: Path, processes: int) -> list[tuple[object, ...]]:
    """Map the house for a planar laser, and for a VLP-16 with some and with all of its beams."""
    start = time.perf_counter()
    path = data / "mesh3d" / "aws_small_house_visual.ply"
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


def points_along(env: Environment) -> Points:
    """Return points every 5 cm along the walls of a plan, shape (N, 2)."""
    ends = env.segments.xy[env.segments.walls]
    count = np.maximum((np.hypot(*(ends[:, 2:] - ends[:, :2]).T) / 0.05).astype(int), 1)
    share = np.concatenate([(np.arange(n) + 0.5) / n for n in count])
    ends = np.repeat(ends, count, axis=0)
    return ends[:, :2] + share[:, None] * (ends[:, 2:] - ends[:, :2])


def picture(points: Points, cell: float) -> NDArray[np.float64]:
    """Return walls as a blurred picture."""
    edges = np.arange(-SPAN, SPAN + cell / 2, cell)
    counts, _, _ = np.histogram2d(points[:, 0], points[:, 1], bins=[edges, edges])
    return gaussian_filter((counts > 0).astype(float), 1.0)


def registration(fixed: Points, moving: Points) -> tuple[float, float, float]:
    """Find the turn (radians) and shift (metres) that best align `moving` with `fixed`."""
    angles, best = np.radians(np.arange(0.0, 360.0, 3.0)), (0.0, 0.0, 0.0)
    for cell, step in ((0.2, math.radians(0.25)), (0.1, 0.0)):
        shown, best_score = picture(fixed, cell), -1.0
        for angle in angles.tolist():
            c, s = math.cos(angle), math.sin(angle)
            turned = moving @ np.array([[c, s], [-s, c]])
            match = fftconvolve(shown, picture(turned, cell)[::-1, ::-1], mode="full")
            row, column = np.unravel_index(match.argmax(), match.shape)
            if match[row, column] > best_score:
                best_score = match[row, column]
                middle = len(shown) - 1
                best = angle, (row - middle) * cell, (column - middle) * cell
        angles = best[0] + step * np.arange(-12, 13)
    return best


def walls_of(mesh: Mesh) -> Points:
    """Return the positions of upright faces within the heights `SLICE`, shape (N, 2)."""
    middle = mesh.triangles.mean(axis=1)
    upright = np.abs(mesh.surface_normal[:, 2]) < 0.5
    inside = (middle[:, 2] > SLICE[0]) & (middle[:, 2] < SLICE[1])
    return np.asarray(middle[upright & inside][:, :2])


def geb079(data: Path, processes: int) -> tuple[str, list[tuple[object, ...]]]:
    """Compare a plan with a 3D map of it: their alignment, and their zones' agreement by range."""
    plan = load_environment(data / "maps_from_logs" / "freiburg-079.yaml")
    with read_octomap(data / "mesh3d" / "geb079.bt", processes=processes) as mesh:
        angle, dx, dy = registration(points_along(plan), walls_of(mesh))
        plan = plan.transformed(0.0, -dx, -dy).transformed(-angle)
        # Maps are made of all floor under the roof; they are compared where it was seen.
        seen = floor_environment(mesh, HEIGHT, RADIUS)
        env = floor_environment(mesh, HEIGHT, RADIUS, floor=seen.floor)
        rows = []
        for reach in RANGES:
            sensor = RangeSensor(max_range=reach, std=0.03, resolution=0.001)
            laser = RangeScanner.planar(sensor, 60, math.tau, z=LASER_HEIGHT)
            flat, _ = built(plan, laser, spacing=0.1, map_std=0.03)
            solid, _ = built(env, laser, spacing=0.1, map_std=0.03)
            rows.append((f"{reach:g} m", *agreement(flat, solid, seen)))
    moved = f"turned by {math.degrees(angle):.2f} degrees and shifted by ({dx:.1f}, {dy:.1f}) m"
    return moved, rows


def agreement(flat: AmbiguityMap, solid: AmbiguityMap, seen: Environment) -> tuple[object, ...]:
    """Return the common area, the share of equal zones, that by chance, and both levels."""
    first, second = flat.dataset, solid.dataset
    row, column = (
        np.rint((first[axis].values - second[axis].values[0]) / flat.spacing).astype(int)
        for axis in ("y", "x")
    )
    rows = np.flatnonzero((row >= 0) & (row < second.sizes["y"]))
    columns = np.flatnonzero((column >= 0) & (column < second.sizes["x"]))
    here, there = np.ix_(rows, columns), np.ix_(row[rows], column[columns])
    zone, other = first["zone"].values[here], second["zone"].values[there]
    both = (zone != NOT_FREE) & (other != NOT_FREE)
    both &= first["unknown"].values[here] < UNEXPLORED
    x, y = np.meshgrid(first["x"].values[columns], first["y"].values[rows])
    both &= np.asarray(seen.is_free(x, y))
    zone, other = zone[both], other[both]
    chance = sum(float((zone == k).mean() * (other == k).mean()) for k in range(len(ZONES)))
    level = first["level"].values[here][both], second["level"].values[there][both]
    bad = (zone > 0).mean(), (other > 0).mean()
    return (
        f"{both.sum() * flat.spacing**2:.0f}", f"{(zone == other).mean():.3f}", f"{chance:.3f}",
        f"{bad[0]:.3f}", f"{bad[1]:.3f}", f"{np.corrcoef(*level)[0, 1]:.2f}",
    )  # fmt: skip


def main() -> None:
    """Measure as the command line says, and report."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--threads", type=int, default=2, help="default: %(default)s")
    parser.add_argument("--processes", type=int, default=2, help="of Embree (default: %(default)s)")
    add_out(parser)
    args = parser.parse_args()
    numba.set_num_threads(args.threads)
    data = Path(os.environ["AMBINAV_DATA"])
    house = house_rows(data, args.processes)
    moved, zones = geb079(data, args.processes)
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
            "## Building 079, a slice of the voxels against the 2D map",
            f"The 2D map {moved} lies over the voxels. A laser of 60 beams, {LASER_HEIGHT} m above "
            "the floor. By chance: the agreement of two maps with these shares of zones that know "
            "nothing of each other. Where nearly all floor is localizable, agreement says little, "
            "and short ranges say more. Faces of voxels step by 8 cm, as no wall does, and more "
            "furniture is among them: of both a laser sees more in the slice.",
            table(
                (
                    "range", "common m2", "same zone", "by chance", "not localizable: 2D",
                    "voxels", "correlation of levels",
                ),
                zones,
            ),
        ]
    )  # fmt: skip
    report("Maps in space", ("ambinav", "numba", "embreex", "numpy"), body, args.out)


if __name__ == "__main__":
    main()
