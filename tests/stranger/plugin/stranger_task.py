"""A task: begin with the back to the wall, and stop at the goal instead of driving over it."""

import numpy as np

from ambinav_envs.plugin import EpisodeEnd, TaskSpec


def from_the_wall(context):
    """A start half a metre off the building's left side, facing right; the goal is drawn."""
    xmin, ymin, _, ymax = context.environment.bounds
    for y in context.rng.uniform(ymin, ymax, 100):
        if context.fits(xmin + 0.5, y):
            return (xmin + 0.5, y, 0.0), None
    raise ValueError("there is no room at the left side")


def who_stands(stepped, ends):
    """Arrived is who is there and hardly moves; whoever moves has not ended."""
    moves = np.abs(stepped.seen.speeds[:, 0]) > 0.25
    return np.where((ends == EpisodeEnd.ARRIVED) & moves, EpisodeEnd.RUNNING, ends)


TASK = TaskSpec(
    name="stranger/Parking-v0",
    about="Drive off the wall, and be slow at the goal.",
    arguments={"suite": "stranger-closets", "buildings": 8, "localizer": "odometry"},
    draw=from_the_wall,
    judge=who_stands,
)
