"""The layers `gfm` and `wall_normals` beside what they stand for.

`gfm` at other steps than its own, and beside the definition of the published program of GFM-Planner
on a grid (hits are whole cells, the step is one cell, a rank is exact) and on the same walls in a
grid shifted by a third of a cell; `wall_normals` beside the smaller eigenvalue of sum n n^T over
what a scan sees.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from harness import ENVIRONMENTS, environment_of, parser_of, report, table
from lasers import laser
from numpy.typing import NDArray
from scipy.stats import spearmanr

from ambinav.geometry.lattice import Lattice
from ambinav.geometry.segments import WALL
from ambinav.layers.context import LayerContext
from ambinav.layers.gfm import DIRECTIONS, STEP, TURN, gfm, rank_masks
from ambinav.layers.wall_normals import wall_normals
from ambinav.map_building.build import build_map

LIBRARIES = ("ambinav", "numpy", "scipy")
MAPS = ("demo", "freiburg-079", "nav2_depot", "aws_small_house")
SPACING = 0.3
STEPS = (0.025, 0.05, 0.1, 0.2, 0.3)
WIDE = 1.0
"""Metres to the nearest wall from which a place counts as wide."""
CELL = 0.05
"""Edge of the published program's cells here, metres."""
SHIFT = (0.37, 0.61)
"""By how much of a cell the second grid is shifted."""
SAMPLE = 1500
FARTHEST = 100.0

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]


def main() -> None:
    """Measure as the command line says, and report."""
    parser = parser_of(__doc__, seed=1)
    parser.add_argument("maps", nargs="*", help=f"default: {' '.join(MAPS)}")
    args = parser.parse_args()
    steps, program, normals = [], [], []
    for name in args.maps or MAPS:
        if name not in ENVIRONMENTS:
            parser.error(f"map {name!r}: choose from {', '.join(sorted(ENVIRONMENTS))}.")
        env = environment_of(name)
        context = LayerContext.of(build_map(env, laser(), SPACING, store=False), env)
        wide = np.asarray(env.clearance(*context.points)) >= WIDE
        steps.append((name, *of_steps(context, wide)))
        program.append((name, *of_program(context, np.random.default_rng(args.seed))))
        normals.append((name, of_normals(context, wide)))
    body = "\n\n".join(
        [
            "60 beams of 4 m; rank correlations (Spearman). Wide: "
            f"{WIDE:g} m or more from every wall; in brackets there alone.",
            f"`gfm` at other steps than {STEP:g} m, against that, and its mean.",
            table(("map", *(f"{step:g} m" for step in STEPS)), steps),
            f"`gfm` without a limit of range and the published program's definition on cells of "
            f"{CELL:g} m, at {SAMPLE} of its cells.",
            table(
                (
                    "map", f"ours, step {STEP:g} m", f"ours, step {CELL:g} m",
                    "itself, grid shifted", f"itself, cells of {2 * CELL:g} m",
                ),
                program,
            ),
            "`wall_normals` and the smaller eigenvalue over what the scan sees, a beam each.",
            table(("map", "rank correlation"), normals),
        ]
    )  # fmt: skip
    report("What layers depend on", LIBRARIES, body, args.out)


def correlation(first: Floats, second: Floats) -> str:
    """Format a correlation with two digits; a dash where one of the values is constant."""
    if min(len(first), np.ptp(first), np.ptp(second)) == 0:
        return "-"
    return f"{spearmanr(first, second).statistic:.2f}"


def both_of(first: Floats, second: Floats, wide: Mask) -> str:
    """Return the correlation everywhere, and in brackets that in wide places."""
    return f"{correlation(first, second)} ({correlation(first[wide], second[wide])})"


def of_steps(context: LayerContext, wide: Mask) -> list[str]:
    """Return the rank correlation of gfm at each step with that at the default, and its mean."""
    values = {s: gfm(context, step=s)["gfm"][context.free] for s in (*STEPS, STEP)}
    return [f"{both_of(values[s], values[STEP], wide)}; {values[s].mean():.2f}" for s in STEPS]


def of_program(context: LayerContext, rng: np.random.Generator) -> tuple[str, str, str, str]:
    """Compare the definition on cells with ours at two steps, and with itself on shifted cells."""
    env = context.environment
    lattice = Lattice.over(env, CELL)
    column, row = np.meshgrid(np.arange(len(lattice.x)), np.arange(len(lattice.y)))
    x, y = lattice.x[column], lattice.y[row]
    walls = np.pad(~lattice.free, 1, constant_values=True)
    moved_walls = np.pad(
        ~np.asarray(env.is_free(x + SHIFT[0] * CELL, y + SHIFT[1] * CELL)),
        1, constant_values=True,
    )  # fmt: skip
    cells = np.argwhere(apart_from_walls(walls) & apart_from_walls(moved_walls)) - 1
    cells = cells[np.sort(rng.permutation(len(cells))[:SAMPLE])]
    free = np.zeros_like(lattice.free)
    free[cells[:, 0], cells[:, 1]] = True
    context = replace(context, lattice=replace(lattice, free=free))
    ours = [
        np.bitwise_count(rank_masks(context, FARTHEST, step)) / DIRECTIONS for step in (STEP, CELL)
    ]
    first, second = (rank_one(grid, cells + 1) for grid in (walls, moved_walls))
    wider = Lattice.over(env, 2 * CELL)
    grid = np.pad(~wider.free, 1, constant_values=True)
    row = np.rint((lattice.y[cells[:, 0]] - wider.y[0]) / (2 * CELL)).astype(np.intp) + 1
    column = np.rint((lattice.x[cells[:, 1]] - wider.x[0]) / (2 * CELL)).astype(np.intp) + 1
    open_there = apart_from_walls(grid)[row, column]
    coarse = rank_one(grid, np.column_stack([row, column])[open_there])
    return (
        correlation(ours[0], first),
        correlation(ours[1], first),
        correlation(first, second),
        correlation(first[open_there], coarse),
    )


def apart_from_walls(occupied: Mask) -> Mask:
    """Return the free cells whose eight neighbours are free."""
    near = np.ones_like(occupied)
    rows, columns = occupied.shape
    near[1:-1, 1:-1] = False
    for i in range(3):
        for j in range(3):
            near[1:-1, 1:-1] |= occupied[i : rows - 2 + i, j : columns - 2 + j]
    return ~near


def rank_one(occupied: Mask, cells: NDArray[np.intp]) -> Floats:
    """Return the share of 64 rays whose differences of hit cells have rank 1, at cells (N, 2)."""
    cells_hit, east, north = hit_cells(occupied, cells), np.array([0, 1]), np.array([1, 0])
    rows = np.stack(
        [
            hit_cells(occupied, cells + east) - hit_cells(occupied, cells - east),
            hit_cells(occupied, cells + north) - hit_cells(occupied, cells - north),
            np.roll(cells_hit, -1, axis=1) - np.roll(cells_hit, 1, axis=1),
        ],
        axis=2,
    )
    minors = [
        rows[:, :, i, 0] * rows[:, :, j, 1] - rows[:, :, i, 1] * rows[:, :, j, 0]
        for i, j in ((0, 1), (0, 2), (1, 2))
    ]
    parallel = ~np.any(minors, axis=0)
    return np.asarray((parallel & rows.any(axis=(2, 3))).mean(axis=1))


def hit_cells(occupied: Mask, cells: NDArray[np.intp]) -> NDArray[np.int64]:
    """Return row and column of the cell hit by each of 64 rays from cells (N, 2), (N, 64, 2)."""
    angle = TURN * np.arange(DIRECTIONS)
    cells_hit = np.zeros((len(cells), DIRECTIONS, 2), dtype=np.int64)
    pose, ray = (part.ravel() for part in np.indices((len(cells), DIRECTIONS)))
    length = 0
    while len(pose):
        length += 1
        row = np.rint(cells[pose, 0] + length * np.sin(angle[ray])).astype(np.int64)
        column = np.rint(cells[pose, 1] + length * np.cos(angle[ray])).astype(np.int64)
        is_hit = occupied[row, column]
        cells_hit[pose[is_hit], ray[is_hit]] = np.stack([row[is_hit], column[is_hit]], axis=1)
        pose, ray = pose[~is_hit], ray[~is_hit]
    return cells_hit


def of_normals(context: LayerContext, wide: Mask) -> str:
    """Return the agreement of wall_normals with the eigenvalue over the visible walls."""
    hits = context.hits()
    seen = np.where((hits.kind == WALL)[..., np.newaxis], hits.normal, 0.0)
    smaller = np.linalg.eigvalsh(np.einsum("pbi,pbj->pij", seen, seen))[:, 0]
    return both_of(wall_normals(context)["wall_normals"][context.free], smaller, wide)


if __name__ == "__main__":
    main()
