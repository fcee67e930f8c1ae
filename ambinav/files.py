"""Writing files so that a reader never meets a half-written one."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from ambinav.errors import InputError


def sha256(*paths: Path) -> str:
    """Checksum over the bytes of the files, in the order given, as a hexadecimal string."""
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.read_bytes())
    return digest.hexdigest()


def writable_parent(path: Path) -> Path:
    """Create and return the folder that is to hold `path`.

    Raises:
        InputError: the folder cannot be made or cannot be written to.
    """
    parent = path.absolute().parent
    try:
        parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{path}: the folder {parent} cannot be made ({error.strerror}); choose another output."
        ) from error
    if not os.access(parent, os.W_OK | os.X_OK):
        raise InputError(f"{path}: the folder {parent} is not writable; choose another output.")
    return parent


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside `path`; on success rename it onto `path`, else remove it.

    The temporary path does not exist yet: the caller makes a file or a folder of it. An
    existing file or folder at `path` is replaced only after the new one is complete.

    Raises:
        InputError: the output folder is not writable.
    """
    path = Path(path)
    parent = writable_parent(path)
    scratch = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=parent))
    fresh = scratch / path.name
    try:
        yield fresh
        if path.is_dir() and not path.is_symlink():
            os.rename(path, scratch / ".old")
        os.replace(fresh, path)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
