"""People get out of the robot's way, walls or not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ambinav.drive.people import KEEP, strolled
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from tests.envs.cases import room

RADIUS, ROBOT, STEP = 0.25, 0.22, 0.1
APART = ROBOT + RADIUS + KEEP


@pytest.mark.parametrize("angle", np.linspace(-3.0, 3.0, 9))
def test_who_is_free_to_walks_straight_away(angle: float) -> None:
    table, bound, _ = CollisionChecker(room(), Footprint.disc(RADIUS), Steering()).arrays
    x, y = 7.0, 6.0
    robot = x - 0.5 * math.cos(angle), y - 0.5 * math.sin(angle)
    got = strolled(x, y, 1.0, *robot, APART, STEP, RADIUS, 2.0, table, bound)
    assert got == pytest.approx((x + STEP * math.cos(angle), y + STEP * math.sin(angle), angle))


@pytest.mark.parametrize("offset", [0.0, 0.1, -0.1])
def test_who_stands_at_a_wall_steps_aside(offset: float) -> None:
    """The robot comes straight at the wall; nobody is run over who could get away."""
    env = room()
    left, low, right, _ = env.bounds
    table, bound, _ = CollisionChecker(env, Footprint.disc(RADIUS), Steering()).arrays
    x, y, t = 0.5 * (left + right), low + RADIUS + 0.01, 0.0
    robot = x + offset, y + 0.75
    for _ in range(40):
        robot = robot[0], max(robot[1] - 0.05, low + ROBOT)
        x, y, t = strolled(x, y, t, *robot, APART, STEP, RADIUS, 2.0, table, bound)
        assert math.hypot(x - robot[0], y - robot[1]) >= ROBOT + RADIUS
