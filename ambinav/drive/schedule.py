"""Open-loop schedule of a route: the robot's pose over time if it stays on the route."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ambinav.drive.robot import Robot
from ambinav.geometry.motion.steering import Steering
from ambinav.routes.clock import speed_profile
from ambinav.runtime.array_types import Floats


def scheduled(poses: Floats, steering: Steering, robot: Robot, desired: float, dt: float) -> Floats:
    """Return poses at times 0, dt, 2 dt ... of a robot that drives exactly along a route.

    The drive is that of `speed_profile`, but turns on the spot are made at the turn rate at once.
    Between two points of the route, 5 cm apart, the speed is even.

    Args:
        poses: The route, shape (N, 3).
        steering: The kind of motion.
        robot: The robot.
        desired: Speed on a free straight path, metres per second.
        dt: Seconds.

    Returns:
        Shape (T, 3); the last one is the goal.

    Raises:
        InputError: the poses are not usable.
    """
    limits = replace(robot.speed_limits(desired), turn_acceleration=None)
    profile = speed_profile(poses, steering, limits)
    count = int(np.ceil(profile.duration / dt - 1e-9)) + 1
    return profile.at(np.minimum(dt * np.arange(count), profile.duration))
