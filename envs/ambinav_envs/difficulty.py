"""Four difficulty levels: how far a robot's world deviates from its map and models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

LEVELS: Final[tuple[Mapping[str, Any], ...]] = (
    {},
    {
        "walls_std": 0.02,
        "furniture_std": 0.1,
        "obstacles": 2,
        "people": 1,
        "odometry_scale": 1.25,
        "pose_latency": 0.2,
        "scan_time": 0.025,
        "gain_std": 0.02,
        "actuation_std": 0.02,
    },
    {
        "walls_std": 0.03,
        "furniture_std": 0.25,
        "obstacles": 4,
        "people": 2,
        "odometry_scale": 1.5,
        "slip": 0.1,
        "pose_latency": 0.2,
        "scan_time": 0.1,
        "gain_std": 0.05,
        "actuation_std": 0.05,
    },
    {
        "walls_std": 0.05,
        "furniture_std": 0.5,
        "obstacles": 6,
        "people": 3,
        "odometry_scale": 2.0,
        "slip": 0.3,
        "pose_latency": 0.4,
        "scan_time": 0.2,
        "gain_std": 0.1,
        "actuation_std": 0.1,
    },
)
"""Settings of each `NavigationParameters.difficulty` where the argument itself is not given.

0 is the world as mapped. 3 has the clutter, people and odometry of the leaderboard's disturbed
settings. Where the values are from: docs/environments.md, "Difficulty".
"""
