"""Zip files from untrusted sources: few known members, read within limits, never unpacked."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Final

from ambinav.runtime.errors import InputError

MEBIBYTE: Final = 1 << 20
LARGEST: Final = 256 * MEBIBYTE
"""Maximum size of a file, bytes."""
DIRECTORY: Final = 64 * 1024
"""Maximum size of the list of a file's members, bytes: Python reads all of it at once."""
DATE: Final = (1980, 1, 1, 0, 0, 0)
"""Date of the members that we write, so that equal content gives an equal file."""

UNREADABLE: Final = (
    OSError, EOFError, ValueError, KeyError, RuntimeError, zlib.error, zipfile.BadZipFile,
)  # fmt: skip
"""Errors that reading a damaged zip file may raise; RuntimeError: a bit says that it is encrypted,
or packed in an unknown way."""

_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_END = 22
_END_64 = 20


def read_archive(
    path: Path, sizes: Mapping[str, int], unread: Collection[str] = ()
) -> dict[str, bytes]:
    """Read the members of a zip file.

    Args:
        path: The file.
        sizes: Members that are read if they are there, with the most bytes that each may have.
        unread: Members that may be there too, and are not looked into.

    Raises:
        InputError: there is no such file, it is damaged, larger than it may be, or has another
            member, or one twice.
    """
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; give a policy's .zip file.")
    try:
        if path.stat().st_size > LARGEST:
            raise InputError(
                f"{path}: the file has more than {LARGEST // MEBIBYTE} MiB; policies are smaller."
            )
        _check_directory(path)
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            _check_members(path, members, sizes, unread)
            return {
                member.filename: _content(archive, member)
                for member in members
                if member.filename in sizes
            }
    except InputError:
        raise
    except UNREADABLE as error:
        raise InputError(
            f"{path}: this is not a policy file, or a damaged one ({error}); copy or train it "
            "again."
        ) from error


def write_archive(path: Path, members: Mapping[str, bytes]) -> None:
    """Write a zip file; the same members give the same bytes."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for name, content in members.items():
            out.writestr(zipfile.ZipInfo(name, DATE), content, zipfile.ZIP_DEFLATED)


def _check_directory(path: Path) -> None:
    """Check the list of members before Python creates objects for all of them."""
    with path.open("rb") as file:
        size = file.seek(0, io.SEEK_END)
        file.seek(max(size - _END - _END_64, 0))
        tail = file.read()
    end, before = tail[-_END:], tail[:-_END]
    if end[:4] != b"PK\x05\x06" or before[:4] == b"PK\x06\x07":
        raise zipfile.BadZipFile("its end is none of a small zip file")
    if int.from_bytes(end[12:16], "little") > DIRECTORY:
        raise InputError(f"{path}: it has far more members than a policy file; train it again.")


def _check_members(
    path: Path, members: list[zipfile.ZipInfo], sizes: Mapping[str, int], unread: Collection[str]
) -> None:
    seen: set[str] = set()
    for member in members:
        name = member.filename
        if name in seen:
            raise InputError(f"{path}: the member {name!r} is given twice; save the policy again.")
        seen.add(name)
        if name not in sizes and name not in unread:
            raise InputError(
                f"{path}: the member {name!r} has no place in a policy file; save the policy again."
            )
        if name not in sizes:
            continue
        if member.compress_type not in _PACKINGS:
            raise InputError(
                f"{path}: the member {name!r} is packed in an unknown way; save it again."
            )
        if member.file_size > sizes[name]:
            raise InputError(
                f"{path}: the member {name!r} has {member.file_size:,} bytes, more than "
                f"{sizes[name]:,}; train a smaller policy."
            )


def _content(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    with archive.open(member) as file:
        # Bounded: without a number all is unpacked before it is cut to the size that it claims.
        content = file.read(member.file_size)
    if len(content) != member.file_size:
        raise EOFError(f"the member {member.filename!r} ends too early")
    return content
