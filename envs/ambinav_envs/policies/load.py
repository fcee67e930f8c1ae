"""Loading of a policy by the name or file that a user gives."""

from __future__ import annotations

import importlib
import inspect
import json
import secrets
import sys
import warnings
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ambinav.config import nearest
from ambinav.plugins import load_callable
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import sha256
from ambinav_envs.policies.archive import UNREADABLE
from ambinav_envs.policies.card import CARD, arguments_of, of_id
from ambinav_envs.policies.corrected import CorrectedPolicy
from ambinav_envs.policies.file import is_plain_model, read_policy_file
from ambinav_envs.policies.policy import CallablePolicy, ModelPolicy, Policy, seen_in
from ambinav_envs.policies.reactive.policy import REACTIVE, ReactivePolicy

_HOMES = {"PPO": "stable_baselines3", "SAC": "stable_baselines3", "RecurrentPPO": "sb3_contrib"}
_PACKAGES = {"stable_baselines3": "stable-baselines3", "sb3_contrib": "sb3-contrib"}
# Put in the place of what was saved: buffers and schedules that serve training alone, and may be
# large, or unreadable to another Python.
_MARKS: Final = {"clip_range": "PPO", "target_entropy": "SAC"}
"""Hyperparameters that tell algorithms apart."""
_RECURRENT: Final = "sb3_contrib.common.recurrent.policies"
_UNUSED: dict[str, dict[str, Any]] = {
    "PPO": {"n_steps": 2, "n_envs": 1, "clip_range": 0.2, "learning_rate": 0.0},
    "RecurrentPPO": {"n_steps": 2, "n_envs": 1, "clip_range": 0.2, "learning_rate": 0.0},
    "SAC": {"buffer_size": 1, "n_envs": 1, "learning_rate": 0.0},
}


def load_policy(
    source: str | Path,
    folder: Path | None = None,
    *,
    trust: bool = False,
    environment: Mapping[str, Any] | None = None,
) -> Policy:
    """Load the policy that a user names.

    A policy file is data: no code in it is run. Everything else but a baseline is code.

    Args:
        source: A policy file (`save_policy`), the name of a reactive baseline
            (`reactive.policy.REACTIVE`); or what needs `trust`: `module:callable`,
            `file.py:callable`, or a file of `model.save` of Stable-Baselines3. The callable is
            called with the observation and the action space and returns an object with
            `act(observations, starts)`, see `Policy.act`.
        folder: Folder to which file names are relative; None: the working folder.
        trust: Run code that the source names or holds, with the rights of this process.
        environment: For a file of `model.save`, which does not contain it: arguments of the
            environment of its training, and its `id`.

    Raises:
        InputError: there is none, it is code and not trusted, or it cannot be loaded; the message
            gives the reason.
    """
    folder = Path() if folder is None else folder
    name = str(source)
    if name in REACTIVE:
        _check_environment(name, environment)
        return ReactivePolicy(name)
    path = folder / name
    if path.suffix == ".py":
        raise InputError(f"policy {name!r} is a file of code; give {name}:callable.")
    if path.is_file() or path.suffix == ".zip":
        if is_plain_model(path):
            return _plain_model(path, trust, environment)
        _check_environment(name, environment)
        return policy_of(path, path.stem)
    if ":" in name:
        _check_environment(name, environment)
        if not trust:
            raise InputError(
                f"policy {name!r} is code, which would run with your rights; if you trust it, add "
                "--trust (trust=True in Python)."
            )
        return CallablePolicy(_callable(name, folder), name)
    raise InputError(
        f"policy {name!r} is neither a file nor a baseline nor module:callable; "
        f"{nearest(name, REACTIVE)}."
    )


def policy_of(path: Path, name: str) -> Policy:
    """Read the policy in a file; no code in it is run.

    Raises:
        InputError: see `read_policy_file`; or a package is missing, or the network and the weights
            do not go together.
    """
    content = read_policy_file(path)
    try:
        arguments, model = arguments_of(content.card), content.build()
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    policy = ModelPolicy(
        model, content.normalization, name=name, environment=arguments, code=content.card.code
    )
    return policy if content.card.base is None else CorrectedPolicy(policy, content.card.base)


def checksum_of(source: str | Path, policy: Policy, folder: Path | None = None) -> str:
    """Return the checksum of a policy's source, which identifies its results.

    The checksum of a callable is that of the file with its code, or with the code of its type. If
    there is no such file, it is a new text every time, so that its results are never reused.

    Args:
        source: Argument of `load_policy`.
        policy: Result of `load_policy`.
        folder: As it was given.
    """
    if isinstance(policy, CallablePolicy):
        code = code_file(policy.make)
        return secrets.token_hex() if code is None else sha256(code)
    if isinstance(policy, ReactivePolicy):
        return policy.checksum
    return sha256((folder or Path()) / source)


def code_file(make: Any) -> Path | None:
    """Return the file where the code of a callable, or of its type, stands; None: in none."""
    for candidate in (make, type(make)):
        # The type of a partial function, say, is Python's own and tells nothing.
        module = str(getattr(candidate, "__module__", None))
        if module.partition(".")[0] in sys.stdlib_module_names:
            continue
        try:
            return Path(inspect.getfile(candidate))
        except (TypeError, OSError):
            continue
    return None


def _callable(source: str, folder: Path) -> Any:
    try:
        return load_callable(source, folder)
    except InputError as error:
        raise InputError(f"{str(error).rstrip('.')}.") from error


def _check_environment(name: str, environment: Mapping[str, Any] | None) -> None:
    if environment is not None:
        raise InputError(
            f"policy {name!r} says itself what it was trained in; leave --env out, which is for "
            "files of model.save."
        )


def _plain_model(path: Path, trust: bool, environment: Mapping[str, Any] | None) -> ModelPolicy:
    """Load the pickled output of Stable-Baselines3's `model.save`."""
    if not trust or environment is None:
        raise InputError(
            f"{path}: the member {CARD} is missing, as in what model.save of Stable-Baselines3 "
            "writes: pickled objects, which run code when they are loaded, and no word of the "
            "environment; if you trust it, add --trust and --env ID (trust=True and environment= "
            "in Python), or save it with ambinav_envs.policies.save_policy."
        )
    arguments = of_id(environment) | dict(environment)
    seen = seen_in(arguments)
    model = _unpickled(path, _algorithm(path))
    policy = ModelPolicy(model, name=path.stem, environment=seen | arguments)
    policy.is_code = True
    return policy


def _algorithm(path: Path) -> str:
    """Return the algorithm that saved a model."""
    try:
        with zipfile.ZipFile(path) as archive:
            plain = json.loads(archive.read("data"))
        recurrent = plain.get("policy_class", {}).get("__module__") == _RECURRENT
    except (*UNREADABLE, AttributeError) as error:
        raise InputError(f"{path}: this is not a file of model.save; save it again.") from error
    for key, algorithm in _MARKS.items():
        if key in plain:
            return "RecurrentPPO" if recurrent else algorithm
    raise InputError(
        f"{path}: this is a model of none of {', '.join(_HOMES)}; give module:callable, which "
        "loads it."
    )


def _unpickled(path: Path, algorithm: str) -> Any:
    home = _HOMES[algorithm]
    try:
        kind = getattr(importlib.import_module(home), algorithm)
    except ImportError as error:
        missing = (error.name or home).partition(".")[0]
        package = _PACKAGES.get(missing, missing)
        raise InputError(
            f"{path}: a {algorithm} policy needs {package}; run: pip install "
            f'"ambinav[envs]" {_PACKAGES[home]}.'
        ) from error
    unused = _UNUSED[algorithm]
    try:
        with warnings.catch_warnings():
            # Warnings about objects that could not be unpickled and are replaced here.
            warnings.simplefilter("ignore")
            # No seed: loading would start the random numbers of the whole process anew.
            return kind.load(
                path, device="cpu", custom_objects={"lr_schedule": None, **unused}, seed=None,
                **unused,
            )  # fmt: skip
    except Exception as error:
        # What is inside is pickled by somebody else, and may fail in any way.
        message = " ".join(str(error).split())[:200]
        raise InputError(
            f"{path}: the model cannot be loaded ({type(error).__name__}: {message}); copy or "
            "train it again."
        ) from error
