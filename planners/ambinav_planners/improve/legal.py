"""Improvement of a route that keeps to one-way lanes.

`improve` knows no lanes. Where its result goes against one, the halves of the route are improved on
their own, and theirs; then vertices are moved to the best place around them, from decimetres to
millimetres, as long as no motion goes against a lane.
"""

from __future__ import annotations

import numpy as np

from ambinav.runtime.array_types import Bools, Floats, Indices
from ambinav_planners.improve.route import improve
from ambinav_planners.one_way import OneWayLanes
from ambinav_planners.problem import Problem

SPACING = 1.0
"""Metres from one vertex to the next at most, before they are moved."""
REACHES = (0.5, 0.2, 0.08, 0.03, 0.01, 0.003)
"""Metres by which a vertex is moved at a time."""
ROUNDS = 20
"""Most rounds in which all vertices are moved by each of them."""
ENOUGH = 1e-6
"""Gains below this share of the cost are none."""

_ANGLES = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
_AROUND = np.stack([np.cos(_ANGLES), np.sin(_ANGLES), np.zeros(16)], axis=-1)


def improve_legally(poses: Floats, problem: Problem, lanes: OneWayLanes) -> Floats:
    """Reduce the cost of a route that goes against no lane, and keep it so.

    Args:
        poses: The route, shape (N, 3), of straight motions.
        problem: The planning problem.
        lanes: Its lanes.
    """
    better = improve(poses, problem.service, problem.checker)
    if lanes.allow(better):
        return better
    parts = _improved_parts(poses, problem, lanes)
    return problem.steering.oriented(_Vertices(problem, lanes).settled(parts))


def _improved_parts(poses: Floats, problem: Problem, lanes: OneWayLanes) -> Floats:
    """Improve the halves of a route, and theirs, as far as they go against no lane."""
    if len(poses) < 3:
        return poses
    middle = len(poses) // 2
    parts = []
    for part in (poses[: middle + 1], poses[middle:]):
        better = improve(part, problem.service, problem.checker)
        parts.append(better if lanes.allow(better) else _improved_parts(part, problem, lanes))
    return np.concatenate([parts[0][:-1], parts[1]])


class _Vertices:
    """Moves vertices of a route, every other one at a time."""

    def __init__(self, problem: Problem, lanes: OneWayLanes) -> None:
        self._problem, self._lanes = problem, lanes

    def settled(self, route: Floats) -> Floats:
        """Move all vertices until no move gains, with shorter and shorter moves."""
        route, _, _ = self._problem.steering.dense(route, SPACING)
        for reach in REACHES:
            # Where neither a vertex nor one beside it has moved, there is nothing to try again.
            stale = np.ones(len(route), dtype=np.bool_)
            for turn in range(2 * ROUNDS):
                inner = np.arange(1 + turn % 2, len(route) - 1, 2)
                vertices = inner[stale[inner]]
                if len(vertices):
                    places, needless = self._best(route, vertices, reach)
                    moved = vertices[needless | (places != route[vertices]).any(axis=1)]
                    route[vertices], stale[vertices] = places, False
                    stale[np.concatenate([moved - 1, moved, moved + 1])] = True
                    route = np.delete(route, vertices[needless], axis=0)
                    stale = np.delete(stale, vertices[needless])
                if not stale[1:-1].any():
                    break
        return route

    def _best(self, route: Floats, vertices: Indices, reach: float) -> tuple[Floats, Bools]:
        """Return the best places around some vertices, (K, 3), and which are not needed, (K,)."""
        count = len(_AROUND) + 1
        places = route[vertices, np.newaxis] + reach * np.concatenate([np.zeros((1, 3)), _AROUND])
        flat = places.reshape(-1, 3)
        before, after = (np.repeat(route[vertices + side], count, axis=0) for side in (-1, 1))
        costs = (self._costs(before, flat) + self._costs(flat, after)).reshape(-1, count)
        best, each = costs.argmin(axis=1), np.arange(len(vertices))
        best[~(costs[each, best] < costs[:, 0] * (1.0 - ENOUGH))] = 0
        straight = self._costs(route[vertices - 1], route[vertices + 1])
        return places[each, best], straight <= costs[each, best] * (1.0 + ENOUGH)

    def _costs(self, a: Floats, b: Floats) -> Floats:
        """Return the costs of motions from poses a to b, inf where they must not be made."""
        checker = self._problem.checker
        may = checker.motions_free(a, b) & self._lanes.allowed(a, b)
        return np.where(may, self._problem.service.motion_costs(a, b, checker.steering), np.inf)
