"""Goals that the episodes in a building share, and the ways to them, which take the most time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambinav.localization.random import states, uniform
from ambinav_envs.buildings.free_space import Places, PlaceTable
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
# Bytes that the lengths of the shortest ways to all goals of a building may take, but for the
# fewest. Where they lead takes a quarter more, and other ways as much as both.
_MEMORY = 2_000_000
# How many of them are tried before a goal is drawn from anywhere.
_TRIES = 8

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Goal:
    """One of them: lengths of the shortest ways to it, and the way to take.

    See `Task`, and `spread_from` for the label.
    """

    place: Floats
    lengths: NDArray[np.float32]
    way: CostToGo
    label: int


class Goals:
    """Some places of a building, the same ones in every process.

    The ways to each are worked out when it is first drawn, and kept.

    Args:
        places: Where the robot fits.
        prices: What a metre costs, see `geodesic`: the cheapest way is the one to take; None:
            the shortest one.
    """

    def __init__(self, places: Places, prices: NDArray[np.float32] | None = None) -> None:
        self._places = places
        self._priced = None if prices is None else places.table._replace(prices=prices)
        self._known: dict[int, _Goal] = {}
        count = min(max(_MEMORY // (4 * places.room.size), FEWEST), MOST)
        self._points = np.empty((count if len(places.standing) else 0, 2))
        state = states(np.random.Generator(np.random.PCG64(0)), 1)[0]
        draw_places(state, places.table, self._points)

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
                    state, float(shortest), float(longest), goal.label, self._places.table,
                    goal.lengths, task,
                )  # fmt: skip
                if found:
                    return self._along(task[:3], goal.place, float(task[5]), goal.way)
        return self.towards(draw_task(self._places, state, shortest, longest))

    def towards(self, task: Task) -> Task:
        """A task with the way to take; it is given with the shortest one."""
        if self._priced is None:
            return task
        way = CostToGo.of(self._costs_to(task.goal, self._priced)[0], self._priced)
        return self._along(task.start, task.goal, task.distance, way)

    def _along(self, start: Floats, goal: Floats, distance: float, way: CostToGo) -> Task:
        cost = distance
        if self._priced is not None:
            cost = self._places.distance(way.costs, float(start[0]), float(start[1]))
        return Task(start, goal, distance, way, cost)

    def _goal(self, which: int) -> _Goal:
        """The goal of this number."""
        if which not in self._known:
            place = self._points[which].copy()
            table = self._places.table
            lengths, label = self._costs_to(place, table)
            if self._priced is None:
                way = CostToGo.of(lengths, table)
            else:
                way = CostToGo.of(self._costs_to(place, self._priced)[0], self._priced)
            self._known[which] = _Goal(place, lengths, way, label)
        return self._known[which]

    def _costs_to(self, place: Floats, table: PlaceTable) -> tuple[NDArray[np.float32], int]:
        """What the ways to a place cost at the prices of a table, and the place's label."""
        costs = np.empty(self._places.room.shape, dtype=np.float32)
        return costs, int(spread_from(place[0], place[1], table, costs))
