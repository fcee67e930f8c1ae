"""Does `level` depend on a map's cells, and how far do its walls stand from the building's?

- Rasters of one building, with cells of 2.5, 5 and 10 cm, upright and turned, are read as
  occupancy maps; `level` at the same places, 0.3 m and more from all walls, is compared.
  Before: the walls' standard deviation was the cell. Now it is `Environment.map_std`.
- Logs of seven robots: a map is made from every second scan, and the others are laid on it, each
  shifted and turned to fit best; what remains, measured at right angles to the walls, is the noise
  of scanner and walls together. Beams of up to 8 m that meet a wall at 60 degrees of incidence or
  less, and lie within 12 cm of it once laid on it.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from itertools import combinations
from pathlib import Path

import numpy as np
from harness import add_out, report, table
from numpy.typing import NDArray

import ambinav as an
from ambinav.geometry.boundary import environment_from_grid
from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy import FREE, OCCUPIED, OccupancyGrid
from ambinav.geometry.segments import WALL
from ambinav.logs.carmen import read_carmen
from ambinav.logs.grid_map import map_from_log
from ambinav.logs.log import Log

CELLS = (0.025, 0.05, 0.1)
ANGLES = (0.0, 0.3)
SPACING = 0.2
CLEAR = 0.3
BUILDINGS = (
    "maps/aws_small_house",
    "maps/willow_full_005",
    "maps/nav2_depot",
    "maps_from_logs/intel",
)
SCANS = 200
LONGEST, STEEPEST, INLIER = 8.0, 0.5, 0.12

Floats = NDArray[np.float64]


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    add_out(parser)
    args = parser.parse_args()
    folder = Path(os.environ.get("AMBINAV_DATA", ""))
    if not (folder / "maps").is_dir():
        sys.exit("bench_cells.py: AMBINAV_DATA must name the folder that holds maps/ and logs/.")
    demo = Path(__file__).parents[1] / "configs" / "demo.geojson"
    paths = [demo, *(folder / f"{name}.yaml" for name in BUILDINGS)]
    rows = [row for path in paths for row in levels(path)]
    pairs = [f"{a * 100:g} and {b * 100:g} cm" for a, b in combinations(CELLS, 2)]
    parts = [
        "Median difference of `level`, before -> now:",
        table(("building", "turned by", "scanner", *pairs), rows, words=3),
        "Standard deviation of walls and scanner, metres, by the cells of the map:",
        table(
            ("log", *(f"{cell * 100:g} cm" for cell in CELLS)),
            [
                [path.name.split(".")[0], *(f"{deviation(path, cell):.3f}" for cell in CELLS)]
                for path in sorted((folder / "logs").glob("*.log.gz"))
            ],
        ),
    ]
    report("Cells of a map", ["numpy", "shapely"], "\n\n".join([str(__doc__), *parts]), args.out)


def scanners() -> dict[str, an.RangeScanner]:
    """Two lasers and a ring of sonars."""
    lasers = {
        f"laser {reach:g} m, {std * 100:g} cm": an.RangeScanner.planar(
            sensor=an.RangeSensor(max_range=reach, std=std, resolution=0.001),
            beams=60,
            aperture=2 * math.pi,
        )
        for reach, std in ((4.0, 0.03), (8.0, 0.01))
    }
    return lasers | {"sonar ring": an.RangeScanner.from_preset("polaroid-6500-ring")}


def raster(env: Environment, cell: float) -> OccupancyGrid:
    """Cells are free where their centres are, all others occupied; walls at odd places in them."""
    xmin, ymin, xmax, ymax = env.bounds
    left, low = xmin - 2.37 * cell, ymin - 2.37 * cell
    x = np.arange(left + cell / 2, xmax + 3 * cell, cell)
    y = np.arange(low + cell / 2, ymax + 3 * cell, cell)
    free = np.asarray(env.is_free(*np.meshgrid(x, y)))
    return OccupancyGrid(np.where(free, FREE, OCCUPIED).astype(np.uint8), cell, (left, low, 0.0))


def levels(path: Path) -> list[list[str]]:
    """Rows of the first table for a building."""
    building = an.load_environment(path)
    rows = []
    for angle in ANGLES:
        turned = building.transformed(angle)
        drawn = {cell: environment_from_grid(raster(turned, cell)) for cell in CELLS}
        for name, scanner in scanners().items():
            medians = []
            for std in (None, "cell"):
                found, at = {}, None
                for cell, env in drawn.items():
                    amap = an.build_map(env, scanner, SPACING, map_std=cell if std else None)
                    if at is None:
                        rows_columns = np.argwhere(amap.dataset["clearance"].values >= CLEAR)
                        x, y = amap.dataset["x"].values, amap.dataset["y"].values
                        at = x[rows_columns[:, 1]], y[rows_columns[:, 0]]
                    found[cell] = np.asarray(amap.sample("level", *at))
                pairs = combinations(found.values(), 2)
                medians.append([float(np.nanmedian(np.abs(a - b))) for a, b in pairs])
            now, before = medians
            cells = [f"{b:.3f} -> {a:.3f}" for a, b in zip(now, before, strict=True)]
            rows.append([path.stem, f"{angle:g} rad", name, *cells])
            print(rows[-1], file=sys.stderr, flush=True)
    return rows


def deviation(path: Path, cell: float) -> float:
    """Robust standard deviation (1.48 median) of scans laid on a map of the other scans, metres."""
    mapped, rest = read_carmen(path).every(2)
    env = map_from_log(mapped, cell, reach=15.0)
    chosen = np.unique(np.linspace(0, rest.scans - 1, SCANS).astype(int))
    return 1.4826 * float(np.median(np.abs(residuals(env, rest, chosen))))


def residuals(env: Environment, log: Log, chosen: NDArray[np.intp]) -> Floats:
    """Distances of readings from the walls that they are cast on, each scan laid on them first."""
    found = []
    for scan in chosen:
        x, y, theta = log.laser_poses[scan]
        angle = theta + log.angles
        ranges = np.asarray(log.ranges[scan], dtype=np.float64)
        distance, segment = env.cast_hits(x, y, angle, LONGEST)
        normal = env.normals(segment)
        u = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        facing = (normal * u).sum(axis=1)
        off = (ranges - distance) * np.abs(facing)
        wall = (segment >= 0) & (env.segments.kind[segment] == WALL) & (np.abs(facing) > STEEPEST)
        wall &= np.isfinite(ranges) & (ranges < LONGEST) & (np.abs(off) < 2 * INLIER)
        # How the distance changes as the pose does (Censi 2007), at right angles to the wall.
        swing = distance * (normal[:, 1] * u[:, 0] - normal[:, 0] * u[:, 1])
        J = -np.column_stack([normal, swing]) * np.sign(facing)[:, None]
        near = wall
        for _ in range(3):
            if near.sum() < 20:
                break
            shift = np.linalg.lstsq(J[near], off[near], rcond=None)[0]
            left = off - J @ shift
            near = wall & (np.abs(left) < INLIER)
        else:
            found.append(left[wall])
    return np.concatenate(found)


if __name__ == "__main__":
    main()
