"""Storage of a method's episodes, so that an interrupted leaderboard can continue."""

from __future__ import annotations

import secrets
import zipfile
import zlib
from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from ambinav.runtime.files import replacing, sha256
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
    arrays = {item.name: getattr(episodes, item.name) for item in fields(Episodes)}
    with replacing(path) as fresh, fresh.open("wb") as file:
        np.savez_compressed(file, **arrays)


def load_episodes(path: Path) -> Episodes | None:
    """Read the output of `save_episodes`; None if there is no such file, or it is damaged."""
    if not path.is_file():
        return None
    try:
        # Opened here: of a damaged file numpy would leave it open.
        with path.open("rb") as file, np.load(file) as stored:
            return Episodes(**{item.name: stored[item.name] for item in fields(Episodes)})
    except (OSError, ValueError, KeyError, EOFError, zlib.error, zipfile.BadZipFile):
        return None
