"""Folder of stored maps and its size limit, from the environment variables."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from typing import Final

from ambinav.runtime.errors import InputError

VARIABLE: Final = "AMBINAV_CACHE"
"""Environment variable: the folder to keep maps in; empty: none are kept, all are computed."""
LIMIT_VARIABLE: Final = "AMBINAV_CACHE_LIMIT"
"""Environment variable: how much room kept maps may take, such as 500 MB or 20 GB."""
LIMIT: Final = 5_000_000_000
"""Bytes that kept maps may take where nobody says otherwise: some hundred maps of large floors."""

_UNITS: Final = {"": 1, "k": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}
_SIZE: Final = re.compile(r"(\d+(?:\.\d+)?) ?([kMGT]?)(B?)")
# Less than this without a unit is no number of bytes.
_BYTES: Final = 10**6


def cache_folder() -> Path | None:
    """Return ambinav's cache: $AMBINAV_CACHE, else `ambinav` in the user's cache.

    Returns:
        None if the variable is set and empty, or the user has no home. The folder need not exist.

    Raises:
        InputError: the variable is a URL.
    """
    chosen = os.environ.get(VARIABLE)
    if chosen is not None and "://" in chosen:
        raise InputError(
            f"{VARIABLE} is {chosen!r}, a URL, where nothing can be locked; name a folder, or "
            "leave it empty to keep no maps."
        )
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        if chosen is not None:
            return Path(chosen).expanduser() if chosen else None
        return (Path(base) if base else Path.home() / ".cache") / "ambinav"
    except RuntimeError:  # as in a container whose user nobody has entered
        return None


def size_limit() -> int:
    """Return the maximum size of stored maps, bytes: $AMBINAV_CACHE_LIMIT, else `LIMIT`.

    Raises:
        InputError: the variable is no size.
    """
    text = os.environ.get(LIMIT_VARIABLE)
    return LIMIT if not text else parse_size(text, LIMIT_VARIABLE)


def parse_size(text: str, source: str) -> int:
    """Parse bytes from a text such as `500 MB`, `2G` or `0`.

    Raises:
        InputError: it is none; the message begins with `source`.
    """
    match = _SIZE.fullmatch(text.strip())
    size = math.inf if match is None else float(match[1]) * _UNITS[match[2]]
    if math.isinf(size):
        raise InputError(f"{source}: {text!r} is not a size; give e.g. 500 MB or 2 GB.")
    if match is not None and not (match[2] or match[3]) and 0.0 < size < _BYTES:
        raise InputError(f"{source}: {text!r} has no unit; give e.g. {match[1]} GB.")
    return round(size)


def size_text(size: int) -> str:
    """Format a number of bytes in a suitable unit."""
    for unit in ("T", "G", "M", "k"):
        if size >= _UNITS[unit]:
            return f"{size / _UNITS[unit]:.3g} {unit}B"
    return f"{size} B"
