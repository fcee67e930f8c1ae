"""Keeping two comparisons from working in one folder at the same time."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path

from ambinav.errors import InputError
from ambinav.files import writable_parent

NAME = "lock"


@contextlib.contextmanager
def only_one(folder: Path) -> Iterator[None]:
    """Hold a folder for this process alone; it is made if it is missing.

    The system lets go of it when the process ends, whatever ends it. Windows has no such lock:
    there nothing is held.

    Raises:
        InputError: another process holds it, or nothing can be written there.
    """
    with (writable_parent(folder / NAME) / NAME).open("ab") as file:
        if sys.platform == "win32":
            yield
            return
        import fcntl

        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"{folder}: another run is at work here; wait for it, or choose another output."
            ) from None
        yield
