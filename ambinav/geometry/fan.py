"""Whole scans: rays that share an origin walk the triangulation together."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ambinav.geometry.triangulation import LEFT, PARALLEL, RIGHT, border_distance, locate
from ambinav.threads import run_rows

if TYPE_CHECKING:
    from ambinav.geometry.environment import Environment

STACK = 128
# Fewer are not worth waking a thread for.
LEAST_RAYS = 2048


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
    origins, which = np.unique(ray_origin.reshape(-1, 2), axis=0, return_inverse=True)
    for k, origin in enumerate(origins):
        mine = np.flatnonzero(which == k)
        mine = mine[counter_clockwise(ray_angle[mine])]
        angles = ray_angle[mine]
        run_rows(
            _fans, len(x), x, y, theta, origin, np.cos(angles), np.sin(angles), float(max_range),
            mine, env.border_segment, env.border_lines, mesh.twin, mesh.node, mesh.hops,
            mesh.corner, *mesh.index, distance, edge, oblique, least=1 + LEAST_RAYS // len(mine),
        )  # fmt: skip
    return distance, edge, oblique


def counter_clockwise(angles: NDArray[np.float64]) -> NDArray[np.intp]:
    """Order of the rays, counter-clockwise from the widest gap on.

    So no two neighbours in the list are half a turn apart, unless nothing lies between them.
    """
    turned = np.mod(angles, 2 * math.pi)
    order = np.argsort(turned, kind="stable")
    gaps = np.diff(turned[order], append=turned[order[0]] + 2 * math.pi)
    return np.roll(order, -1 - int(gaps.argmax()))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def first_edges(px, py, ux, uy, n, t, corner, twin, edges, lows, highs, through):
    """Split the fan among the edges of its first triangle; how many pieces.

    `through` is work space, int32, shape (n,); -1 when this returns.
    """
    ax, ay = corner[3 * t, 0] - px, corner[3 * t, 1] - py
    bx, by = corner[3 * t + 1, 0] - px, corner[3 * t + 1, 1] - py
    cx, cy = corner[3 * t + 2, 0] - px, corner[3 * t + 2, 1] - py
    for i in range(n):
        a = ax * uy[i] - ay * ux[i] >= 0
        b = bx * uy[i] - by * ux[i] >= 0
        c = cx * uy[i] - cy * ux[i] >= 0
        through[i] = 0 if (a & (not b)) else (1 if (b & (not c)) else 2)
    depth = 0
    before = -1
    for i in range(n):
        edge = through[i]
        through[i] = -1
        if edge != before:
            if depth > 0:
                highs[depth - 1] = i
            edges[depth] = twin[3 * t + edge]
            lows[depth] = i
            depth += 1
            before = edge
    highs[depth - 1] = n
    return depth


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def cast_fan(px, py, ux, uy, n, t, corner, twin, node, hops, border, stack, distance, hit):
    """Distances and border edges for the rays (ux, uy)[:n], counter-clockwise, from triangle t.

    The walk writes the edge of the first ray of each piece alone. Loops over all rays then spread
    it and work out the distances: pieces are short, and many short loops take longer.
    """
    edges, lows, highs = stack
    depth = first_edges(px, py, ux, uy, n, t, corner, twin, edges, lows, highs, hit)
    while depth > 0:
        depth -= 1
        h, low, high = edges[depth], lows[depth], highs[depth]
        while h >= 0 and high - low > 1:
            qx, qy = node[h, 0] - px, node[h, 1] - py
            if ux[low] * qy - uy[low] * qx <= 0:
                h = hops[h, LEFT]
            elif ux[high - 1] * qy - uy[high - 1] * qx > 0:
                h = hops[h, RIGHT]
            else:
                right, left = low, high - 1
                while left - right > 1:
                    middle = (left + right) >> 1
                    if ux[middle] * qy - uy[middle] * qx > 0:
                        right = middle
                    else:
                        left = middle
                edges[depth], lows[depth], highs[depth] = hops[h, LEFT], left, high
                depth += 1
                h = hops[h, RIGHT]
                high = left
        if h >= 0:
            vx, vy = ux[low], uy[low]
            while h >= 0:
                side = vx * (node[h, 1] - py) - vy * (node[h, 0] - px)
                h = hops[h, RIGHT] if side > 0 else hops[h, LEFT]
        hit[low] = -1 - h
    k = hit[0]
    for i in range(n):
        k = hit[i] if hit[i] >= 0 else k
        hit[i] = k
    parallel = False
    for i in range(n):
        k = hit[i]
        ax, ay = border[k, 0] - px, border[k, 1] - py
        ex, ey = border[k, 2] - border[k, 0], border[k, 3] - border[k, 1]
        cross = ux[i] * ey - uy[i] * ex
        parallel |= not abs(cross) > PARALLEL * (abs(ex) + abs(ey))
        distance[i] = (ax * ey - ay * ex) / cross
    if parallel:
        for i in range(n):
            distance[i] = border_distance(px, py, ux[i], uy[i], border, hit[i])


@njit(cache=True, nogil=True, error_model="numpy")
def _fans(
    begin, end, x, y, theta, origin, bx, by, reach, column, border_segment, border, twin, node,
    hops, corner, x0, y0, cell, rows, columns, start, item, triangle, distance, segment, incidence,
):  # fmt: skip
    n = bx.size
    angles = incidence.size > 0
    ux, uy, d = np.empty(n), np.empty(n), np.empty(n)
    hit = np.empty(n, dtype=np.int32)
    size = n + STACK
    stack = (
        np.empty(size, dtype=np.int32),
        np.empty(size, dtype=np.int32),
        np.empty(size, dtype=np.int32),
    )
    for p in range(begin, end):
        co, si = math.cos(theta[p]), math.sin(theta[p])
        px = x[p] + co * origin[0] - si * origin[1]
        py = y[p] + si * origin[0] + co * origin[1]
        t = locate(px, py, x0, y0, cell, rows, columns, start, item, triangle)
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
        cast_fan(px, py, ux, uy, n, t, corner, twin, node, hops, border, stack, d, hit)
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
