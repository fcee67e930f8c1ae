"""Optional packages that a command needs."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec

from ambinav.runtime.errors import InputError

ENVIRONMENTS = ("gymnasium",)
"""Of the environments."""
TRAINED = (*ENVIRONMENTS, "stable_baselines3", "torch", "safetensors")
"""Of what is trained, or was."""


def need(what: str, packages: Sequence[str], extra: str = "envs") -> None:
    """Report how to install a missing package, before any of them is imported.

    Args:
        what: What they are for.
        packages: By the names that they are imported by.
        extra: Of this distribution, that brings them.

    Raises:
        InputError: one is missing.
    """
    for name in packages:
        if find_spec(name) is None:
            raise InputError(f'{what} needs {name}; run: pip install "ambinav[{extra}]".')
