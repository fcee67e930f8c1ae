"""Milestones for the roadmap: free poses, half of them moved to narrow parts of the free space."""

from __future__ import annotations

from typing import Any

import numpy as np
from ompl import base as ob
from scipy.ndimage import maximum_filter

from ambinav.runtime.array_types import Floats
from ambinav_planners.floor import clearances
from ambinav_planners.problem import Problem
from ambinav_planners.spaces import has_heading

# Radius in which the widest point is searched to measure narrowness, metres.
AROUND = 0.5
# Room to spare, metres, from which on a place is no longer called narrow.
ROOM = 0.1
BLOCK = 4096


class FreeSampler(ob.ValidStateSampler):
    """Draws free poses from the map's cells, in blocks that are checked together.

    Uniform samples find a door with probability proportional to its area. Half of these are drawn
    with a weight of 1 / (room + 0.1 m)^2 instead, the room being what the widest place within
    half a metre leaves to the footprint's inner disc (in the spirit of the bridge test of Hsu,
    Jiang, Reif and Sun 2003, which OMPL has but does not offer to Python). The other half keeps
    the roadmap dense everywhere, as its optimality needs.

    Args:
        si: OMPL's space information.
        problem: The planning problem.
        rng: Random generator.

    Attributes:
        failed: Blocks without a free pose since the last that had one.
    """

    def __init__(self, si: ob.SpaceInformation, problem: Problem, rng: np.random.Generator) -> None:
        super().__init__(si)
        self._with_heading = has_heading(si.getStateSpace())
        self._checker = problem.checker
        self._rng = rng
        amap = problem.service.map
        self._spacing = amap.spacing
        clearance = clearances(amap)
        inner = problem.checker.footprint.inner
        # A cell whose centre is not free for the robot may contain free poses.
        near = clearance > max(inner - amap.spacing, 0.0)
        rows, columns = np.nonzero(near)
        size = 2 * max(round(AROUND / amap.spacing), 1) + 1
        room = np.maximum(maximum_filter(clearance, size=size) - inner, 0.0)[rows, columns]
        narrow = 1.0 / (room + ROOM) ** 2
        self._odds = 0.5 / max(len(rows), 1) + 0.5 * narrow / narrow.sum()
        self._x = amap.dataset["x"].values[columns]
        self._y = amap.dataset["y"].values[rows]
        self._drawn: list[tuple[float, float, float]] = []
        self.failed = 0

    def sample(self, state: Any) -> bool:
        """Write the next free pose into a state."""
        if not self._drawn and not self._draw():
            return False
        x, y, theta = self._drawn.pop()
        if self._with_heading:
            state.setX(x)
            state.setY(y)
            state.setYaw(theta)
        else:
            state[0], state[1] = x, y
        return True

    def sampleNear(self, state: Any, near: Any, distance: float) -> bool:  # noqa: N802
        """Return False without sampling: PRM* does not use it."""
        return False

    def _draw(self) -> bool:
        """Draw a block of free poses; False if all of it was blocked."""
        self.failed += 1
        if not len(self._odds):
            return False
        cells = self._rng.choice(len(self._odds), size=BLOCK, p=self._odds)
        poses: Floats = np.empty((BLOCK, 3))
        within = self._rng.uniform(-0.5, 0.5, size=(BLOCK, 2)) * self._spacing
        poses[:, 0], poses[:, 1] = self._x[cells] + within[:, 0], self._y[cells] + within[:, 1]
        poses[:, 2] = self._rng.uniform(-np.pi, np.pi, size=BLOCK)
        free = poses[self._checker.poses_free(poses)]
        self._drawn = [(x, y, theta) for x, y, theta in free.tolist()]
        if self._drawn:
            self.failed = 0
        return bool(self._drawn)
