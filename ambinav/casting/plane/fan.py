"""Casting of whole scans: rays that share an origin walk the triangulation together."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ambinav.casting.plane.triangulation import (
    LEFT,
    PARALLEL,
    RIGHT,
    border_distance,
    first_edge,
    locate,
)
from ambinav.casting.scene import Scene
from ambinav.runtime.array_types import Floats, Floats32, Indices, Ints32
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

STACK = 128
# Up to this many rays are divided at a corner one by one.
_FEW, _ONE = np.uint64(16), np.uint64(1)
# Margin beyond the reach, metres, at which edges are ignored.
ROUNDING = 1e-6
# Gaps between rays that differ by less, in radians, are equally wide.
EQUAL = 1e-9
# Minimum number of rays for a further thread.
LEAST_RAYS = 2048


class Fan(NamedTuple):
    """Rays with a common origin, counter-clockwise, robot frame.

    Attributes:
        origin: x and y, metres, shape (2,).
        cosine: Cosine of the rays' directions, shape (n,).
        sine: Likewise.
        column: Column of the results that each ray belongs to, shape (n,).
        reach: How far to look, metres.
    """

    origin: Floats
    cosine: Floats
    sine: Floats
    column: Indices
    reach: float


def scan_plan(
    scene: Scene,
    x: Floats,
    y: Floats,
    theta: Floats,
    ray_origin: Floats,
    ray_angle: Floats,
    max_range: float,
    *,
    incidence: bool = True,
) -> tuple[Floats32, Ints32, Floats32]:
    """Cast the same level rays from many poses of the robot, in the plane.

    A scanner's rays are cast by `scans.scan_rays`: they may end on what no plan shows.

    Args:
        scene: The free space and its segments; an `Environment` is one.
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
    mesh = scene.triangulation.arrays(scene.border_segment, scene.border_lines)
    # One layout: columns of an array of poses would be compiled for anew.
    x, y, theta = map(np.ascontiguousarray, (x, y, theta))
    origins, which = distinct_rows(ray_origin.reshape(-1, 2))
    for k, origin in enumerate(origins):
        mine = np.flatnonzero(which == k)
        mine = mine[counter_clockwise(ray_angle[mine])]
        angles = ray_angle[mine]
        fan = Fan(origin, np.cos(angles), np.sin(angles), mine, float(max_range))
        run_rows(
            _fans, len(x), x, y, theta, fan, mesh, distance, edge, oblique,
            least=1 + LEAST_RAYS // len(mine),
        )  # fmt: skip
    return distance, edge, oblique


def distinct_rows(rows: Floats) -> tuple[Floats, Indices]:
    """Return the distinct rows, sorted, and which of them each row is."""
    if (rows == rows[:1]).all():
        # The rays of one sensor: sorting their origins takes longer than casting them.
        return rows[:1], np.zeros(len(rows), dtype=np.intp)
    return np.unique(rows, axis=0, return_inverse=True)


def counter_clockwise(angles: Floats) -> Indices:
    """Return the order of the rays, counter-clockwise from the widest gap on.

    So no two neighbours in the list are half a turn apart, unless nothing lies between them. Of
    gaps that are equally wide it is one that keeps rays in their order, if there is one.
    """
    turned = np.mod(angles, 2 * math.pi)
    order = np.argsort(turned, kind="stable")
    ascending = turned[order]
    gaps = np.append(ascending[1:], ascending[0] + 2 * math.pi) - ascending
    widest = np.flatnonzero(gaps > gaps.max() - EQUAL)
    after = (widest + 1) % len(order)
    first = after[order[after].argmin()]
    return np.concatenate([order[first:], order[:first]])


@kernel(inline="always")
def first_edges(px, py, ux, uy, n, t, corner, twin, edges, lows, highs, through):
    """Split the fan among the edges of its first triangle; return the number of pieces.

    Counter-clockwise from the first ray on, the rays leave through that ray's edge, the next one,
    the one after, and, if they come round, the first again: so it is enough to count them.
    `through` is -1 when this returns, shape (n,).
    """
    ax, ay = corner[3 * t, 0] - px, corner[3 * t, 1] - py
    bx, by = corner[3 * t + 1, 0] - px, corner[3 * t + 1, 1] - py
    cx, cy = corner[3 * t + 2, 0] - px, corner[3 * t + 2, 1] - py
    along = False
    for i in range(n):
        a = ax * uy[i] - ay * ux[i] >= 0
        b = bx * uy[i] - by * ux[i] >= 0
        c = cx * uy[i] - cy * ux[i] >= 0
        through[i] = 0 if (a & (not b)) else (1 if (b & (not c)) else 2)
        along |= (a == b) & (b == c)
    if along:
        for i in range(n):
            through[i] = first_edge(px, py, ux[i], uy[i], t, corner)
    first = through[0]
    second, third = (first + 1) % 3, (first + 2) % 3
    begun, seconds, thirds = n, 0, 0
    for i in range(n):
        edge = through[i]
        seconds += edge == second
        thirds += edge == third
        begun = min(begun, n if edge == first else i)
        through[i] = -1
    depth = 0
    low = 0
    for k in range(4):
        high = begun if k == 0 else (low + seconds if k == 1 else (low + thirds if k == 2 else n))
        edges[depth], lows[depth], highs[depth] = twin[3 * t + (first + k) % 3], low, high
        depth += high > low
        low = high
    return depth


@kernel(forceinline=True)
def cast_fan(px, py, ux, uy, n, t, reach, corner, twin, node, hops, border, stack, distance, hit):
    """Write distances and border edges of rays (ux, uy)[:n], counter-clockwise, from triangle t.

    A ray that meets nothing within `reach` gets either what it meets beyond, or inf and -1.

    The walk writes the edge of the first ray of each piece alone. Loops over all rays then spread
    it and work out the distances: pieces are short, and many short loops take longer.
    """
    edges, lows, highs = stack
    depth = first_edges(px, py, ux, uy, n, t, corner, twin, edges, lows, highs, hit)
    none = border.shape[0]
    enough = reach + ROUNDING
    while depth > 0:
        depth -= 1
        # Without a sign, numba need not ask at each access whether an index counts from the end.
        h, low, last = edges[depth], np.uint64(lows[depth]), np.uint64(highs[depth]) - _ONE
        # How far the ends of half-edge h are along the first ray: no point of the edge is nearer
        # than the less of the two. In drawn buildings a third of all steps lead beyond 4 m.
        vx, vy = ux[low], uy[low]
        left_end = right_end = 0.0
        if h >= 0:
            after = h + 1 if h % 3 < 2 else h - 2
            left_end = (corner[h, 0] - px) * vx + (corner[h, 1] - py) * vy
            right_end = (corner[after, 0] - px) * vx + (corner[after, 1] - py) * vy
        while h >= 0 and low < last:
            qx, qy = node[h, 0] - px, node[h, 1] - py
            end = vx * qx + vy * qy
            if vx * qy - vy * qx <= 0:
                h = hops[h, LEFT]
                right_end = end
            elif ux[last] * qy - uy[last] * qx > 0:
                h = hops[h, RIGHT]
                left_end = end
            else:
                right, left = low, last
                while left - right > _FEW:
                    middle = (left + right) >> _ONE
                    if ux[middle] * qy - uy[middle] * qx > 0:
                        right = middle
                    else:
                        left = middle
                # Check all of a few: a binary search mispredicts every other branch.
                passed = 0
                for i in range(right + _ONE, left):
                    passed += ux[i] * qy - uy[i] * qx > 0
                right += np.uint64(passed)
                edges[depth], lows[depth], highs[depth] = hops[h, LEFT], right + _ONE, last + _ONE
                depth += 1
                h = hops[h, RIGHT]
                left_end = end
                last = right
            if min(left_end, right_end) > enough:
                h = -1 - none
        while h >= 0:
            qx, qy = node[h, 0] - px, node[h, 1] - py
            end = vx * qx + vy * qy
            onto_right = vx * qy - vy * qx > 0
            h = hops[h, RIGHT] if onto_right else hops[h, LEFT]
            left_end = end if onto_right else left_end
            right_end = right_end if onto_right else end
            if min(left_end, right_end) > enough:
                h = -1 - none
        hit[low] = -1 - h
    k = hit[0]
    for i in range(n):
        k = hit[i] if hit[i] >= 0 else k
        hit[i] = k
    parallel = False
    for i in range(n):
        seen = hit[i] < none
        k = np.uint64(hit[i] if seen else 0)
        ax, ay = border[k, 0] - px, border[k, 1] - py
        ex, ey = border[k, 2] - border[k, 0], border[k, 3] - border[k, 1]
        cross = ux[i] * ey - uy[i] * ex
        parallel |= not abs(cross) > PARALLEL * (abs(ex) + abs(ey))
        distance[i] = (ax * ey - ay * ex) / cross if seen else math.inf
        hit[i] = hit[i] if seen else -1
    if parallel:
        for i in range(n):
            if hit[i] >= 0:
                distance[i] = border_distance(px, py, ux[i], uy[i], border, hit[i])


@kernel
def _fans(begin, end, x, y, theta, fan, mesh, distance, segment, incidence):
    origin, bx, by, column, reach = fan
    border_segment, border, twin, node, hops, corner, _ = mesh
    x0, y0, cell, rows, columns, start, item, triangle = mesh.grid
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
        cast_fan(px, py, ux, uy, n, t, reach, corner, twin, node, hops, border, stack, d, hit)
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
