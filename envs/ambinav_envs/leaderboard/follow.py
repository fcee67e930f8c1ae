"""Route following in the navigation environment: many robots, each with its own route."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambinav.drive.course import Course
from ambinav.drive.follower import pursue
from ambinav.drive.parameters import FollowerParameters
from ambinav.drive.robot import Robot
from ambinav.runtime.array_types import Floats
from ambinav.runtime.kernels import kernel


class Followers:
    """N robots with regulated pure pursuit, controlled as in `ambinav.drive.drive`.

    Args:
        courses: One a robot; None for a robot that stands still.
        robot: The robots.
        parameters: Parameters of the follower.
        dt: Time step, seconds.
    """

    def __init__(
        self,
        courses: Sequence[Course | None],
        robot: Robot,
        parameters: FollowerParameters,
        dt: float,
    ) -> None:
        count = len(courses)
        sizes = [0 if course is None else len(course.points) for course in courses]
        self._first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        total = int(self._first[-1])
        # `directions` and `end` have one entry less than there are points; the last stays unused.
        self._points, self._along = np.zeros((total, 2)), np.zeros(total)
        self._directions, self._end = np.zeros(total), np.zeros(total, dtype=np.int64)
        self._goal = np.zeros((count, 3))
        for i, course in enumerate(courses):
            if course is not None:
                low, high = self._first[i : i + 2].tolist()
                self._points[low:high], self._along[low:high] = course.points, course.along
                self._directions[low : high - 1], self._end[low : high - 1] = (
                    course.directions,
                    course.end,
                )
                self._goal[i] = course.goal
        self._turns = any(course.turns for course in courses if course is not None)
        self._piece, self._stage = np.zeros((2, count), dtype=np.int64)
        self._fixed = (parameters.packed, robot.limits, float(dt))

    def steer(self, belief: Floats, speeds: Floats) -> Floats:
        """Return the commanded speed (m/s) and turn rate (rad/s) of each robot, shape (N, 2).

        Args:
            belief: Poses by which they steer, shape (N, 3), metres and radians, map frame.
            speeds: Speed and turn rate now, shape (N, 2).
        """
        want = np.zeros((len(self._goal), 2))
        _steer(
            belief, speeds, self._first, self._points, self._along, self._directions, self._end,
            self._goal, self._turns, self._piece, self._stage, *self._fixed, want,
        )  # fmt: skip
        return want


@kernel
def _steer(
    belief, speeds, first, points, along, directions, end, goal, turns, piece, stage, p, limits, dt,
    want
):  # fmt: skip
    for i in range(len(goal)):
        low, high = first[i], first[i + 1]
        if high - low < 2:
            continue
        course = points[low:high], along[low:high], directions[low : high - 1], end[low : high - 1]
        want[i, 0], want[i, 1], piece[i], stage[i] = pursue(
            belief[i, 0], belief[i, 1], belief[i, 2], speeds[i, 0], speeds[i, 1], piece[i],
            stage[i], course, (goal[i, 0], goal[i, 1], goal[i, 2]), turns, p, limits, dt,
        )  # fmt: skip
