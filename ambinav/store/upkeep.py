"""Maintenance of a store: list, verify and remove its entries."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from ambinav.runtime.errors import InputError
from ambinav.store import entry
from ambinav.store.map_store import DAMAGED, ENTRY, MapStore

CURRENT: Final = "current"
OTHER_CODE: Final = "other code"
NEWER: Final = "newer format"
SET_ASIDE: Final = "damaged"
"""States of entries: of use to this process, computed by other code or libraries, kept by a newer
ambinav, damaged or set aside as such."""


@dataclass(frozen=True)
class Kept:
    """Entry of a store.

    Attributes:
        key: What it is kept as.
        path: Its file.
        size: Bytes.
        used: When it was last written or opened, ISO 8601.
        state: One of the states above; a checksum is not looked at.
        about: What it says of its map; None where that cannot be read.
    """

    key: str
    path: Path
    size: int
    used: str
    state: str
    about: entry.About | None


def entries_of(store: MapStore) -> list[Kept]:
    """List all entries of a store, most recently used first.

    Raises:
        InputError: nothing is kept.
    """
    entries = []
    for path in reversed(store.files()):
        with contextlib.suppress(FileNotFoundError):  # another process removed it
            entries.append(_look(path))
    return entries


def find(store: MapStore, begun: str) -> Kept:
    """Find the entry whose key begins with a text.

    Raises:
        InputError: there is none, or several.
    """
    matches = [item for item in entries_of(store) if begun and item.key.startswith(begun)]
    keys = {item.key for item in matches}
    if len(keys) != 1:
        reason = f"{len(keys)} maps begin so; give more of the key" if keys else "no map begins so"
        raise InputError(f"{begun!r}: {reason}; `ambinav store list` shows the keys.")
    return max(matches, key=lambda item: item.path.suffix == ENTRY)


def verify(store: MapStore, keys: list[str] | None = None) -> Iterator[tuple[Kept, str | None]]:
    """Read whole entries and set damaged ones aside.

    Args:
        store: The store.
        keys: Keys, or how they begin; None: all.

    Yields:
        Each entry that was not set aside before, and what is wrong with it; None: nothing. One of
        a newer format cannot be judged and is left out.

    Raises:
        InputError: there is no such entry, or several.
    """
    chosen = entries_of(store) if keys is None else [find(store, key) for key in keys]
    for item in chosen:
        if item.path.suffix == DAMAGED or item.state == NEWER:
            continue
        reason = None
        try:
            entry.check_whole(item.path.read_bytes(), item.key)
        except FileNotFoundError:
            continue
        except (OSError, entry.DamagedError) as error:
            reason = str(error)
            store.set_aside(item.key)
        except entry.NewerFormatError:
            continue
        yield item, reason


def prune(
    store: MapStore, limit: int, *, other_code: bool = False, every: bool = False
) -> tuple[int, int]:
    """Remove entries, and leftovers of killed processes.

    Args:
        store: The store. What a newer ambinav keeps in it stays.
        limit: Bytes that may be left; those go first that were not used for longest.
        other_code: Remove what other code or libraries computed.
        every: Remove all.

    Returns:
        How many entries are gone, and how many bytes they took.

    Raises:
        InputError: nothing is kept.
    """
    before = {item.path: item.size for item in entries_of(store)}
    if other_code:
        for item in entries_of(store):
            if item.state == OTHER_CODE:
                item.path.unlink(missing_ok=True)
    store.make_room(-1 if every else limit)  # at 0 empty files would stay
    remaining_paths = {item.path for item in entries_of(store)}
    removed_sizes = [size for path, size in before.items() if path not in remaining_paths]
    return len(removed_sizes), sum(removed_sizes)


def _look(path: Path) -> Kept:
    about, state = None, SET_ASIDE
    with path.open("rb") as file:
        status = os.fstat(file.fileno())
        try:
            about = entry.read_about(file)
            if path.suffix == ENTRY:
                state = CURRENT if about.is_current else OTHER_CODE
        except entry.NewerFormatError:
            state = NEWER
        except entry.DamagedError:
            pass
    used = datetime.fromtimestamp(status.st_mtime, UTC).isoformat(timespec="seconds")
    return Kept(path.stem, path, status.st_size, used, state, about)
