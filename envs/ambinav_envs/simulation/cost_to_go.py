"""Costs to go of the goals that robots in one building drive to, in arrays that kernels index."""

from __future__ import annotations

import numpy as np

from ambinav_envs.buildings.tasks import CostToGo


class CostToGoTable:
    """One slot for each goal that robots in a building drive to.

    Robots with the same goal share its slot, and a slot is used again when none has its goal.

    Args:
        shape: Rows and columns of the lattice.

    Attributes:
        arrays: `CostToGo` of all slots, shape (slots, rows, columns); others when it has grown.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.arrays = _slots(1, shape)
        self._free = [0]
        # By the identity of what a task holds, which the second dictionary keeps alive.
        self._slot: dict[int, int] = {}
        self._held: dict[int, CostToGo] = {}
        self._robots: dict[int, int] = {}

    def hold(self, goal: CostToGo) -> int:
        """The slot of a robot's goal; `release` it when the robot has another one."""
        slot = self._slot.get(id(goal))
        if slot is None:
            if not self._free:
                self._grow()
            slot = self._free.pop()
            self._slot[id(goal)], self._held[slot], self._robots[slot] = slot, goal, 0
            self.arrays.costs[slot], self.arrays.towards[slot] = goal.costs, goal.towards
        self._robots[slot] += 1
        return slot

    def release(self, slot: int) -> None:
        """Say that a robot no longer drives to the goal in a slot."""
        self._robots[slot] -= 1
        if not self._robots[slot]:
            del self._slot[id(self._held.pop(slot))], self._robots[slot]
            self._free.append(slot)

    def _grow(self) -> None:
        """Make twice as many slots."""
        before = self.arrays
        count, *shape = before.costs.shape
        self.arrays = _slots(2 * count, tuple(shape))
        self.arrays.costs[:count], self.arrays.towards[:count] = before.costs, before.towards
        self._free.extend(range(2 * count - 1, count - 1, -1))


def _slots(count: int, shape: tuple[int, ...]) -> CostToGo:
    return CostToGo(
        np.empty((count, *shape), dtype=np.float32), np.empty((count, *shape), dtype=np.int8)
    )
