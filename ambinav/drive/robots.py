"""True state of the robots of all runs."""

from __future__ import annotations

import numpy as np

from ambinav.drive.course import Course
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.parameters import FollowerParameters
from ambinav.drive.robot import Robot
from ambinav.drive.world import DRIVING, REACHED, report_all, tick, tick_commanded
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.runtime.array_types import Bools, Floats, UInts


class Robots:
    """State of R robots on the same course.

    Args:
        start: Where they all begin, shape (3,): metres and radians, map frame.
        robot: What they are.
        course: What they follow.
        follower: How.
        noise: How their odometry errs.
        checker: Checker of the robot's disc in the world.
        states: States of the random numbers of odometry, shape (R, 4).
        dt: Time step, seconds.
        path: Poses of an open-loop drive, shape (T, 3); None to steer by what they believe.

    Attributes:
        truth: Where they are, shape (R, 3), map frame.
        odometry: What their odometry says, shape (R, 3), from (0, 0, 0) on.
        speeds: Metres and radians per second, shape (R, 2); not kept open loop.
        outcome: DRIVING, REACHED or COLLIDED, int64, shape (R,).
    """

    def __init__(
        self,
        start: Floats,
        robot: Robot,
        course: Course,
        follower: FollowerParameters,
        noise: OdometryNoise,
        checker: CollisionChecker,
        states: UInts,
        dt: float,
        path: Floats | None = None,
    ) -> None:
        runs = len(states)
        self.truth = np.tile(np.asarray(start, dtype=np.float64), (runs, 1))
        self.odometry = np.zeros((runs, 3))
        self.speeds = np.zeros((runs, 2))
        self.outcome = np.full(runs, DRIVING, dtype=np.int64)
        self._piece = np.zeros(runs, dtype=np.int64)
        self._stage = np.zeros(runs, dtype=np.int64)
        self._states = states
        self._path = path
        self._gone = 0
        self._noise = noise.packed
        self._fixed = (
            course.arrays, course.goal, course.turns, follower.packed, robot.limits, float(dt),
            self._noise,
        )  # fmt: skip
        self._fixed_arguments = (
            course.goal, follower.xy_goal_tolerance, robot.limits, float(dt), self._noise,
        )  # fmt: skip
        self._walls = (robot.radius, *checker.arrays[:2])

    def step(self, belief: Floats, want: Floats | None = None) -> Bools:
        """Drive for one time step; return which robots did, bool, shape (R,).

        Args:
            belief: Poses by which they steer, shape (R, 3); not looked at open loop.
            want: Commanded speeds, shape (R, 2), metres and radians per second; None to
                follow the course.
        """
        driving = np.asarray(self.outcome == DRIVING, dtype=np.bool_)
        if self._path is None and want is not None:
            tick_commanded(
                self.truth, self.odometry, belief, self.speeds, self.outcome, want,
                *self._fixed_arguments, self._states, *self._walls,
            )  # fmt: skip
            return np.asarray(driving & (self.outcome != REACHED))
        if self._path is None:
            tick(
                self.truth, self.odometry, belief, self.speeds, self._piece, self._stage,
                self.outcome, *self._fixed, self._states, *self._walls,
            )  # fmt: skip
            return np.asarray(driving & (self.outcome != REACHED))
        self._gone += 1
        if self._gone >= len(self._path):
            self.outcome[:] = REACHED
            return np.zeros_like(driving)
        before = self.truth.copy()
        self.truth[:] = self._path[self._gone]
        report_all(self.odometry, before, self.truth, self._noise, self._states)
        return driving
