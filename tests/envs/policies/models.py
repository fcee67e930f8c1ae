"""Small models that the tests of policies share; untrained, which changes nothing here."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.envs.cases import room

pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from ambinav_envs.policies import save_policy
from ambinav_envs.sb3 import make_sb3

NAME = "ambinav/Navigation-v1"
OPTIONS: dict[str, Any] = {"longest": 8.0, "max_steps": 25, "window_cells": 4}


def normalized(**options: Any) -> VecNormalize:
    """Two robots whose observations are normalised by what a few steps showed."""
    envs = VecNormalize(make_sb3(NAME, 2, seed=1, map=room(), **{**OPTIONS, **options}))
    envs.reset()
    for _ in range(5):
        envs.step([envs.action_space.sample() for _ in range(2)])
    return envs


def model(envs: Any, **options: Any) -> PPO:
    """A PPO model with a small network."""
    small = {"net_arch": [8]}
    return PPO(
        "MultiInputPolicy", envs, n_steps=4, batch_size=8, policy_kwargs=small, seed=3, **options
    )


def saved(path: Path, **options: Any) -> Path:
    """A policy file of such a model."""
    envs = normalized(**options)
    environment = {**OPTIONS, **options, "id": NAME}
    save_policy(
        model(envs), path, environment=environment, normalization=envs, notes={"note": "a test"}
    )
    return path
