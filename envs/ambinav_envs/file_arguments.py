"""Arguments of an environment that name files: its map and its scanner."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

_NAMING: Final = ("map", "scanner")
_FILE: Final = "file"
"""Key of the file in a map that is given with how it is read, see `map_file.MapFile`."""


def with_absolute_files(arguments: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return arguments with the names of files that are there made absolute.

    Args:
        arguments: Arguments of an environment.
        folder: Folder to which the names are relative.
    """
    resolved = dict(arguments)
    for key in (*_NAMING, _FILE):
        name = resolved.get(key)
        if isinstance(name, Mapping):
            resolved[key] = with_absolute_files(name, folder)
        elif isinstance(name, str) and Path(name).suffix and (folder / name).is_file():
            resolved[key] = str((folder / name).resolve())
    return resolved


def files_of(arguments: Mapping[str, Any]) -> dict[str, str]:
    """Return the files with absolute names, by the argument that names them."""
    files = {}
    for key in _NAMING:
        value = arguments.get(key)
        name = value.get(_FILE) if isinstance(value, Mapping) else value
        if isinstance(name, str) and Path(name).is_absolute():
            files[key] = name
    return files
