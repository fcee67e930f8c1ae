"""Casting of single rays through the triangulation, many at a time.

One ray after the other waits at every triangle for the one before, and at its end the processor
has guessed wrong. A block of rays that all take one step in turn does neither: the steps of
different rays overlap, and a ray that has arrived is dropped from the list without a branch.

Rays in random order would find none of the triangles that they walk through in the nearest caches.
So many of them are first put in order by where they start and where they look.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.casting.plane.triangulation import LEFT, RIGHT, border_distance, first_edge, locate
from ambinav.casting.scene import Scene
from ambinav.runtime.array_types import Bools, Floats, Ints32
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

# Rays that walk together: their state stays in the first-level cache.
BLOCK = 256
# Rays that are put in order together.
CHUNK = 524_288
# Fewer rays are not worth sorting.
LEAST = 4096
# Average number of rays in a cell of the sorting grid.
PER_CELL = 4


def walk_rays(
    scene: Scene, x: Floats, y: Floats, angle: Floats, max_range: float
) -> tuple[Floats, Ints32, Bools]:
    """Find the first segment that each ray meets; the rays start in the free space.

    Args:
        scene: The free space and its segments; an `Environment` is one.
        x: Origins, shape (N,), metres, map frame.
        y: Origins, shape (N,), metres, map frame.
        angle: Directions, shape (N,), radians counter-clockwise from the map's x axis.
        max_range: How far to look, metres.

    Returns:
        Distance, shape (N,), metres, `max_range` where nothing is met; index of the segment,
        int32, shape (N,), -1 where nothing is met; and whether the ray starts in the free space,
        shape (N,): where it does not, the other two say nothing.
    """
    distance = np.empty(len(x))
    segment = np.empty(len(x), dtype=np.int32)
    inside = np.empty(len(x), dtype=np.bool_)
    mesh = scene.triangulation.arrays(scene.border_segment, scene.border_lines)
    ux, uy = np.empty(min(CHUNK, len(x))), np.empty(min(CHUNK, len(x)))
    order, rays = np.empty(len(ux), dtype=np.int32), np.empty((len(ux), 4))
    for low in range(0, len(x), CHUNK):
        part = slice(low, low + CHUNK)
        count = len(angle[part])
        np.cos(angle[part], out=ux[:count])
        np.sin(angle[part], out=uy[:count])
        _order(x[part], y[part], ux[:count], uy[:count], order, rays)
        run_rows(
            _walk, count, order, rays, float(max_range), mesh, distance[part], segment[part],
            inside[part], least=4 * BLOCK,
        )  # fmt: skip
    return distance, segment, inside


@kernel
def _order(x, y, ux, uy, order, rays):
    """Sort rays so that rays with nearby starts and similar directions are together.

    They stay as they are where neighbours share their origins, or where there are few.

    Args:
        x: Origins, shape (N,), metres.
        y: Origins.
        ux: Directions, shape (N,).
        uy: Directions.
        order: Written, which ray comes when, shape (N,).
        rays: Written, these four numbers of each ray in that order, shape (N, 4).
    """
    count = x.size
    same = 0
    for i in range(1, count):
        same += (x[i] == x[i - 1]) & (y[i] == y[i - 1])
    if 2 * same > count or count < LEAST:
        for i in range(count):
            order[i] = i
            rays[i, 0], rays[i, 1], rays[i, 2], rays[i, 3] = x[i], y[i], ux[i], uy[i]
        return
    low_x, high_x, low_y, high_y = x[0], x[0], y[0], y[0]
    for i in range(count):
        low_x, high_x = min(low_x, x[i]), max(high_x, x[i])
        low_y, high_y = min(low_y, y[i]), max(high_y, y[i])
    cells = int(math.sqrt(count / PER_CELL))
    scale_x, scale_y = cells / max(high_x - low_x, 1e-9), cells / max(high_y - low_y, 1e-9)
    key = np.empty(count, dtype=np.int32)
    start = np.zeros(4 * cells * cells + 1, dtype=np.int32)
    for i in range(count):
        column, row = (x[i] - low_x) * scale_x, (y[i] - low_y) * scale_y
        # The last ones, and where coordinates are too large for a difference: any cell will do.
        column, row = column if 0.0 <= column < cells else 0.0, row if 0.0 <= row < cells else 0.0
        cell = int(row) * cells + int(column)
        # By quadrant within a cell.
        key[i] = 4 * cell + 2 * (ux[i] > 0.0) + (uy[i] > 0.0)
        start[key[i] + 1] += 1
    for k in range(1, start.size):
        start[k] += start[k - 1]
    for i in range(count):
        to = start[key[i]]
        start[key[i]] += 1
        order[to] = i
        rays[to, 0], rays[to, 1], rays[to, 2], rays[to, 3] = x[i], y[i], ux[i], uy[i]


@kernel
def _walk(low, high, order, rays, reach, mesh, distance, segment, inside):
    border_segment, border, twin, node, hops, corner, _ = mesh
    x0, y0, cell, rows, columns, start, item, triangle = mesh.grid
    at = np.empty(BLOCK, dtype=np.int32)
    going = np.empty(BLOCK, dtype=np.int32)
    for first in range(low, high, BLOCK):
        count = min(BLOCK, high - first)
        ray = rays[first : first + count]
        left = 0
        before_x, before_y, t = math.nan, math.nan, -1
        for i in range(count):
            r = order[first + i]
            px, py, vx, vy = ray[i, 0], ray[i, 1], ray[i, 2], ray[i, 3]
            if px != before_x or py != before_y:
                t = locate(px, py, x0, y0, cell, rows, columns, start, item, triangle)
                before_x, before_y = px, py
            inside[r] = t >= 0
            if t >= 0:
                at[i] = twin[3 * t + first_edge(px, py, vx, vy, t, corner)]
                going[left] = i
                left += at[i] >= 0
        while left > 0:
            still = 0
            for j in range(left):
                i = going[j]
                h = at[i]
                side = ray[i, 2] * (node[h, 1] - ray[i, 1]) - ray[i, 3] * (node[h, 0] - ray[i, 0])
                onto = hops[h, RIGHT] if side > 0 else hops[h, LEFT]
                at[i] = onto
                going[still] = i
                still += onto >= 0
            left = still
        for i in range(count):
            r = order[first + i]
            if inside[r]:
                k = -1 - at[i]
                d = border_distance(ray[i, 0], ray[i, 1], ray[i, 2], ray[i, 3], border, k)
                met = d < reach
                distance[r] = d if met else reach
                segment[r] = border_segment[k] if met else -1
