"""The folder of a training: its files, and the data for repeating it."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import ambinav
from ambinav.maps.content_digest import environment_digest
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import write_text
from ambinav.runtime.provenance import code_digest, library_versions
from ambinav.runtime.runfolder import LOCK, RunFolder
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.scenario import source_of
from ambinav_envs.training.config import Training

CONFIG: Final = "config.yaml"
ABOUT: Final = "run.json"
PROGRESS: Final = "progress.csv"
BEST: Final = "best.zip"
FINAL: Final = "final.zip"
CURVE: Final = "curve.png"
REPORT: Final = "report.md"
CHECKPOINTS: Final = "checkpoints"
TENSORBOARD: Final = "tensorboard"
FOLDER: Final = RunFolder(
    "training",
    (CONFIG, ABOUT, PROGRESS, BEST, FINAL, CURVE, REPORT, CHECKPOINTS, TENSORBOARD, LOCK),
    kept=CHECKPOINTS,
    locked="",
)

HASHED: Final = 64
"""Number of buildings of a suite that a checksum covers."""
_PACKAGES: Final = (
    "ambinav", "stable-baselines3", "sb3-contrib", "torch", "gymnasium", "numpy", "numba",
)  # fmt: skip


def about(config: Training, command: Sequence[str]) -> dict[str, Any]:
    """Return the metadata of a run: versions, machine, buildings, command.

    Each of its `sessions` has a command, a commit and versions of its own, see `session`.
    """
    return {
        "format": 1,
        "seed": config.seed,
        "command": list(command),
        "commit": commit(),
        "code": code_digest(),
        "versions": versions(),
        "platform": platform.platform(),
        "processor": platform.machine(),
        "cores": os.cpu_count(),
        "threads": config.threads,
        "buildings": buildings(source_of(config.arguments)[0]),
        "judged_in": buildings(source_of(config.judged)[0]),
        "sessions": [],
    }


def session(steps: int, command: Sequence[str]) -> dict[str, Any]:
    """Return the metadata of a session: when it began, after how many steps, and by which code."""
    return {
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "from_steps": steps,
        "command": list(command),
        "commit": commit(),
        "code": code_digest(),
        "versions": versions(),
    }


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that a training depends on."""
    return {"python": platform.python_version(), **library_versions(_PACKAGES)}


def buildings(source: BuildingSource) -> dict[str, Any]:
    """Return which buildings are used, and a checksum of the first `HASHED` of them."""
    count = HASHED if source.count is None else min(source.count, HASHED)
    digest = hashlib.sha256()
    for number in range(source.first, source.first + count):
        digest.update(environment_digest(source.get(number).environment).encode())
    return {
        "name": source.name,
        "first": source.first,
        "count": source.count,
        "hashed": count,
        "sha256": digest.hexdigest(),
    }


def commit() -> str | None:
    """Return the commit of ambinav's sources, "-dirty" if they were changed; None without git."""
    root = Path(ambinav.__file__).parents[1]
    call = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40"]
    if not (root / ".git").exists():
        return None
    try:
        result = subprocess.run(call, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return result.stdout.strip() or None


def write_json(path: Path, plain: Mapping[str, Any]) -> None:
    """Write plain values atomically."""
    write_text(path, json.dumps(plain, indent=2) + "\n")


def read_json(path: Path) -> dict[str, Any]:
    """Read the output of `write_json`.

    Raises:
        InputError: it is something else.
    """
    try:
        plain = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: the file cannot be read ({error}); remove it.") from error
    if not isinstance(plain, dict):
        raise InputError(f"{path} holds {type(plain).__name__}; remove it.")
    return plain
