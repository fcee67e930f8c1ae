"""Whole scans: rays that share an origin walk the triangulation together."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from ambinav.geometry.raycast import cast_one
from ambinav.geometry.triangulation import locate

if TYPE_CHECKING:
    from ambinav.geometry.environment import Environment

STACK = 128


def scan_rays(
    env: Environment,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    theta: NDArray[np.float64],
    ray_origin: NDArray[np.float64],
    ray_angle: NDArray[np.float64],
    max_range: float,
    *,
    incidence: bool = True,
    parallel: bool = True,
) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.float32]]:
    """Cast the same rays from many poses of the robot.

    Args:
        env: The environment.
        x: Poses, shape (N,), metres, map frame.
        y: Poses, shape (N,), metres, map frame.
        theta: Headings, shape (N,), radians.
        ray_origin: Where the rays start, shape (R, 2), metres, robot frame.
        ray_angle: Where they look, shape (R,), radians, robot frame.
        max_range: How far to look, metres.
        incidence: Work out the angles of incidence too.
        parallel: Use all of numba's threads.

    Returns:
        distance: float32, shape (N, R), metres; inf where nothing is hit within `max_range`,
            nan where the ray starts outside the free space.
        segment: int32, shape (N, R), index of the segment that was hit, -1 for none.
        incidence: float32, shape (N, R), angle between ray and surface normal, radians in
            [0, pi/2]; nan where nothing is hit. Shape (0, 0) if not asked for.
    """
    distance = np.empty((len(x), len(ray_angle)), dtype=np.float32)
    edge = np.empty((len(x), len(ray_angle)), dtype=np.int32)
    oblique = np.empty((len(x), len(ray_angle)) if incidence else (0, 0), dtype=np.float32)
    mesh = env.triangulation
    kernel = _fans_parallel if parallel else _fans_serial
    origins, which = np.unique(ray_origin.reshape(-1, 2), axis=0, return_inverse=True)
    for k, origin in enumerate(origins):
        mine = np.flatnonzero(which == k)
        mine = mine[_counter_clockwise(ray_angle[mine])]
        angles = ray_angle[mine]
        kernel(
            x, y, theta, origin, np.cos(angles), np.sin(angles), float(max_range), mine,
            env.border_segment, env.border_lines, mesh.twin, mesh.apex, mesh.onward, *mesh.index,
            distance, edge, oblique,
        )  # fmt: skip
    return distance, edge, oblique


def cast_bundles(
    env: Environment,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    angle: NDArray[np.float64],
    max_range: float,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """First segment that each ray meets, for rays that come in bundles with one origin each.

    Args:
        env: The environment.
        x: Origins, shape (N,), metres, map frame.
        y: Origins, shape (N,), metres, map frame.
        angle: Directions, shape (N, R), radians counter-clockwise from the map's x axis.
        max_range: How far to look, metres.

    Returns:
        Distance, shape (N, R), metres, `max_range` where nothing is met, and the index of the
        segment, int32, shape (N, R), -1 where nothing is met.
    """
    distance = np.empty(angle.shape)
    segment = np.empty(angle.shape, dtype=np.int32)
    mesh = env.triangulation
    _bundles(
        x, y, angle, float(max_range), env.border_segment, env.border_lines, mesh.twin,
        mesh.apex, mesh.onward, mesh.index, env.grid.arrays, distance, segment,
    )  # fmt: skip
    return distance, segment


def _counter_clockwise(angles: NDArray[np.float64]) -> NDArray[np.intp]:
    """Order of the rays, counter-clockwise from the widest gap on, so that no two neighbours in
    the list are apart by more than half a turn unless nothing lies between them.
    """  # noqa: D205
    turned = np.mod(angles, 2 * math.pi)
    order = np.argsort(turned, kind="stable")
    gaps = np.diff(turned[order], append=turned[order[0]] + 2 * math.pi)
    return np.roll(order, -1 - int(gaps.argmax()))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def first_edges(px, py, ux, uy, n, t, corner, twin, edges, lows, highs):
    """Split the fan among the edges of its first triangle; how many pieces."""
    ax, ay = corner[3 * t, 0] - px, corner[3 * t, 1] - py
    bx, by = corner[3 * t + 1, 0] - px, corner[3 * t + 1, 1] - py
    cx, cy = corner[3 * t + 2, 0] - px, corner[3 * t + 2, 1] - py
    depth = 0
    before = -1
    for i in range(n):
        a = ax * uy[i] - ay * ux[i] >= 0
        b = bx * uy[i] - by * ux[i] >= 0
        c = cx * uy[i] - cy * ux[i] >= 0
        through = 0 if (a & (not b)) else (1 if (b & (not c)) else 2)
        if through != before:
            if depth > 0:
                highs[depth - 1] = i
            edges[depth] = twin[3 * t + through]
            lows[depth] = i
            depth += 1
            before = through
    highs[depth - 1] = n
    return depth


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def cast_fan(px, py, ux, uy, n, t, corner, twin, apex, onward, border, stack, distance, hit):
    """Distances and border edges for the rays (ux, uy)[:n], counter-clockwise, from triangle t."""
    edges, lows, highs = stack
    depth = first_edges(px, py, ux, uy, n, t, corner, twin, edges, lows, highs)
    while depth > 0:
        depth -= 1
        h, low, high = edges[depth], lows[depth], highs[depth]
        while h >= 0 and high - low > 1:
            qx, qy = apex[h, 0] - px, apex[h, 1] - py
            if ux[low] * qy - uy[low] * qx <= 0:
                h = onward[h, 0]
            elif ux[high - 1] * qy - uy[high - 1] * qx > 0:
                h = onward[h, 1]
            else:
                right, left = low, high - 1
                while left - right > 1:
                    middle = (left + right) >> 1
                    if ux[middle] * qy - uy[middle] * qx > 0:
                        right = middle
                    else:
                        left = middle
                edges[depth], lows[depth], highs[depth] = onward[h, 0], left, high
                depth += 1
                h = onward[h, 1]
                high = left
        if h >= 0:
            vx, vy = ux[low], uy[low]
            while h >= 0:
                side = vx * (apex[h, 1] - py) - vy * (apex[h, 0] - px)
                h = onward[h, 1] if side > 0 else onward[h, 0]
        k = -1 - h
        ex, ey = border[k, 2] - border[k, 0], border[k, 3] - border[k, 1]
        offset = (border[k, 0] - px) * ey - (border[k, 1] - py) * ex
        for i in range(low, high):
            distance[i] = offset / (ux[i] * ey - uy[i] * ex)
            hit[i] = k


def _fans(
    x, y, theta, origin, bx, by, reach, column, border_segment, border, twin, apex, onward,
    corner, x0, y0, cell, rows, columns, start, item, distance, segment, incidence,
):  # fmt: skip
    n = bx.size
    angles = incidence.size > 0
    block = 64
    for first in prange((x.size + block - 1) // block):
        ux, uy, d = np.empty(n), np.empty(n), np.empty(n)
        hit = np.empty(n, dtype=np.int32)
        size = n + STACK
        stack = (
            np.empty(size, dtype=np.int32),
            np.empty(size, dtype=np.int32),
            np.empty(size, dtype=np.int32),
        )
        for p in range(first * block, min((first + 1) * block, x.size)):
            co, si = math.cos(theta[p]), math.sin(theta[p])
            px = x[p] + co * origin[0] - si * origin[1]
            py = y[p] + si * origin[0] + co * origin[1]
            t = locate(px, py, corner, x0, y0, cell, rows, columns, start, item)
            if t < 0:
                for i in range(n):
                    distance[p, column[i]] = np.nan
                    segment[p, column[i]] = -1
                    if angles:
                        incidence[p, column[i]] = np.nan
                continue
            for i in range(n):
                ux[i] = co * bx[i] - si * by[i]
                uy[i] = si * bx[i] + co * by[i]
            cast_fan(px, py, ux, uy, n, t, corner, twin, apex, onward, border, stack, d, hit)
            for i in range(n):
                c = column[i]
                if d[i] <= reach:
                    k = hit[i]
                    distance[p, c] = d[i]
                    segment[p, c] = border_segment[k]
                    if angles:
                        ex, ey = border[k, 2] - border[k, 0], border[k, 3] - border[k, 1]
                        along = abs(ux[i] * ex + uy[i] * ey)
                        incidence[p, c] = math.atan2(along, abs(ux[i] * ey - uy[i] * ex))
                else:
                    distance[p, c] = np.inf
                    segment[p, c] = -1
                    if angles:
                        incidence[p, c] = np.nan


_fans_serial = njit(cache=True, nogil=True, error_model="numpy")(_fans)
_fans_parallel = njit(cache=True, nogil=True, error_model="numpy", parallel=True)(_fans)


@njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def _bundles(
    x, y, angle, reach, border_segment, border, twin, apex, onward, index, grid, distance, segment
):
    corner, x0, y0, cell, rows, columns, start, item = index
    gx, gy, g_cell, g_rows, g_columns, g_start, g_item, g_line = grid
    n = angle.shape[1]
    block = 64
    for first in prange((x.size + block - 1) // block):
        ux, uy, d = np.empty(n), np.empty(n), np.empty(n)
        hit = np.empty(n, dtype=np.int32)
        size = n + STACK
        stack = (
            np.empty(size, dtype=np.int32),
            np.empty(size, dtype=np.int32),
            np.empty(size, dtype=np.int32),
        )
        for p in range(first * block, min((first + 1) * block, x.size)):
            for i in range(n):
                ux[i], uy[i] = math.cos(angle[p, i]), math.sin(angle[p, i])
            t = locate(x[p], y[p], corner, x0, y0, cell, rows, columns, start, item)
            rising = 0.0 <= angle[p, n - 1] - angle[p, 0] < 2.0 * math.pi
            for i in range(1, n):
                # A gap of half a turn could hide in one edge of a triangle.
                rising &= 0.0 <= angle[p, i] - angle[p, i - 1] < 3.0
            if t >= 0 and rising:
                cast_fan(
                    x[p], y[p], ux, uy, n, t, corner, twin, apex, onward, border, stack, d, hit
                )
                for i in range(n):
                    seen = d[i] < reach
                    distance[p, i] = d[i] if seen else reach
                    segment[p, i] = border_segment[hit[i]] if seen else -1
                continue
            for i in range(n):
                far, j = cast_one(
                    x[p], y[p], ux[i], uy[i], reach, gx, gy, g_cell, g_rows, g_columns, g_start,
                    g_line,
                )  # fmt: skip
                distance[p, i] = far
                segment[p, i] = g_item[j] if j >= 0 else -1
