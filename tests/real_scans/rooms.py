"""Rooms of straight walls, and logs of exact scans taken in them."""

from __future__ import annotations

import math

import numpy as np
import shapely

import ambinav as an
from ambinav.geometry.environment import Environment
from ambinav.logs.log import Log

CORRIDOR = shapely.Polygon([(0, 0), (24, 0), (24, 5), (21, 5), (21, 2), (0, 2)])
HALF_TURN = np.linspace(-math.pi / 2, math.pi / 2, 181)


def environment(shape: shapely.Polygon = CORRIDOR) -> Environment:
    return an.environment_from_shapes([shape])


def log_of(
    env: Environment, poses, *, angles=HALF_TURN, noise: float = 0.0, mount=(0, 0, 0)
) -> Log:
    """Exact scans (or with noise) at poses (S, 3) of the robot."""
    poses = np.asarray(poses, dtype=np.float64)
    sensor = an.RangeSensor(max_range=30.0, std=0.02, resolution=0.01)
    x, y, yaw = mount
    mounts = np.column_stack([np.full_like(angles, x), np.full_like(angles, y), angles + yaw])
    scanner = an.RangeScanner.from_mounts(sensor, mounts)
    ranges = scanner.scan(env, *poses.T)
    if noise:
        ranges = ranges + np.random.default_rng(0).normal(0.0, noise, ranges.shape)
    return Log(
        name="walls",
        angles=angles,
        max_range=30.0,
        ranges=ranges.astype(np.float32),
        time=np.arange(len(poses), dtype=np.float64),
        odometry=poses,
        poses=poses,
        mount=mount,
    )


def drive(there: float = 22.0, step: float = 0.4) -> np.ndarray:
    """Along the corridor and back, a little beside the way there."""
    x = np.arange(1.5, there, step)
    out = np.column_stack([x, np.full_like(x, 1.0), np.zeros_like(x)])
    back = np.column_stack([x[::-1] + 0.1, np.full_like(x, 1.2), np.full_like(x, 0.1)])
    return np.concatenate([out, back])
