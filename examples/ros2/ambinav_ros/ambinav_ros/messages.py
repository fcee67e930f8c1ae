"""Plain dataclasses in the shapes of ROS 2 messages, for loops that run without ROS.

Only the messages that a policy takes and gives. Fields, names and units are those of
`builtin_interfaces`, `std_msgs`, `geometry_msgs`, `nav_msgs` and `sensor_msgs`; `policy_loop.py`
reads both these and the real ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

PLANAR = np.ix_((0, 1, 5), (0, 1, 5))
"""x, y and yaw of the 6 by 6 covariances of geometry_msgs."""


@dataclass
class Time:
    """builtin_interfaces/Time."""

    sec: int = 0
    nanosec: int = 0


@dataclass
class Header:
    """std_msgs/Header."""

    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Vector3:
    """geometry_msgs/Vector3, and Point."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass
class Quaternion:
    """geometry_msgs/Quaternion."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


@dataclass
class Pose:
    """geometry_msgs/Pose: metres."""

    position: Vector3 = field(default_factory=Vector3)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass
class PoseWithCovariance:
    """geometry_msgs/PoseWithCovariance: row after row of x, y, z, roll, pitch, yaw."""

    pose: Pose = field(default_factory=Pose)
    covariance: Sequence[float] = (0.0,) * 36


@dataclass
class PoseWithCovarianceStamped:
    """geometry_msgs/PoseWithCovarianceStamped, as AMCL publishes it."""

    header: Header = field(default_factory=Header)
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)


@dataclass
class Twist:
    """geometry_msgs/Twist: m/s and rad/s in the robot's frame."""

    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@dataclass
class TwistWithCovariance:
    """geometry_msgs/TwistWithCovariance."""

    twist: Twist = field(default_factory=Twist)
    covariance: Sequence[float] = (0.0,) * 36


@dataclass
class Odometry:
    """nav_msgs/Odometry: the pose in `odom`, the twist in `base_link`."""

    header: Header = field(default_factory=Header)
    child_frame_id: str = "base_link"
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


@dataclass
class LaserScan:
    """sensor_msgs/LaserScan: radians, seconds and metres; inf no echo, -inf too near (REP 117)."""

    header: Header = field(default_factory=Header)
    angle_min: float = 0.0
    angle_max: float = 0.0
    angle_increment: float = 0.0
    time_increment: float = 0.0
    scan_time: float = 0.0
    range_min: float = 0.0
    range_max: float = 0.0
    ranges: Sequence[float] | NDArray[np.float32] = ()
    intensities: Sequence[float] = ()


def stamp(seconds: float) -> Time:
    """A point in time."""
    nanoseconds = round(1e9 * seconds)
    return Time(nanoseconds // 10**9, nanoseconds % 10**9)


def pose_message(
    seconds: float, pose: ArrayLike, covariance: ArrayLike
) -> PoseWithCovarianceStamped:
    """An estimated pose.

    Args:
        seconds: When.
        pose: x, y (metres) and theta (radians), map frame.
        covariance: Of these, shape (3, 3).
    """
    x, y, theta = np.asarray(pose, dtype=np.float64).tolist()
    whole = np.zeros((6, 6))
    whole[PLANAR] = covariance
    turned = Quaternion(z=math.sin(0.5 * theta), w=math.cos(0.5 * theta))
    estimate = PoseWithCovariance(Pose(Vector3(x, y), turned), whole.ravel().tolist())
    return PoseWithCovarianceStamped(Header(stamp(seconds), "map"), estimate)


def odometry_message(seconds: float, speed: float, turn_rate: float) -> Odometry:
    """Measured speeds, m/s and rad/s; nothing is told of the pose."""
    twist = Twist(Vector3(float(speed)), Vector3(z=float(turn_rate)))
    return Odometry(Header(stamp(seconds), "odom"), twist=TwistWithCovariance(twist))


def scan_message(
    seconds: float, ranges: ArrayLike, angles: ArrayLike, range_min: float, range_max: float
) -> LaserScan:
    """A scan whose readings are evenly apart.

    Args:
        seconds: When.
        ranges: Metres, inf no echo, -inf too near, shape (B,).
        angles: Of the beams in the robot's frame, radians, rising evenly, shape (B,).
        range_min: Metres.
        range_max: Metres.
    """
    directions = np.asarray(angles, dtype=np.float64)
    return LaserScan(
        Header(stamp(seconds), "base_link"), float(directions[0]), float(directions[-1]),
        float(directions[1] - directions[0]), range_min=range_min, range_max=range_max,
        ranges=np.asarray(ranges, dtype=np.float32),
    )  # fmt: skip
