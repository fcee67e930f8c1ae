"""Telling by the code whether what an earlier call left can still be used."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

import ambinav


@functools.cache
def code_checksum(patterns: tuple[str, ...]) -> str:
    """Checksum of ambinav's version and of some of its files, as a hexadecimal string.

    Args:
        patterns: Of the files, relative to the package.
    """
    root = Path(ambinav.__file__).parent
    digest = hashlib.sha256(ambinav.__version__.encode())
    for path in sorted({path for pattern in patterns for path in root.glob(pattern)}):
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()
