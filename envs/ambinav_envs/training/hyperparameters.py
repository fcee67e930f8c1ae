"""Hyperparameters of the algorithms: names, defaults and ranges, without loading torch."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from ambinav.config import as_number, nearest
from ambinav.runtime.errors import InputError
from ambinav_envs.training.schedules import schedule_of

PPO: Final = {
    "learning_rate": 3e-4, "n_steps": 128, "batch_size": 2048, "n_epochs": 5, "gamma": 0.99,
    "gae_lambda": 0.95, "clip_range": 0.2, "clip_range_vf": None, "normalize_advantage": True,
    "ent_coef": 0.0, "vf_coef": 0.5, "max_grad_norm": 0.5, "use_sde": False, "sde_sample_freq": -1,
    "target_kl": None,
}  # fmt: skip
SAC: Final = {
    "learning_rate": 3e-4, "buffer_size": 100_000, "learning_starts": 5_000, "batch_size": 256,
    "tau": 0.005, "gamma": 0.99, "train_freq": 1, "gradient_steps": 8, "ent_coef": "auto",
    "target_update_interval": 1, "target_entropy": "auto", "use_sde": False, "sde_sample_freq": -1,
}  # fmt: skip
DEFAULTS: Final[Mapping[str, Mapping[str, Any]]] = {"ppo": PPO, "sac": SAC, "recurrent-ppo": PPO}
"""Defaults by algorithm; those of Stable-Baselines3 where many environments do not ask for others.
"""

SCHEDULED: Final[Mapping[str, tuple[str, ...]]] = {
    "ppo": ("learning_rate", "clip_range"),
    "sac": ("learning_rate",),
    "recurrent-ppo": ("learning_rate", "clip_range"),
}
"""Hyperparameters that may be a mapping {from, to}."""

_SWITCHES = ("normalize_advantage", "use_sde")
# Lowest and highest value of whole numbers, then of all others.
_WHOLE: Mapping[str, tuple[float, float]] = {
    "n_steps": (1, math.inf), "batch_size": (2, math.inf), "n_epochs": (1, math.inf),
    "buffer_size": (1, math.inf), "learning_starts": (0, math.inf), "train_freq": (1, math.inf),
    "gradient_steps": (1, math.inf), "target_update_interval": (1, math.inf),
    "sde_sample_freq": (-1, math.inf),
}  # fmt: skip
_REAL: Mapping[str, tuple[float, float]] = {
    "learning_rate": (0.0, 1.0), "gamma": (0.0, 1.0), "gae_lambda": (0.0, 1.0), "tau": (0.0, 1.0),
    "clip_range": (0.0, math.inf), "clip_range_vf": (0.0, math.inf), "ent_coef": (0.0, math.inf),
    "vf_coef": (0.0, math.inf), "max_grad_norm": (0.0, math.inf), "target_kl": (0.0, math.inf),
    "target_entropy": (-math.inf, math.inf),
}  # fmt: skip
_MAY_BE_NONE = ("clip_range_vf", "target_kl")
_MAY_BE_AUTO = ("ent_coef", "target_entropy")


def hyperparameters_of(algorithm: str, values: Mapping[str, Any], envs: int) -> dict[str, Any]:
    """Return all hyperparameters of an algorithm, with defaults for those not given.

    Args:
        algorithm: One of `DEFAULTS`.
        values: By the names of Stable-Baselines3. Where PPO's batch size is not among them, it is
            the greatest up to the default that divides a rollout, n_steps times envs.
        envs: How many environments are trained in.

    Raises:
        InputError: a name is unknown (the nearest is offered), or a value makes no sense.
    """
    defaults = DEFAULTS[algorithm]
    for name in values:
        if name not in defaults:
            raise InputError(f"hyperparameters: {name!r} is unknown; {nearest(name, defaults)}.")
    chosen = {
        name: _checked(name, values.get(name, default), algorithm)
        for name, default in defaults.items()
    }
    if "n_epochs" in chosen and "batch_size" not in values:
        rollout = chosen["n_steps"] * envs
        largest = min(chosen["batch_size"], rollout)
        # A prime number of steps is one batch: batches of one step cannot be normalized.
        divisors = (size for size in range(largest, 1, -1) if rollout % size == 0)
        chosen["batch_size"] = next(divisors, rollout)
    return chosen


def _checked(name: str, value: Any, algorithm: str) -> Any:
    where = f"hyperparameters.{name}"
    if name in _SWITCHES:
        if not isinstance(value, bool):
            raise InputError(f"{where} is {value!r}; give true or false.")
        return value
    if value is None and name in _MAY_BE_NONE:
        return None
    if algorithm == "sac" and value == "auto" and name in _MAY_BE_AUTO:
        return value
    if isinstance(value, Mapping) and name in SCHEDULED[algorithm]:
        schedule = schedule_of(value, where)
        ends = {"from": schedule.start, "to": schedule.end}
        return {end: _within(number, f"{where}.{end}", _REAL[name]) for end, number in ends.items()}
    number = _within(as_number(value, where), where, {**_WHOLE, **_REAL}[name])
    if name not in _WHOLE:
        return number
    if isinstance(value, bool) or number != int(number):
        raise InputError(f"{where} is {value!r}; give a whole number.")
    return int(number)


def _within(number: float, where: str, limits: tuple[float, float]) -> float:
    low, high = limits
    if not low <= number <= high:
        wish = f"{low:g} to {high:g}" if math.isfinite(high) else f"at least {low:g}"
        raise InputError(f"{where} is {number:g}; give {wish}.")
    return number
