"""Store of maps: a map that was computed before from the same input is opened instead."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.files import replacing
from ambinav.store import entry
from ambinav.store.build_lock import PATIENCE, build_lock, try_lock
from ambinav.store.settings import (
    LIMIT,
    LIMIT_VARIABLE,
    VARIABLE,
    cache_folder,
    size_limit,
    size_text,
)

MAPS: Final = "ambinav-maps"
"""Folder of the kept maps within $AMBINAV_CACHE, which may be any folder; this one is ours."""
TAG: Final = "CACHEDIR.TAG"
"""File that tells backups that the folder may be left out (bford.info/cachedir)."""
ENTRY, DAMAGED, LOCK = ".map", ".damaged", ".lock"
"""Suffixes of kept maps, of those that were set aside, and of the locks of those being made."""

# All names that are written here but the tag. Nothing else in the folder is ever touched.
_NAME: Final = re.compile(r"(?P<key>[0-9a-f]{32})(?P<suffix>\.map|\.damaged|\.lock)")
# What `replacing` makes beside an entry while it is written.
_SCRATCH: Final = re.compile(r"\.(?P<key>[0-9a-f]{32})\.map\.[0-9a-z_]{8}")
_TAG_TEXT: Final = """Signature: 8a477f597d28d172789f06886806bc55
# Maps that ambinav keeps so as not to compute them again; `ambinav store prune` removes them.
"""

# The folder is looked through about so many times until as much as the limit has been added.
_LOOKS: Final = 1000

Alive = Callable[[], None]


@dataclass(frozen=True)
class MapStore:
    """Maps stored in a folder, each under the digest of everything it depends on.

    Any number of processes may use one folder. Reading takes no lock; an entry appears and
    disappears as a whole. The remains of killed processes are removed when the folder is scanned.
    This happens when a map is stored, about once for each thousandth of the limit that is added:
    with every large map, and rarely with small ones, for which it would take longer than their
    computation.

    Attributes:
        folder: The folder, which need not exist. None: nothing is stored, and every map is
            computed.
        limit: Maximum size of all entries, bytes; the least recently used are removed first.
        notify: Called with a sentence about each action; None: it is not called.
        before_build: Called before a map is computed because it is not stored.
        patience: Seconds to wait for another process that computes the same map and gives no sign
            of life.
    """

    folder: Path | None
    limit: int = LIMIT
    notify: Callable[[str], None] | None = None
    before_build: Callable[[], None] | None = None
    patience: float = PATIENCE

    def __post_init__(self) -> None:
        """Take the name of a folder for it."""
        if self.folder is not None:
            object.__setattr__(self, "folder", Path(self.folder))

    @classmethod
    def of_user(
        cls,
        notify: Callable[[str], None] | None = None,
        before_build: Callable[[], None] | None = None,
    ) -> MapStore:
        """Return the user's store: in $AMBINAV_CACHE, or else in the user's cache folder.

        Raises:
            InputError: $AMBINAV_CACHE is a file, or $AMBINAV_CACHE_LIMIT no size.
        """
        folder = cache_folder()
        if folder is None:
            return cls(None, notify=notify, before_build=before_build)
        with contextlib.suppress(OSError):  # which is reported when the map cannot be kept
            if VARIABLE in os.environ and folder.exists() and not folder.is_dir():
                raise InputError(
                    f"{VARIABLE} is {str(folder)!r}, where no map can be kept, for it is a file; "
                    "name a folder, or leave it empty to keep none."
                )
        return cls(folder / MAPS, size_limit(), notify, before_build)

    def path(self, key: str) -> Path:
        """Return the file of a map, which may not exist.

        Raises:
            InputError: nothing is kept.
        """
        return self.place / f"{key}{ENTRY}"

    @property
    def place(self) -> Path:
        """Folder of the store.

        Raises:
            InputError: nothing is kept.
        """
        if self.folder is None:
            raise InputError(
                f"no map is kept: {VARIABLE} is empty, or there is no home; name a folder in it."
            )
        return self.folder

    def opened_or_built(
        self, key: str | None, build: Callable[[Alive], AmbiguityMap]
    ) -> tuple[AmbiguityMap, bool]:
        """Open a map, or build and store it.

        Where another process is building it, its map is waited for.

        Args:
            key: Digest of all that the map depends on; None: it is not kept.
            build: Builds the map; is given what is to be called now and then meanwhile.

        Returns:
            The map, and whether it was opened.

        Raises:
            Whatever `build` raises.

        Warns:
            InputWarning: an entry is damaged and set aside, is of a newer format, or the map cannot
                be kept.
        """
        if self.folder is None or key is None:
            return self._built(build, None), False
        stored = self._open(key)
        if stored is not None:
            return stored, True
        with contextlib.suppress(OSError):  # which is reported when the map cannot be kept
            self.folder.mkdir(parents=True, exist_ok=True)
            with contextlib.suppress(FileExistsError), (self.folder / TAG).open("x") as tag:
                tag.write(_TAG_TEXT)
        lock = self.folder / f"{key}{LOCK}"
        with build_lock(lock, self.patience, self._waiting) as alive:
            # The earlier holder of the lock has built it meanwhile.
            stored = self._open(key, set_aside=True)
            if stored is not None:
                return stored, True
            amap = self._built(build, alive)
            self._keep(key, amap, is_locked=alive is not None)
        return amap, False

    def _built(self, build: Callable[[Alive], AmbiguityMap], alive: Alive | None) -> AmbiguityMap:
        if self.before_build is not None:
            self.before_build()
        return build(alive or _no_sign_of_life)

    def _open(self, key: str, *, set_aside: bool = False) -> AmbiguityMap | None:
        """Return the stored map; None: there is none that can be used."""
        path = self.path(key)
        try:
            content = path.read_bytes()
        except OSError:
            return None
        try:
            amap = AmbiguityMap(entry.unpack(content, entry.check_whole(content, key)))
        except entry.NewerFormatError as error:
            if set_aside:
                warnings.warn(
                    f"{path}: this map was kept by a newer ambinav (format {error}), so it is left "
                    "alone and the map is computed again.",
                    InputWarning,
                    stacklevel=4,
                )
            return None
        except entry.DamagedError as error:
            if set_aside:
                aside = self.set_aside(key)
                warnings.warn(
                    f"{path}: this kept map is damaged ({error}), so it is set aside as "
                    f"{aside.name} and the map is computed again.",
                    InputWarning,
                    stacklevel=4,
                )
            return None
        with contextlib.suppress(OSError):  # of another user, or on a disk that is read only
            os.utime(path)
        return amap

    def note_opened(self, key: str, amap: AmbiguityMap) -> None:
        """Report that a map was opened, by the names of its building and scanner in this call."""
        if self.notify is not None:
            self.notify(
                f"the map of {amap.dataset.attrs['environment']} for "
                f"{amap.dataset.attrs['scanner']} is opened from the store ({self.path(key)})."
            )

    def set_aside(self, key: str) -> Path:
        """Rename a damaged entry, replacing an older one of that kind; return the new path."""
        aside = self.path(key).with_suffix(DAMAGED)
        with contextlib.suppress(OSError):  # it is gone, or of another user
            self.path(key).replace(aside)
        return aside

    def _keep(self, key: str, amap: AmbiguityMap, *, is_locked: bool) -> None:
        path = self.path(key)
        with contextlib.suppress(OSError, entry.NewerFormatError):
            if entry.read_format(path) > entry.FORMAT:
                return
        try:
            parts = entry.pack(amap.dataset, key)
            size = sum(map(len, parts))
            if size > self.limit:
                return self._not_kept(
                    f"it takes {size_text(size)}, and the limit is {size_text(self.limit)}",
                    f"raise {LIMIT_VARIABLE}",
                )
            # Make room first: a process killed in between leaves less than the limit, not more.
            is_due = self._is_due(key, size)
            if is_due:
                self._remove_leftovers(key if is_locked else None)
                # A hundredth is left for what is added until the next time.
                self._evict(self.limit - self.limit // 100 - size)
            with replacing(path) as fresh, fresh.open("xb") as file:
                file.writelines(parts)
            if is_due:
                self._evict(self.limit)  # others may have added maps meanwhile
        except (InputError, OSError) as error:
            # The sentence of an InputError without the file that it begins with, and its remedy.
            reason = str(error).partition(": ")[2].partition(";")[0]
            return self._not_kept(
                getattr(error.__cause__ or error, "strerror", None) or reason,
                f"set {VARIABLE} to a folder with room that is writable, or leave it empty",
            )
        except MemoryError:
            return self._not_kept("no memory is left to pack it", f"leave {VARIABLE} empty")

    def _not_kept(self, reason: str, remedy: str) -> None:
        warnings.warn(
            f"{self.place}: the map cannot be kept here ({reason}), so the next run computes it "
            f"again; {remedy}.",
            InputWarning,
            stacklevel=5,
        )

    def _is_due(self, key: str, size: int) -> bool:
        """Return whether to clean the folder before a map of this size is added.

        Its key decides: as digests are evenly distributed, it happens as often as it should,
        whichever processes add maps.
        """
        return int(key[:8], 16) / 16**8 * self.limit < _LOOKS * size

    def _waiting(self) -> None:
        if self.notify is not None:
            self.notify("another process computes this map; waiting for it.")

    # -- room --------------------------------------------------------------------------------

    def files(self) -> list[Path]:
        """List stored maps and those set aside, in the order in which they are removed.

        That is what was set aside, then what was not used for longest.
        """
        entries = [
            (item.name.endswith(ENTRY), status.st_mtime_ns, item.path)
            for item, status in self._entries()
        ]
        return [Path(path) for _, _, path in sorted(entries)]

    def make_room(self, limit: int) -> list[Path]:
        """Remove leftovers, and the first of `files` until at most `limit` bytes remain.

        What a newer ambinav keeps stays, and does not count.

        Returns:
            The entries that are gone.
        """
        self._remove_leftovers()
        return self._evict(limit)

    def _evict(self, limit: int) -> list[Path]:
        # Sizes first: to look into each file as well takes several times as long.
        if sum(status.st_size for _, status in self._entries()) <= limit:
            return []
        sizes: dict[Path, int] = {}
        for path in self.files():
            with contextlib.suppress(OSError):
                if entry.read_format(path) <= entry.FORMAT:
                    sizes[path] = path.stat().st_size
        total, removed = sum(sizes.values()), []
        for path, size in sizes.items():
            if total <= limit:
                break
            with contextlib.suppress(OSError):  # of another user, or on a disk that is read only
                path.unlink(missing_ok=True)
                removed.append(path)
                total -= size
        return removed

    def _remove_leftovers(self, locked: str | None = None) -> None:
        """Remove partly written files and locks of killed processes.

        Args:
            locked: The key whose lock is held here; of others it is done where nobody holds theirs.
        """
        leftovers: dict[str, list[str]] = {}
        for item in self._all():
            name, scratch = _NAME.fullmatch(item.name), _SCRATCH.fullmatch(item.name)
            if name is not None and name["suffix"] == LOCK:
                leftovers.setdefault(name["key"], [])
            elif scratch is not None and item.is_dir(follow_symlinks=False):
                leftovers.setdefault(scratch["key"], []).append(item.path)
        for key, paths in leftovers.items():
            lock = None if key == locked else try_lock(self.place / f"{key}{LOCK}")
            if key == locked or lock is not None:
                with lock or contextlib.nullcontext():
                    for path in paths:
                        shutil.rmtree(path, ignore_errors=True)

    def _entries(self) -> Iterator[tuple[os.DirEntry[str], os.stat_result]]:
        for item in self._all():
            name = _NAME.fullmatch(item.name)
            if name is not None and name["suffix"] != LOCK and item.is_file(follow_symlinks=False):
                with contextlib.suppress(OSError):  # another process removed it
                    yield item, item.stat()

    def _all(self) -> list[os.DirEntry[str]]:
        try:
            with os.scandir(self.place) as items:
                return list(items)
        except (FileNotFoundError, NotADirectoryError):
            return []


def _no_sign_of_life() -> None:
    """Do nothing: the sign of life where no lock is held."""
