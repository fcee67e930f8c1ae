"""Address of a map: a folder, or a URL that fsspec knows (`s3://maps/office.zarr`)."""

from __future__ import annotations

import os
import queue
import re
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path, PurePosixPath
from typing import Any, Final, TypeVar

from ambinav.runtime.errors import InputError
from ambinav.runtime.files import replacing

PATIENCE: Final = 6.0
"""Seconds in which what is at a URL must answer: clients of buckets try for minutes."""
BUCKETS: Final = frozenset({"s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl"})
"""Protocols without folders: to make one would make the bucket, of a name misspelt perhaps."""
LOCAL: Final = ("file://", "local://")
"""URLs that are but folders of this machine."""
ROOT: Final = "zarr.json"
"""File within a zarr store that describes it."""

T = TypeVar("T")


@dataclass(frozen=True)
class Address:
    """Address of a map.

    Attributes:
        place: Folder, or URL; what messages call it.
        options: Options of the file system of a URL (`storage_options`).
    """

    place: str
    options: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(cls, place: str | Path, options: Mapping[str, Any] | None = None) -> Address:
        """Parse the address that a caller gave."""
        text = str(place)
        for begin in LOCAL:
            text = text.removeprefix(begin)
        return cls(text, dict(options or {}))

    @property
    def is_url(self) -> bool:
        """True if fsspec reads and writes the address."""
        return "://" in self.place

    @property
    def folder(self) -> Path | None:
        """Folder of the map; None for a URL."""
        return None if self.is_url else Path(self.place)

    @property
    def stem(self) -> str:
        """Name without suffix."""
        if self.is_url:
            return PurePosixPath(self.place.partition("?")[0].rstrip("/")).stem
        return Path(self.place).resolve().stem

    @cached_property
    def files(self) -> tuple[Any, str]:
        """File system and root of a URL.

        Raises:
            InputError: nothing that is installed knows such a URL.
        """
        try:
            import fsspec

            system, root = fsspec.core.url_to_fs(self.place, **self.options)
        # Protocols are looked up with ValueError, and their packages with ImportError.
        except (ImportError, ValueError) as error:
            raise InputError(f"{self.place}: {_missing_package(error)}.") from error
        return system, str(root)

    def store(self, *, read_only: bool = False) -> Any:
        """Return the zarr store."""
        import zarr.storage  # takes half a second: only when a map is written or read

        if not self.is_url:
            return zarr.storage.LocalStore(self.place, read_only=read_only)
        _ = self.files  # says what is lacking
        return zarr.storage.FsspecStore.from_url(
            self.place, storage_options=dict(self.options), read_only=read_only
        )

    def read(self, key: str, patience: float | None = None) -> bytes | None:
        """Return the bytes of a file within the store; None: there is none.

        Args:
            key: Name of the file, with slashes.
            patience: Seconds in which a URL must have given all of it; None: `PATIENCE`.

        Raises:
            InputError: it cannot be read: no rights, nobody answers, no package for such a URL.
        """

        def read_file() -> bytes:
            if not self.is_url:
                return (Path(self.place) / key).read_bytes()
            system, root = self.files
            return bytes(system.cat_file(f"{root}/{key}"))

        try:
            return self.answered(read_file, patience) if self.is_url else read_file()
        except (FileNotFoundError, NotADirectoryError, IsADirectoryError) as error:
            if self.is_url and _is_about_bucket(error):
                raise InputError(
                    f"{self.place}: nothing can be read there ({reason_of(error)}); check the "
                    "address."
                ) from error
            return None
        except InputError:
            raise
        # Whatever a file system raises: each has errors of its own.
        except Exception as error:
            raise self._unreadable(error) from error

    def write(self, key: str, content: bytes) -> None:
        """Write a file within the store, completely or not at all, where its file system can.

        Raises:
            InputError: that is not possible.
        """
        try:
            if not self.is_url:
                with replacing(Path(self.place) / key) as fresh:
                    fresh.write_bytes(content)
                return
            system, root = self.files
            path = f"{root}/{key}"
            if self.place.partition("://")[0] not in BUCKETS:
                system.makedirs(path.rpartition("/")[0], exist_ok=True)
            system.pipe_file(path, content)
        except InputError:
            raise
        # Whatever a file system raises: each has errors of its own.
        except Exception as error:
            raise self._unwritable(error) from error

    def names(self) -> list[str]:
        """Return the names of all files, with slashes, sorted.

        Raises:
            InputError: they cannot be listed.
        """
        if not self.is_url:
            # What others remove meanwhile is passed over, which Path.rglob does not do.
            root = self.place
            paths = (Path(folder, name) for folder, _, names in os.walk(root) for name in names)
            return sorted(path.relative_to(root).as_posix() for path in paths if path.is_file())
        try:
            system, base = self.files
            return sorted(path.removeprefix(base).lstrip("/") for path in system.find(base))
        except InputError:
            raise
        # Whatever a file system raises: each has errors of its own.
        except Exception as error:
            raise self._unreadable(error) from error

    def exists(self, key: str) -> bool:
        """Return whether a file exists within the store."""
        if not self.is_url:
            return (Path(self.place) / key).is_file()
        system, root = self.files
        return bool(system.exists(f"{root}/{key}"))

    def is_empty(self) -> bool:
        """Return whether nothing is stored there."""
        if not self.is_url:
            folder = Path(self.place)
            return not folder.exists() or (folder.is_dir() and not any(folder.iterdir()))
        system, root = self.files
        return not system.exists(root) or not system.ls(root, detail=False)

    def check_writable(self) -> None:
        """Write a test file to a URL, and remove it.

        Raises:
            InputError: that is not possible, for want of rights say, or nobody answers.
        """

        def probe() -> None:
            system, root = self.files
            if self.place.partition("://")[0] not in BUCKETS:
                system.makedirs(root, exist_ok=True)
            system.pipe_file(f"{root}/.ambinav-probe", b"probe")
            system.rm_file(f"{root}/.ambinav-probe")

        try:
            self.answered(probe)
        except InputError:
            raise
        # Whatever a file system raises: each has errors of its own.
        except Exception as error:
            raise self._unwritable(error) from error

    def _unreadable(self, error: Exception) -> InputError:
        return InputError(
            f"{self.place}: nothing can be read there ({reason_of(error)}); check the address and "
            "your rights."
        )

    def _unwritable(self, error: Exception) -> InputError:
        return InputError(
            f"{self.place}: nothing can be written there ({reason_of(error)}); check the address "
            "and your rights, or choose another output."
        )

    def answered(self, ask: Callable[[], T], patience: float | None = None) -> T:
        """Return the result of a call to a URL's file system, if it comes in time.

        Raises:
            InputError: nobody answers.
            Exception: what the call raises.
        """
        patience = PATIENCE if patience is None else patience
        answers: queue.SimpleQueue[tuple[T | None, Exception | None]] = queue.SimpleQueue()

        def call() -> None:
            try:
                answers.put((ask(), None))
            except Exception as error:
                answers.put((None, error))

        threading.Thread(target=call, daemon=True).start()
        try:
            value, error = answers.get(timeout=patience)
        except queue.Empty:
            raise InputError(
                f"{self.place}: nobody answers there within {patience:g} s; check the address (of "
                "a server of your own AWS_ENDPOINT_URL) and the network, or name another place."
            ) from None
        if error is not None:
            raise error
        return value  # type: ignore[return-value]

    def __getstate__(self) -> dict[str, Any]:
        """Return the constructor's arguments; each process opens the address for itself."""
        return {"place": self.place, "options": dict(self.options)}

    def __str__(self) -> str:
        """Return the folder or URL."""
        return self.place


def reason_of(error: BaseException) -> str:
    """Return what went wrong, in a few words."""
    message = getattr(error, "strerror", None) or " ".join(str(error).split()).rstrip(".")
    return f"{type(error).__name__}: {message}"[:200] if message else type(error).__name__


def _is_about_bucket(error: OSError) -> bool:
    """Return whether s3fs, gcsfs or adlfs reports that the bucket does not exist."""
    return re.search(r"(bucket|container) does not exist", str(error)) is not None


def _missing_package(error: ImportError | ValueError) -> str:
    """Return which package to install for a URL, or that none reads it."""
    cause: BaseException | None = error
    while cause is not None:
        name = getattr(cause, "name", None)
        if isinstance(cause, ImportError) and name:
            package = str(name).partition(".")[0]
            return f'the package {package} reads and writes such URLs; run: pip install "{package}"'
        cause = cause.__cause__ or cause.__context__
    return f"nothing can be read or written there ({reason_of(error)}); check the address"
