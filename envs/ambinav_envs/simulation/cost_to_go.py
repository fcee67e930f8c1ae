"""Costs to go of the active goals in one building, in arrays that kernels index."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.array_types import Bytes, Floats32
from ambinav_envs.buildings.free_space import FreeSpaceLattice
from ambinav_envs.buildings.tasks import CostToGo


class GoalArrays(NamedTuple):
    """Costs to go on the lattice of a building, one slot a goal.

    Attributes:
        costs: See `CostToGo`, float32, shape (slots, rows, columns).
        towards: See there, int8, shape (slots, rows, columns).
        links: See `ambinav_envs.buildings.geodesic`, uint8, shape (rows, columns).
        frame: x and y of cell (0, 0), metres, map frame, and cells per metre.
    """

    costs: Floats32
    towards: NDArray[np.int8]
    links: Bytes
    frame: tuple[float, float, float]


class CostToGoTable:
    """One slot for each goal to which robots in a building drive.

    Robots with the same goal share its slot, and a slot is free again when no robot has its goal.

    Attributes:
        arrays: Arrays for the kernels; replaced when slots are added.
    """

    def __init__(self, lattice: FreeSpaceLattice) -> None:
        shape = (1, *lattice.room.shape)
        self.arrays = GoalArrays(
            np.empty(shape, np.float32), np.empty(shape, np.int8), lattice.links, lattice.frame
        )
        self._free = [0]
        self._slot: dict[int, int] = {}
        # The goal of each slot in use; holding it here keeps its id() unique.
        self._goals: dict[int, CostToGo] = {}
        self._robots: dict[int, int] = {}

    def hold(self, goal: CostToGo) -> int:
        """Return the slot of a robot's goal; `release` it when the robot gets another goal."""
        slot = self._slot.get(id(goal))
        if slot is None:
            if not self._free:
                self._grow()
            slot = self._free.pop()
            self._slot[id(goal)], self._goals[slot], self._robots[slot] = slot, goal, 0
            self.arrays.costs[slot], self.arrays.towards[slot] = goal.costs, goal.towards
        self._robots[slot] += 1
        return slot

    def release(self, slot: int) -> None:
        """Note that a robot no longer drives to the goal in a slot."""
        self._robots[slot] -= 1
        if not self._robots[slot]:
            del self._slot[id(self._goals.pop(slot))], self._robots[slot]
            self._free.append(slot)

    def _grow(self) -> None:
        """Double the number of slots."""
        count = len(self.arrays.costs)
        self.arrays = self.arrays._replace(
            costs=np.concatenate([self.arrays.costs, np.empty_like(self.arrays.costs)]),
            towards=np.concatenate([self.arrays.towards, np.empty_like(self.arrays.towards)]),
        )
        self._free.extend(range(2 * count - 1, count - 1, -1))
