"""Kernels of the improvement: stations along a route, candidates beside it, cheapest chain."""

from __future__ import annotations

import math

import numpy as np

from ambinav.geometry.collision.sweep import motion_free
from ambinav.geometry.motion.curves import motion_length
from ambinav.runtime.kernels import kernel
from ambinav.service.motion import motion_integral

# A motion counts this much, metres-equivalent, when chains are compared: of two that cost the
# same the one with fewer motions is taken. A chain of a thousand may become dearer by 0.1 mm.
PER_MOTION = 1e-7
# Next to a vertex where the route turns by more than this, radians, stations stand closer ...
TURNING = 0.08
# ... by this factor, and farther apart again by this share of the path from it.
CLOSER = 0.25
WIDENING = 0.5


@kernel(inline="always")
def put(pose, out, row):
    """Write a pose to a row of poses.

    `out[row] = pose` would do, but the message for shapes that differ takes seconds to compile.
    """
    out[row, 0], out[row, 1], out[row, 2] = pose[0], pose[1], pose[2]


@kernel
def stations(poses, spacing):
    """Return poses along straight motions, at most `spacing` apart, and closer near turns.

    Args:
        poses: float64, shape (N, 3).
        spacing: Metres.

    Returns:
        float64, shape (M, 3): all vertices and what was put between them, headings turned evenly.
    """
    count = poses.shape[0]
    bend = np.zeros(count)
    for i in range(1, count - 1):
        bend[i] = abs(turn_at(poses, i))
    capacity = count
    for i in range(count - 1):
        length = math.hypot(poses[i + 1, 0] - poses[i, 0], poses[i + 1, 1] - poses[i, 1])
        capacity += 2 * int(length / (CLOSER * spacing)) + 4
    out = np.empty((capacity, 3))
    put(poses[0], out, 0)
    size = 1
    for i in range(count - 1):
        length = math.hypot(poses[i + 1, 0] - poses[i, 0], poses[i + 1, 1] - poses[i, 1])
        near = CLOSER * spacing if bend[i] > TURNING else spacing
        far = CLOSER * spacing if bend[i + 1] > TURNING else spacing
        # Steps are counted first, then stretched to fill the motion evenly.
        steps, along = 0, 0.0
        while along < length * (1.0 - 1e-9):
            along += _step(along, length, near, far, spacing)
            steps += 1
        scale = length / along if along > 0.0 else 0.0
        turn = wrap_angle(poses[i + 1, 2] - poses[i, 2])
        along = 0.0
        for _ in range(steps - 1):
            along += _step(along, length, near, far, spacing)
            share = along * scale / length
            for axis in range(2):
                out[size, axis] = poses[i, axis] + share * (poses[i + 1, axis] - poses[i, axis])
            out[size, 2] = poses[i, 2] + share * turn
            size += 1
        put(poses[i + 1], out, size)
        size += 1
    return out[:size].copy()


@kernel(inline="always")
def _step(along, length, near, far, spacing):
    # Towards the far end a step is as long as one that comes from there.
    left = max(length - along, 0.0)
    return min(spacing, near + WIDENING * along, (far + WIDENING * left) / (1.0 + WIDENING))


@kernel(inline="always")
def wrap_angle(angle):
    """Wrap an angle to [-pi, pi), radians."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@kernel
def travelled(kind, radius, poses):
    """Return the metres travelled from the start to each pose of a route, shape (N,)."""
    out = np.zeros(poses.shape[0])
    for k in range(poses.shape[0] - 1):
        out[k + 1] = out[k] + motion_length(
            kind, radius, poses[k, 0], poses[k, 1], poses[k, 2],
            poses[k + 1, 0], poses[k + 1, 1], poses[k + 1, 2],
        )  # fmt: skip
    return out


@kernel
def turn_at(poses, i):
    """Return the turn of the direction at vertex i, radians, left positive; 0 without motion."""
    ax, ay = poses[i, 0] - poses[i - 1, 0], poses[i, 1] - poses[i - 1, 1]
    bx, by = poses[i + 1, 0] - poses[i, 0], poses[i + 1, 1] - poses[i, 1]
    return math.atan2(ax * by - ay * bx, ax * bx + ay * by)


@kernel
def beside(poses, step, share, sides):
    """Return candidates to the left and right of every pose but the first and the last.

    Args:
        poses: float64, shape (N, 3).
        step: Metres between candidates.
        share: They stand closer where that is more than this share of the shorter motion there.
        sides: How many candidates on each side.

    Returns:
        float64, shape (N, 2 * sides + 1, 3), the pose itself first; all are the same at the ends.
    """
    count, wide = poses.shape[0], 2 * sides + 1
    out = np.empty((count, wide, 3))
    for i in range(count):
        for k in range(wide):
            put(poses[i], out[i], k)
        if i == 0 or i == count - 1:
            continue
        ax, ay = poses[i, 0] - poses[i - 1, 0], poses[i, 1] - poses[i - 1, 1]
        bx, by = poses[i + 1, 0] - poses[i, 0], poses[i + 1, 1] - poses[i, 1]
        a, b = math.hypot(ax, ay), math.hypot(bx, by)
        if a == 0.0 or b == 0.0:
            continue
        tx, ty = ax / a + bx / b, ay / a + by / b
        size = math.hypot(tx, ty)
        if size < 1e-6:  # the route turns back on itself: move along it
            tx, ty, size = -ay, ax, a
        width = min(step, share * min(a, b))
        for k in range(1, wide):
            offset = width * ((k + 1) // 2)
            if k % 2 == 0:
                offset = -offset
            out[i, k, 0] -= ty / size * offset
            out[i, k, 1] += tx / size * offset
    return out


@kernel
def headings(poses, step, sides):
    """Return heading candidates: along the travel first, then unchanged, then turned.

    Args:
        poses: float64, shape (N, 3).
        step: Radians between the turned ones.
        sides: How many turned ones each way.

    Returns:
        float64, shape (N, 2 + 2 * sides, 3); all are the same at the ends.
    """
    count, wide = poses.shape[0], 2 + 2 * sides
    out = np.empty((count, wide, 3))
    for i in range(count):
        for k in range(wide):
            put(poses[i], out[i], k)
        if i == 0 or i == count - 1:
            continue
        ax, ay = poses[i, 0] - poses[i - 1, 0], poses[i, 1] - poses[i - 1, 1]
        if ax != 0.0 or ay != 0.0:
            out[i, 0, 2] = wrap_angle(math.atan2(ay, ax) + 0.5 * turn_at(poses, i))
        for k in range(2, wide):
            out[i, k, 2] += step * (k // 2) * (1.0 if k % 2 == 0 else -1.0)
    return out


@kernel
def route_price(kind, radius, poses, limit, field, walls):
    """Return the cost of a route, shape (N, 3); inf if above `limit` or not free.

    The first pose must be free.
    """
    total = 0.0
    for k in range(poses.shape[0] - 1):
        total += motion_integral(
            kind, radius, poses[k, 0], poses[k, 1], poses[k, 2],
            poses[k + 1, 0], poses[k + 1, 1], poses[k + 1, 2], *field,
        )  # fmt: skip
        if not total <= limit:
            return np.inf
    for k in range(poses.shape[0] - 1):
        if not motion_free(
            kind, radius, poses[k, 0], poses[k, 1], poses[k, 2],
            poses[k + 1, 0], poses[k + 1, 1], poses[k + 1, 2], *walls,
        ):  # fmt: skip
            return np.inf
    return total


@kernel
def cheapest_chain(kind, radius, candidates, first, least, field, walls):
    """Find the cheapest free chain of motions from the first station to the last.

    Dynamic programming: a chain takes one candidate of each station that it stops at.

    Args:
        kind: Kind of motion.
        radius: Turning radius, metres.
        candidates: float64, shape (N, K, 3).
        first: int64, shape (N,): the earliest station from which a motion leads to station j.
        least: Lower bound of the cost of a metre.
        field: Field arguments of `motion_integral`.
        walls: Wall arguments of `motion_free`.

    Returns:
        The chain, float64, shape (M, 3), and its cost, metres-equivalent, with `PER_MOTION` for
        each motion; inf and an empty chain if there is none.
    """
    count, wide, _ = candidates.shape
    cost = np.full((count, wide), np.inf)
    before = np.full((count, wide), -1, dtype=np.int64)
    cost[0, 0] = 0.0
    for j in range(1, count):
        for b in range(1 if j == count - 1 else wide):
            x1, y1, t1 = candidates[j, b, 0], candidates[j, b, 1], candidates[j, b, 2]
            best, origin = np.inf, -1
            for i in range(first[j], j):
                for a in range(wide):
                    base = cost[i, a] + PER_MOTION
                    if not base < best:
                        continue
                    x0, y0, t0 = candidates[i, a, 0], candidates[i, a, 1], candidates[i, a, 2]
                    if base + least * math.hypot(x1 - x0, y1 - y0) >= best:
                        continue
                    total = base + motion_integral(kind, radius, x0, y0, t0, x1, y1, t1, *field)
                    if total < best and motion_free(kind, radius, x0, y0, t0, x1, y1, t1, *walls):
                        best, origin = total, i * wide + a
            cost[j, b] = best
            before[j, b] = origin
    if not math.isfinite(cost[count - 1, 0]):
        return np.empty((0, 3)), np.inf
    size, node = 1, (count - 1) * wide
    while node > 0:
        node = before[node // wide, node % wide]
        size += 1
    chain = np.empty((size, 3))
    node = (count - 1) * wide
    for k in range(size - 1, -1, -1):
        put(candidates[node // wide, node % wide], chain, k)
        node = before[node // wide, node % wide]
    return chain, cost[count - 1, 0]
