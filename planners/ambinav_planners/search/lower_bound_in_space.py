"""Lower bound of the cost of all paths of a flying robot, proved on grids that become finer.

As `lower_bound`, in three dimensions: where the largest sphere within the body cannot be, no path
leads, and a metre costs at least what the volume says.
"""

from __future__ import annotations

import math
from collections.abc import Callable
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


def lower_bound_in_space(
    service: VolumeService,
    checker: SphereChecker,
    start: Place,
    goal: Place,
    known: float,
    gap: float,
    cells: int,
) -> tuple[float, float]:
    """Return a lower bound of the cost of all paths, and the edge of the finest cells, metres.

    Args:
        service: Service for the cost per metre; paths stay between the heights of its volume.
        checker: Checker of the robot's body.
        start: x, y, z, metres.
        goal: The same.
        known: Cost of a path, metres-equivalent; the bound is at most that.
        gap: Share of `known` below which the bound is good enough.
        cells: No grid with more open cells than these is begun.
    """
    ends = (goal[1], goal[0], goal[2]), (start[1], start[0], start[2])

    def bounds_on(grid: ProofGrid) -> Callable[[ProofGrid, int], Floats]:
        price = _price(grid, service)
        return lambda part, iterations: _bounds(part, price, ends, known, iterations)

    first = _reached(service, checker, ends[1])
    bound, grid = prove(
        first, lambda grid: grid.open_cells if grid is first else _met(grid, checker), bounds_on,
        ends, known, gap, cells, first=FIRST_ROUNDS, carried=CARRIED,
    )  # fmt: skip
    return bound, max(grid.edges)


def are_apart(service: VolumeService, checker: SphereChecker, start: Place, goal: Place) -> bool:
    """Return whether it is proved that no path leads between two places, x, y, z."""
    _, fine, pieces = _parts(service, checker)
    first, last = (pieces[fine.cell((y, x, z))] for x, y, z in (start, goal))
    return bool(first != last)


def _reached(service: VolumeService, checker: SphereChecker, start: Place) -> ProofGrid:
    """Return the first grid, with the cells open that paths from a start, y, x, z, may meet."""
    grid, fine, pieces = _parts(service, checker)
    counts = grid.open_cells.shape
    paired = [n for axis in range(3) for n in (counts[axis], pieces.shape[axis] // counts[axis])]
    reached = (pieces == pieces[fine.cell(start)]).reshape(paired).any(axis=(1, 3, 5))
    return replace(grid, open_cells=reached, kept=np.zeros((2, *(2 * n + 1 for n in counts))))


def _parts(service: VolumeService, checker: SphereChecker) -> tuple[ProofGrid, ProofGrid, Ints32]:
    """Return the first grid, a finer one, and the connected pieces of what paths may meet of that.

    The cells are parts of those between the points of the volume's lattice, no larger than the
    body's radius; the finer ones half as large, so that a wall with the body on both sides is
    thicker.
    """
    volume = service.volume
    axes = [volume.dataset[name].values for name in "yxz"]
    pitch = volume.spacing, volume.spacing, volume.step
    # Places may be half a cell beside the outermost centres of cells, but between the heights.
    beside = (1, 1, 0)
    origin = tuple(
        float(values[0]) - more * edge
        for values, more, edge in zip(axes, beside, pitch, strict=True)
    )
    parts = [math.ceil(edge / inner(checker) - 1e-9) for edge in pitch]
    counts = [
        (len(values) - 1 + 2 * more) * part
        for values, more, part in zip(axes, beside, parts, strict=True)
    ]
    edges = tuple(edge / part for edge, part in zip(pitch, parts, strict=True))
    grid, fine = (
        ProofGrid(
            origin,
            tuple(edge / more for edge in edges),
            np.ones([more * count for count in counts], dtype=np.bool_),
            np.empty(0),
        )
        for more in (1, 2)
    )
    pieces, _ = label(_met(fine, checker), np.ones((3, 3, 3)))
    return grid, fine, pieces


def inner(checker: SphereChecker) -> float:
    """Return the radius of the largest sphere in the body, metres."""
    return min(checker.radius, checker.half_height or checker.radius)


def _met(grid: ProofGrid, checker: SphereChecker) -> Bools:
    """Return which open cells hold, or may hold, a place for the robot's centre."""
    index, (y, x, z) = grid.centres()
    edges, size = np.array(grid.edges), inner(checker)
    parts = np.maximum(np.ceil(2.0 * edges / size - 1e-9), 1.0).astype(np.int64)
    radius = (size - 0.5 * float(np.linalg.norm(edges / parts))) * (1.0 - ROUNDING)
    met = np.empty(len(x), dtype=np.bool_)
    _, _, *rest = checker.arrays
    run_rows(boxes_met, len(x), y, x, z, edges, parts, radius, (-1.0, *rest), met, least=64)
    out = np.zeros_like(grid.open_cells)
    out[index] = met
    return out


def _price(grid: ProofGrid, service: VolumeService) -> Floats:
    """Return the cost per metre at the vertices; linear in each cell, as the cost itself is."""
    density = service.density.astype(np.float64)
    origin = [float(service.volume.dataset[name].values[0]) for name in "yxz"]
    pitch = service.volume.spacing, service.volume.spacing, service.volume.step
    for axis, (values, first, edge) in enumerate(zip(grid.axes, origin, pitch, strict=True)):
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
    grid: ProofGrid, price: Floats, places: tuple[Place, ...], known: float, iterations: int
) -> Floats:
    """Return lower bounds of costs to the first place and from the second.

    Beyond `known` they are about as much. The grid keeps by how much they differ from upwind costs.
    """
    bounds = np.empty_like(grid.kept)
    cells = np.array(np.nonzero(grid.open_cells))
    step = 0.5 * np.array(grid.edges)

    def compute(low: int, high: int) -> None:
        for k in range(low, high):
            seeds = np.arange(price.size).reshape(price.shape)[grid.block(places[k])].ravel()
            upwind = upwind_costs_in_space(price, step, grid.open_cells, seeds, known)
            upwind = np.minimum(upwind, known)
            to_coefficients_in_space(upwind, price, step)
            cost = grid.kept[k] + upwind
            relax_in_space(cost, price, step, cells, iterations)
            grid.kept[k] = cost - upwind
            cost = cost.clip(0.0, known)
            worst = steepness_in_space(cost, price, step, cells, known, BINS)
            cost = flattened(cost, worst, known)
            bounds[k] = cost - grid.at(cost, places[k])

    share(compute, 2)
    return bounds
