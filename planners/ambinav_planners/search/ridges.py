"""Ridges of the clearance: its decrease to both sides, and its maximum.

All that is asked of a point lies within a step of it, so the few segments that can be nearest there
are looked up once, and not for each of some fifty clearances.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.casting.plane.grid import SegmentGrid
from ambinav.casting.plane.raycast import squared_distance
from ambinav.runtime.array_types import Floats
from ambinav.runtime.arrays import copy_into
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

# Directions across a channel, unit vectors 22.5 degrees apart.
ACROSS = np.array([(math.cos(a), math.sin(a)) for a in np.arange(8) * math.pi / 8.0])
# The search for the ridge narrows its bracket so often, by the golden ratio: to 1e-5 of the step.
NARROWINGS = 24
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
# Margin of the reach, so that rounding excludes nothing.
SLACK = 1e-9


def decreases(
    grid: SegmentGrid, points: Floats, room: Floats, step: float
) -> tuple[Floats, Floats]:
    """Return the largest decrease of the clearance from points, summed over both sides.

    Args:
        grid: Grid of the segments.
        points: x and y, shape (N, 2), metres.
        room: Their clearances, shape (N,), metres.
        step: Distance to both sides, metres.

    Returns:
        The fall in that direction of `ACROSS` in which it is largest, shape (N,), metres, and the
        direction, a unit vector, shape (N, 2).
    """
    fall, direction = np.empty(len(points)), np.empty((len(points), 2))
    run_rows(_decreases, len(points), points, room, step, *grid.arrays, fall, direction, least=64)
    return fall, direction


def ridge(
    grid: SegmentGrid, points: Floats, room: Floats, direction: Floats, step: float
) -> tuple[Floats, Floats]:
    """Find the highest clearance within a step of points along a direction, by golden section.

    Args:
        grid: Grid of the segments.
        points: x and y, shape (N, 2), metres.
        room: Their clearances, shape (N,), metres.
        direction: A unit vector for each, shape (N, 2).
        step: Distance to both sides, metres.

    Returns:
        Where it is, shape (N, 2), and how high, shape (N,), metres.
    """
    points_on_ridge, high = np.empty((len(points), 2)), np.empty(len(points))
    run_rows(
        _ridge,
        len(points),
        points,
        room,
        direction,
        step,
        *grid.arrays,
        points_on_ridge,
        high,
        least=64,
    )
    return points_on_ridge, high


@kernel
def _decreases(
    low, high, points, here, step, x0, y0, cell, rows, columns, start, item, line, most, direction
):
    near = np.empty((64, 4))
    for i in range(low, high):
        x, y = points[i, 0], points[i, 1]
        near, count = within(
            x, y, here[i] + 2.0 * step, x0, y0, cell, rows, columns, start, line, near
        )
        most[i] = -math.inf
        for k in range(ACROSS.shape[0]):
            dx, dy = step * ACROSS[k, 0], step * ACROSS[k, 1]
            fall = (
                2.0 * here[i] - nearest(x + dx, y + dy, near, count)
                - nearest(x - dx, y - dy, near, count)
            )  # fmt: skip
            if fall > most[i]:
                most[i] = fall
                direction[i, 0], direction[i, 1] = ACROSS[k, 0], ACROSS[k, 1]


@kernel
def _ridge(
    low, high, points, here, direction, step, x0, y0, cell, rows, columns, start, item, line,
    highest_points, highest,
):  # fmt: skip
    near = np.empty((64, 4))
    for i in range(low, high):
        x, y, ux, uy = points[i, 0], points[i, 1], direction[i, 0], direction[i, 1]
        near, count = within(
            x, y, here[i] + 2.0 * step, x0, y0, cell, rows, columns, start, line, near
        )
        begin, end = -step, step
        for _ in range(NARROWINGS):
            width = GOLDEN * (end - begin)
            left, right = end - width, begin + width
            if nearest(x + left * ux, y + left * uy, near, count) < nearest(
                x + right * ux, y + right * uy, near, count
            ):
                begin = left
            else:
                end = right
        middle = 0.5 * (begin + end)
        highest_points[i, 0], highest_points[i, 1] = x + middle * ux, y + middle * uy
        highest[i] = nearest(highest_points[i, 0], highest_points[i, 1], near, count)


@kernel
def within(px, py, reach, x0, y0, cell, rows, columns, start, line, near):
    """Return the segments that may have a part within `reach` of a point.

    Returns:
        The array `near`, or a longer one, whose first rows are lines as of `SegmentGrid`; and how
        many. One that stands in several cells may be there several times.
    """
    limit = reach * reach * (1.0 + SLACK)
    low_row = max(int(math.floor((py - reach - y0) / cell)), 0)
    high_row = min(int(math.floor((py + reach - y0) / cell)), rows - 1)
    low_column = max(int(math.floor((px - reach - x0) / cell)), 0)
    high_column = min(int(math.floor((px + reach - x0) / cell)), columns - 1)
    count = 0
    for r in range(low_row, high_row + 1):
        for j in range(start[r * columns + low_column], start[r * columns + high_column + 1]):
            if squared_distance(px, py, line, j) > limit:
                continue
            if count == near.shape[0]:
                longer = np.empty((2 * count, 4))
                copy_into(longer, near)
                near = longer
            for k in range(4):
                near[count, k] = line[j, k]
            count += 1
    return near, count


@kernel
def nearest(px, py, near, count):
    """Return the distance to the nearest of some lines."""
    best = math.inf
    for j in range(count):
        best = min(best, squared_distance(px, py, near, j))
    return math.sqrt(best)
