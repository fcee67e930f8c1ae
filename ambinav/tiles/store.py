"""Zarr store to which any number of processes write tiles, each with a checksum.

    <store>/<layer>             arrays of the map, a chunk a tile
    <store>/tiles/record        of each tile SHA-256 and number of free points, 40 bytes; 0: none

The template comes first: all that is known before any tile is. A process then writes a tile's
chunks, and its record last, so that what a killed one leaves counts as not made.
"""

from __future__ import annotations

import contextlib
import hashlib
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from ambinav.maps import schema
from ambinav.maps.address import Address, reason_of
from ambinav.maps.judged_floor import LAYER as JUDGED
from ambinav.maps.judged_floor import FloorJudge
from ambinav.maps.store import FORMAT, FORMAT_ATTR, TILES, UNFINISHED, attributes_there, finish
from ambinav.maps.zones import NOT_FREE
from ambinav.runtime.array_types import Bools
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import holding_interrupts
from ambinav.tiles.job import Tile

if TYPE_CHECKING:
    import zarr

RECORD: Final = "record"
KEY: Final = "key"

_DIGEST: Final = 32
_LENGTH: Final = _DIGEST + 8


@dataclass(frozen=True)
class TileStore:
    """Store of a map that is made tile by tile.

    Attributes:
        address: Where it is.
        cells: Rows and columns of a tile.
    """

    address: Address
    cells: int

    @cached_property
    def _store(self) -> Any:
        return self.address.store()

    @cached_property
    def _group(self) -> zarr.Group:
        import zarr

        return zarr.open_group(self._store, mode="r+", use_consolidated=False)

    @cached_property
    def _lattice_arrays(self) -> dict[str, zarr.Array[Any]]:
        """Arrays over the lattice, by name; empty chunks are written too."""
        import zarr

        with zarr.config.set({"array.write_empty_chunks": True}):
            arrays = {
                name: array
                for name, array in zarr.open_group(
                    self._store, mode="r+", use_consolidated=False
                ).arrays()
                if tuple(array.metadata.dimension_names or ())[:2] == ("y", "x")  # type: ignore[union-attr]
            }
        return dict(sorted(arrays.items()))

    @property
    def _arrays(self) -> dict[str, zarr.Array[Any]]:
        """Arrays to which tiles are written."""
        return {name: array for name, array in self._lattice_arrays.items() if name != JUDGED}

    @cached_property
    def _record(self) -> zarr.Array[Any]:
        import zarr

        return zarr.open_array(self._store, path=f"{TILES}/{RECORD}", mode="r+")

    # -- template ----------------------------------------------------------------------------

    def key(self) -> str | None:
        """Return the key of the map that is being made, or was made, there.

        Returns:
            None: nothing is there; empty: a template that was not laid to its end.

        Raises:
            InputError: something else is there.
        """
        attributes = attributes_there(self.address)
        if attributes is None:
            return None
        import zarr

        with contextlib.suppress(FileNotFoundError, KeyError, ValueError):
            group = zarr.open_group(self._store, path=TILES, mode="r", use_consolidated=False)
            return str(group.attrs[KEY])
        if self.address.is_url and attributes and UNFINISHED not in attributes:
            raise InputError(
                f"{self.address}: a map is there that was not made in tiles, and it is not "
                "replaced; choose another output."
            )
        return ""

    def lay(
        self,
        key: str,
        shape: tuple[int, int],
        layers: Mapping[str, xr.DataArray],
        building: xr.Dataset,
    ) -> None:
        """Write everything except the tiles.

        Args:
            key: See `TilePlan.key`.
            shape: Rows and columns of the lattice.
            layers: Variables of some tile.
            building: Coordinates, attributes and all variables that are not over the lattice.
        """
        import zarr
        from zarr.codecs import ZstdCodec

        codec = ZstdCodec(level=0, checksum=True)
        small = xr.Dataset({n: v.isel(y=slice(1), x=slice(1)).variable for n, v in layers.items()})
        fresh = building.drop_encoding().assign_attrs({FORMAT_ATTR: FORMAT, UNFINISHED: TILES})
        memory = zarr.storage.MemoryStore()
        with warnings.catch_warnings(), holding_interrupts():
            warnings.filterwarnings("ignore", message="Consolidated metadata")
            small.to_zarr(memory, mode="w", consolidated=False, zarr_format=3)
            fresh.to_zarr(
                self._store,
                mode="w",
                consolidated=False,
                zarr_format=3,
                encoding={name: {"compressors": [codec]} for name in fresh.variables},
                write_empty_chunks=True,
            )
            for name, array in zarr.open_group(memory, mode="r").arrays():
                other_axes = array.shape[2:]
                zarr.create_array(
                    self._store,
                    name=name,
                    shape=(*shape, *other_axes),
                    chunks=(*(min(self.cells, n) for n in shape), *other_axes),
                    dtype=array.dtype,
                    fill_value=array.fill_value,
                    compressors=[codec],
                    attributes=dict(array.attrs),
                    dimension_names=array.metadata.dimension_names,  # type: ignore[union-attr]
                    zarr_format=3,
                )
            tiles = tuple(-(-n // self.cells) for n in shape)
            zarr.create_array(
                self._store,
                name=f"{TILES}/{RECORD}",
                shape=(*tiles, _LENGTH),
                chunks=(1, 1, _LENGTH),
                dtype="uint8",
                fill_value=0,
                compressors=None,
                zarr_format=3,
            )
            # The key is written last: a template without it is written again.
            group = zarr.open_group(self._store, path=TILES, mode="a", use_consolidated=False)
            group.attrs[KEY] = key

    # -- tiles -------------------------------------------------------------------------------

    def records(self) -> Bools:
        """Return which tiles have a record, shape (rows, columns) of tiles."""
        records = np.asarray(self._record[...])
        return np.asarray(records.any(axis=2))

    def write(self, tile: Tile, variables: Mapping[str, xr.DataArray]) -> int:
        """Write a tile, and then its record.

        Args:
            tile: The tile.
            variables: See `tile_variables`.

        Returns:
            Number of its free points.

        Raises:
            InputError: it cannot be written, for want of room say.
        """
        checksum = hashlib.sha256()
        free = 0
        try:
            # zarr writes in threads, which would go on without this one.
            with holding_interrupts():
                for name, array in self._arrays.items():
                    if name in variables:
                        values = variables[name].values.astype(array.dtype)
                    else:
                        values = np.full((*tile.shape, *array.shape[2:]), _empty(name, array.dtype))
                        values = values.astype(array.dtype)
                    if name == "free":
                        free = int(values.astype(np.bool_).sum())
                    array[tile.window] = values
                    _digest(checksum, name, values)
                record = checksum.digest() + free.to_bytes(8, "little")
                row, column = self._index(tile)
                self._record[row, column] = np.frombuffer(record, dtype=np.uint8)
        except Exception as error:
            if isinstance(error, OSError) or self.address.is_url:
                raise InputError(
                    f"{self.address}: a tile cannot be written ({reason_of(error)}); what was made "
                    "is kept: make room or check your rights, and give the same command again."
                ) from error
            raise
        return free

    def holds(self, tile: Tile) -> int | None:
        """Return the number of free points of a tile that is intact; None: it is not."""
        try:
            row, column = self._index(tile)
            record = np.asarray(self._record[row, column]).tobytes()
            checksum = hashlib.sha256()
            for name, array in self._arrays.items():
                chunk = array.metadata.encode_chunk_key((row, column, *([0] * (array.ndim - 2))))
                # For a lost chunk zarr reads the fill value.
                if not self.address.exists(f"{name}/{chunk}"):
                    return None
                _digest(checksum, name, np.asarray(array[tile.window]))
        # Whatever zarr or a codec raises on a damaged chunk: the tile is made again.
        except Exception:
            return None
        if checksum.digest() != record[:_DIGEST]:
            return None
        return int.from_bytes(record[_DIGEST:], "little")

    def finish(self, attributes: Mapping[str, Any], judge: FloorJudge) -> None:
        """Turn the store into an ordinary map, once all tiles are there.

        Args:
            attributes: Attributes of the map, in place of those that were laid.
            judge: What decides which floor counts, which no tile knows by itself.
        """
        self._judge(judge)
        folder = self.address.folder
        if folder is not None:
            for left in folder.rglob("*.partial"):  # by a process that was killed
                with contextlib.suppress(FileNotFoundError):
                    left.unlink()
        with warnings.catch_warnings(), holding_interrupts():
            warnings.filterwarnings("ignore", message="Consolidated metadata")
            finish(self._store, attributes)

    def _judge(self, judge: FloorJudge) -> None:
        """Write the layer of judged floor, tile by tile."""
        free, unknown = self._arrays["free"], self._arrays["unknown"]
        x, y = (np.asarray(self._group[axis][...]) for axis in ("x", "y"))  # type: ignore[index]
        judged = self._lattice_arrays[JUDGED]
        for low in range(0, free.shape[0], self.cells):
            for left in range(0, free.shape[1], self.cells):
                window = slice(low, low + self.cells), slice(left, left + self.cells)
                judged[window] = judge.codes(
                    np.asarray(free[window], dtype=np.bool_), np.asarray(unknown[window]),
                    x[window[1]], y[window[0]],
                )  # fmt: skip

    def attributes(self) -> dict[str, Any]:
        """Return the attributes of the map, as they were first written."""
        attributes = dict(self._group.attrs)
        for name in (FORMAT_ATTR, UNFINISHED):
            attributes.pop(name, None)
        return attributes

    def _index(self, tile: Tile) -> tuple[int, int]:
        return tile.rows[0] // self.cells, tile.columns[0] // self.cells

    def __getstate__(self) -> dict[str, Any]:
        """Return the constructor's arguments; each process opens the store for itself."""
        return {"address": self.address, "cells": self.cells}


def _digest(checksum: Any, name: str, values: NDArray[Any]) -> None:
    checksum.update(f"{name} {values.dtype.str} {values.shape}".encode())
    checksum.update(np.ascontiguousarray(values).tobytes())


def _empty(name: str, dtype: np.dtype[Any]) -> float:
    """Return the fill value of a layer where a robot cannot stand."""
    if dtype.kind == "f":
        return np.nan
    return NOT_FREE if schema.base_name(name) == "zone" else 0
