"""Does `level` depend on a map's cells, and how far are its walls from the building's?

- Rasters of one building, with cells of 2.5, 5 and 10 cm, are read as occupancy maps; `level` at
  the same places, 0.3 m and more from all walls, is compared (median difference). Of every map the
  window of 24 m with the most walls, for a laser of 4 m; five buildings, upright and turned, for
  three scanners. Before: the walls' standard deviation was the cell. Now it is
  `Environment.map_std`.
- Logs of seven robots: a map is made from every second scan, and the others are laid on it, each
  shifted and turned to fit best; what remains, measured at right angles to the walls, is the noise
  of scanner and walls together. Beams of up to 8 m that meet a wall at 60 degrees of incidence or
  less, and lie within 12 cm of it once laid on it.
"""

from __future__ import annotations

import sys
from itertools import combinations, product
from pathlib import Path

import numpy as np
from harness import arguments, data_file, environment_path, recorded_maps, report, table
from lasers import laser
from numpy.typing import NDArray
from raster import CELLS, busiest, medians

import ambinav as an
from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.map_server import load_map_server
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import WALL
from ambinav.logs.carmen import read_carmen
from ambinav.logs.grid_map import map_from_log
from ambinav.logs.log import Log

ANGLES = (0.0, 0.3)
BUILDINGS = ("aws_small_house", "willow_full_005", "nav2_depot", "intel")
SCANS = 200
LONGEST, STEEPEST, INLIER = 8.0, 0.5, 0.12

Floats = NDArray[np.float64]


def main() -> None:
    """Print both tables."""
    args = arguments(__doc__)
    header = [f"{a * 100:g} and {b * 100:g} cm: before, now" for a, b in combinations(CELLS, 2)]
    kinds = scanners()
    every = []
    for path in recorded_maps():
        window = environment_from_grid(busiest(load_map_server(path)))
        every.append([path.stem, *row(window, laser(), 0.25)])
        print(every[-1], file=sys.stderr, flush=True)
    turned = []
    for path in [environment_path("demo"), *map(environment_path, BUILDINGS)]:
        building = an.load_environment(path)
        for angle, (name, scanner) in product(ANGLES, kinds.items()):
            cells = row(building.transformed(angle), scanner, 0.2)
            turned.append([path.stem, f"{angle:g} rad", name, *cells])
            print(turned[-1], file=sys.stderr, flush=True)
    parts = [
        "## Every map",
        table(("map", *header), every),
        "## Turned, and for other scanners",
        table(("building", "turned by", "scanner", *header), turned, words=3),
        "## Standard deviation of walls and scanner, metres, by the cells of the map",
        table(
            ("log", *(f"{cell * 100:g} cm" for cell in CELLS)),
            [
                [path.name.split(".")[0], *(f"{deviation(path, cell):.3f}" for cell in CELLS)]
                for path in sorted(data_file("logs").glob("*.log.gz"))
            ],
        ),
    ]
    report("Cells of a map", ["numpy", "shapely"], "\n\n".join([str(__doc__), *parts]), args.out)


def scanners() -> dict[str, an.RangeScanner]:
    """Return two lasers and a ring of sonars."""
    lasers = {
        f"laser {reach:g} m, {std * 100:g} cm": laser(reach, std)
        for reach, std in ((4.0, 0.03), (8.0, 0.01))
    }
    return lasers | {"sonar ring": an.RangeScanner.from_preset("polaroid-6500-ring")}


def row(building: Environment, scanner: an.RangeScanner, spacing: float) -> list[str]:
    """Return median differences between pairs of rasters, before and after."""
    before, now = (medians(building, scanner, spacing, by_cell) for by_cell in (True, False))
    return [f"{b:.3f}, {a:.3f}" for b, a in zip(before, now, strict=True)]


def deviation(path: Path, cell: float) -> float:
    """Return the robust deviation (1.48 median) of scans from a map of the other scans, metres."""
    mapped, other_scans = read_carmen(path).every(2)
    env = map_from_log(mapped, cell, reach=15.0)
    chosen = np.unique(np.linspace(0, other_scans.scans - 1, SCANS).astype(int))
    return 1.4826 * float(np.median(np.abs(residuals(env, other_scans, chosen))))


def residuals(env: Environment, log: Log, chosen: NDArray[np.intp]) -> Floats:
    """Return distances of readings from the walls that they hit, after registering each scan."""
    distances = []
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
        # Derivative of the distance with the pose (Censi 2007), perpendicular to the wall.
        swing = distance * (normal[:, 1] * u[:, 0] - normal[:, 0] * u[:, 1])
        J = -np.column_stack([normal, swing]) * np.sign(facing)[:, None]
        near = wall
        for _ in range(3):
            if near.sum() < 20:
                break
            shift = np.linalg.lstsq(J[near], off[near], rcond=None)[0]
            residual = off - J @ shift
            near = wall & (np.abs(residual) < INLIER)
        else:
            distances.append(residual[wall])
    return np.concatenate(distances)


if __name__ == "__main__":
    main()
