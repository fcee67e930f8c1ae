"""Ambiguity maps kept on disk, so that a building that was met before costs milliseconds."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import warnings
import zipfile
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr

from ambinav.ambiguity.build import build_map
from ambinav.errors import InputError, InputWarning
from ambinav.files import replacing
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.content_digest import environment_digest
from ambinav.provenance import Provenance, digest_of
from ambinav.sensing.scanner import RangeScanner

VARIABLE: Final = "AMBINAV_CACHE"
"""Environment variable: the folder to keep maps in; empty: none are kept."""

OTHERS: Final = 3
"""Maps that other code made, in an older version or another checkout, are kept of so many."""

_ABOUT: Final = "about"
# What reading a damaged file raises.
_DAMAGED: Final = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile)


def cache_folder() -> Path | None:
    """The folder that maps are kept in: $AMBINAV_CACHE, else ambinav in the user's cache.

    Returns:
        None if the variable is set and empty. The folder need not exist.
    """
    chosen = os.environ.get(VARIABLE)
    if chosen is not None:
        return Path(chosen) if chosen else None
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "ambinav"


def map_of(
    environment: Environment,
    scanner: RangeScanner,
    *,
    spacing: float,
    layers: tuple[str, ...] = (),
    keep: bool = True,
) -> AmbiguityMap:
    """The ambiguity map of a building, read if it is kept and else built.

    A file that is damaged is made again. Several processes may build the same map at the same
    time; each file is replaced as a whole.

    Args:
        environment: The building.
        scanner: The scanner.
        spacing: Of the map's lattice, metres.
        layers: Layers beside those of every map.
        keep: Whether to read and write files at all.

    Raises:
        InputError: the map cannot be built, or $AMBINAV_CACHE is no folder to write in.

    Warns:
        InputWarning: the user's own cache is not writable, or what it holds is of other code alone.
    """
    folder = cache_folder() if keep else None
    path = None
    if folder is not None:
        path = code_folder(folder) / f"{checksum(environment, scanner, spacing, layers)}.npz"
        found = _read(path)
        if found is not None:
            return found
        _begin(path.parent)
    amap = build_map(environment, scanner, spacing=spacing, layers=layers)
    if path is not None:
        _write(amap, path)
    return amap


def code_folder(folder: Path) -> Path:
    """The folder within `folder` for the maps that this code makes, with these libraries."""
    return folder / "maps" / Provenance.here().digest[:16]


def _begin(folder: Path) -> None:
    """Before the first map of this code is kept: say so, and remove the oldest of other code."""
    if folder.exists():
        return
    times = {}
    with contextlib.suppress(OSError):
        for path in folder.parent.iterdir():
            # Another process may be removing it.
            with contextlib.suppress(OSError):
                times[path] = path.stat().st_mtime
    if not times:
        return
    warnings.warn(
        f"the maps kept in {folder.parent} were computed by other code or libraries than these, "
        "so maps are built anew.",
        InputWarning,
        stacklevel=3,
    )
    for path in sorted(times, key=times.__getitem__, reverse=True)[OTHERS:]:
        if path.is_dir():
            shutil.rmtree(path, ignore_errors=True)
        else:
            # Earlier versions kept all maps in one folder.
            with contextlib.suppress(OSError):
                path.unlink()


def checksum(
    environment: Environment, scanner: RangeScanner, spacing: float, layers: tuple[str, ...] = ()
) -> str:
    """What tells one map from another of the same code, as a hexadecimal string.

    It is made of the building's content and name, the scanner and the parameters.
    """
    names = (environment.name, environment.source)
    content = environment_digest(environment)
    return digest_of(content, names, _text_of(scanner), float(spacing), layers)[:32]


@lru_cache(maxsize=16)
def _text_of(scanner: RangeScanner) -> str:
    return scanner.to_yaml()


def _read(path: Path) -> AmbiguityMap | None:
    """The map in a file; None if there is none, or a damaged one."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            about = json.loads(str(stored[_ABOUT]))
            values = {
                name: (dims, stored[name], attrs)
                for name, (dims, attrs) in about["variables"].items()
            }
        coords = {name: values.pop(name) for name in about["coords"]}
        return AmbiguityMap(xr.Dataset(values, coords, about["attrs"]), source=str(path))
    except _DAMAGED:
        return None


def _write(amap: AmbiguityMap, path: Path) -> None:
    dataset = amap.dataset
    about = {
        "attrs": dataset.attrs,
        "coords": [str(name) for name in dataset.coords],
        "variables": {
            str(name): (values.dims, values.attrs) for name, values in dataset.variables.items()
        },
    }
    arrays: dict[str, Any] = {str(name): one.values for name, one in dataset.variables.items()}
    arrays[_ABOUT] = np.array(json.dumps(about))
    try:
        with replacing(path) as fresh, fresh.open("xb") as file:
            np.savez(file, **arrays)
    except (InputError, OSError) as error:
        if os.environ.get(VARIABLE):
            raise InputError(
                f"{VARIABLE} is {os.environ[VARIABLE]!r}, where no map can be kept ({error}); name "
                "a folder that is writable, or leave it empty to keep none."
            ) from error
        warnings.warn(
            f"no map can be kept in {path.parent}, so each is built anew ({error}); set {VARIABLE} "
            "to a folder that is writable, or leave it empty.",
            InputWarning,
            stacklevel=3,
        )
