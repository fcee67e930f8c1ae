"""Storage of a method's episodes, so that an interrupted leaderboard can continue."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from ambinav.runtime.array_files import read_arrays, write_arrays
from ambinav.runtime.files import sha256
from ambinav.runtime.provenance import PLANNING, POLICIES, Provenance, digest_of
from ambinav_envs.evaluation import Episodes
from ambinav_envs.policies.load import code_file


def computed_by() -> Provenance:
    """Return the provenance of the code that computes episodes."""
    return Provenance.here(*PLANNING, *POLICIES)


def key_of(identity: Mapping[str, Any]) -> str:
    """Return a short hash of everything that some episodes depend on, the code included."""
    return digest_of(identity, computed_by().digest)[:24]


def code_of(*functions: Callable[..., Any]) -> list[str]:
    """Return the checksums of the files of functions; of one in no file a new text every time."""
    files = {code_file(function) for function in functions}
    return sorted(secrets.token_hex() if file is None else sha256(file) for file in files)


def save_episodes(episodes: Episodes, path: Path) -> None:
    """Write episodes as .npz atomically."""
    write_arrays(path, {item.name: getattr(episodes, item.name) for item in fields(Episodes)})


def load_episodes(path: Path) -> Episodes | None:
    """Read the output of `save_episodes`; None if there is no such file, or it is damaged."""
    arrays = read_arrays(path)
    return None if arrays is None else Episodes(**arrays)
