"""Ambiguity maps on disk: a zarr store, written whole or not at all."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import xarray as xr

from ambinav.errors import InputError
from ambinav.files import holding_interrupts, replacing

_TILE = 1024
"""Cells along the side of a stored chunk: 4 MiB of float32."""


def write(dataset: xr.Dataset, path: Path) -> None:
    """Write a dataset as a zarr store at `path`, replacing an older store.

    Raises:
        InputError: the place is not writable, or something that is not a store is there.
    """
    path = path.absolute()
    check_target(path)
    fresh = dataset.drop_encoding()
    encoding = {
        name: {"chunks": tuple(min(size, _TILE) for size in values.shape)}
        for name, values in fresh.data_vars.items()
        if values.size
    }
    with replacing(path) as scratch, warnings.catch_warnings():
        # Consolidated metadata is read by xarray and Zarr-Python but not yet in the Zarr 3 text.
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        # zarr writes in threads: left half-way, they would go on while the scratch is removed.
        with holding_interrupts():
            fresh.to_zarr(scratch, mode="w", consolidated=True, zarr_format=3, encoding=encoding)


def check_target(path: Path) -> None:
    """Refuse to replace anything but an older store.

    Raises:
        InputError: `path` is a file, or a folder with something else in it, or is called as if it
            were another kind of file.
    """
    if path.is_dir():
        if any(path.iterdir()) and not (path / "zarr.json").is_file():
            raise InputError(
                f"{path}: this folder is not an ambiguity map and is not replaced; "
                "choose another output, e.g. one that ends in .zarr."
            )
    elif path.exists():
        raise InputError(f"{path}: this is a file and is not replaced; choose another output.")
    if path.suffix not in ("", ".zarr"):
        raise InputError(
            f"{path}: a map is a folder, a zarr store; give a name that ends in .zarr."
        )


def read(path: Path) -> xr.Dataset:
    """Read a dataset into memory.

    It is read whole, not lazily: a map that is replaced while open would otherwise turn to NaN.

    Raises:
        InputError: there is no readable zarr store at `path`.
    """
    if not path.exists():
        raise InputError(f"{path}: there is no such map; make one with `ambinav map`.")
    if not (path / "zarr.json").is_file():
        raise InputError(
            f"{path}: not an ambiguity map, it lacks zarr.json; make one with `ambinav map`."
        )
    try:
        # Not from the consolidated metadata: locally that saves nothing, and stores that another
        # program wrote without are read as well.
        with xr.open_zarr(path, chunks=None, consolidated=False) as lazy:
            dataset: xr.Dataset = lazy.load()
            return dataset
    # Whatever zarr or a codec raises on a damaged store is about the user's file.
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, np.exceptions.AxisError) as e:
        raise InputError(
            f"{path}: the map cannot be read ({type(e).__name__}: {e}); make it again."
        ) from e
