"""Distance of a map's wall cells from the segments fitted to them, map by map."""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

import numpy as np
import shapely
from harness import add_out, report, table
from numpy.typing import NDArray
from scipy import ndimage

from ambinav.buildings.boundary import MIN_AREA, environment_from_grid
from ambinav.buildings.map_server import load_map_server
from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, OccupancyGrid

FOLDERS = ("maps", "maps_research_only", "maps_from_logs", "planner_maps")
SMALLEST_WALL = 10
# Metres: cells up to this size have gaps of one cell closed.
CLOSED = 0.1
HEADER = ("map", "wall cells", "none within 3", "none within 2", "worst", "segments")


def wall_cells(grid: OccupancyGrid) -> NDArray[np.int64]:
    """Return row and column of occupied cells beside floor that is kept, (K, 2).

    They belong to pieces of at least `SMALLEST_WALL` occupied cells; floor is kept where two by
    two free cells fit in pieces of at least `MIN_AREA`.
    """
    around = np.ones((3, 3), dtype=bool)
    labels, count = ndimage.label(grid.state == OCCUPIED, around)
    large = np.bincount(labels.ravel(), minlength=count + 1) >= SMALLEST_WALL
    large[0] = False
    wall = large[labels]
    free = grid.state == FREE
    if grid.resolution <= CLOSED:
        free = ndimage.binary_opening(free, np.ones((2, 2), dtype=bool))
    labels, count = ndimage.label(free)
    kept = np.bincount(labels.ravel(), minlength=count + 1) >= MIN_AREA / grid.resolution**2
    kept[0] = False
    return np.argwhere(wall & ndimage.binary_dilation(kept[labels]))


def away(grid: OccupancyGrid, env: Environment, cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the distance of each cell's centre from the nearest segment, in cells."""
    points = shapely.points(*grid.to_world(cells[:, 1] + 0.5, cells[:, 0] + 0.5))
    tree = shapely.STRtree(shapely.linestrings(env.segments.xy.reshape(-1, 2, 2)))
    _, distance = tree.query_nearest(points, return_distance=True, all_matches=False)
    return np.asarray(distance) / grid.resolution


def main() -> None:
    """Measure every map of the data folder and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", type=Path, help="a report of this script to stand beside it")
    add_out(parser)
    chosen = parser.parse_args()
    folder = os.environ.get("AMBINAV_DATA")
    if not folder:
        print(
            "bench_walls.py: AMBINAV_DATA is not set; set it to the data folder.", file=sys.stderr
        )
        raise SystemExit(2)
    rows: list[list[str]] = []
    for path in (path for name in FOLDERS for path in sorted((Path(folder) / name).glob("*.yaml"))):
        grid = load_map_server(path)
        env = environment_from_grid(grid)
        distances = away(grid, env, wall_cells(grid))
        row = [
            len(distances),
            (distances > 3.0).sum(),
            (distances > 2.0).sum(),
            f"{distances.max():.2f}",
        ]
        rows.append([path.stem, *(str(cell) for cell in row), str(len(env.segments))])
    totals = [sum(int(row[k]) for row in rows) for k in (1, 2, 3, 5)]
    worst = max(float(row[4]) for row in rows)
    rows.append(["all", *(str(n) for n in totals[:3]), f"{worst:.2f}", str(totals[3])])
    header = HEADER
    if chosen.before is not None:
        rows = beside(rows, chosen.before)
        header = (*HEADER[:2], *(f"{name}: before, now" for name in HEADER[2:]))
    body = (
        "Occupied cells in pieces of more than 9 that share an edge with floor that is kept; "
        "distances from a cell's centre to the nearest segment, in cells.\n\n" + table(header, rows)
    )
    report("Wall cells and segments", ("numba", "numpy", "scipy", "shapely"), body, chosen.out)


def beside(rows: list[list[str]], before: Path) -> list[list[str]]:
    """Return the rows with the figures of an earlier report in front of their own."""
    old = {}
    for line in before.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == len(HEADER):
            old[cells[0]] = cells
    return [
        [*row[:2], *(f"{old[row[0]][k]}, {row[k]}" for k in range(2, len(HEADER)))] for row in rows
    ]


if __name__ == "__main__":
    main()
