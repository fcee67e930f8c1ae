"""Provenance of a stored result: digests of the code and of the values it came from.

A result that is kept to be used again is named by digests of all that it depends on: the sources
of the whole distribution, the versions of the libraries that decide numbers, and its inputs by
their content. Whatever file is edited, and however a map is changed, nothing stale is found.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import importlib.metadata
import importlib.util
import json
import shutil
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from ambinav.runtime.errors import InputWarning
from ambinav.runtime.files import write_text
from ambinav.version import __version__

PACKAGES: Final = ("ambinav", "ambinav_envs", "ambinav_planners")
"""The import packages of the distribution."""
LIBRARIES: Final = ("numba", "numpy", "scipy", "shapely")
"""Distributions that decide the numbers of every result."""
PLANNING: Final = ("ompl",)
"""Further distributions that affect planned routes."""
POLICIES: Final = ("sb3-contrib", "stable-baselines3", "torch")
"""Further distributions that affect trained policies."""

STAMP: Final = "computed-by.json"
"""File in a folder of stored results that records the code and versions that computed them."""

# Suffixes of files that running the code, or an editor, creates.
_MADE: Final = (".pyc", ".pyo", ".nbi", ".nbc", ".orig", ".rej", ".swp", ".tmp", "~")


@functools.cache
def code_digest() -> str:
    """Compute the digest of all sources and package data of `PACKAGES`, in hexadecimal.

    It is worked out once in a process. It does not depend on where the packages lie, on how git
    writes line ends, nor on files that running the code leaves beside it, so that a wheel and the
    checkout that it was made of have the same one.
    """
    checksum = hashlib.sha256()
    for package in PACKAGES:
        for name, content in _sources(package):
            for part in (f"{package}/{name}".encode(), content):
                checksum.update(len(part).to_bytes(8, "big"))
                checksum.update(part)
    return checksum.hexdigest()


def _sources(package: str) -> Iterator[tuple[str, bytes]]:
    """Yield names, relative to the package, and contents of its files; none if not installed."""
    spec = importlib.util.find_spec(package)
    for place in (spec.submodule_search_locations or ()) if spec is not None else ():
        root = Path(place)
        files = {path.relative_to(root).as_posix(): path for path in root.rglob("*")}
        for name, path in sorted(files.items()):
            hidden = any(part.startswith((".", "__pycache__")) for part in name.split("/"))
            if hidden or name.endswith(_MADE) or not path.is_file():
                continue
            content = path.read_bytes()
            # Text is what has no zero byte, as git has it.
            yield name, content if b"\0" in content else content.replace(b"\r\n", b"\n")


@functools.cache
def library_version(name: str) -> str | None:
    """Return the version of an installed distribution; None if it is not installed."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def library_versions(names: Iterable[str]) -> dict[str, str]:
    """Return the versions of those of some distributions that are installed."""
    versions = {name: library_version(name) for name in names}
    return {name: version for name, version in versions.items() if version is not None}


@dataclasses.dataclass(frozen=True)
class Provenance:
    """Code and libraries that compute results.

    Attributes:
        ambinav: Version of ambinav.
        code: See `code_digest`.
        libraries: Versions of libraries, by name.
    """

    ambinav: str
    code: str
    libraries: Mapping[str, str]

    @classmethod
    def here(cls, *libraries: str) -> Provenance:
        """Return the provenance of this process: code, `LIBRARIES` and those named here."""
        versions = library_versions(sorted({*LIBRARIES, *libraries}))
        return cls(__version__, code_digest(), versions)

    @property
    def digest(self) -> str:
        """Single digest of the provenance."""
        return digest_of(self)

    def difference(self, other: Provenance) -> str | None:
        """Describe what `other` computed with and this does not; None: nothing that matters.

        A library that one of the two did without does not count.
        """
        if self.code != other.code:
            return (
                f"other code (ambinav {other.ambinav}, sources {other.code[:8]}; here "
                f"{self.ambinav}, {self.code[:8]})"
            )
        both = sorted(set(self.libraries) & set(other.libraries))
        changed = [
            f"{name} {other.libraries[name]} (here {self.libraries[name]})"
            for name in both
            if self.libraries[name] != other.libraries[name]
        ]
        return f"other libraries: {', '.join(changed)}" if changed else None


def discard_stale(folder: Path, here: Provenance, *, kept: Collection[str] = ()) -> None:
    """Empty a folder of stored results if other code computed them, and stamp it.

    Args:
        folder: It exists, and no other process is at work in it.
        here: What computes now.
        kept: Names of files in it that are no results.

    Warns:
        InputWarning: results are discarded; the message gives the folder and the reason.
    """
    stamp = folder / STAMP
    before, old = _read_stamp(stamp), [p for p in folder.iterdir() if p.name not in kept]
    if before is not None:
        why = here.difference(before)
        here = dataclasses.replace(here, libraries={**before.libraries, **here.libraries})
    else:
        why = "code that left no note of itself, as earlier versions of ambinav" if old else None
    if why is not None:
        results = [path for path in old if path != stamp]
        if results:
            warnings.warn(
                f"{folder}: the stored results were computed by {why}, so they are discarded and "
                "computed again.",
                InputWarning,
                stacklevel=2,
            )
        for path in results:
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
    write_text(stamp, json.dumps(dataclasses.asdict(here), indent=2) + "\n")


def _read_stamp(path: Path) -> Provenance | None:
    """Read the stamp of a folder; None if there is none or it cannot be read."""
    try:
        plain = json.loads(path.read_text(encoding="utf-8"))
        return Provenance(str(plain["ambinav"]), str(plain["code"]), dict(plain["libraries"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def digest_of(*values: object) -> str:
    """Compute the digest of plain values, arrays, geometries, dataclasses, mappings and rows.

    Returns:
        A hexadecimal string; the same in every process.

    Raises:
        TypeError: a value is of another type, so that nobody knows what makes it what it is.
    """
    checksum = hashlib.sha256()
    for part in _encoded(values):
        checksum.update(len(part).to_bytes(8, "big"))
        checksum.update(part)
    return checksum.hexdigest()


def _encoded(value: Any) -> Iterator[bytes]:
    """Yield the bytes of a value, which no other value has."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | complex | str):
        yield f"{type(value).__name__} {value!r}".encode(errors="surrogatepass")
    elif isinstance(value, bytes):
        yield b"bytes"
        yield value
    elif isinstance(value, Path):
        yield f"path {value.as_posix()}".encode(errors="surrogatepass")
    elif isinstance(value, np.ndarray) and not value.dtype.hasobject:
        yield f"array {value.dtype.descr} {value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, shapely.Geometry):
        yield b"geometry"
        yield shapely.to_wkb(value)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield f"{type(value).__qualname__} {len(dataclasses.fields(value))}".encode()
        for field in dataclasses.fields(value):
            yield field.name.encode()
            yield from _encoded(getattr(value, field.name))
    elif isinstance(value, Mapping):
        yield f"mapping {len(value)}".encode()
        for name in sorted(value, key=lambda item: (type(item).__name__, item)):
            yield from _encoded(name)
            yield from _encoded(value[name])
    elif isinstance(value, Sequence):
        yield f"row {len(value)}".encode()
        for item in value:
            yield from _encoded(item)
    else:
        raise TypeError(f"there is no digest of a {type(value).__name__}")
