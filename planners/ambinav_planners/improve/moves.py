"""Moves of a flight's points to the best place around them."""

from __future__ import annotations

import math

import numpy as np

from ambinav.geometry.collision.sphere import sphere_free
from ambinav.runtime.kernels import kernel
from ambinav.service.motion import integral_in_space

# Metres by which a point is moved at a time, and how often all are by each of them at most.
REACHES, MOVES = (0.5, 0.2, 0.08, 0.03, 0.01), 20
# Gains below this share of the cost are none.
ENOUGH = 1e-6


@kernel
def settled(points, low, high, field, body):
    """Return a path whose points have been moved until no move gains, or left out.

    Args:
        points: x, y, z, (N, 3), metres; a free path.
        low: Where the points may be at least, (3,), metres.
        high: The same at most.
        field: What `integral_in_space` takes behind the ends.
        body: What `sphere_free` takes behind them.
    """
    path, count = points.copy(), len(points)
    for reach in REACHES:
        for _ in range(MOVES):
            moved = False
            for k in range(count - 2, 0, -1):
                before, here, after = path[k - 1].copy(), path[k].copy(), path[k + 1].copy()
                now = _leg(before, here, field, body) + _leg(here, after, field, body)
                best, place = now, here.copy()
                for side in range(27):
                    step = np.array([side // 9 - 1.0, side // 3 % 3 - 1.0, side % 3 - 1.0])
                    if side == 13:  # no step
                        continue
                    there = here + step * (reach / math.sqrt((step * step).sum()))
                    there = np.minimum(np.maximum(there, low), high)
                    cost = _leg(before, there, field, body)
                    if cost < best:
                        cost += _leg(there, after, field, body)
                    if cost < best * (1.0 - ENOUGH):
                        best, place = cost, there
                if _leg(before, after, field, body) <= best * (1.0 + ENOUGH):
                    path[k : count - 1] = path[k + 1 : count].copy()
                    count -= 1
                elif best < now:
                    path[k], moved = place, True
            if not moved:
                break
    return path[:count]


@kernel
def _leg(a, b, field, body):
    """Return the cost of a straight motion; inf where it is not free."""
    ends = a[0], a[1], a[2], b[0], b[1], b[2]
    return integral_in_space(*ends, *field) if sphere_free(*ends, *body) else math.inf
