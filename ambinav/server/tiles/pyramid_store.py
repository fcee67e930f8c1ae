"""Pyramids stored in the zarr store of their map, in a group beside its arrays.

    office.zarr/pyramid/<layer>/<mean|worst>/<k>     float32, blocks of 2^k x 2^k cells, k from 1

Rows run from the largest y downwards. The group is written beside the store and renamed into it,
so it is there whole or not at all; a map that is open meanwhile was read whole, and stays what it
is. Replacing the map replaces the folder, and its pyramid with it.
"""

from __future__ import annotations

import contextlib
import glob
import hashlib
import os
import shutil
import tempfile
import warnings
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

import numpy as np

from ambinav.server.tiles.pyramid import STATS, Pyramid, Values
from ambinav.store.build_lock import try_lock

GROUP: Final = "pyramid"
FORMAT: Final = 2
"""2: zones of judged floor."""


def key_of(store: Path) -> str | None:
    """Return the key of a store's map, which its pyramid must match; None if it is unreadable."""
    try:
        return hashlib.sha256((store / "zarr.json").read_bytes()).hexdigest()
    except OSError:
        return None


def load(store: Path, key: str, layer: str, base: Values) -> Pyramid | None:
    """Return the stored pyramid of a layer; None if it is missing or belongs to another map.

    Args:
        store: Store of the map.
        key: Key of the store when the map was read from it.
        layer: Layer of the map, or the walls.
        base: The layer itself, see `pyramid.floor_values`.
    """
    import zarr  # takes half a second: only when a pyramid is read or written

    try:
        group = zarr.open_group(store / GROUP, mode="r", use_consolidated=False)
        if group.attrs.get("key") != key or group.attrs.get("format") != FORMAT:
            return None
        depth = int(str(group.attrs["depth"]))
        mean, worst = (
            tuple(
                np.asarray(group[f"{layer}/{stat}/{k}"][...], dtype=np.float32)  # type: ignore[index]
                for k in range(1, depth + 1)
            )
            for stat in STATS
        )
    # Whatever zarr or a codec raises on a damaged group: it is made again.
    except Exception:
        return None
    return Pyramid(base, mean, worst)


def is_kept(store: Path, key: str) -> bool:
    """Return whether a store contains the pyramid of its map."""
    import zarr

    try:
        group = zarr.open_group(store / GROUP, mode="r", use_consolidated=False)
    except Exception:
        return False
    return group.attrs.get("key") == key and group.attrs.get("format") == FORMAT


def keep(store: Path, key: str, depth: int, made: Iterable[tuple[str, Pyramid]]) -> bool:
    """Write the pyramids of a map into its store.

    Args:
        store: Store of the map.
        key: Key of the store when the map was read from it.
        depth: Number of halvings of each layer.
        made: Layers and their pyramids; made while they are written.

    Returns:
        Whether they are there now; not where nothing can be written, the map was replaced, or
        another server is at it.
    """
    if not os.access(store, os.W_OK) or not os.access(store.parent, os.W_OK):
        return False
    # Written beside the store, so that no reader of the store finds an incomplete group.
    prefix = f".{store.name}.{GROUP}."
    lock = try_lock(store.with_name(f"{prefix}lock"))
    if lock is None:
        return False
    with lock:
        for left in store.parent.glob(f"{glob.escape(prefix)}*"):  # by one that was killed
            if left.is_dir():
                shutil.rmtree(left, ignore_errors=True)
        return _kept(store, key, depth, made, prefix)


def _kept(
    store: Path, key: str, depth: int, made: Iterable[tuple[str, Pyramid]], prefix: str
) -> bool:
    try:
        scratch = Path(tempfile.mkdtemp(prefix=prefix, dir=store.parent))
    except OSError:
        return False
    try:
        _write(scratch / GROUP, key, depth, made)
        if key_of(store) != key:
            return False
        return _replace_group(scratch, store / GROUP)
    except OSError:
        return False
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _write(path: Path, key: str, depth: int, made: Iterable[tuple[str, Pyramid]]) -> None:
    import zarr
    from zarr.codecs import ZstdCodec

    attributes: Mapping[str, str | int] = {"key": key, "format": FORMAT, "depth": depth}
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Consolidated metadata")
        group = zarr.open_group(path, mode="w", zarr_format=3, attributes=dict(attributes))
        for layer, pyramid in made:
            for stat in STATS:
                for k in range(1, depth + 1):
                    values = pyramid.at(k, stat)
                    group.create_array(
                        f"{layer}/{stat}/{k}",
                        data=values,
                        chunks=tuple(min(size, 1024) for size in values.shape),
                        compressors=[ZstdCodec(level=0, checksum=True)],
                    )


def _replace_group(scratch: Path, place: Path) -> bool:
    """Move the new group to its place; an outdated or damaged group is removed."""
    fresh = scratch / GROUP
    try:
        fresh.rename(place)
    except OSError:
        old = scratch / "old"
        with contextlib.suppress(FileNotFoundError):
            place.rename(old)
        fresh.rename(place)
    return True
