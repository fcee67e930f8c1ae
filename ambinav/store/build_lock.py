"""Lock that lets only one process compute a map: others wait unless it stops making progress.

The operating system locks a file beside the entry, so that the lock ends with its process. It saves
work and nothing depends on it: entries are replaced as a whole, so that two processes may compute
the same entry. Hence a process that does not acquire it in time continues without.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, Final

PATIENCE: Final = 120.0
"""Seconds without a sign of life after which whoever holds a lock counts as stopped."""
POLL: Final = 0.05
"""Seconds between two looks at a lock that another holds."""

_LOOKS = 4  # whoever holds it only to clean up is gone by then


@contextlib.contextmanager
def build_lock(
    path: Path, patience: float, waiting: Callable[[], None]
) -> Iterator[Callable[[], None] | None]:
    """Hold a lock, or continue without it where it cannot be acquired.

    Args:
        path: The lock's file; it exists only while a process holds it, or was killed holding it.
        patience: Seconds to wait for a holder that gives no sign of life: it was stopped
            (Ctrl-Z), say.
        waiting: Called once, where another holds it for longer than a moment.

    Yields:
        A function that gives a sign of life, to be called regularly; None: the lock is not held,
        since its holder stands still, the folder is read-only, or the file system has no locks.
    """
    file = _acquire(path, patience, waiting)
    if file is None:
        yield None
        return
    with file:
        try:
            yield lambda: _touch(file)
        finally:
            # Remove the file before the release: waiting processes notice it, and create a new one.
            _remove(path, file)


def try_lock(path: Path) -> contextlib.AbstractContextManager[object] | None:
    """Take a lock if it is free.

    Returns:
        To be left when done, which removes its file; None: another holds it, or it cannot be had.
    """
    file, _ = _attempt(path)
    if file is None:
        return None
    stack = contextlib.ExitStack()
    stack.enter_context(file)
    stack.callback(_remove, path, file)
    return stack


def _acquire(path: Path, patience: float, waiting: Callable[[], None]) -> BinaryIO | None:
    for look in itertools.count(1):
        file, still = _attempt(path)
        if file is not None or still is None or still > patience:
            return file
        if look == _LOOKS:
            waiting()
        time.sleep(POLL)
    return None


def _attempt(path: Path) -> tuple[BinaryIO | None, float | None]:
    """Return the lock's file if it was free, else the seconds since its holder's last update.

    Neither: there are no locks here.
    """
    if sys.platform == "win32":
        return None, None
    import fcntl

    try:
        file = path.open("ab")
    except OSError:
        return None, None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if _is_at(path, file):
            os.utime(file.fileno())
            return file, None
        still = 0.0  # its holder was done, and removed the file, after it was opened here
    except BlockingIOError:
        still = abs(time.time() - os.fstat(file.fileno()).st_mtime)
    except OSError:
        file.close()
        return None, None
    file.close()
    return None, still


def _touch(file: BinaryIO) -> None:
    with contextlib.suppress(OSError):  # a network's file that another removed: the work goes on
        os.utime(file.fileno())


def _remove(path: Path, file: BinaryIO) -> None:
    with contextlib.suppress(OSError):
        if _is_at(path, file):
            path.unlink()


def _is_at(path: Path, file: BinaryIO) -> bool:
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False
