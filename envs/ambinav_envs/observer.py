"""Observations of robots that are simulated elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambinav.runtime.array_types import Floats, Floats32
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.normalization import Observation
from ambinav_envs.simulation.simulation import Simulation


class Observer:
    """Makes observations of R robots with one goal in one building.

    Nobody counts steps here, so `remaining` stays 1: no time limit is known.

    Args:
        source: The building.
        parameters: Parameters of observations and robot.
        start: x, y, theta where the robot fits.
        goal: x and y.
        count: R.

    Raises:
        InputError: the robot does not fit at the start or the goal, or there is no path.
    """

    def __init__(
        self,
        source: BuildingSource,
        parameters: NavigationParameters,
        start: Sequence[float],
        goal: Sequence[float],
        count: int,
    ) -> None:
        self._simulation = Simulation(source, parameters, count)
        self._out = self._simulation.outcome()
        generators = [np.random.default_rng(0) for _ in range(count)]
        options = {"start": tuple(start), "goal": tuple(goal)}
        self._simulation.reset(range(count), generators, options, self._out)

    @property
    def distance(self) -> float:
        """Length of the shortest path from start to goal, metres."""
        return float(self._simulation.state["shortest"][0])

    def see(
        self, belief: Floats, covariance: Floats, speeds: Floats, ranges: Floats32
    ) -> Observation:
        """Return observations; the next call overwrites the same arrays.

        Args:
            belief: Estimated poses, shape (R, 3), metres and radians, map frame.
            covariance: Their covariances, shape (R, 3, 3).
            speeds: Speed (m/s) and turn rate (rad/s), shape (R, 2).
            ranges: Readings, shape (R, B), metres: inf no echo, -inf too near.
        """
        state = self._simulation.state
        state["mean"], state["covariance"], state["speeds"] = belief, covariance, speeds
        self._simulation.readings[:] = ranges
        self._simulation.observe(self._out)
        return self._out.observation
