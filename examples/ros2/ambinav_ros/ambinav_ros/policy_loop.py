"""A policy in the loop of a robot: messages in, a Twist out; no ROS is imported here.

A node subscribes to a scan, odometry and the localizer's pose, gives each message to `PolicyLoop`,
and publishes what `command` gives, once each time step of the policy's training.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ambinav import Environment, InputError, RangeScanner, Robot
from ambinav_envs import PolicyController
from ambinav_ros.conversions import Quaternion, beams_of, directions, readings, yaw_of
from ambinav_ros.messages import PLANAR, Twist, Vector3

LEVEL: Quaternion = (0.0, 0.0, 0.0, 1.0)
"""A scanner that looks ahead and is mounted the right way up."""


class PolicyLoop:
    """The latest messages, and what the policy wants the robot to do about them.

    Args:
        policy: Of a file, or the name of a reactive baseline.
        environment: The building of the map.
        scanner: Whose beams the policy was trained with; the scan may have more.
        robot: Its limits.
        start: x, y (metres) where the robot has room and begins, and its heading, map frame.
        goal: x and y, map frame.
        rate: Time steps a second; None: those of the policy's training.
        timeout: Seconds after which a message is too old to drive by.
        mounted: Rotation of the scanner's frame in the robot's, as tf has it.

    Attributes:
        dt: Time step, seconds: the period in which to ask for commands.

    Raises:
        InputError: the policy does not fit the scanner, or start or goal has no room.
    """

    def __init__(
        self,
        policy: str,
        environment: Environment,
        scanner: RangeScanner,
        robot: Robot,
        start: tuple[float, float, float],
        goal: tuple[float, float],
        *,
        rate: float | None = None,
        timeout: float = 0.5,
        mounted: Quaternion = LEVEL,
    ) -> None:
        self._controller = PolicyController(
            policy, Path(), start, goal, environment, scanner, robot, rate, 1
        )
        self.dt = self._controller.dt
        self._scanner, self._timeout, self._mounted = scanner, timeout, mounted
        self._ranges, self._speeds = np.zeros((1, scanner.beams), np.float32), np.zeros((1, 2))
        self._pose, self._covariance = np.zeros((1, 3)), np.zeros((1, 3, 3))
        self._heard: dict[str, float] = {}

    def on_scan(self, message: Any) -> None:
        """Take a sensor_msgs/LaserScan.

        A reading that failed (nan, 0) counts as no echo, as the sensor's model has a lost one.

        Raises:
            InputError: the scan does not reach where a beam of the scanner looks.
        """
        step, count = message.angle_increment, len(message.ranges)
        towards = directions(message.angle_min, step, count, self._mounted)
        reached = ~np.isnan(beams_of(self._scanner, np.ones(count), towards, step))
        if not reached.all():
            raise InputError(
                f"scan: {count} readings from {message.angle_min:g} rad in steps of {step:g} leave "
                f"out {np.count_nonzero(~reached)} of the policy's {self._scanner.beams} beams; "
                "give a scan that covers them, or a policy trained with this scanner."
            )
        ranges = readings(message.ranges, message.range_min, message.range_max)
        seen = beams_of(self._scanner, ranges, towards, step)
        self._ranges[0] = np.where(np.isnan(seen), np.inf, seen)
        self._note("scan", message)

    def on_odometry(self, message: Any) -> None:
        """Take a nav_msgs/Odometry: its twist, not its pose."""
        twist = message.twist.twist
        self._speeds[0] = _finite("odometry", [twist.linear.x, twist.angular.z])
        self._note("odometry", message)

    def on_pose(self, message: Any) -> None:
        """Take a geometry_msgs/PoseWithCovarianceStamped in the map's frame, as of AMCL.

        Raises:
            InputError: a number is not finite, or the orientation is no rotation.
        """
        pose, q = message.pose.pose, message.pose.pose.orientation
        yaw = yaw_of((q.x, q.y, q.z, q.w))
        self._pose[0] = _finite("pose", [pose.position.x, pose.position.y, yaw])
        whole = np.asarray(message.pose.covariance, dtype=np.float64)
        if whole.size != 36:
            raise InputError(f"pose.covariance: {whole.size} numbers; give 36, row after row.")
        self._covariance[0] = _finite("pose.covariance", whole.reshape(6, 6)[PLANAR])
        self._note("pose", message)

    def waiting_for(self, now: float) -> tuple[str, ...]:
        """Which messages have not come, or are too old, at a time in seconds.

        A stamp so far ahead is of another clock, and would never become too old.
        """
        names = ("scan", "odometry", "pose")
        return tuple(
            name for name in names if not abs(now - self._heard.get(name, np.inf)) <= self._timeout
        )

    def command(self, now: float) -> Twist:
        """What to do for the next time step; to stand where a message is missing or too old.

        Args:
            now: Seconds, on the clock of the messages' stamps.
        """
        if self.waiting_for(now):
            return Twist()
        speed, turn_rate = self._controller.command(
            self._pose, self._covariance, self._speeds, self._ranges
        )[0]
        return Twist(Vector3(float(speed)), Vector3(z=float(turn_rate)))

    def _note(self, name: str, message: Any) -> None:
        stamp = message.header.stamp
        self._heard[name] = stamp.sec + 1e-9 * stamp.nanosec


def _finite(what: str, values: Any) -> Any:
    if not np.isfinite(values).all():
        raise InputError(f"{what}: {np.asarray(values).tolist()} is not finite; check the sender.")
    return values
