"""Lower bound of the cost of all paths between two poses, proved on grids that become finer.

The bound is that of `search.subsolution` for the position of the robot's centre: where the largest
disc within the footprint cannot be, no path leads, and a motion costs at least the cost per metre
times its length in the plane. So it holds for all spaces; where the robot may face any way while
it moves, the cost is taken at the best heading.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.collision.obstacles import FORBIDDEN_INVERSE, FORBIDDEN_X, FORBIDDEN_Y
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.runtime.threads import run_rows, share
from ambinav.service.field import Field
from ambinav_planners.problem import Problem
from ambinav_planners.search.costs_to_go import cost_to_go
from ambinav_planners.search.lattice_graph import lattice_of
from ambinav_planners.search.proof_grid import BINS, ROUNDING, Place, ProofGrid, flattened, prove
from ambinav_planners.search.reachability import planar
from ambinav_planners.search.subsolution import (
    allowed_radii,
    relax,
    steepness,
    steps_along,
    to_coefficients,
    upwind_costs,
)

# Iterations of `relax` on the first grid, as `ROUNDS`.
FIRST_ROUNDS, FIRST_ROUNDS_BY_HEADING = (0, 10, 20, 40), (0, 20, 80, 320)
# What a finer grid has to relax is about half of what the one before it had: it grows with the
# edge of a cell. Where costs depend on the heading, upwind costs are not that near, and a finer
# grid goes on from all that the one before it found.
CARRIED = 0.5
# Directions in which gradients are limited, headings at which costs are looked at for that, at
# least, and marches until the directions of the costs are known.
DIRECTIONS, HEADINGS, TURNS = 64, 128, 3


def directions(count: int = DIRECTIONS) -> Floats:
    """Return unit vectors around the circle, (M, 2), those of `gauge`."""
    part = np.arange(count // 4) / (count // 4)
    x, y = np.stack([1.0 - part, part]) / np.hypot(1.0 - part, part)
    return np.concatenate([np.column_stack(q) for q in ((x, y), (-y, x), (-x, -y), (y, -x))])


def weights_of_headings(circle: Floats, headings: int) -> Floats:
    """Return by what costs at headings bound the gradients in directions, (M, K); inf: not at all.

    Args:
        circle: Directions of gradients, (M, 2).
        headings: K headings of travel evenly around the circle. Between two of them, `step` apart,
            a gradient falls by (sin(step - t) a + sin(t) b) / sin(step), where it falls by a and b
            along them, and costs are linear in t, however different the two are. Of each of these
            terms sin(t) / sin(step) is at most step / sin(step) times its share t / step.
    """
    step = 2.0 * math.pi / headings
    angle = step * np.arange(headings)
    fall = -circle @ np.stack([np.cos(angle), np.sin(angle)])
    weights = math.sin(step) / step / np.maximum(fall, 1e-9)
    return np.asarray(np.where(fall > 1e-9, weights, math.inf))


CIRCLE = directions()

# Cells and gap of a bound without a route: half a second.
QUICK_CELLS, QUICK_GAP = 10_000, 0.01


def lower_bound(problem: Problem, path_cost: float, gap: float, cells: int) -> tuple[float, float]:
    """Return a lower bound of the cost of all paths, and the edge of the finest cells, metres.

    Args:
        problem: Start, goal, robot and cost. A limit on bad metres and one-way lanes are not
            looked at, so the bound holds with and without.
        path_cost: Cost of a path, metres-equivalent; the bound is at most that.
        gap: Share of `path_cost` below which the bound is good enough.
        cells: No grid with more open cells than these is begun.
    """
    spacing, shape = problem.service.map.spacing, problem.service.density.free.shape
    x, y = problem.service.density.origin[:2]
    # Its cells lie between the centres of the map's, with one row more on all sides.
    grid = ProofGrid(
        (y - spacing, x - spacing),
        (spacing, spacing),
        np.ones((shape[0] + 1, shape[1] + 1), dtype=np.bool_),
        np.zeros((2, 2 * shape[0] + 3, 2 * shape[1] + 3)),
    )
    goal, start = ((place[1], place[0]) for place in (problem.goal, problem.start))
    radii = _allowed(problem)
    by_heading = radii.values.shape[2] > 1

    def bounds_on(grid: ProofGrid) -> Callable[[ProofGrid, int], Floats]:
        y, x = grid.axes
        to_goal = 0.5 * grid.edges[0] * radii.on(x, y)
        # Away from the start costs rise in the direction of travel, not against it.
        limits = to_goal, np.roll(to_goal, to_goal.shape[2] // 2, axis=2)
        return lambda part, iterations: _bounds(part, limits, (goal, start), path_cost, iterations)

    bound, grid = prove(
        grid, lambda grid: _met_by_paths(grid, problem.checker), bounds_on, (goal, start),
        path_cost, gap, cells, first=FIRST_ROUNDS_BY_HEADING if by_heading else FIRST_ROUNDS,
        carried=1.0 if by_heading else CARRIED,
    )  # fmt: skip
    return bound, grid.edges[0]


def quick_lower_bound(problem: Problem) -> float:
    """Return a lower bound of the cost of all paths where none is known.

    It is at most the cost on the lattice for the largest disc within the footprint.
    """
    checker = planar(problem.checker)
    graph = lattice_of(problem.service, checker).with_ends(problem.ends, checker)
    start = len(graph.poses) - 2
    lattice_cost = cost_to_go(graph, graph.cost(problem.service.weight), start + 1)[start]
    if not math.isfinite(lattice_cost):
        return math.dist(problem.start[:2], problem.goal[:2])
    return lower_bound(problem, float(lattice_cost), QUICK_GAP, QUICK_CELLS)[0]


def _allowed(problem: Problem) -> Field:
    """Return the gradients that the costs per metre allow, by direction (see `gauge`)."""
    density, space = problem.service.density, problem.steering.space
    cost = density.values
    headings = cost.shape[2]
    if space == "reeds-shepp" and headings % 2 == 0:
        cost = np.minimum(cost, np.roll(cost, headings // 2, axis=2))
    elif space not in ("r2", "dubins"):
        cost = cost.min(axis=2, keepdims=True)
    if cost.shape[2] > 1:
        radii = np.empty((*cost.shape[:2], len(CIRCLE)), dtype=np.float32)
        weights = weights_of_headings(CIRCLE, headings * math.ceil(HEADINGS / headings))
        run_rows(allowed_radii, len(cost), np.ascontiguousarray(cost), weights, radii)
        cost = radii
    return replace(density, values=cost)


def _bounds(
    grid: ProofGrid,
    limits: tuple[Floats32, Floats32],
    places: tuple[Place, Place],
    path_cost: float,
    iterations: int,
) -> Floats:
    """Return lower bounds of costs to the first place and from the second, (2, R, C).

    Above `path_cost` they are about that value. The computation continues from the values kept in
    the grid; where costs do not depend on the heading, these are differences from upwind costs.
    """
    by_heading = limits[0].shape[2] > 1
    bounds = np.empty_like(grid.kept)
    cells = np.array(np.nonzero(grid.open_cells))

    def compute(low: int, high: int) -> None:
        for k in range(low, high):
            cost, upwind = grid.kept[k].copy(), np.zeros_like(grid.kept[k])
            if not (by_heading and cost.any()):
                upwind = _upwind(grid, limits[k], places[k], path_cost)
            cost += upwind
            relax(cost, limits[k], CIRCLE, cells, iterations)
            grid.kept[k] = cost if by_heading else cost - upwind
            cost = cost.clip(0.0, path_cost)
            worst = steepness(cost, limits[k], CIRCLE, cells, path_cost, BINS)
            cost = flattened(cost, worst, path_cost)
            bounds[k] = cost - grid.at(cost, places[k])

    share(compute, 2)
    return bounds


def _upwind(grid: ProofGrid, radii: Floats32, place: Place, path_cost: float) -> Floats:
    """Return upwind costs to a place, (R, C), at most `path_cost`."""
    seeds = np.arange(radii[:, :, 0].size).reshape(radii.shape[:2])[grid.block(place)].ravel()
    step, order = radii.max(axis=2).astype(np.float64), 1 if radii.shape[2] > 1 else 2
    cost = upwind_costs(step, grid.open_cells, seeds, path_cost, order)
    for _ in range(TURNS if radii.shape[2] > 1 else 0):
        steps_along(cost, radii, CIRCLE, step)
        cost = upwind_costs(step, grid.open_cells, seeds, path_cost, order)
    cost = np.minimum(cost, path_cost)
    if order == 2:
        to_coefficients(cost, step)
    return np.asarray(cost)


def _met_by_paths(grid: ProofGrid, checker: CollisionChecker) -> Bools:
    """Return which open cells of a grid hold, or may hold, a place for the robot's centre."""
    (i, j), (y, x) = grid.centres()
    half = 0.5 * grid.edges[0]
    # The centre of a cell is nearer to a wall than another of its points by this much at most.
    radius = (checker.footprint.inner - math.sqrt(2.0) * half) * (1.0 - ROUNDING)
    if radius > 0.0:
        disc = CollisionChecker(
            checker.environment,
            Footprint.disc(radius),
            Steering("r2"),
            simulated=checker.geometry is checker.environment,
        )
        fits = disc.poses_free(np.column_stack([x, y, np.zeros(len(x))]))
    else:
        free = checker.geometry.free
        shapely.prepare(free)
        fits = shapely.intersects(free, shapely.box(x - half, y - half, x + half, y + half))
    if checker.has_forbidden:
        # A cell of the first grid meets four cells of the map, one of the others no more than one.
        quarters = [
            _forbidden(checker, x + sx * half, y + sy * half)
            for sx in (-0.5, 0.5)
            for sy in (-0.5, 0.5)
        ]
        fits &= ~np.logical_and.reduce(quarters)
    out = np.zeros_like(grid.open_cells)
    out[i[fits], j[fits]] = True
    return out


def _forbidden(
    checker: CollisionChecker, x: NDArray[np.floating], y: NDArray[np.floating]
) -> Bools:
    """Return which points lie in forbidden cells, (N,)."""
    table, _, forbidden = checker.arrays
    rows, columns = forbidden.shape
    u = np.floor((x - table[FORBIDDEN_X]) * table[FORBIDDEN_INVERSE] + 0.5).astype(np.intp)
    v = np.floor((y - table[FORBIDDEN_Y]) * table[FORBIDDEN_INVERSE] + 0.5).astype(np.intp)
    inside = (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
    out: Bools = inside & forbidden[v.clip(0, rows - 1), u.clip(0, columns - 1)]
    return out
