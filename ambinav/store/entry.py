"""Stored map: one file, with a checksum over all of it.

The file begins with a line of text: what it is, its format, and the SHA-256 of all that follows.
Then come eight bytes, the length of a JSON object; that object, which says what the map is and how
its variables are laid out; and the variables, each compressed in pieces. One file rather than a
zarr store's many: it comes and goes in one step, and a reader who has opened it keeps it.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ambinav.runtime.array_types import Bytes
from ambinav.runtime.provenance import Provenance

FORMAT: Final = 1
"""Format version of the files that are written."""

_NAME: Final = "ambinav-map"
_LINE: Final = re.compile(rb"ambinav-map ([1-9]\d{0,5}) ([0-9a-f]{64})\n")
_LONGEST_LINE: Final = 100
_LONGEST_ABOUT: Final = 100_000_000
# Attributes that `ambinav store` shows; every map that is built has them.
_SHOWN: Final = (
    "environment", "environment_source", "scanner", "parameters", "ambinav_version", "versions",
)  # fmt: skip
# Bytes of a variable that are compressed at a time; the compressor takes at most 2 GB.
_PIECE: Final = 1 << 28
# Level 1 packs twice as fast as level 0 (3), into as much (benchmarks/results/store-speed.md).
_LEVEL: Final = 1


class DamagedError(Exception):
    """Damaged file; the message says briefly what is wrong."""


class NewerFormatError(Exception):
    """File in a format newer than this program; the message names the format."""


@dataclass(frozen=True)
class About:
    """Header of a stored map's file.

    Attributes:
        key: What it was asked for with (`ambinav.map_building.stored.map_key`).
        code: Digest of what computed it (`Provenance.digest`).
        made: When, ISO 8601.
        attrs: The map's attributes.
        variables: Its variables in order: each name, dimensions, attributes, dtype, shape, and the
            lengths in bytes of its compressed pieces.
        coords: Names of those that are coordinates.
    """

    key: str
    code: str
    made: str
    attrs: dict[str, Any]
    variables: list[tuple[str, list[str], dict[str, Any], str, list[int], list[int]]]
    coords: list[str]

    @property
    def is_current(self) -> bool:
        """True if the code and libraries of this process would compute the same."""
        return self.code == Provenance.here().digest


def pack(dataset: xr.Dataset, key: str) -> list[bytes]:
    """Return a dataset as the pieces of a file, in order.

    Raises:
        TypeError: an attribute is nothing that JSON has.
    """
    from numcodecs.zstd import compress  # only when a map is kept

    laid_out: list[tuple[Any, ...]] = []
    parts: list[bytes] = []
    for name, variable in dataset.variables.items():
        values = np.ascontiguousarray(variable.values)
        pieces = [compress(piece, _LEVEL) for piece in _pieces(values)]
        parts += pieces
        lengths = [len(piece) for piece in pieces]
        # Not `values`: numpy makes a row of one that has no dimension.
        shape = list(variable.shape)
        dims = list(variable.dims)
        laid_out.append((str(name), dims, variable.attrs, values.dtype.str, shape, lengths))
    about = {
        "key": key,
        "code": Provenance.here().digest,
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "attrs": dataset.attrs,
        "variables": laid_out,
        "coords": [str(name) for name in dataset.coords],
    }
    text = json.dumps(about).encode()
    body = [len(text).to_bytes(8, "big"), text, *parts]
    return [f"{_NAME} {FORMAT} {_checksum(FORMAT, body)}\n".encode(), *body]


def read_about(file: BinaryIO) -> About:
    """Read the header of a map's file, without checking the checksum.

    Raises:
        DamagedError: it cannot be read.
        NewerFormatError: it is of a newer format.
        OSError: the file cannot be read.
    """
    _check_format(file.readline(_LONGEST_LINE))
    length = int.from_bytes(file.read(8), "big")
    if length > _LONGEST_ABOUT:
        raise DamagedError("its beginning cannot be read")
    about = _about(file.read(length))
    _check_shown(about)
    return about


def read_format(path: Path) -> int:
    """Return the format number in a file; 0: none.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        match = _LINE.fullmatch(file.readline(_LONGEST_LINE))
    return 0 if match is None else int(match[1])


def check_whole(content: bytes, key: str) -> About:
    """Check the content of a file against its checksum.

    Args:
        content: All of it.
        key: What it is kept as.

    Raises:
        DamagedError: a bit of it is not as it was written, or it was written as another.
        NewerFormatError: it is of a newer format.
    """
    end = content.find(b"\n", 0, _LONGEST_LINE) + 1
    checksum = _check_format(content[:end])
    body = memoryview(content)[end:]
    if _checksum(FORMAT, [body]) != checksum:
        raise DamagedError("its checksum does not match")
    length = int.from_bytes(body[:8], "big")
    about = _about(bytes(body[8 : 8 + length]))
    if about.key != key:
        raise DamagedError("it is another map under this name")
    return about


def unpack(content: bytes, about: About) -> xr.Dataset:
    """Return the dataset in the content of an intact file."""
    from numcodecs.zstd import decompress

    start = len(content) - sum(sum(lengths) for *_, lengths in about.variables)
    packed = memoryview(content)
    variables: dict[str, Any] = {}
    for name, dims, attrs, dtype, shape, lengths in about.variables:
        values = np.empty(shape, dtype)
        for piece, length in zip(_pieces(values), lengths, strict=True):
            decompress(packed[start : start + length], piece)
            start += length
        variables[name] = (tuple(dims), values, attrs)
    coords = {name: variables.pop(name) for name in about.coords}
    return xr.Dataset(variables, coords, about.attrs)


def cells(about: About) -> int:
    """Return the number of cells times headings of a map."""
    sizes = {name: math.prod(shape) for name, _, _, _, shape, _ in about.variables}
    return sizes.get("x", 0) * sizes.get("y", 0) * sizes.get("theta", 1)


def _pieces(values: NDArray[Any]) -> Iterator[Bytes]:
    """Yield the bytes of an array in writable pieces; none for an empty array."""
    flat = values.reshape(-1).view(np.uint8) if values.size else np.empty(0, np.uint8)
    for start in range(0, len(flat), _PIECE):
        yield flat[start : start + _PIECE]


def _checksum(version: int, body: list[Any]) -> str:
    """Compute SHA-256 of the format and everything after the first line."""
    checksum = hashlib.sha256(f"{_NAME} {version}\n".encode())
    for part in body:
        checksum.update(part)
    return checksum.hexdigest()


def _check_format(line: bytes) -> str:
    """Return the checksum in a file's first line."""
    match = _LINE.fullmatch(line)
    if match is None:
        raise DamagedError("its first line is missing")
    if int(match[1]) > FORMAT:
        raise NewerFormatError(int(match[1]))
    if int(match[1]) < FORMAT:
        raise DamagedError(f"its format {int(match[1])} is none")
    return match[2].decode()


def _about(text: bytes) -> About:
    try:
        plain = json.loads(text)
        plain["variables"] = [tuple(fields) for fields in plain["variables"]]
        return About(**plain)
    except (ValueError, TypeError, KeyError) as error:
        raise DamagedError("its beginning cannot be read") from error


def _check_shown(about: About) -> None:
    """Check the attributes that are shown: a changed bit may leave a header that JSON can read."""
    try:
        texts = {name: about.attrs[name] for name in _SHOWN}
        json.loads(texts["versions"])
        float(json.loads(texts["parameters"])["spacing"])
    except (ValueError, TypeError, KeyError) as error:
        raise DamagedError("its beginning cannot be read") from error
