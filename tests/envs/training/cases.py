"""Trainings so small that they take a second."""

from __future__ import annotations

from typing import Any

from ambinav_envs.training.config import Training
from ambinav_envs.training.config_file import parse_config

TINY: dict[str, Any] = {
    "steps": 512,
    "seed": 3,
    "envs": 8,
    "threads": 1,
    "log": 256,
    "environment": {
        "id": "ambinav/Hall-v1", "buildings": 2, "longest": 8.0, "max_steps": 30, "window": False,
    },
    "evaluation": {
        "episodes": 4, "every": 256, "environment": {"first_building": 2, "buildings": 1},
    },
    "checkpoints": {"every": 100_000, "keep": 2},
    "policy": {"net_arch": [16], "scan_features": 8, "scan": "dense"},
    "hyperparameters": {"n_steps": 32, "batch_size": 64, "n_epochs": 2},
}  # fmt: skip
SAC: dict[str, Any] = {
    "algorithm": "sac",
    "hyperparameters": {
        "buffer_size": 2048, "learning_starts": 100, "batch_size": 32, "gradient_steps": 1,
    },
}  # fmt: skip
RECURRENT: dict[str, Any] = {
    "algorithm": "recurrent-ppo",
    "policy": {"net_arch": [16], "scan_features": 8, "lstm_hidden_size": 8},
}
CORRECTED: dict[str, Any] = {
    "base": "vfh",
    "environment": {**TINY["environment"], "waypoint": True, "waypoint_distance": 1.0},
}


def tiny(**other: Any) -> Training:
    """A configuration of two rounds or so."""
    return parse_config(TINY | other, "tiny.yaml")
