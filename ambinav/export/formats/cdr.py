"""CDR encoding of ROS 2 messages, and their definitions for MCAP.

Only what `mcap` writes; messages are little-endian, aligned from behind the 4 bytes of the head.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.array_types import Floats

HEAD: Final = b"\x00\x01\x00\x00"
LINE: Final = "=" * 80

_BASE: Final = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular",
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\n"
    "geometry_msgs/Quaternion rotation",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance",
    "geometry_msgs/PoseWithCovarianceStamped": "std_msgs/Header header\n"
    "geometry_msgs/PoseWithCovariance pose",
    "geometry_msgs/TransformStamped": "std_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/Transform transform",
    "nav_msgs/MapMetaData": "builtin_interfaces/Time map_load_time\nfloat32 resolution\n"
    "uint32 width\nuint32 height\ngeometry_msgs/Pose origin",
    "nav_msgs/OccupancyGrid": "std_msgs/Header header\nnav_msgs/MapMetaData info\nint8[] data",
    "nav_msgs/Path": "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses",
    "nav_msgs/Odometry": "std_msgs/Header header\nstring child_frame_id\n"
    "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms",
}

Pose = Sequence[float]


def definition(name: str) -> str:
    """Return a message's definition with those of nested messages, as rosbag2 writes them.

    Args:
        name: "nav_msgs/Path", without "msg".
    """
    types = [name]
    for each in types:
        for line in _BASE[each].splitlines():
            inner = line.split()[0].split("[")[0]
            if inner in _BASE and inner not in types:
                types.append(inner)
    parts = [_BASE[name], *(f"{LINE}\nMSG: {each}\n{_BASE[each]}" for each in types[1:])]
    return "\n".join(parts) + "\n"


class Message:
    """Bytes of one message, appended field by field."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def encoded(self) -> bytes:
        """Return header and fields as bytes."""
        return HEAD + bytes(self._bytes)

    def number(self, code: str, *values: float) -> Message:
        """Append numbers of one type: "i" int32, "I" uint32, "f" float32, "d" float64."""
        size = struct.calcsize(code)
        self._bytes += bytes(-len(self._bytes) % size)
        self._bytes += struct.pack(f"<{len(values)}{code}", *values)
        return self

    def text(self, value: str) -> Message:
        """Append a string: its length with the closing zero, then both."""
        plain = value.encode("utf-8") + b"\x00"
        self.number("I", len(plain))
        self._bytes += plain
        return self

    def small(self, values: NDArray[np.int8]) -> Message:
        """Append a sequence of int8."""
        self.number("I", values.size)
        self._bytes += np.ascontiguousarray(values, dtype=np.int8).tobytes()
        return self

    def header(self, seconds: float, frame: str) -> Message:
        """Append a std_msgs/Header."""
        return self.stamp(seconds).text(frame)

    def stamp(self, seconds: float) -> Message:
        """Append a builtin_interfaces/Time."""
        full_seconds, nanoseconds = divmod(round(seconds * 1e9), 1_000_000_000)
        return self.number("i", full_seconds).number("I", nanoseconds)

    def pose(self, pose: Pose) -> Message:
        """Append a geometry_msgs/Pose (or Transform, with the same fields) of x, y, theta."""
        x, y, theta = pose
        turn = (0.0, 0.0, math.sin(theta / 2.0), math.cos(theta / 2.0))
        return self.number("d", x, y, 0.0, *turn)

    def covariance(self, of_pose: Floats | None) -> Message:
        """Append the 36 numbers of a covariance of x, y, theta, shape (3, 3); None: all 0."""
        full = np.zeros((6, 6))
        if of_pose is not None:
            full[np.ix_((0, 1, 5), (0, 1, 5))] = of_pose
        return self.number("d", *full.ravel().tolist())


def occupancy_grid(
    seconds: float, values: NDArray[np.int8], x: float, y: float, resolution: float, frame: str
) -> bytes:
    """Encode a nav_msgs/OccupancyGrid of int8 (ny, nx), row 0 lowest; x, y its lower corner."""
    rows, columns = values.shape
    message = Message().header(seconds, frame).stamp(seconds)
    message.number("f", resolution).number("I", columns, rows).pose((x, y, 0.0))
    return message.small(values.ravel()).encoded()


def path(seconds: float, poses: Floats, stamps: Floats, frame: str) -> bytes:
    """Encode a nav_msgs/Path of poses (N, 3), stamped (N,) seconds after the path itself."""
    message = Message().header(seconds, frame).number("I", len(poses))
    for pose, stamp in zip(poses.tolist(), stamps.tolist(), strict=True):
        message.header(seconds + stamp, frame).pose(pose)
    return message.encoded()


def pose_stamped(seconds: float, pose: Pose, frame: str) -> bytes:
    """Encode a geometry_msgs/PoseStamped."""
    return Message().header(seconds, frame).pose(pose).encoded()


def pose_with_covariance(seconds: float, pose: Pose, covariance: Floats, frame: str) -> bytes:
    """Encode a geometry_msgs/PoseWithCovarianceStamped."""
    return Message().header(seconds, frame).pose(pose).covariance(covariance).encoded()


def odometry(seconds: float, pose: Pose, frame: str, child: str) -> bytes:
    """Encode a nav_msgs/Odometry without speeds."""
    message = Message().header(seconds, frame).text(child).pose(pose).covariance(None)
    return message.number("d", *[0.0] * 6).covariance(None).encoded()


def transforms(seconds: float, placed: Sequence[tuple[Pose, str]], frame: str) -> bytes:
    """Encode a tf2_msgs/TFMessage of frames: of each its pose in `frame`, and its name."""
    message = Message().number("I", len(placed))
    for pose, child in placed:
        message.header(seconds, frame).text(child).pose(pose)
    return message.encoded()
