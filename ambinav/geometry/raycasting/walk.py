"""Single rays through the triangulation, many at a time.

One ray after the other waits at every triangle for the one before, and at its end the processor
has guessed wrong. A block of rays that all take one step in turn does neither: the steps of
different rays overlap, and a ray that has arrived is dropped from the list without a branch.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.raycasting.scene import Scene
from ambinav.geometry.raycasting.triangulation import LEFT, RIGHT, border_distance, locate
from ambinav.kernels import kernel
from ambinav.threads import run_rows

# Rays that walk together: their state stays in the first-level cache.
BLOCK = 256
# Rays whose directions are worked out in one go, in the second-level cache.
CHUNK = 32_768


def walk_rays(
    scene: Scene,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    angle: NDArray[np.float64],
    max_range: float,
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.bool_]]:
    """First segment that each ray meets, for rays that start in the free space.

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
    mesh = scene.triangulation
    ux, uy = np.empty(min(CHUNK, len(x))), np.empty(min(CHUNK, len(x)))
    for low in range(0, len(x), CHUNK):
        part = slice(low, low + CHUNK)
        count = len(angle[part])
        np.cos(angle[part], out=ux[:count])
        np.sin(angle[part], out=uy[:count])
        run_rows(
            _walk, count, x[part], y[part], ux[:count], uy[:count], float(max_range),
            scene.border_segment, scene.border_lines, mesh.twin, mesh.node, mesh.hops, mesh.corner,
            *mesh.index, distance[part], segment[part], inside[part], least=4 * BLOCK,
        )  # fmt: skip
    return distance, segment, inside


@kernel(inline="always")
def first_edge(px, py, ux, uy, t, corner):
    """Edge of triangle t through which the ray leaves it."""
    h = 3 * t
    a = (corner[h, 0] - px) * uy - (corner[h, 1] - py) * ux >= 0
    b = (corner[h + 1, 0] - px) * uy - (corner[h + 1, 1] - py) * ux >= 0
    c = (corner[h + 2, 0] - px) * uy - (corner[h + 2, 1] - py) * ux >= 0
    return 0 if (a & (not b)) else (1 if (b & (not c)) else 2)


@kernel
def _walk(
    low, high, x, y, ux, uy, reach, border_segment, border, twin, node, hops,
    corner, x0, y0, cell, rows, columns, start, item, triangle, distance, segment, inside,
):  # fmt: skip
    at = np.empty(BLOCK, dtype=np.int32)
    going = np.empty(BLOCK, dtype=np.int32)
    for first in range(low, high, BLOCK):
        count = min(BLOCK, high - first)
        left = 0
        before_x, before_y, t = math.nan, math.nan, -1
        for i in range(count):
            px, py = x[first + i], y[first + i]
            if px != before_x or py != before_y:
                t = locate(px, py, x0, y0, cell, rows, columns, start, item, triangle)
                before_x, before_y = px, py
            inside[first + i] = t >= 0
            if t >= 0:
                edge = first_edge(px, py, ux[first + i], uy[first + i], t, corner)
                at[i] = twin[3 * t + edge]
                going[left] = i
                left += at[i] >= 0
        while left > 0:
            still = 0
            for j in range(left):
                i = going[j]
                h = at[i]
                r = first + i
                side = ux[r] * (node[h, 1] - y[r]) - uy[r] * (node[h, 0] - x[r])
                onto = hops[h, RIGHT] if side > 0 else hops[h, LEFT]
                at[i] = onto
                going[still] = i
                still += onto >= 0
            left = still
        for i in range(count):
            r = first + i
            if inside[r]:
                k = -1 - at[i]
                d = border_distance(x[r], y[r], ux[r], uy[r], border, k)
                met = d < reach
                distance[r] = d if met else reach
                segment[r] = border_segment[k] if met else -1
