"""Ambiguity maps kept on disk, so that a building that was met before costs milliseconds."""

from __future__ import annotations

import hashlib
import json
import os
import warnings
import zipfile
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely
import xarray as xr

from ambinav.ambiguity.build import build_map
from ambinav.compare.code import code_checksum
from ambinav.errors import InputError, InputWarning
from ambinav.files import replacing
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.sensing.scanner import RangeScanner

VARIABLE: Final = "AMBINAV_CACHE"
"""Environment variable: the folder to keep maps in; empty: none are kept."""

CODE: Final = (
    "ambiguity/**/*.py",
    "geometry/*.py",
    "localization/casting.py",
    "localization/information.py",
    "maps/*.py",
    "sensing/*.py",
)
"""Files of ambinav that a map depends on."""

_ABOUT: Final = "about"
# What reading a damaged file raises.
_DAMAGED: Final = (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile)


def cache_folder() -> Path | None:
    """The folder that maps are kept in: $AMBINAV_CACHE, else ambinav in the user's cache.

    Returns:
        None if the variable is set and empty. The folder need not exist.
    """
    told = os.environ.get(VARIABLE)
    if told is not None:
        return Path(told) if told else None
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
        InputWarning: the user's own cache is not writable.
    """
    folder = cache_folder() if keep else None
    path = None
    if folder is not None:
        path = folder / "maps" / f"{checksum(environment, scanner, spacing, layers)}.npz"
        found = _read(path)
        if found is not None:
            return found
    amap = build_map(environment, scanner, spacing=spacing, layers=layers)
    if path is not None:
        _write(amap, path)
    return amap


def checksum(
    environment: Environment, scanner: RangeScanner, spacing: float, layers: tuple[str, ...] = ()
) -> str:
    """What tells one map from another, as a hexadecimal string.

    It is made of the building's geometry and name, the scanner, the parameters and the code.
    """
    told = [
        environment.name, str(environment.source or ""), environment.checksum, environment.map_std,
        _text_of(scanner), spacing, layers, code_checksum(CODE),
    ]  # fmt: skip
    digest = hashlib.sha256(json.dumps(told).encode())
    digest.update(environment.segments.xy.tobytes())
    digest.update(environment.segments.kind.tobytes())
    digest.update(shapely.to_wkb(environment.free))
    if environment.drivable is not None:
        digest.update(shapely.to_wkb(environment.drivable))
    return digest.hexdigest()[:32]


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
