"""Lower bound of the cost of all paths between two poses, proved on grids that become finer.

The bound is that of `search.subsolution` for the position of the robot's centre: where the largest
disc within the footprint cannot be, no path leads, and a motion costs at least the cost per metre
times its length in the plane. So it holds for all spaces; where the robot may face any way while
it moves, the cost is taken at the best heading.

A path that costs no more than one that is known stays where the bounds from the start and to the
goal together are no higher. On that part alone the next grid is laid, with cells of half the edge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import chain, repeat

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.collision.obstacles import FORBIDDEN_INVERSE, FORBIDDEN_X, FORBIDDEN_Y
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.threads import run_rows, share
from ambinav.service.field import Field
from ambinav_planners.problem import Problem
from ambinav_planners.search.subsolution import (
    allowed_radii,
    relax,
    steepness,
    steps_along,
    to_coefficients,
    upwind_costs,
)

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]
Place = tuple[float, float]

# Iterations of `relax` on the first grid and on the finer ones, one number a round: after each,
# fewer cells are left.
FIRST_ROUNDS, FIRST_ROUNDS_BY_HEADING, ROUNDS = (0, 10, 20, 40), (0, 20, 80, 320), (20, 40, 80)
# What a finer grid has to relax is about half of what the one before it had: it grows with the
# edge of a cell. Where costs depend on the heading, upwind costs are not that near, and a finer
# grid goes on from all that the one before it found.
CARRIED = 0.5
# Share of the bound that is given up for rounding.
ROUNDING = 1e-6
# Directions in which gradients are limited, headings at which costs are looked at for that, at
# least, and marches until the directions of the costs are known.
DIRECTIONS, HEADINGS, TURNS = 64, 128, 3
# Ranges of values that are flattened apart.
BINS = 20_000


def directions(count: int = DIRECTIONS) -> Floats:
    """Return unit vectors around the circle, (M, 2), those of `gauge`."""
    part = np.arange(count // 4) / (count // 4)
    x, y = np.stack([1.0 - part, part]) / np.hypot(1.0 - part, part)
    return np.concatenate([np.column_stack(q) for q in ((x, y), (-y, x), (-x, -y), (y, -x))])


def weights_of_headings(circle: Floats, headings: int) -> Floats:
    """Return by what costs at headings bound the gradients in directions, (M, K); inf: not at all.

    Args:
        circle: Directions of gradients, (M, 2).
        headings: K headings of travel evenly around the circle. Between two of them the gradient
            may be steeper by the cosine of half their angle.
    """
    angle = 2.0 * math.pi / headings * np.arange(headings)
    fall = -circle @ np.stack([np.cos(angle), np.sin(angle)])
    weights = np.cos(math.pi / headings) / np.maximum(fall, 1e-9)
    return np.asarray(np.where(fall > 1e-9, weights, math.inf))


CIRCLE = directions()


@dataclass(frozen=True, eq=False)
class _Grid:
    """Square grid of cells with 3 x 3 vertices each, of which cells share those on their edges.

    Attributes:
        x0: x of the first column of vertices, metres.
        y0: y of the first row.
        edge: Edge of a cell, two steps from vertex to vertex.
        open_cells: Cells that paths may meet, bool, ((R - 1) / 2, (C - 1) / 2).
        kept: Costs to the goal and from the start after `relax`, (2, R, C); where costs do not
            depend on the heading, only by how much they differ from upwind costs.
    """

    x0: float
    y0: float
    edge: float
    open_cells: Bools
    kept: Floats

    @property
    def axes(self) -> tuple[Floats, Floats]:
        """Columns' x and rows' y of the vertices, metres."""
        rows, columns = self.kept.shape[1:]
        x, y = (
            np.asarray(origin + 0.5 * self.edge * np.arange(count))
            for origin, count in ((self.x0, columns), (self.y0, rows))
        )
        return x, y

    def halved(self, carried: float) -> _Grid:
        """Return the part with open cells, with cells of half the edge and a share of `kept`."""
        i, j = (np.flatnonzero(self.open_cells.any(axis=axis)) for axis in (1, 0))
        rows, columns = slice(i[0], i[-1] + 1), slice(j[0], j[-1] + 1)
        cells = self.open_cells[rows, columns].repeat(2, axis=0).repeat(2, axis=1)
        coarse = self.kept[:, 2 * i[0] : 2 * i[-1] + 3, 2 * j[0] : 2 * j[-1] + 3]
        fine = np.empty((2, 2 * cells.shape[0] + 1, 2 * cells.shape[1] + 1))
        fine[:, ::2, ::2] = carried * coarse
        fine[:, 1::2, ::2] = 0.5 * (fine[:, :-1:2, ::2] + fine[:, 2::2, ::2])
        fine[:, :, 1::2] = 0.5 * (fine[:, :, :-1:2] + fine[:, :, 2::2])
        x0, y0 = self.x0 + self.edge * j[0], self.y0 + self.edge * i[0]
        return _Grid(float(x0), float(y0), 0.5 * self.edge, cells, fine)

    def cell(self, place: Place) -> tuple[int, int]:
        """Return row and column of the cell around a place."""
        i, j = ((place[1] - self.y0) // self.edge, (place[0] - self.x0) // self.edge)
        rows, columns = self.open_cells.shape
        return min(max(int(i), 0), rows - 1), min(max(int(j), 0), columns - 1)

    def at(self, values: Floats, place: Place) -> float:
        """Return the quadratic with coefficients at the vertices, (R, C), at a place."""
        i, j = self.cell(place)
        u, v = (place[0] - self.x0) / self.edge - j, (place[1] - self.y0) / self.edge - i
        along, up = (np.array([(1.0 - w) ** 2, 2.0 * w * (1.0 - w), w * w]) for w in (u, v))
        return float(up @ values[2 * i : 2 * i + 3, 2 * j : 2 * j + 3] @ along)

    def least(self, values: Floats) -> Floats:
        """Return the least coefficient of each cell: its quadratic is nowhere lower."""
        rows = np.minimum(np.minimum(values[:-1:2], values[1::2]), values[2::2])
        return np.minimum(np.minimum(rows[:, :-1:2], rows[:, 1::2]), rows[:, 2::2])


def lower_bound(problem: Problem, known: float, gap: float, cells: int) -> tuple[float, float]:
    """Return a lower bound of the cost of all paths, and the edge of the finest cells, metres.

    Args:
        problem: Start, goal, robot and cost. A limit on bad metres and one-way lanes are not
            looked at, so the bound holds with and without.
        known: Cost of a path, metres-equivalent; the bound is at most that.
        gap: Share of `known` below which the bound is good enough.
        cells: No grid with more open cells than these is begun.
    """
    spacing, shape = problem.service.map.spacing, problem.service.density.free.shape
    # Its cells lie between the centres of the map's, with one row more on all sides.
    grid = _Grid(
        problem.service.density.origin[0] - spacing,
        problem.service.density.origin[1] - spacing,
        spacing,
        np.ones((shape[0] + 1, shape[1] + 1), dtype=np.bool_),
        np.zeros((2, 2 * shape[0] + 3, 2 * shape[1] + 3)),
    )
    best, places, radii = 0.0, (problem.goal[:2], problem.start[:2]), _allowed(problem)
    first = FIRST_ROUNDS if radii.values.shape[2] == 1 else FIRST_ROUNDS_BY_HEADING
    for rounds in chain([first], repeat(ROUNDS)):
        grid = replace(grid, open_cells=_met_by_paths(grid, problem.checker))
        to_goal = 0.5 * grid.edge * radii.on(*grid.axes)
        # Away from the start costs rise in the direction of travel, not against it.
        limits = to_goal, np.roll(to_goal, to_goal.shape[2] // 2, axis=2)
        for iterations in rounds:
            bounds = _bounds(grid, limits, places, known, iterations)
            best = max(best, *(grid.at(bounds[k], places[1 - k]) for k in (0, 1)))
            if best >= (1.0 - gap) * known:
                return min(best, known), grid.edge
            least = grid.least(bounds[0] + bounds[1])
            near = grid.open_cells & (least <= known * (1.0 + ROUNDING))
            grid = replace(grid, open_cells=near)
        if 4 * np.count_nonzero(grid.open_cells) > cells:
            break
        grid = grid.halved(CARRIED if to_goal.shape[2] == 1 else 1.0)
    return min(best, known), grid.edge


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
    grid: _Grid,
    limits: tuple[NDArray[np.float32], NDArray[np.float32]],
    places: tuple[Place, Place],
    known: float,
    iterations: int,
) -> Floats:
    """Return lower bounds of costs to the first place and from the second, (2, R, C).

    Beyond `known` they are about as much. What the grid has kept goes on from where it was.
    """
    by_heading = limits[0].shape[2] > 1
    bounds = np.empty_like(grid.kept)
    cells = np.array(np.nonzero(grid.open_cells))

    def compute(low: int, high: int) -> None:
        for k in range(low, high):
            cost, upwind = grid.kept[k].copy(), np.zeros_like(grid.kept[k])
            if not (by_heading and cost.any()):
                upwind = _upwind(grid, limits[k], places[k], known)
            cost += upwind
            relax(cost, limits[k], CIRCLE, cells, iterations)
            grid.kept[k] = cost if by_heading else cost - upwind
            cost = cost.clip(0.0, known)
            worst = steepness(cost, limits[k], CIRCLE, cells, known, BINS)
            flat = np.concatenate([[0.0], np.cumsum((known / BINS) / worst)])
            cost = np.interp(cost, np.linspace(0.0, known, BINS + 1), flat * (1.0 - ROUNDING))
            bounds[k] = cost - grid.at(cost, places[k])

    share(compute, 2)
    return bounds


def _upwind(grid: _Grid, radii: NDArray[np.float32], place: Place, known: float) -> Floats:
    """Return upwind costs to a place, (R, C), at most `known`."""
    i, j = grid.cell(place)
    seeds = ((2 * i + np.arange(3))[:, np.newaxis] * radii.shape[1] + 2 * j + np.arange(3)).ravel()
    step, order = radii.max(axis=2).astype(np.float64), 1 if radii.shape[2] > 1 else 2
    cost = upwind_costs(step, grid.open_cells, seeds, known, order)
    for _ in range(TURNS if radii.shape[2] > 1 else 0):
        steps_along(cost, radii, CIRCLE, step)
        cost = upwind_costs(step, grid.open_cells, seeds, known, order)
    cost = np.minimum(cost, known)
    if order == 2:
        to_coefficients(cost, step)
    return np.asarray(cost)


def _met_by_paths(grid: _Grid, checker: CollisionChecker) -> Bools:
    """Return which open cells of a grid hold, or may hold, a place for the robot's centre."""
    i, j = np.nonzero(grid.open_cells)
    x = np.asarray(grid.x0 + (j + 0.5) * grid.edge, dtype=np.float64)
    y = np.asarray(grid.y0 + (i + 0.5) * grid.edge, dtype=np.float64)
    half = 0.5 * grid.edge
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
