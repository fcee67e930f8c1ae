"""Small logs for tests: lines of CARMEN text, and a square room scanned by hand."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ambinav.logs.log import Log


def flaser(ranges, laser=(0.0, 0.0, 0.0), robot=None, time=0.0) -> str:
    robot = laser if robot is None else robot
    words = ["FLASER", len(ranges), *ranges, *laser, *robot, time, "host", time]
    return " ".join(map(str, words))


def robotlaser(
    ranges,
    laser=(0.0, 0.0, 0.0),
    robot=None,
    time=0.0,
    start=-1.0,
    step=0.5,
    top=8.0,
    remissions=(),
) -> str:
    robot = laser if robot is None else robot
    words = ["ROBOTLASER1", 0, start, step * (len(ranges) - 1), step, top, 0.01, 0, len(ranges)]
    words += [*ranges, len(remissions), *remissions, *laser, *robot, 0, 0, 0, 0, 0, time, "h", time]
    return " ".join(map(str, words))


def odom(pose, time=0.0) -> str:
    return " ".join(map(str, ["ODOM", *pose, 0, 0, 0, time, "host", time]))


def write(folder: Path, *lines: str, name: str = "small.log") -> Path:
    path = folder / name
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def room(scans: int = 12, beams: int = 361, side: float = 4.0, mount=(0.1, 0.0, 0.0)) -> Log:
    """Exact scans of half a turn from a drive in the square room from (0, 0) to (side, side)."""
    k = np.arange(scans)
    poses = np.column_stack([1.0 + 1.5 * k / scans, 1.2 + 0.9 * k / scans, 0.3 + 2.0 * k])
    angles = np.linspace(-math.pi / 2, math.pi / 2, beams)
    x = poses[:, 0] + mount[0] * np.cos(poses[:, 2]) - mount[1] * np.sin(poses[:, 2])
    y = poses[:, 1] + mount[0] * np.sin(poses[:, 2]) + mount[1] * np.cos(poses[:, 2])
    bearing = (poses[:, 2] + mount[2])[:, None] + angles
    c, s = np.cos(bearing), np.sin(bearing)
    to_x = np.where(c > 0.0, side - x[:, None], -x[:, None]) / c
    to_y = np.where(s > 0.0, side - y[:, None], -y[:, None]) / s
    return Log(
        name="room",
        angles=angles,
        max_range=8.0,
        ranges=np.minimum(to_x, to_y).astype(np.float32),
        time=0.5 * k,
        odometry=poses + np.column_stack([0.02 * k, -0.01 * k, 0.01 * k]),
        poses=poses,
        mount=mount,
    )
