"""The algorithms: a new model, and one loaded from a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.vec_env import VecEnv

from ambinav.runtime.errors import InputError
from ambinav_envs.scenario import source_of
from ambinav_envs.training.config import Training
from ambinav_envs.training.curriculum import RECENT
from ambinav_envs.training.features import NavigationFeatures, looks_around
from ambinav_envs.training.hyperparameters import SCHEDULED
from ambinav_envs.training.schedules import LinearSchedule, schedule_of

SAC_ROUND = 4096
"""Steps between two looks at an algorithm that has no rounds of its own."""


def algorithm_of(name: str) -> type[BaseAlgorithm]:
    """Return the class of an algorithm.

    Raises:
        InputError: its package is missing.
    """
    if name == "ppo":
        return PPO
    if name == "sac":
        return SAC
    try:
        from sb3_contrib import RecurrentPPO
    except ImportError as error:
        raise InputError(
            'recurrent-ppo needs sb3-contrib; run: pip install "ambinav[envs]" sb3-contrib.'
        ) from error
    algorithm: type[BaseAlgorithm] = RecurrentPPO
    return algorithm


def make_model(config: Training, envs: VecEnv) -> BaseAlgorithm:
    """Create an untrained model.

    Raises:
        InputError: a package is missing, or the algorithm refuses a value.
    """
    kind = algorithm_of(config.algorithm)
    recurrent = config.algorithm == "recurrent-ppo"
    # Nothing draws from it, but it is saved with the model: the same seed, the same file.
    envs.observation_space.seed(config.seed)
    try:
        return kind(
            "MultiInputLstmPolicy" if recurrent else "MultiInputPolicy",
            envs,
            seed=config.seed,
            device="cpu",
            stats_window_size=RECENT,
            policy_kwargs=network(config),
            **_hyperparameters(config),
        )
    except (AssertionError, TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        message = " ".join(str(error).split())
        raise InputError(f"{config.algorithm} refuses its hyperparameters: {message}.") from error


def load_model(config: Training, envs: VecEnv, path: Path) -> BaseAlgorithm:
    """Load a model saved with `model.save`; the environments keep their state."""
    kind = algorithm_of(config.algorithm)
    hyperparameters = _hyperparameters(config)
    changing = {name: hyperparameters[name] for name in SCHEDULED[config.algorithm]}
    return kind.load(path, env=envs, device="cpu", force_reset=False, **changing)


def network(config: Training) -> dict[str, Any]:
    """Return `policy_kwargs` for Stable-Baselines3."""
    policy = config.policy
    _, parameters = source_of(config.arguments)
    chosen: dict[str, Any] = {
        "features_extractor_class": NavigationFeatures,
        "features_extractor_kwargs": {
            "scan": policy.scan,
            "window": policy.window,
            "scan_features": policy.scan_features,
            "window_features": policy.window_features,
            "circular": looks_around(parameters.scanner),
        },
        "net_arch": list(policy.net_arch),
    }
    if config.algorithm != "sac":
        chosen["log_std_init"] = policy.log_std_init
    if config.algorithm == "recurrent-ppo":
        chosen["lstm_hidden_size"] = policy.lstm_hidden_size
    return chosen


def schedules(model: Any) -> list[LinearSchedule]:
    """Return the hyperparameters of a model that change over the training."""
    rates = (model.learning_rate, getattr(model, "clip_range", None))
    inner = (getattr(value, "value_schedule", value) for value in rates)
    return [schedule for schedule in inner if isinstance(schedule, LinearSchedule)]


def round_steps(config: Training) -> int:
    """Return the steps of one call of `learn`: for on-policy algorithms one rollout."""
    values = config.hyperparameters
    if "n_epochs" in values:
        return int(values["n_steps"]) * config.envs
    # Multiples of what the algorithm collects before it learns.
    piece = int(values["train_freq"]) * config.envs
    max_steps = SAC_ROUND if config.steps is None else min(SAC_ROUND, config.steps)
    return piece * max(max_steps // piece, 1)


def _hyperparameters(config: Training) -> dict[str, Any]:
    """Convert the hyperparameters to the algorithm's arguments."""
    values = config.hyperparameters
    return {name: schedule_of(value, name) for name, value in values.items()}
