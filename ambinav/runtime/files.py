"""Writing of files so that readers never see a partly written one."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import hashlib
import os
import shutil
import signal
import sqlite3
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

from ambinav.runtime.errors import InputError

# Of Linux's renameat2: relative to the working folder, and swap the two.
_HERE = -100
_EXCHANGE = 2


def sha256(*paths: Path) -> str:
    """Compute the checksum of the files' bytes, in the order given, as a hexadecimal string."""
    digest = hashlib.sha256()
    for path in paths:
        digest.update(path.read_bytes())
    return digest.hexdigest()


def ends_with(path: Path, mark: bytes) -> bool:
    """Return whether a file has its closing mark among its last bytes; without it, it was cut off.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        file.seek(max(file.seek(0, os.SEEK_END) - 4096, 0))
        return mark in file.read()


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
    existing file or folder at `path` is replaced by one of its own kind only, and only after the
    new one is complete; whatever fails or interrupts, one of the two is there.

    Raises:
        InputError: the output folder is not writable, or a folder stands where a file is to be
            written or the reverse.
    """
    path = Path(os.path.realpath(path))  # through a link, so that the link stays
    parent = writable_parent(path)
    with contextlib.ExitStack() as stack:
        # Made and noted for removal in one go: an interrupt in between would leave it behind.
        with holding_interrupts():
            try:
                scratch = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=parent))
            except OSError as error:
                raise InputError(
                    f"{path}: nothing can be written in {parent} ({error.strerror}); "
                    "choose another output."
                ) from error
            stack.callback(_remove, scratch)
        fresh = scratch / path.name
        yield fresh
        _replace_path(fresh, path, scratch / ".old")


def move_onto(fresh: Path, path: Path) -> None:
    """Rename a finished folder onto `path`; an older folder there is removed afterwards.

    Args:
        fresh: On the same file system, with nothing beside it that ends in `.old`.
        path: A folder, or nothing.
    """
    old = fresh.with_name(f"{fresh.name}.old")
    with holding_interrupts():
        _replace_path(fresh, Path(os.path.realpath(path)), old)
        for left in (fresh, old):
            shutil.rmtree(left, ignore_errors=True)


def write_text(path: Path, text: str) -> None:
    """Write a text in UTF-8, completely or not at all; raises as `replacing` does."""
    with replacing(path) as fresh:
        fresh.write_text(text, encoding="utf-8")


@contextlib.contextmanager
def holding_interrupts() -> Iterator[None]:
    """Delay Ctrl-C and termination until the block is done.

    For calls that go on in threads of their own when they are left by an exception. A second one,
    of either kind, does not wait. Does nothing outside of the main thread, where signals do not
    arrive.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    received: list[int] = []
    both = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    # None: a handler that is not Python's, which cannot be put back.
    before = {number: handler for number, handler in both.items() if handler is not None}

    def note(number: int, frame: FrameType | None) -> None:
        for each, handler in before.items():
            signal.signal(each, handler)
        received.append(number)

    for number in before:
        signal.signal(number, note)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if received:
            signal.raise_signal(received[0])


def _remove(scratch: Path) -> None:
    with holding_interrupts():
        shutil.rmtree(scratch, ignore_errors=True)


def _replace_path(fresh: Path, path: Path, old: Path) -> None:
    """Rename `fresh` onto `path`; move a folder at `path` beside `fresh` or to `old`."""
    if not path.exists():
        os.replace(fresh, path)
        return
    if path.is_dir() != fresh.is_dir():
        existing, wanted = ("folder", "file") if path.is_dir() else ("file", "folder")
        raise InputError(
            f"{path}: a {existing} exists where a {wanted} is to be written; choose another output."
        )
    if path.is_file():
        os.replace(fresh, path)
    elif not _exchanged(fresh, path):
        try:
            os.rename(path, old)
            os.replace(fresh, path)
        except BaseException:
            if old.exists() and not path.exists():
                os.rename(old, path)
            raise


def _exchanged(first: Path, second: Path) -> bool:
    """Swap two paths in one step, if the system can, so that neither is ever missing."""
    rename = getattr(ctypes.CDLL(None, use_errno=True), "renameat2", None)
    if rename is None:
        return False
    return bool(
        rename(_HERE, os.fsencode(first), _HERE, os.fsencode(second), ctypes.c_uint(_EXCHANGE)) == 0
    )


def disk_is_full(error: BaseException) -> bool:
    """Return whether an error, also one of SQLite, says that the disk is full."""
    if isinstance(error, sqlite3.OperationalError):
        return "full" in str(error)
    return isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
