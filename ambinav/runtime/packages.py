"""Optional packages: what to install where one is missing."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec

from ambinav.runtime.errors import InputError

ENVIRONMENTS = ("gymnasium",)
"""Packages of the environments."""
TRAINED = (*ENVIRONMENTS, "stable_baselines3", "torch", "safetensors")
"""Packages of training, and of trained policies."""


def need(purpose: str, packages: Sequence[str], extra: str = "envs") -> None:
    """Raise an error that says how to install a missing package, before any is imported.

    Args:
        purpose: Purpose of the packages.
        packages: Import names of the packages.
        extra: Extra of this distribution that installs them.

    Raises:
        InputError: one is missing.
    """
    for name in packages:
        if find_spec(name) is None:
            raise InputError(f'{purpose} needs {name}; run: pip install "ambinav[{extra}]".')
