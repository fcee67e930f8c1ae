"""Lower bound of the cost of all paths of a flying robot, proved on grids that become finer.

As `lower_bound`, in three dimensions: where the body cannot be, no path leads, and a metre costs at
least what the volume says.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import label

from ambinav.geometry.collision.sphere import SphereChecker
from ambinav.runtime.array_types import Bools, Floats, Ints32
from ambinav.runtime.threads import run_rows, share
from ambinav.service.volume_service import VolumeService
from ambinav_planners.search.proof_grid import BINS, ROUNDING, Place, ProofGrid, flattened, prove
from ambinav_planners.search.subsolution_in_space import (
    boxes_met,
    relax_in_space,
    steepness_in_space,
    to_coefficients_in_space,
    upwind_costs_in_space,
)

# Iterations of `relax_in_space` on the first grid, as `ROUNDS`.
FIRST_ROUNDS = (0, 20, 40, 80)
CARRIED = 0.5
# The first grid may have so many times more boxes, half as wide, than later ones may have cells;
# and at most so many are looked at in all, for time and memory.
FIRST, MOST_BOXES = 64, 10_000_000
# Parts of a cell along each axis of which one looks whether the body fits.
MOST_PARTS = 8
# Of what costs less, equivalent metres, nothing is proved on grids: that takes as long as for more.
TINY = 1e-3
# How often the box around all cheaper paths is drawn closer.
BOXES = 6


def lower_bound_in_space(
    service: VolumeService,
    checker: SphereChecker,
    start: Place,
    goal: Place,
    path_cost: float,
    gap: float,
    cells: int,
) -> tuple[float, float]:
    """Return a lower bound of the cost of all paths, and the edge of the finest cells, metres.

    The edge is 0 where the straight line says enough, as it does of nearly straight ways along
    which the cost per metre changes little, and where `path_cost` is below a millimetre.

    Args:
        service: Service for the cost per metre; paths stay between the heights of its volume.
        checker: Checker of the robot's body.
        start: x, y, z, metres.
        goal: The same.
        path_cost: Cost of a path, metres-equivalent; the bound is at most that.
        gap: Share of `path_cost` below which the bound is good enough.
        cells: No grid with more open cells than these is begun after the first one, which is made
            coarser where it would have more than eight times as many.
    """
    ends = (goal[1], goal[0], goal[2]), (start[1], start[0], start[2])
    line = _bound_of_line(service, *ends, path_cost)
    if line >= (1.0 - gap) * path_cost or path_cost < TINY:
        return line, 0.0

    def bounds_on(grid: ProofGrid) -> Callable[[ProofGrid, int], Floats]:
        price = _price(grid.axes, service)
        return lambda part, iterations: _bounds(part, price, ends, path_cost, iterations)

    first = _reached(service, checker, ends[1], cells)
    bound, grid = prove(
        first, lambda grid: grid.open_cells if grid is first else _met(grid, checker), bounds_on,
        ends, path_cost, gap, cells, first=FIRST_ROUNDS, carried=CARRIED,
    )  # fmt: skip
    return max(bound, line), max(grid.edges)


def _bound_of_line(service: VolumeService, goal: Place, start: Place, path_cost: float) -> float:
    """Return a lower bound by the straight line at the lowest cost per metre near to it.

    A path of no more than the known cost is no longer than that at the lowest cost per metre, and
    so within an ellipsoid with its ends as foci. In the box around it the lowest cost is higher,
    and the next ellipsoid smaller.

    Args:
        service: Service for the cost per metre.
        goal: y, x, z, metres.
        start: The same.
        path_cost: Cost of a path.
    """
    lattice = [service.volume.dataset[name].values.astype(np.float64) for name in "yxz"]
    offset, length = np.array(goal) - np.array(start), math.dist(start, goal)
    along = np.square(offset / length) if length > 0.0 else np.zeros(3)
    middle, least = np.array(start) + 0.5 * offset, float(service.density.min())
    for _ in range(BOXES):
        longest = max(path_cost / least, length)
        half = 0.5 * np.sqrt(longest**2 - (1.0 - along) * length**2)
        low, high = middle - half, middle + half
        # Linear along each axis between the lattice's points, costs are least at one of these.
        axes = [
            np.concatenate([[a], values[(values > a) & (values < b)], [b]])
            for values, a, b in zip(lattice, low, high, strict=True)
        ]
        least = float(_price(axes, service).min())
    return min(path_cost, least * length * (1.0 - ROUNDING))


def are_apart(service: VolumeService, checker: SphereChecker, start: Place, goal: Place) -> bool:
    """Return whether it is proved that no path leads between two places, x, y, z."""
    _, fine, pieces = _parts(service, checker, MOST_BOXES)
    first, last = (pieces[fine.cell((y, x, z))] for x, y, z in (start, goal))
    return bool(first != last)


def _reached(service: VolumeService, checker: SphereChecker, start: Place, cells: int) -> ProofGrid:
    """Return the first grid, with the cells open that paths from a start, y, x, z, may meet."""
    grid, fine, pieces = _parts(service, checker, min(FIRST * cells, MOST_BOXES))
    counts = grid.open_cells.shape
    paired = [n for axis in range(3) for n in (counts[axis], pieces.shape[axis] // counts[axis])]
    reached = (pieces == pieces[fine.cell(start)]).reshape(paired).any(axis=(1, 3, 5))
    return replace(grid, open_cells=reached, kept=np.zeros((2, *(2 * n + 1 for n in counts))))


def _parts(
    service: VolumeService, checker: SphereChecker, max_cells: int
) -> tuple[ProofGrid, ProofGrid, Ints32]:
    """Return the first grid, a finer one, and the connected pieces of what paths may meet of that.

    The cells are parts of those between the points of the volume's lattice, no larger than the
    body is from its centre on; the finer ones half as large, so that a wall with the body on both
    sides is thicker. Where that would be more than `max_cells` finer cells, they are larger, down
    to the lattice's own, and less is proved.
    """
    volume = service.volume
    axes = [volume.dataset[name].values for name in "yxz"]
    pitch = np.array([volume.spacing, volume.spacing, volume.step])
    # Places may be half a cell beside the outermost centres of cells, but between the heights.
    beside = np.array([1, 1, 0])
    cells_of_axis = np.array([len(values) - 1 for values in axes]) + 2 * beside
    size = _sizes(checker)
    while True:
        parts = np.ceil(pitch / size - 1e-9).astype(np.int64)
        if 8.0 * math.prod((cells_of_axis * parts).tolist()) <= max_cells or (parts == 1).all():
            break
        size = size * math.cbrt(2.0)
    origin = np.array([values[0] for values in axes], dtype=np.float64) - beside * pitch
    grid, fine = (
        ProofGrid(
            tuple(origin.tolist()),
            tuple((pitch / (parts * finer)).tolist()),
            np.ones(cells_of_axis * parts * finer, dtype=np.bool_),
            np.empty(0),
        )
        for finer in (1, 2)
    )
    pieces, _ = label(_met(fine, checker), np.ones((3, 3, 3)))
    return grid, fine, pieces


def _sizes(checker: SphereChecker) -> Floats:
    """Return how far the body reaches from its centre along y, x and z, metres."""
    return np.array([checker.radius, checker.radius, checker.half_height or checker.radius])


def _met(grid: ProofGrid, checker: SphereChecker) -> Bools:
    """Return which open cells hold, or may hold, a place for the robot's centre.

    A smaller body in the middle of a part of a cell lies within the robot's, wherever in the part
    that is: so where the smaller one does not fit, the robot does not.
    """
    edges = np.array(grid.edges)
    parts = np.clip(np.ceil(2.0 * edges / _sizes(checker) - 1e-9), 1, MOST_PARTS).astype(np.int64)
    along, across, up = (0.5 * edges / parts).tolist()
    if checker.half_height is None:
        radius, half = checker.radius - math.hypot(along, across, up), 0.0
    else:
        radius, half = checker.radius - math.hypot(along, across), checker.half_height - up
    if radius <= 0.0 or (checker.half_height is not None and half <= 0.0):
        return grid.open_cells.copy()
    body = radius * (1.0 - ROUNDING), half * (1.0 - ROUNDING) if checker.half_height else -1.0
    _, _, *bins = checker.arrays
    cells = np.flatnonzero(grid.open_cells)
    out = np.zeros(grid.open_cells.shape, dtype=np.bool_)
    origin, shape = np.array(grid.origin), np.array(out.shape, dtype=np.int64)
    run_rows(
        boxes_met, len(cells), cells, shape, origin, edges, parts, (*body, *bins), out.reshape(-1),
        least=64,
    )  # fmt: skip
    return out


def _price(axes: Sequence[Floats], service: VolumeService) -> Floats:
    """Return the cost per metre at all points with given y, x and z, as the service has it."""
    density = service.density.astype(np.float64)
    origin = [float(service.volume.dataset[name].values[0]) for name in "yxz"]
    pitch = service.volume.spacing, service.volume.spacing, service.volume.step
    for axis, (values, first, edge) in enumerate(zip(axes, origin, pitch, strict=True)):
        last = density.shape[axis] - 1
        place = np.clip((values - first) / edge, 0.0, last)
        low = np.minimum(place.astype(np.intp), max(last - 1, 0))
        shape = [1, 1, 1]
        shape[axis] = -1
        weight = (place - low).reshape(shape)
        below, above = (density.take(np.minimum(low + k, last), axis) for k in (0, 1))
        density = below + weight * (above - below)
    return np.ascontiguousarray(density)


def _bounds(
    grid: ProofGrid, price: Floats, places: tuple[Place, ...], path_cost: float, iterations: int
) -> Floats:
    """Return lower bounds of costs to the first place and from the second.

    Above `path_cost` they are about that value. The grid keeps their differences from upwind costs.
    """
    bounds = np.empty_like(grid.kept)
    cells = np.array(np.nonzero(grid.open_cells))
    step = 0.5 * np.array(grid.edges)

    def compute(low: int, high: int) -> None:
        for k in range(low, high):
            seeds = np.arange(price.size).reshape(price.shape)[grid.block(places[k])].ravel()
            upwind = upwind_costs_in_space(price, step, grid.open_cells, seeds, path_cost)
            upwind = np.minimum(upwind, path_cost)
            to_coefficients_in_space(upwind, price, step)
            cost = grid.kept[k] + upwind
            relax_in_space(cost, price, step, cells, iterations)
            grid.kept[k] = cost - upwind
            cost = cost.clip(0.0, path_cost)
            worst = steepness_in_space(cost, price, step, cells, path_cost, BINS)
            cost = flattened(cost, worst, path_cost)
            bounds[k] = cost - grid.at(cost, places[k])

    share(compute, 2)
    return bounds
