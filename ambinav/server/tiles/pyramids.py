"""The pyramids of a map's layers: computed or read on demand, stored beside the map."""

from __future__ import annotations

import contextlib
import threading
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.server.served import worse_end
from ambinav.server.tiles import pyramid_store
from ambinav.server.tiles.pyramid import WALLS, Pyramid, build, depth_of, floor_values

KEPT_BYTES: Final = 512 * 2**20
"""Most bytes of pyramids in memory; the least recently read ones are dropped first."""


class Pyramids:
    """The pyramids of a map's layers.

    Args:
        amap: The map.
        store: Store that it was read from; None: no store, nothing is kept on disk.
        key: Key of the store when the map was read, see `pyramid_store.key_of`.
    """

    def __init__(
        self, amap: AmbiguityMap, store: Path | None = None, key: str | None = None
    ) -> None:
        self.amap = amap
        rows, columns, _ = amap.possible.shape
        self.depth = depth_of((rows, columns))
        self._store, self._key = store, key
        self._cache: OrderedDict[tuple[str, int | None], Pyramid] = OrderedDict()
        self._lock = threading.Lock()

    def has(self, layer: str, heading: int | None) -> bool:
        """Return whether `get` returns at once."""
        return (layer, heading) in self._cache

    def get(self, layer: str, heading: int | None = None) -> Pyramid:
        """Return the pyramid of a layer, or of `WALLS`; at a heading if the layer has headings."""
        key = (layer, heading)
        pyramid = self._cache.get(key)
        if pyramid is not None:  # not behind the lock, which is held while another one is made
            with contextlib.suppress(KeyError):
                self._cache.move_to_end(key)
            return pyramid
        with self._lock:
            pyramid = self._cache.get(key)
            if pyramid is None:
                pyramid = self._cache[key] = self._find(layer, heading)
                while len(self._cache) > 1 and self._bytes() > KEPT_BYTES:
                    self._cache.popitem(last=False)
        return pyramid

    def keep(self, stop: threading.Event) -> bool:
        """Write the pyramids of all layers without headings into the map's store.

        Args:
            stop: Is set when there is no more time.

        Returns:
            Whether they are there.
        """
        if self._store is None or self._key is None or self.depth == 0:
            return False
        if pyramid_store.is_kept(self._store, self._key):
            return True
        return pyramid_store.keep(self._store, self._key, self.depth, self._all(stop))

    def _all(self, stop: threading.Event) -> Iterator[tuple[str, Pyramid]]:
        for layer in flat_layers(self.amap):
            if stop.is_set():
                raise InterruptedError
            yield layer, self._cache.get((layer, None)) or self._make(layer, None)

    def _find(self, layer: str, heading: int | None) -> Pyramid:
        if heading is None and self._store is not None and self._key is not None:
            base = floor_values(self.amap, layer, None)
            read = pyramid_store.load(self._store, self._key, layer, base)
            if read is not None and _is_consistent(read):
                return read
        return self._make(layer, heading)

    def _make(self, layer: str, heading: int | None) -> Pyramid:
        values = floor_values(self.amap, layer, heading)
        low = layer != WALLS and worse_end(self.amap, layer) == "low"
        return build(values, layer, low)

    def _bytes(self) -> int:
        # A copy, since `get` may change the dictionary during the iteration.
        return sum(pyramid.bytes for pyramid in tuple(self._cache.values()))


def _is_consistent(pyramid: Pyramid) -> bool:
    """Return whether every halving is half as large as the level before it."""
    rows, columns = pyramid.base.shape
    for mean, worst in zip(pyramid.mean, pyramid.worst, strict=True):
        rows, columns = (rows + 1) // 2, (columns + 1) // 2
        if mean.shape != (rows, columns) or worst.shape != (rows, columns):
            return False
    return True


def flat_layers(amap: AmbiguityMap) -> tuple[str, ...]:
    """Return the layers to store: those without headings, aggregates and the walls."""
    return (
        *(name for name in schema.layers(amap.dataset) if "theta" not in amap.dataset[name].dims),
        WALLS,
    )
