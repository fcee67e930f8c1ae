"""Files of ambiguity maps: a zarr store at any address, written and read completely or not."""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import math
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
import yaml

from ambinav.maps.address import ROOT, Address, reason_of
from ambinav.maps.schema import REQUIRED_ATTRS
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import holding_interrupts, replacing
from ambinav.runtime.input_suggestions import kind_of, kind_of_path, refuse

FORMAT: Final = 3
"""Format version that is written. 1 (stores without the attribute `map_format`) left out chunks
that held only the fill value, so that a lost chunk could not be distinguished from an empty one. In
2 and before, the zone of floor over all headings was that of mean radii.
"""
FORMAT_ATTR: Final = "map_format"
UNFINISHED: Final = "unfinished"
"""Attribute of a map that is being written: of what some parts are still to be made,"""
TILES: Final = "tiles"
"""by `ambinav map --tile`, or"""
LAYERS: Final = "layers"
"""in one piece."""

ATTEMPTS: Final = 5
"""A map that is replaced while it is read is read again, so many times in all."""
_TILE = 1024
"""Cells along the side of a stored chunk: 4 MiB of float32."""


def write(dataset: xr.Dataset, address: Address) -> None:
    """Write a dataset as a zarr store, replacing an older store.

    Every chunk is written and carries a checksum, so that a lost or damaged one is noticed. At a
    URL, where nothing can be renamed, it says of itself that it is unfinished until all is there.

    Raises:
        InputError: the place is not writable, or something that is not a store is there.
    """
    from zarr.codecs import ZstdCodec  # takes half a second: only when a map is written or read

    check_target(address)
    fresh = dataset.drop_encoding().assign_attrs({FORMAT_ATTR: FORMAT})
    encoding: dict[Any, dict[str, Any]] = {
        name: {"compressors": [ZstdCodec(level=0, checksum=True)]} for name in fresh.variables
    }
    for name, values in fresh.data_vars.items():
        if values.size:
            encoding[name]["chunks"] = tuple(min(size, _TILE) for size in values.shape)

    def put(part: xr.Dataset, store: Any, *, consolidated: bool) -> None:
        part.to_zarr(
            store,
            mode="w",
            consolidated=consolidated,
            zarr_format=3,
            encoding=encoding,
            write_empty_chunks=True,
        )

    with warnings.catch_warnings(), contextlib.ExitStack() as stack:
        # Consolidated metadata is read by xarray and Zarr-Python but not yet in the Zarr 3 text.
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        if address.folder is not None:
            scratch = stack.enter_context(replacing(address.folder.absolute()))
            # zarr writes in threads: left running, they would go on while the scratch is removed.
            with holding_interrupts():
                put(fresh, scratch, consolidated=True)
            return
        stack.enter_context(holding_interrupts())
        try:
            # What is there goes first, and may be what parts of the map are still to be read from.
            fresh = fresh.load()
            put(fresh.assign_attrs({UNFINISHED: LAYERS}), address.store(), consolidated=False)
            finish(address.store())
        # Whatever a file system raises: each has errors of its own.
        except Exception as error:
            raise InputError(
                f"{address}: the map cannot be written ({reason_of(error)}), and the incomplete "
                "store there is not a map; check your rights and the network, and save it again."
            ) from error


def finish(store: Any, attributes: Mapping[str, Any] | None = None) -> None:
    """Turn an unfinished store into an ordinary map, all of whose chunks exist.

    Args:
        store: The zarr store.
        attributes: Attributes of the map, in place of those that it has; None: they stay.
    """
    import zarr

    group = zarr.open_group(store, mode="r+", use_consolidated=False)
    attrs = dict(group.attrs) if attributes is None else dict(attributes)
    attrs.pop(UNFINISHED, None)
    group.attrs.put({**attrs, FORMAT_ATTR: FORMAT})
    zarr.consolidate_metadata(store, zarr_format=3)


def check_target(address: Address) -> None:
    """Check that only an older store is replaced, and that a URL is writable.

    Raises:
        InputError: a file is there, or a folder with something else in it, or the name is that of
            another kind of file; nothing can be written at the URL.
    """
    path = address.folder
    if path is None:
        address.check_writable()
        if (attributes_there(address) or {}).get(UNFINISHED) == TILES:
            raise InputError(
                f"{address}: tiles of a map that is being made are there, and are not "
                "replaced; remove them, or choose another output."
            )
        return
    if path.is_dir():
        attributes_there(address)
    elif path.exists():
        raise InputError(f"{path}: this is a file and is not replaced; choose another output.")
    if path.suffix not in ("", ".zarr"):
        raise InputError(
            f"{path}: a map is a folder, a zarr store; give a name that ends in .zarr."
        )


def attributes_there(address: Address) -> dict[str, Any] | None:
    """Return the attributes of the map, finished or not, at an address that is to be written to.

    Returns:
        None: the place is empty; an empty dictionary: a map was just begun.

    Raises:
        InputError: something else is there, such as a zarr store of another program.
    """
    root = address.read(ROOT)
    if root is None and address.answered(address.is_empty):
        return None
    try:
        metadata = _metadata(address, root or b"")
    except InputError:
        metadata = {}
    attributes: dict[str, Any] = metadata.get("attributes") or {}
    if FORMAT_ATTR in attributes or attributes.keys() >= {*REQUIRED_ATTRS}:
        return attributes
    # A map begins with a group that has no attributes yet.
    begun = not attributes and metadata.get("node_type") == "group"
    if begun and address.answered(address.names) == [ROOT]:
        return attributes
    raise InputError(
        f"{address}: this folder is not an ambiguity map and is not replaced; choose another "
        "output, e.g. one that ends in .zarr."
    )


def read(
    address: Address, *, bounds: tuple[float, float, float, float] | None = None, lazy: bool = False
) -> xr.Dataset:
    """Read a dataset into memory.

    If nothing else is asked for, it is read whole, not lazily: a map that is replaced while open
    would otherwise turn to NaN. One that is replaced meanwhile is read again.

    Args:
        address: Where the store is.
        bounds: (xmin, ymin, xmax, ymax), metres, of the cells that are read; None: all.
        lazy: Variables are read when they are first asked for, and kept.

    Raises:
        InputError: there is no readable zarr store, it is of a newer format, or a part of it is
            missing or damaged; the message names the file. A URL gives no answer, or nothing that
            is installed reads it. The bounds are none.
    """
    if bounds is not None:
        bounds = _checked_bounds(bounds)
    for attempts_left in reversed(range(ATTEMPTS)):
        before = _stamp(address)
        try:
            dataset = _read(address, bounds, lazy)
        except InputError:
            if not attempts_left or _stamp(address) == before:
                raise
        else:
            if lazy or _stamp(address) == before:
                return dataset
    raise InputError(
        f"{address}: the map was replaced {ATTEMPTS} times while it was read; wait for who writes "
        "it, and open it again."
    )


def _stamp(address: Address) -> object:
    """Return what is another one once the map has been replaced."""
    if address.folder is None:
        return address.read(ROOT)
    try:
        about = address.folder.stat()
    except OSError:
        return None
    return about.st_dev, about.st_ino


def _checked_bounds(bounds: Any) -> tuple[float, float, float, float]:
    refusal = InputError(f"bounds is {bounds!r}; give xmin, ymin, xmax and ymax in metres.")
    try:
        xmin, ymin, xmax, ymax = (float(value) for value in bounds)
    except (TypeError, ValueError):
        raise refusal from None
    if any(map(math.isnan, (xmin, ymin, xmax, ymax))):
        raise refusal
    return xmin, ymin, xmax, ymax


def _read(
    address: Address, bounds: tuple[float, float, float, float] | None, lazy: bool
) -> xr.Dataset:
    if address.folder is not None and not address.folder.exists():
        raise InputError(f"{address}: there is no such map; make one with `ambinav map`.")
    root = address.read(ROOT)
    if root is None:
        if address.folder is None:
            raise InputError(
                f"{address}: there is no ambiguity map, zarr.json is not there; check the "
                "address, or make one with `ambinav map`."
            )
        _refuse_other(address.folder)
        raise InputError(
            f"{address}: not an ambiguity map, it lacks zarr.json; make one with `ambinav map`."
        )
    metadata = _metadata(address, root)
    is_whole = _check_format(address, metadata)

    from ambinav.maps.chunk_check import ChunkCheck

    store = ChunkCheck(address.store(read_only=True), address, is_whole=is_whole)
    try:
        # What another program wrote may lack consolidated metadata, and over HTTP nothing can be
        # listed.
        opened = xr.open_zarr(
            store,
            chunks=None,
            consolidated=metadata.get("consolidated_metadata") is not None,
            zarr_format=3,
        )
        version = (metadata.get("attributes") or {}).get(FORMAT_ATTR, 1)
        if version < 3 and "theta" in opened.sizes:
            raise InputError(
                f"{address}: this map with headings is of an earlier ambinav, whose zones of floor "
                "differ from those of today's maps; make the map again."
            )
        if bounds is not None:
            opened = _within(opened, bounds, address)
        dataset: xr.Dataset = opened if lazy else opened.load()
    except InputError:
        raise
    # Whatever zarr or a codec raises on a damaged store is about the user's file.
    except Exception as error:
        culprit = _unreadable_file(address)
        reason = " ".join(str(error).split()).rstrip(".")
        raise InputError(
            f"{culprit or address}: the map cannot be read ({type(error).__name__}: {reason}); "
            "make it again."
        ) from error
    dataset.attrs.pop(FORMAT_ATTR, None)
    return dataset


def _within(
    dataset: xr.Dataset, bounds: tuple[float, float, float, float], address: Address
) -> xr.Dataset:
    """Return the cells whose centres lie in bounds."""
    xmin, ymin, xmax, ymax = bounds
    part = dataset.sel(x=slice(xmin, xmax), y=slice(ymin, ymax))
    if not (part.sizes["x"] and part.sizes["y"]):
        raise InputError(
            f"{address}: no cell of the map lies in the bounds {bounds}; it covers x from "
            f"{float(dataset['x'][0]):g} to {float(dataset['x'][-1]):g} and y from "
            f"{float(dataset['y'][0]):g} to {float(dataset['y'][-1]):g}."
        )
    return part


def _refuse_other(path: Path) -> None:
    """Raise `InputError` with the kind of a known file in the place of a store."""
    expected, remedy = "an ambiguity map", "make one of it with `ambinav map`"
    kind = kind_of_path(path)
    if kind is None and path.suffix.lower() in (".yaml", ".yml", ".json"):
        try:
            kind = kind_of(yaml.safe_load(path.read_text(encoding="utf-8")))
        except (OSError, ValueError, yaml.YAMLError):
            kind = None
    if kind is not None:
        building = kind.name in ("an occupancy map", "a floor plan")
        refuse(f"{path}", kind._replace(remedy=remedy) if building else kind, expected)


def _metadata(address: Address, root: bytes) -> dict[str, Any]:
    """Parse zarr.json.

    Raises:
        InputError: it is none of zarr's.
    """
    try:
        metadata = json.loads(root)
        if isinstance(metadata.get("attributes") or {}, dict):
            return dict(metadata)
        raise ValueError
    except (ValueError, AttributeError) as error:
        raise InputError(
            f"{address}/{ROOT}: the map cannot be read, this is not metadata of zarr; make the map "
            "again."
        ) from error


def _check_format(address: Address, metadata: Mapping[str, Any]) -> bool:
    """Return whether the store has a format whose chunks are all present.

    Raises:
        InputError: it is of a format that is newer than this program, or unfinished.
    """
    attributes = metadata.get("attributes") or {}
    version = attributes.get(FORMAT_ATTR, 1)
    if not isinstance(version, int) or version < 1:
        raise InputError(f"{address}: {FORMAT_ATTR} is {version!r}; make the map again.")
    if version > FORMAT:
        raise InputError(
            f"{address}: the map has format {version} (of ambinav "
            f"{attributes.get('ambinav_version', '?')}), and this ambinav "
            f"{importlib.metadata.version('ambinav')} reads formats up to {FORMAT}; install a "
            "newer ambinav, or make the map again."
        )
    if UNFINISHED in attributes:
        missing = attributes[UNFINISHED]
        remedy = (
            "give the same `ambinav map --tile` command again"
            if missing == TILES
            else "wait for who writes it, or save it again"
        )
        raise InputError(
            f"{address}: this map is not finished, some of its {missing} are still to be made; "
            f"{remedy}."
        )
    return version >= 2


def _unreadable_file(address: Address) -> str | None:
    """Return the unreadable file of a store, if it can be found."""
    import zarr  # see `write`

    store = address.store(read_only=True)
    try:
        names = sorted(zarr.open_group(store, mode="r").array_keys())
    except Exception:
        return None
    for name in names:
        try:
            array = zarr.open_array(store, path=name, mode="r")
        except Exception:
            return f"{address}/{name}/{ROOT}"
        for index in np.ndindex(array.cdata_shape):
            try:
                array.blocks[index]
            except Exception:
                return f"{address}/{name}/{array.metadata.encode_chunk_key(index)}"
    return None
