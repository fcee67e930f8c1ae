"""Goals shared by the episodes in a building, with their costs to go, which are slow to compute."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ambinav.localization.random import states, uniform
from ambinav.runtime.array_types import Floats, Floats32, UInts
from ambinav.runtime.errors import InputError
from ambinav_envs.buildings.doors import close_door, shortest_path
from ambinav_envs.buildings.free_space import MARGIN, FreeSpaceArrays, FreeSpaceLattice
from ambinav_envs.buildings.tasks import (
    CostToGo,
    Task,
    draw_places,
    draw_task,
    path_length,
    spread_from,
    start_for,
)

FEWEST, MOST = 32, 256
"""Number of goals of a building."""
# Bytes that the distances to all goals of a building may take, but for the fewest. Directions take
# a quarter more, and costs with their directions as much as both.
_MEMORY = 2_000_000
# Number of shared goals tried before a goal is drawn from anywhere.
_TRIES = 8
# How many tasks are drawn until there is one that the world has room for, where it is not the map.
_IN_WORLD = 64


@dataclass(frozen=True, eq=False)
class _Goal:
    """A goal: distances to it, and the data that `Task` holds; see `spread_from` for the label.

    `lengths` and `label` are the map's, `true_lengths` the world's.
    """

    place: Floats
    lengths: Floats32
    true_lengths: Floats32
    cost_to_go: CostToGo
    label: int


class Goals:
    """A fixed set of goal points of a building, the same in every process.

    The cost to go of each is computed when it is first drawn, and kept.

    Where the world is not as the map says (`world.World`), tasks are drawn on the map until both
    ends are free in the world and a path joins them there. Distances and costs are the world's,
    the directions that robots are led in are the map's.

    Args:
        lattice: Lattice of the map.
        prices: What a metre costs, see `geodesic`: robots are led along the cheapest path; None:
            along the shortest one.
        world: Lattice of the world, with the same cells; None: that of the map.
    """

    def __init__(
        self,
        lattice: FreeSpaceLattice,
        prices: Floats32 | None = None,
        world: FreeSpaceLattice | None = None,
    ) -> None:
        self._lattice = lattice
        self._world = lattice if world is None else world
        self._priced = self._true_priced = None
        if prices is not None:
            self._priced = lattice.table._replace(prices=prices)
            self._true_priced = self._world.table._replace(prices=prices)
        self._goals: dict[int, _Goal] = {}
        count = min(max(_MEMORY // (4 * lattice.room.size), FEWEST), MOST)
        self._points = np.empty((count if len(lattice.standing) else 0, 2))
        state = states(np.random.Generator(np.random.PCG64(0)), 1)[0]
        draw_places(state, lattice.table, self._points)

    def draw(self, state: UInts, shortest: float, longest: float) -> Task:
        """Draw one of the goals, and a start as `draw_task` does.

        If there is no start for those drawn, the goal is drawn from anywhere. See `draw_task` for
        the arguments and errors.
        """
        task = np.empty(6)
        for _ in range(_TRIES if 0.0 <= shortest < longest and len(self._points) else 0):
            goal = self._goal(int(uniform(state) * len(self._points)))
            if goal.label >= 0:
                has_start, _, _ = start_for(
                    state, float(shortest), float(longest), goal.label, self._lattice.table,
                    goal.lengths, task,
                )  # fmt: skip
                if has_start:
                    drawn = self._along(
                        task[:3], goal.place, float(task[5]), goal.cost_to_go, goal.true_lengths
                    )
                    if drawn is not None:
                        return drawn
        return self.between(state, shortest, longest)

    def between(
        self,
        state: UInts,
        shortest: float,
        longest: float,
        start: ArrayLike | None = None,
        goal: ArrayLike | None = None,
    ) -> Task:
        """Draw a task as `draw_task` does, and compute its cost to go at the prices.

        Raises:
            InputError: see `draw_task`; or what is given, or all that is drawn, is not free or not
                joined in the world.
        """
        for _ in range(_IN_WORLD if start is None or goal is None else 1):
            task = self.towards(
                draw_task(self._lattice, state, shortest, longest, start=start, goal=goal)
            )
            if task is not None:
                return task
        raise InputError(
            f"{self._lattice.name}: the map has a start and a goal, but with walls_std and "
            "furniture_std a wall or a thing stands in the robot's way there; move what is given, "
            "or give less of these."
        )

    def towards(self, task: Task) -> Task | None:
        """Return a task with costs to go at the world's prices, given one with the map's lengths.

        None: the world has no room for it.
        """
        if self._priced is None and self._world is self._lattice:
            return task
        lengths = true_lengths = task.cost_to_go.costs
        if self._world is not self._lattice:
            true_lengths = self._costs_to(task.goal, self._world.table)[0]
        cost_to_go = self._cost_to_go(task.goal, lengths, true_lengths)
        return self._along(task.start, task.goal, task.distance, cost_to_go, true_lengths)

    def close_door(
        self, task: Task, state: UInts, width: float, detour: tuple[float, float]
    ) -> Task | None:
        """Return one of these tasks with a door on its route closed; see `doors.close_door`."""
        world = self._world, self._true_priced
        return close_door(self._lattice, self._priced, world, task, state, width, detour)

    def shortest_path(self, task: Task) -> Floats:
        """Return the map's shortest path of one of these tasks; see `doors.shortest_path`."""
        return shortest_path(self._lattice, self._priced, task)

    def lengths(self, task: Task) -> Floats32:
        """Return the lengths of the map's shortest paths to the goal of one of these tasks."""
        if self._priced is None and self._world is self._lattice:
            return task.cost_to_go.costs
        return self._costs_to(task.goal, self._lattice.table)[0]

    def restarted(self, task: Task, start: Floats) -> Task | None:
        """Return one of these tasks from another start; None: the robot does not fit there.

        Args:
            task: The task.
            start: x, y, theta, shape (3,).
        """
        lengths = self.lengths(task)
        distance = self._lattice.distance(lengths, float(start[0]), float(start[1]))
        checker, pose = self._lattice.checker, start[None] * (1.0, 1.0, 0.0)
        if not (
            np.isfinite(distance)
            and checker.poses_free(pose)[0]
            and checker.clearance(pose)[0] >= MARGIN
        ):
            return None
        if self._world is not self._lattice:
            lengths = self._costs_to(task.goal, self._world.table)[0]
        return self._along(start, task.goal, distance, task.cost_to_go, lengths)

    def _along(
        self,
        start: Floats,
        goal: Floats,
        distance: float,
        cost_to_go: CostToGo,
        true_lengths: Floats32,
    ) -> Task | None:
        """Return a task, or None if its ends are not free or not connected in the world."""
        world, x, y = self._world, float(start[0]), float(start[1])
        cost = distance
        if world is not self._lattice:
            ends = np.array([[x, y, 0.0], [goal[0], goal[1], 0.0]])
            cost = world.distance(true_lengths, x, y)
            distance = path_length(world, start[:2], goal, cost)
            checker = world.checker
            if not (
                np.isfinite(distance)
                and checker.poses_free(ends).all()
                and (checker.clearance(ends) >= MARGIN).all()
            ):
                return None
        if self._priced is not None:
            cost = world.distance(cost_to_go.costs, x, y)
        return Task(start, goal, distance, cost_to_go, cost)

    def _goal(self, which: int) -> _Goal:
        """Return the goal with this number."""
        if which not in self._goals:
            place = self._points[which].copy()
            table = self._lattice.table
            lengths, label = self._costs_to(place, table)
            true_lengths = lengths
            if self._world is not self._lattice:
                true_lengths = self._costs_to(place, self._world.table)[0]
            cost_to_go = self._cost_to_go(place, lengths, true_lengths)
            self._goals[which] = _Goal(place, lengths, true_lengths, cost_to_go, label)
        return self._goals[which]

    def _cost_to_go(self, place: Floats, lengths: Floats32, true_lengths: Floats32) -> CostToGo:
        """Combine costs in the world with directions on the map, given the lengths of both."""
        table, true_costs = self._lattice.table, true_lengths
        if self._priced is not None and self._true_priced is not None:
            table, lengths = self._priced, self._costs_to(place, self._priced)[0]
            true_costs = lengths
            if self._world is not self._lattice:
                true_costs = self._costs_to(place, self._true_priced)[0]
        cost_to_go = CostToGo.of(lengths, table)
        return cost_to_go if true_costs is lengths else cost_to_go._replace(costs=true_costs)

    def _costs_to(self, place: Floats, table: FreeSpaceArrays) -> tuple[Floats32, int]:
        """Return the costs to a point at the prices of a table, and the point's label."""
        costs = np.empty(self._lattice.room.shape, dtype=np.float32)
        return costs, int(spread_from(place[0], place[1], table, costs))
