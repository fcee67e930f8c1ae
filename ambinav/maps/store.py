"""Ambiguity maps on disk: a zarr store, written and read whole or not at all."""

from __future__ import annotations

import importlib.metadata
import json
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr
import yaml

from ambinav.errors import InputError
from ambinav.files import holding_interrupts, replacing
from ambinav.mistaken import kind_of, kind_of_path, refuse

if TYPE_CHECKING:
    import zarr

FORMAT: Final = 2
"""Of what is written here. 1 (stores without the attribute `map_format`) left out chunks that held
nothing but the fill value, so that a lost chunk could not be distinguished from an empty one."""
FORMAT_ATTR: Final = "map_format"
UNFINISHED: Final = "unfinished"
"""Attribute of a map some of whose tiles are still to be made."""

_TILE = 1024
"""Cells along the side of a stored chunk: 4 MiB of float32."""


def write(dataset: xr.Dataset, path: Path) -> None:
    """Write a dataset as a zarr store at `path`, replacing an older store.

    Every chunk is written and carries a checksum, so that a lost or damaged one is noticed.

    Raises:
        InputError: the place is not writable, or something that is not a store is there.
    """
    from zarr.codecs import ZstdCodec  # takes half a second: only when a map is written or read

    path = path.absolute()
    check_target(path)
    fresh = dataset.drop_encoding().assign_attrs({FORMAT_ATTR: FORMAT})
    encoding: dict[Any, dict[str, Any]] = {
        name: {"compressors": [ZstdCodec(level=0, checksum=True)]} for name in fresh.variables
    }
    for name, values in fresh.data_vars.items():
        if values.size:
            encoding[name]["chunks"] = tuple(min(size, _TILE) for size in values.shape)
    with replacing(path) as scratch, warnings.catch_warnings():
        # Consolidated metadata is read by xarray and Zarr-Python but not yet in the Zarr 3 text.
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        # zarr writes in threads: left running, they would go on while the scratch is removed.
        with holding_interrupts():
            fresh.to_zarr(
                scratch,
                mode="w",
                consolidated=True,
                zarr_format=3,
                encoding=encoding,
                write_empty_chunks=True,
            )


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


def read(
    path: Path, *, bounds: tuple[float, float, float, float] | None = None, lazy: bool = False
) -> xr.Dataset:
    """Read a dataset into memory.

    If nothing else is asked for, it is read whole, not lazily: a map that is replaced while open
    would otherwise turn to NaN.

    Args:
        path: Folder of the store.
        bounds: (xmin, ymin, xmax, ymax), metres, of the cells that are read; None: all.
        lazy: Variables are read when they are first asked for, and kept.

    Raises:
        InputError: there is no readable zarr store at `path`, it is of a newer format, or a part
            of it is missing or damaged; the message names the file.
    """
    if not path.exists():
        raise InputError(f"{path}: there is no such map; make one with `ambinav map`.")
    root = path / "zarr.json"
    if not root.is_file():
        _refuse_other(path)
        raise InputError(
            f"{path}: not an ambiguity map, it lacks zarr.json; make one with `ambinav map`."
        )
    checked = _check_format(path, root)
    import zarr  # see `write`

    try:
        # Not from the consolidated metadata: locally that saves nothing, and stores that another
        # program wrote without are read as well.
        group = zarr.open_group(path, mode="r", use_consolidated=False)
        if checked:
            _check_chunks(path, group)
        opened = xr.open_zarr(path, chunks=None, consolidated=False)
        if bounds is not None:
            opened = _within(opened, bounds, path)
        dataset: xr.Dataset = opened if lazy else opened.load()
    except InputError:
        raise
    # Whatever zarr or a codec raises on a damaged store is about the user's file.
    except Exception as error:
        culprit = _culprit(path)
        reason = " ".join(str(error).split()).rstrip(".")
        raise InputError(
            f"{culprit or path}: the map cannot be read ({type(error).__name__}: {reason}); "
            "make it again."
        ) from error
    dataset.attrs.pop(FORMAT_ATTR, None)
    return dataset


def _within(
    dataset: xr.Dataset, bounds: tuple[float, float, float, float], path: Path
) -> xr.Dataset:
    """The cells whose centres lie in bounds."""
    xmin, ymin, xmax, ymax = bounds
    part = dataset.sel(x=slice(xmin, xmax), y=slice(ymin, ymax))
    if not (part.sizes["x"] and part.sizes["y"]):
        raise InputError(
            f"{path}: no cell of the map lies in the bounds {bounds}; it covers x from "
            f"{float(dataset['x'][0]):g} to {float(dataset['x'][-1]):g} and y from "
            f"{float(dataset['y'][0]):g} to {float(dataset['y'][-1]):g}."
        )
    return part


def _refuse_other(path: Path) -> None:
    """Say what is in the place of a store, if it is known."""
    wanted, remedy = "an ambiguity map", "make one of it with `ambinav map`"
    found = kind_of_path(path)
    if found is None and path.suffix.lower() in (".yaml", ".yml", ".json"):
        try:
            found = kind_of(yaml.safe_load(path.read_text(encoding="utf-8")))
        except (OSError, ValueError, yaml.YAMLError):
            found = None
    if found is not None:
        building = found.name in ("an occupancy map", "a floor plan")
        refuse(f"{path}", found._replace(remedy=remedy) if building else found, wanted)


def _check_format(path: Path, root: Path) -> bool:
    """Whether the store is of a format whose chunks are all there.

    Raises:
        InputError: it is of a format that is newer than this program.
    """
    try:
        attributes = json.loads(root.read_bytes()).get("attributes") or {}
        version = attributes.get(FORMAT_ATTR, 1)
    except (OSError, ValueError, AttributeError) as error:
        raise InputError(
            f"{root}: the map cannot be read, this is no metadata of zarr; make the map again."
        ) from error
    if not isinstance(version, int) or version < 1:
        raise InputError(f"{path}: {FORMAT_ATTR} is {version!r}; make the map again.")
    if version > FORMAT:
        raise InputError(
            f"{path}: the map has format {version} (of ambinav "
            f"{attributes.get('ambinav_version', '?')}), and this ambinav "
            f"{importlib.metadata.version('ambinav')} reads formats up to {FORMAT}; install a "
            "newer ambinav, or make the map again."
        )
    if UNFINISHED in attributes:
        raise InputError(
            f"{path}: this map is not finished, some of its {attributes[UNFINISHED]} are still to "
            "be made; give the same `ambinav map --tile` command again."
        )
    return version >= 2


def _chunk_file(path: Path, name: str, array: zarr.Array[Any], index: tuple[int, ...]) -> Path:
    return path / name / array.metadata.encode_chunk_key(index)


def _check_chunks(path: Path, group: zarr.Group) -> None:
    """Check that every chunk is there; zarr takes a missing one for the fill value.

    Raises:
        InputError: one is missing.
    """
    for name, array in group.arrays():
        for index in np.ndindex(array.cdata_shape):
            file = _chunk_file(path, name, array, index)
            if not file.is_file():
                raise InputError(
                    f"{file}: this part of the map is missing; copy the whole folder again, or "
                    "make the map again."
                )


def _culprit(path: Path) -> Path | None:
    """The file of a store that cannot be read, if it can be found."""
    import zarr  # see `write`

    for metadata in sorted(path.glob("*/zarr.json")):
        name = metadata.parent.name
        try:
            array = zarr.open_array(path / name, mode="r")
        except Exception:
            return metadata
        for index in np.ndindex(array.cdata_shape):
            try:
                array.blocks[index]
            except Exception:
                return _chunk_file(path, name, array, index)
    return None
