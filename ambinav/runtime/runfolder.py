"""Output folders: what may be replaced, one run at a time, leftovers of killed runs."""

from __future__ import annotations

import contextlib
import errno
import json
import shutil
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final

from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.files import writable_parent

LOCK: Final = "lock"
NO_LOCKS: Final = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
"""Answers of file systems without locks."""
"""Name of the file that a run holds."""
WORK: Final = "work"
"""Folder of what is kept to go on after a break."""


@dataclass(frozen=True)
class RunFolder:
    """Rules for the folders that a command writes.

    Attributes:
        kind: What messages call what an earlier run left there, such as "comparison".
        names: What it writes there, as patterns of names.
        proof: A file of these that shows that a folder which is not empty is of an earlier run;
            empty: there need not be one.
        format: What that file, JSON, says in its member `format` up to the slash; empty: anything.
        kept: Folder of results that are written one by one; it may hold left-overs too.
        locked: Folder in which the lock lies, of the same; empty: the folder itself.
    """

    kind: str
    names: tuple[str, ...]
    proof: str = ""
    format: str = ""
    kept: str = WORK
    locked: str = WORK

    def check(self, folder: str | Path) -> Path:
        """Check that a run may write to a folder without losing anything else.

        Returns:
            The folder.

        Raises:
            InputError: it is a file, or a folder that holds something else than an earlier run.
        """
        path = Path(folder)
        if not path.exists():
            return path
        if not path.is_dir():
            raise InputError(f"{folder}: this is a file, not a folder; choose another output.")
        items = sorted(path.iterdir())
        foreign = [
            item.name for item in items if not (self._owns(item.name) or self._leftover(item))
        ]
        if not foreign and items and not self._proven(path):
            foreign = [item.name for item in items]
        if foreign:
            raise InputError(
                f"{folder}: this folder holds {foreign[0]}, which is not of an earlier "
                f"{self.kind}; choose a new folder."
            )
        return path

    @contextlib.contextmanager
    def hold(self, folder: Path, *, shared: bool = False) -> Iterator[None]:
        """Lock a folder for this process, and remove the leftovers of killed ones.

        It is made if it is missing. The system lets go of it when the process ends, whatever ends
        it. Where there is no such lock, as on Windows and on some shared file systems, nothing is
        held.

        Args:
            folder: The folder.
            shared: Whether others that share it may hold it too; then no leftovers are removed.

        Warns:
            InputWarning: its file system has no locks.

        Raises:
            InputError: another process holds it, or nothing can be written there.
        """
        lock = folder / self.locked / LOCK
        with (writable_parent(lock) / LOCK).open("a+b") as file:
            if sys.platform != "win32":
                import fcntl

                try:
                    kind = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
                    fcntl.flock(file, kind | fcntl.LOCK_NB)
                except BlockingIOError:
                    raise InputError(
                        f"{lock.parent}: another run is at work here; wait for it, or choose "
                        "another output."
                    ) from None
                except OSError as error:
                    if error.errno not in NO_LOCKS:
                        raise
                    warnings.warn(
                        f"{lock.parent}: this file system has no locks, so nothing keeps another "
                        "run out; start no other one here until this one has ended.",
                        InputWarning,
                        stacklevel=3,
                    )
            if not shared:
                work = folder / self.kept
                for item in (*folder.iterdir(), *(work.iterdir() if work.is_dir() else ())):
                    if self._leftover(item):
                        shutil.rmtree(item)
            yield

    def _owns(self, name: str) -> bool:
        return any(fnmatchcase(name, pattern) for pattern in self.names)

    def _leftover(self, path: Path) -> bool:
        """Return whether this folder is a leftover of `files.replacing` in a killed process."""
        name, _, suffix = path.name.removeprefix(".").rpartition(".")
        ours = self._owns(name) or path.parent.name == self.kept
        return path.name.startswith(".") and bool(suffix) and ours and path.is_dir()

    def _proven(self, path: Path) -> bool:
        if not self.proof:
            return True
        try:
            content = json.loads((path / self.proof).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return False
        # Of whichever version: what an older one wrote may be replaced.
        label = content.get("format") if isinstance(content, dict) else None
        return not self.format or str(label).split("/")[0] == self.format
