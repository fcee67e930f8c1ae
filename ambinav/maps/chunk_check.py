"""Zarr store that raises an error where a part of a map is missing or unreadable."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Any, Final

from zarr.storage import WrapperStore

from ambinav.maps.address import Address, reason_of
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from zarr.abc.store import ByteRequest
    from zarr.core.buffer import Buffer, BufferPrototype

PATIENCE: Final = 60.0
"""Seconds in which a chunk must come from a URL."""


class ChunkCheck(WrapperStore[Any]):
    """Store of a map, all of whose chunks were written.

    zarr takes a chunk that is missing for one of the fill value: a map of which half was copied
    would be floor where nobody can stand.

    Args:
        store: The zarr store.
        address: Where it is.
        is_whole: Whether chunks that hold nothing were written too, see `maps.store.FORMAT`.
    """

    def __init__(self, store: Any, address: Address, *, is_whole: bool) -> None:
        super().__init__(store)
        self._address, self._is_whole = address, is_whole

    def _with_store(self, store: Any) -> ChunkCheck:
        return ChunkCheck(store, self._address, is_whole=self._is_whole)

    async def get(
        self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None
    ) -> Buffer | None:
        """Return the bytes of a file; None where there is none, unless it is a chunk.

        Raises:
            InputError: a chunk is missing, or a URL gives none.
        """
        request = super().get(key, prototype, byte_range)
        if self._address.is_url:
            try:
                content = await asyncio.wait_for(request, PATIENCE)
            # Whatever a file system raises: each has errors of its own.
            except Exception as error:
                raise InputError(
                    f"{self._address}/{key}: this part of the map cannot be read "
                    f"({reason_of(error)}); check your rights and the network."
                ) from error
        else:
            content = await request
        if content is None and self._is_whole and "c" in key.split("/")[1:2]:
            raise InputError(
                f"{self._address}/{key}: this part of the map is missing; copy the whole folder "
                "again, or make the map again."
            )
        return content
