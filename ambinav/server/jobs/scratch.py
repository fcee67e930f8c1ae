"""The folder of a server's temporary files, and removal of those left by killed servers."""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import stat
import tempfile
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Final

from ambinav.store.build_lock import try_lock

PREFIX: Final = "ambinav-serve-"
LOCK: Final = ".lock"
"""Ending of the file beside a folder that its server holds locked as long as it lives."""
_ATTEMPTS: Final = 8


class ScratchFolder:
    """Folder of one server; `remove_left` removes it if the server is killed."""

    def __init__(self) -> None:
        place, stack = Path(tempfile.gettempdir()), contextlib.ExitStack()
        # The lock comes first, since whoever finds it free removes the folder. It cannot be had
        # where the file system has no locks.
        for _ in range(_ATTEMPTS):
            self.path = place / f"{PREFIX}{secrets.token_hex(6)}"
            lock = try_lock(self.path.with_name(self.path.name + LOCK))
            if lock is not None:
                stack.enter_context(lock)
                break
        stack.callback(shutil.rmtree, self.path, ignore_errors=True)
        self._remove = weakref.finalize(self, stack.close)  # where nobody calls `close`
        self.path.mkdir(mode=0o700)

    def close(self) -> None:
        """Remove the folder."""
        self._remove()


def remove_left() -> None:
    """Remove folders of this user's servers that no longer run: their lock is free."""
    for lock in Path(tempfile.gettempdir()).glob(f"{PREFIX}*{LOCK}"):
        locked = try_lock(lock) if _is_ours(lock, stat.S_ISREG) else None
        if locked is not None:
            with locked:
                folder = lock.with_name(lock.name.removesuffix(LOCK))
                if _is_ours(folder, stat.S_ISDIR):
                    shutil.rmtree(folder, ignore_errors=True)
            if folder.exists():  # a worker that has yet to end writes there: for the next start
                lock.touch()


def _is_ours(path: Path, is_kind: Callable[[int], bool]) -> bool:
    """Return whether a path belongs to this user and is of a kind, not a link to one."""
    try:
        status = path.lstat()
    except OSError:
        return False
    return status.st_uid == os.getuid() and is_kind(status.st_mode)
