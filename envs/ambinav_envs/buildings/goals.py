"""Goals that the episodes in a building share, with their costs to go, which take most time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambinav.localization.random import states, uniform
from ambinav_envs.buildings.free_space import FreeSpaceArrays, FreeSpaceLattice
from ambinav_envs.buildings.tasks import (
    CostToGo,
    Task,
    draw_places,
    draw_task,
    spread_from,
    start_for,
)

FEWEST, MOST = 32, 256
"""How many a building has."""
# Bytes that the distances to all goals of a building may take, but for the fewest. Directions take
# a quarter more, and costs with their directions as much as both.
_MEMORY = 2_000_000
# How many of them are tried before a goal is drawn from anywhere.
_TRIES = 8

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Goal:
    """One of them: distances to it, and what `Task` holds; see `spread_from` for the label."""

    place: Floats
    lengths: NDArray[np.float32]
    cost_to_go: CostToGo
    label: int


class Goals:
    """Some points of a building, the same ones in every process.

    The cost to go of each is computed when it is first drawn, and kept.

    Args:
        lattice: Where the robot fits.
        prices: What a metre costs, see `geodesic`: robots are led along the cheapest path; None:
            along the shortest one.
    """

    def __init__(
        self, lattice: FreeSpaceLattice, prices: NDArray[np.float32] | None = None
    ) -> None:
        self._lattice = lattice
        self._priced = None if prices is None else lattice.table._replace(prices=prices)
        self._known: dict[int, _Goal] = {}
        count = min(max(_MEMORY // (4 * lattice.room.size), FEWEST), MOST)
        self._points = np.empty((count if len(lattice.standing) else 0, 2))
        state = states(np.random.Generator(np.random.PCG64(0)), 1)[0]
        draw_places(state, lattice.table, self._points)

    def draw(self, state: NDArray[np.uint64], shortest: float, longest: float) -> Task:
        """Draw one of them, and a start as `draw_task` does.

        If there is no start for those drawn, the goal is drawn from anywhere. See `draw_task` for
        the arguments and errors.
        """
        task = np.empty(6)
        for _ in range(_TRIES if 0.0 <= shortest < longest and len(self._points) else 0):
            goal = self._goal(int(uniform(state) * len(self._points)))
            if goal.label >= 0:
                found, _, _ = start_for(
                    state, float(shortest), float(longest), goal.label, self._lattice.table,
                    goal.lengths, task,
                )  # fmt: skip
                if found:
                    return self._along(task[:3], goal.place, float(task[5]), goal.cost_to_go)
        return self.towards(draw_task(self._lattice, state, shortest, longest))

    def towards(self, task: Task) -> Task:
        """A task with the cost to go at the prices, from one with distances."""
        if self._priced is None:
            return task
        priced = CostToGo.of(self._costs_to(task.goal, self._priced)[0], self._priced)
        return self._along(task.start, task.goal, task.distance, priced)

    def _along(self, start: Floats, goal: Floats, distance: float, cost_to_go: CostToGo) -> Task:
        cost = distance
        if self._priced is not None:
            cost = self._lattice.distance(cost_to_go.costs, float(start[0]), float(start[1]))
        return Task(start, goal, distance, cost_to_go, cost)

    def _goal(self, which: int) -> _Goal:
        """The goal of this number."""
        if which not in self._known:
            place = self._points[which].copy()
            table = self._lattice.table
            lengths, label = self._costs_to(place, table)
            if self._priced is None:
                found = CostToGo.of(lengths, table)
            else:
                found = CostToGo.of(self._costs_to(place, self._priced)[0], self._priced)
            self._known[which] = _Goal(place, lengths, found, label)
        return self._known[which]

    def _costs_to(self, place: Floats, table: FreeSpaceArrays) -> tuple[NDArray[np.float32], int]:
        """Costs to a point at the prices of a table, and the point's label."""
        costs = np.empty(self._lattice.room.shape, dtype=np.float32)
        return costs, int(spread_from(place[0], place[1], table, costs))
