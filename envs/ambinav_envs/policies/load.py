"""Finding a policy by what a user names it by."""

from __future__ import annotations

import importlib
import inspect
import secrets
import sys
import warnings
from pathlib import Path
from typing import Any, Final

from ambinav.config import nearest
from ambinav.errors import InputError
from ambinav.files import sha256
from ambinav.plugins import load_callable
from ambinav_envs.policies.file import arguments_of, read_members
from ambinav_envs.policies.policy import CallablePolicy, ModelPolicy, Policy

BASELINES: Final = Path(__file__).parent / "baselines"
"""Folder of the policies that are shipped: NAME.zip, and NAME.md, which says what it is."""

_HOMES = {"PPO": "stable_baselines3", "SAC": "stable_baselines3", "RecurrentPPO": "sb3_contrib"}
_PACKAGES = {"stable_baselines3": "stable-baselines3", "sb3_contrib": "sb3-contrib"}
# Put in the place of what was saved: buffers and schedules that serve training alone, and may be
# large, or unreadable to another Python.
_UNUSED: dict[str, dict[str, Any]] = {
    "PPO": {"n_steps": 2, "n_envs": 1, "clip_range": 0.2, "learning_rate": 0.0},
    "RecurrentPPO": {"n_steps": 2, "n_envs": 1, "clip_range": 0.2, "learning_rate": 0.0},
    "SAC": {"buffer_size": 1, "n_envs": 1, "learning_rate": 0.0},
}


def baselines() -> tuple[str, ...]:
    """Names of the policies that are shipped."""
    return tuple(sorted(path.stem for path in BASELINES.glob("*.zip")))


def load_policy(source: str | Path, folder: Path | None = None) -> Policy:
    """The policy that a user names.

    A file holds pickled objects, and a callable is code: load what you trust alone.

    Args:
        source: A policy file (`save_policy`), the name of a baseline, `module:callable` or
            `file.py:callable`. The callable is called with the observation and the action space
            and gives something with `act(observations, starts)`, see `Policy.act`.
        folder: What names of files are relative to; None: the working folder.

    Raises:
        InputError: there is none, or it cannot be loaded; one sentence says why.
    """
    folder = Path() if folder is None else folder
    name = str(source)
    if name in baselines():
        policy = policy_of(BASELINES / f"{name}.zip", name)
        # What code trained it is said where it is shipped: in its card's text.
        policy.code = None
        return policy
    path = folder / name
    if path.suffix == ".py":
        raise InputError(f"policy {name!r} is a file of code; give {name}:callable.")
    if path.is_file() or path.suffix == ".zip":
        return policy_of(path, path.stem)
    if ":" in name:
        return CallablePolicy(_callable(name, folder), name)
    offer = nearest(name, baselines()) if baselines() else "give a policy's .zip file"
    raise InputError(
        f"policy {name!r} is neither a file nor a baseline nor module:callable; {offer}."
    )


def policy_of(path: Path, name: str) -> ModelPolicy:
    """The policy in a file.

    Raises:
        InputError: see `read_members`; or a package is missing, or the model cannot be loaded.
    """
    card, normalization = read_members(path)
    try:
        arguments = arguments_of(card)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    model = _model(path, card.algorithm)
    return ModelPolicy(model, normalization, name=name, environment=arguments, code=str(card.code))


def checksum_of(source: str | Path, policy: Policy, folder: Path | None = None) -> str:
    """Checksum of what a policy was loaded from, to know its results again by.

    Of a callable it is that of the file where its code stands, or that of its type. One whose code
    is in no file gets another text every time, so that its results are never taken for known.

    Args:
        source: What `load_policy` was given.
        policy: What it gave.
        folder: As it was given.
    """
    if isinstance(policy, CallablePolicy):
        code = _code_file(policy.make)
        return secrets.token_hex() if code is None else sha256(code)
    name = str(source)
    return sha256(BASELINES / f"{name}.zip" if name in baselines() else (folder or Path()) / name)


def _code_file(make: Any) -> Path | None:
    for one in (make, type(make)):
        # The type of a partial function, say, is Python's own and tells nothing.
        module = str(getattr(one, "__module__", None))
        if module.partition(".")[0] in sys.stdlib_module_names:
            continue
        try:
            return Path(inspect.getfile(one))
        except (TypeError, OSError):
            continue
    return None


def _callable(source: str, folder: Path) -> Any:
    try:
        return load_callable(source, folder)
    except InputError as error:
        raise InputError(f"{str(error).rstrip('.')}.") from error


def _model(path: Path, algorithm: str) -> Any:
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
            # Of what could not be unpickled and is replaced here.
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
