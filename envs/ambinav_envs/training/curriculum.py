"""The curriculum: paths to the goal become longer during the training."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Final

from ambinav_envs.simulation.simulation import Simulation
from ambinav_envs.training.config import StagePart

RECENT: Final = 200
"""Number of episodes over which a rate of arrival is computed, all of the stage itself;
Stable-Baselines3 keeps them (`stats_window_size`)."""


class Curriculum:
    """The current stage of a training.

    Args:
        stages: In their order; after the last one the environment is as it was made.
        number: Number of the stage, from 0 on.
    """

    def __init__(self, stages: Sequence[StagePart], number: int = 0) -> None:
        self.stages = tuple(stages)
        self.number = number

    def apply(self, simulation: Simulation, longest: float) -> float:
        """Set the path lengths of new episodes to those of the stage.

        Args:
            simulation: Episodes that are going on there go on.
            longest: After the last stage.

        Returns:
            Greatest length of the shortest path from start to goal, metres.
        """
        if self.number < len(self.stages):
            longest = self.stages[self.number].longest
        simulation.parameters = replace(simulation.parameters, longest=longest)
        return longest

    def advance(self, share: float, arrived: Collection[bool]) -> bool:
        """Go to the next stage if the present one is over.

        Args:
            share: Completed share of the training, 0 to 1.
            arrived: Whether each episode since the stage began arrived; the last `RECENT` do.
        """
        if self.number >= len(self.stages):
            return False
        stage = self.stages[self.number]
        has_ended = stage.share is not None and share >= stage.share
        if stage.arrival is not None and len(arrived) >= RECENT:
            has_ended |= sum(list(arrived)[-RECENT:]) >= stage.arrival * RECENT
        self.number += has_ended
        return has_ended
