"""Motions between the cells of a lattice: which are free, and what they cost.

They are written in the order of their cells at once: a list of pairs that is checked, measured and
then sorted takes several times the memory of the graph that comes of it.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ambinav.casting.plane.raycast import clearances
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.collision.sweep import motion_free
from ambinav.runtime.array_types import Floats, Indices, Ints32
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav.service.motion import motion_integral
from ambinav.service.service import AmbiguityService
from ambinav_planners.search.graph import MotionGraph

STEPS: Final = np.array(
    [
        (column, row)
        for column in range(-3, 4)
        for row in range(4)
        if math.gcd(column, row) == 1 and (row > 0 or column > 0)
    ],
    dtype=np.int32,
)
"""Half of the 32 steps to neighbours, columns and rows; the others are their opposites. The
directions are at most 18.4 degrees apart, so a path over them is at most 1.3 % longer than the
straight one."""
HALF: Final = len(STEPS)
MARGIN: Final = int(np.abs(STEPS).max())


def lattice_motions(
    poses: Floats,
    rows: Indices,
    columns: Indices,
    cell: Ints32,
    spacing: float,
    service: AmbiguityService,
    checker: CollisionChecker,
) -> MotionGraph:
    """Return the free motions of `STEPS` and their opposites between cells.

    Args:
        poses: Centres of the cells, shape (N, 3), heading 0; each must be free.
        rows: Row of each cell, shape (N,).
        columns: Column of each cell.
        cell: int32, shape (rows, columns): the number of a cell, -1 where nothing fits.
        spacing: Distance between neighbouring cells, metres.
        service: Service for the cost per metre.
        checker: Collision checker of the robot, for straight motions.
    """
    count = len(poses)
    # A margin of cells that nothing fits in, so that no step leaves the array.
    margin = np.pad(cell, MARGIN, constant_values=-1)
    places = (rows + MARGIN) * margin.shape[1] + columns + MARGIN
    offsets = (STEPS[:, 1] * margin.shape[1] + STEPS[:, 0]).astype(np.int64)
    lengths = spacing * np.hypot(*STEPS.T.astype(np.float64))
    # Larger clearances than this make no difference.
    outer = checker.footprint.outer
    room = np.zeros(count)
    if not checker.has_forbidden:
        reach = outer + float(lengths.max())
        room = clearances(checker.geometry.grid, poses[:, 0], poses[:, 1], reach)
    cells = margin.ravel(), places, offsets
    steering = checker.steering
    kind, radius = steering.kind, steering.kernel_radius
    steps = np.zeros(count, dtype=np.uint32)
    run_rows(
        _mark_free, count, *cells, poses, room, outer, lengths, kind, radius, *checker.arrays,
        2 * HALF if checker.is_directed else HALF, steps, least=64,
    )  # fmt: skip
    if not checker.is_directed:
        onward, steps = steps, np.empty(count, dtype=np.uint32)
        run_rows(_mark_all, count, *cells, onward, steps, least=4096)
    first = np.zeros(count + 1, dtype=np.int64)
    np.cumsum(np.bitwise_count(steps), out=first[1:])
    target = np.empty(first[-1], dtype=np.int32)
    length, exposure = (np.empty(first[-1], dtype=np.float32) for _ in range(2))
    graded, is_length = service.graded, service.plain is None
    plain = graded.values if is_length else service.plain
    fixed = length if is_length else np.empty_like(length)
    both_ways = not (service.has_headings or checker.is_directed)
    run_rows(
        _measure, count, *cells, poses, lengths, first, steps, kind, radius, both_ways, is_length,
        plain, graded.values, *graded.origin, 1.0 / graded.spacing, target, length, fixed, exposure,
        least=64,
    )  # fmt: skip
    return MotionGraph(poses, first, target, length, fixed, exposure, steering)


@kernel
def _mark_free(
    low, high, cell, places, offsets, poses, room, outer, lengths, kind, radius, table, bound,
    forbidden, tried, steps,
):  # fmt: skip
    """Mark the free ones of the first steps that are tried, a bit each; see `_mark_all`.

    Each point of a straight motion is as far from the walls as the roomier end less its distance
    from it; so between two ends with room enough nothing has to be looked at.
    """
    for n in range(low, high):
        marks = 0
        for k in range(tried):
            way = k % HALF
            m = cell[places[n] + (offsets[way] if k < HALF else -offsets[way])]
            if m < 0:
                continue
            if room[n] + room[m] - lengths[way] >= 2.0 * outer or motion_free(
                kind, radius, poses[n, 0], poses[n, 1], 0.0, poses[m, 0], poses[m, 1], 0.0,
                table, bound, forbidden,
            ):  # fmt: skip
                marks |= 1 << k
        steps[n] = marks


@kernel
def _mark_all(low, high, cell, places, offsets, onward, steps):
    """Mark the free steps, those of `STEPS` in the lower bits, their opposites in the upper."""
    for n in range(low, high):
        marks = np.int64(onward[n])
        for k in range(HALF):
            m = cell[places[n] - offsets[k]]
            if m >= 0 and (np.int64(onward[m]) >> k) & 1:
                marks |= 1 << (k + HALF)
        steps[n] = marks


@kernel
def _measure(
    low, high, cell, places, offsets, poses, lengths, first, steps, kind, radius, both_ways,
    is_length, plain, graded, left, bottom, inverse, target, length, fixed, exposure,
):  # fmt: skip
    """Write what the motions from cells cost; and, if it is the same, what the ways back do."""
    for n in range(low, high):
        e = first[n]
        for k in range(2 * HALF):
            if not (np.int64(steps[n]) >> k) & 1:
                continue
            way = k % HALF
            m = cell[places[n] + (offsets[way] if k < HALF else -offsets[way])]
            target[e], length[e] = m, lengths[way]
            if k < HALF or not both_ways:
                x0, y0, x1, y1 = poses[n, 0], poses[n, 1], poses[m, 0], poses[m, 1]
                if not is_length:
                    fixed[e] = motion_integral(
                        kind, radius, x0, y0, 0.0, x1, y1, 0.0, plain, left, bottom, inverse
                    )
                exposure[e] = motion_integral(
                    kind, radius, x0, y0, 0.0, x1, y1, 0.0, graded, left, bottom, inverse
                )
                if both_ways:
                    back = first[m] + _marks_below(np.int64(steps[m]), k + HALF)
                    exposure[back] = exposure[e]
                    if not is_length:
                        fixed[back] = fixed[e]
            e += 1


@kernel
def _marks_below(marks, k):
    """Count the marks below bit k."""
    count = 0
    marks &= (1 << k) - 1
    while marks:
        marks &= marks - 1
        count += 1
    return count
