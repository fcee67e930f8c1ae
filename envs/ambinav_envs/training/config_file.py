"""Reading configurations, and comparing two of them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numba
import yaml

from ambinav.config import checked, parse_yaml, read_text
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import write_text
from ambinav.runtime.input_suggestions import TRAINING, kind_of, kind_of_path, refuse
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.buildings.suites import suite
from ambinav_envs.file_arguments import with_absolute_files
from ambinav_envs.policies.shapes import action_misfit, described, misfit
from ambinav_envs.scenario import source_of
from ambinav_envs.spaces import action_space, observation_space
from ambinav_envs.training.config import Training
from ambinav_envs.training.hyperparameters import hyperparameters_of

MAY_CHANGE: Final = ("steps", "minutes")
"""Keys that may differ when a training is resumed."""


def load_training_config(
    path: str | Path,
    *,
    seed: int | None = None,
    limits: Mapping[str, Any] | None = None,
    task: str | None = None,
) -> Training:
    """Read a configuration and fill in its defaults.

    Args:
        path: The YAML file.
        seed: Instead of the file's.
        limits: `steps` or `minutes` or both, instead of both of the file's; none: the file's.
        task: Id of the environment instead of the file's.

    Raises:
        InputError: the file is missing or cannot be used; the message names file, key and value.
    """
    path = Path(path)
    refuse(str(path), kind_of_path(path), "a training configuration")
    plain = parse_yaml(read_text(path), str(path), "docs/training.md has every key")
    refuse(str(path), kind_of(plain), "a training configuration", TRAINING)
    if not isinstance(plain, Mapping):
        raise InputError(f"{path} holds {type(plain).__name__}; give a mapping of keys.")
    settings = {**plain, **dict.fromkeys(MAY_CHANGE), **limits} if limits else dict(plain)
    if seed is not None:
        settings["seed"] = seed
    if task is not None:
        environment = settings.get("environment")
        settings["environment"] = {
            **(environment if isinstance(environment, Mapping) else {}), "id": task,
        }  # fmt: skip
    return parse_config(settings, str(path), path.parent)


def parse_config(plain: Mapping[str, Any], where: str, folder: Path | None = None) -> Training:
    """Create a configuration from plain values, with all defaults filled in.

    Args:
        plain: Its keys.
        where: Names it in messages.
        folder: What its files' names are relative to; None: the working folder.

    Raises:
        InputError: a key is unknown or missing, or a value of no use.
    """
    config = checked(Training, plain, where)
    folder = Path() if folder is None else folder
    max_threads = numba.config.NUMBA_NUM_THREADS
    threads = min(os.cpu_count() or 1, max_threads) if config.threads is None else config.threads
    if threads > max_threads:
        raise InputError(f"{where}: threads is {threads}; there are cores for {max_threads}.")
    environment = with_absolute_files(config.judged_apart, folder)
    evaluation = config.evaluation.model_copy(update={"environment": environment})
    config = config.model_copy(
        update={
            "threads": threads,
            "environment": with_absolute_files(config.environment, folder),
            "evaluation": evaluation,
            "hyperparameters": hyperparameters_of(
                config.algorithm, config.hyperparameters, config.envs
            ),
        }
    )
    sources, spaces = [], []
    for name, arguments in (
        ("environment", config.arguments),
        ("evaluation.environment", config.judged),
    ):
        try:
            source, parameters = source_of(arguments)
            sources.append(source)
            spaces.append((observation_space(parameters), action_space(parameters)))
        except InputError as error:
            raise InputError(f"{where}: {name}: {error}") from error
        for i, stage in enumerate(config.curriculum):
            if stage.longest <= parameters.shortest:
                raise InputError(
                    f"{where}: curriculum[{i}].longest is {stage.longest:g}; give more than the "
                    f"environment's shortest, {parameters.shortest:g}."
                )
    (observations, actions), (judged_observations, judged_actions) = spaces
    why = misfit(described(observations), judged_observations) or action_misfit(
        described(actions), judged_actions
    )
    if why is not None:
        raise InputError(f"{where}: evaluation.environment does not fit that of training: {why}.")
    if config.arguments.get("map") is None and config.judged.get("map") is None:
        _check_apart(where, *sources)
    return config


def _check_apart(where: str, train: BuildingSource, judged: BuildingSource) -> None:
    """Check that training and evaluation share no building of a suite.

    Building k of a mixture is building k of a member; which member is not considered. Where any
    number is drawn, from billions, two do not meet.
    """
    shared = suite(train.name).leaves() & suite(judged.name).leaves()
    if not shared or train.count is None or judged.count is None:
        return
    if max(train.first, judged.first) < min(train.first + train.count, judged.first + judged.count):
        raise InputError(
            f"{where}: evaluation.environment: the buildings from {judged.first} on, "
            f"{judged.count} of them, are partly those of training, {train.count} from "
            f"{train.first} on (both have the suite {', '.join(sorted(shared))}); give another "
            "first_building."
        )


def write_config(config: Training, path: Path) -> None:
    """Write a complete configuration; `load_training_config` reads it back."""
    write_text(path, plain_text(config))


def plain_text(config: Training) -> str:
    """Return a configuration as YAML."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False)


def difference(now: Training, before: Training) -> str | None:
    """Return the first key whose difference forbids to resume, or None."""
    return _differs(now.model_dump(mode="json"), before.model_dump(mode="json"), "")


def _differs(now: Any, before: Any, place: str) -> str | None:
    if isinstance(now, dict) and isinstance(before, dict):
        for key in dict.fromkeys((*now, *before)):
            if place or key not in MAY_CHANGE:
                inside = f"{place}.{key}" if place else str(key)
                key_path = _differs(now.get(key), before.get(key), inside)
                if key_path is not None:
                    return key_path
        return None
    return None if now == before else f"{place} is {now!r} and was {before!r}"
