"""Environments of recorded files, each read once in a process: many tests go through them all."""

from __future__ import annotations

import functools
import warnings
from pathlib import Path
from typing import Any

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputWarning


@functools.cache
def read(path: Path, **options: Any) -> tuple[Environment, tuple[str, ...]]:
    """The environment of a file, and what is warned about."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", InputWarning)
        environment = load_environment(path, **options)
    texts = [str(warning.message) for warning in caught if warning.category is InputWarning]
    return environment, tuple(texts)


def all_maps(data_dir: Path) -> list[Path]:
    """The occupancy maps of all folders."""
    paths = sorted(data_dir.glob("*maps*/*.yaml"))
    assert len(paths) >= 30
    return paths
