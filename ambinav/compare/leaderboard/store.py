"""Keeping the episodes of a method, so that a leaderboard that was interrupted goes on."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.metadata
import importlib.util
import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import numpy as np

import ambinav
from ambinav.files import replacing
from ambinav_envs.evaluation import Episodes

CODE: Final[Mapping[str, tuple[str, ...]]] = {
    "ambinav": (
        "ambiguity/**/*.py", "compare/leaderboard/*.py", "drive/*.py", "geometry/*.py",
        "localization/*.py", "maps/*.py", "routes/*.py", "sensing/*.py", "service/*.py",
        "threads.py",
    ),
    "ambinav_envs": (
        "*.py", "buildings/*.py", "policies/*.py", "simulation/*.py", "training/features.py",
    ),
    "ambinav_planners": ("*.py",),
}  # fmt: skip
"""Files that the outcome of an episode depends on, by package."""
PACKAGES: Final = ("numba", "numpy", "ompl", "sb3-contrib", "stable-baselines3", "torch")
"""Packages of others that it depends on too."""
WRITING: Final = ("draws.py", "figures.py", "overview.py", "report.py", "board.py")
"""Files of this folder that only tell what came out."""


@functools.cache
def code_checksum() -> str:
    """Checksum of the versions and of all files in `CODE`, as a hexadecimal string."""
    digest = hashlib.sha256(ambinav.__version__.encode())
    for name in PACKAGES:
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            digest.update(f"{name} {importlib.metadata.version(name)}".encode())
    for package, patterns in CODE.items():
        spec = importlib.util.find_spec(package)
        if spec is None or spec.origin is None:
            continue
        root = Path(spec.origin).parent
        for path in sorted({path for pattern in patterns for path in root.glob(pattern)}):
            if path.parent.name == "leaderboard" and path.name in WRITING:
                continue
            digest.update(f"{package}/{path.relative_to(root).as_posix()}".encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


def key_of(told: Mapping[str, Any]) -> str:
    """A short name for everything that some episodes depend on, the code among it."""
    text = json.dumps({**told, "code": code_checksum()}, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:24]


def save_episodes(episodes: Episodes, path: Path) -> None:
    """Write episodes as .npz, whole or not at all."""
    arrays = {item.name: getattr(episodes, item.name) for item in fields(Episodes)}
    with replacing(path) as fresh, fresh.open("wb") as file:
        np.savez_compressed(file, **arrays)


def load_episodes(path: Path) -> Episodes | None:
    """Read what `save_episodes` wrote; None if there is no such file, or it is damaged."""
    if not path.is_file():
        return None
    try:
        # Opened here: of a damaged file numpy would leave it open.
        with path.open("rb") as file, np.load(file) as stored:
            return Episodes(**{item.name: stored[item.name] for item in fields(Episodes)})
    except (OSError, ValueError, KeyError, EOFError, zlib.error, zipfile.BadZipFile):
        return None
