"""The served maps: each with its name, its services, and data about its floor."""

from __future__ import annotations

import math
import re
import threading
from collections import OrderedDict
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np

from ambinav.config import nearest
from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.content_digest import map_digest
from ambinav.maps.zones import ZONES
from ambinav.runtime.array_types import Bools, Bytes, Floats
from ambinav.sensing.scanner import RangeScanner
from ambinav.server.problems import Problem
from ambinav.service.service import AmbiguityService

DEFAULT_WEIGHT: Final = 5.0
"""Default weight of the cost, as in `AmbiguityService`."""
KEPT_SERVICES: Final = 6
"""Services of a map, by layer and weight, that are kept; each holds three copies of a layer."""

MARK: Final = "--"
"""In the name of an edited map, between the original's name and its own; `slug` makes no such."""

REASONS: Final = (None, "outside", "wall", "unknown")
"""Reasons why there is no value at a pose, by the codes of `ServedMap.why`."""
OUTSIDE, WALL, UNKNOWN = 1, 2, 3


class ServedMap:
    """A served ambiguity map and its name.

    Args:
        name: Name in addresses: lower-case letters, digits and dashes.
        amap: The map.
        path: The store that it was opened from, in which its pyramid is kept; None: nowhere.
        key: Key of the store when it was opened, see `pyramid_store.key_of`.
        title: Name for people.
    """

    def __init__(
        self,
        name: str,
        amap: AmbiguityMap,
        title: str,
        path: Path | None = None,
        key: str | None = None,
    ) -> None:
        self.name = name
        self.amap = amap
        self.title = title
        self.path = path
        self.key = key
        self._services: OrderedDict[tuple[str, float], AmbiguityService] = OrderedDict()
        self._lock = threading.Lock()

    def has_service(self, layer: str | None, weight: float) -> bool:
        """Return whether `service` returns at once."""
        return (layer or self.amap.cost_layer, weight) in self._services

    def service(self, layer: str | None = None, weight: float = DEFAULT_WEIGHT) -> AmbiguityService:
        """Return the service of a layer (None: the cost layer) at a weight; created once and kept.

        Raises:
            InputError: there is no such layer, it is no cost, or the weight is no weight.
        """
        key = (layer or self.amap.cost_layer, weight)
        service = self._services.get(key)
        if service is not None:
            return service
        with self._lock:
            if key in self._services:
                return self._services[key]
            same_layer = next(
                (s for (name, _), s in self._services.items() if name == key[0]), None
            )
            made = (
                AmbiguityService(self.amap, key[0], weight)
                if same_layer is None
                else same_layer.with_weight(weight)
            )
            self._services[key] = made
            while len(self._services) > KEPT_SERVICES:
                self._services.popitem(last=False)
        return made

    @cached_property
    def scanner(self) -> RangeScanner:
        """The scanner of the map.

        Raises:
            Problem: the map was made before scanners were kept with maps.
        """
        text = self.amap.dataset.attrs.get("scanner_yaml")
        if not text:
            raise Problem(404, "The map does not contain its scanner; build it again.")
        return RangeScanner.from_yaml_text(str(text), file=f"scanner of {self.name}")

    @cached_property
    def digest(self) -> str:
        """Digest of the map's content, hexadecimal; it takes a moment for a large map."""
        return map_digest(self.amap)[:32]

    @cached_property
    def _codes(self) -> Bytes:
        """0 for free cells, otherwise WALL or UNKNOWN, shape (ny, nx)."""
        codes = np.where(self.amap.solid, WALL, UNKNOWN).astype(np.uint8)
        codes[np.asarray(self.amap.dataset["free"].values, dtype=np.bool_)] = 0
        return codes

    def why(self, x: Floats, y: Floats) -> Bytes:
        """Return codes of `REASONS` that explain missing values at points, each of shape (N,).

        0 on free floor, where a value may be missing at a heading alone: there the robot
        collides with a wall.
        """
        xmin, ymin, xmax, ymax = self.amap.bounds
        ny, nx = self._codes.shape
        inside = (x >= xmin) & (x < xmax) & (y >= ymin) & (y < ymax)
        column = ((np.where(inside, x, xmin) - xmin) / (xmax - xmin) * nx).astype(np.intp)
        row = ((np.where(inside, y, ymin) - ymin) / (ymax - ymin) * ny).astype(np.intp)
        codes = self._codes[np.minimum(row, ny - 1), np.minimum(column, nx - 1)]
        return np.where(inside, codes, OUTSIDE).astype(np.uint8)

    def reasons(self, x: Floats, y: Floats, missing: Bools) -> list[str | None]:
        """Return for each pose why there is no value, None where there is one."""
        out: list[str | None] = [None] * len(missing)
        where = np.flatnonzero(missing)
        codes = self.why(x[where], y[where])
        codes[codes == 0] = WALL
        for i, code in zip(where.tolist(), codes.tolist(), strict=True):
            out[i] = REASONS[code]
        return out

    def around(self, x: float, y: float) -> AmbiguityMap:
        """Return the cells around a point as a small map, so that no layer is copied whole."""
        data, amap = self.amap.dataset, self.amap
        xs, ys = data["x"].values, data["y"].values
        column, row = (
            int(np.clip(np.searchsorted(values, at) - 2, 0, max(values.size - 4, 0)))
            for values, at in ((xs, x), (ys, y))
        )
        part = data.isel(x=slice(column, column + 4), y=slice(row, row + 4))
        return AmbiguityMap(part, source=amap.source)


def digest_of_map(served: ServedMap) -> str:
    """Return `ServedMap.digest`."""
    return served.digest


class ServedMaps:
    """All served maps, by name.

    Edited maps are found by their names, but are not listed: each is its visitor's own business.
    """

    def __init__(self) -> None:
        self._maps: dict[str, ServedMap] = {}
        self._edited: OrderedDict[str, ServedMap] = OrderedDict()

    def __iter__(self) -> Iterator[ServedMap]:
        """Iterate over the maps in the order of their addition."""
        return iter(tuple(self._maps.values()))

    def __len__(self) -> int:
        """Return the number of maps."""
        return len(self._maps)

    def add(
        self,
        amap: AmbiguityMap,
        stem: str,
        path: Path | None = None,
        key: str | None = None,
        *,
        title: str = "",
    ) -> ServedMap:
        """Add a map under a name made of `stem`, which is also its title if it has no other one.

        Other arguments as in `ServedMap`.
        """
        name = first = slug(stem)
        number = 2
        while name in self._maps:
            name, number = f"{first}-{number}", number + 1
        served = ServedMap(name, amap, title or stem, path, key)
        self._maps[name] = served
        return served

    def add_edited(self, served: ServedMap) -> None:
        """Add an edited map, which already has a name."""
        self._edited[served.name] = served

    @property
    def edited(self) -> tuple[ServedMap, ...]:
        """Edited maps, the most recently used last."""
        return tuple(self._edited.values())

    def has(self, name: str) -> bool:
        """Return whether there is a map of a name."""
        return name in (self._edited if MARK in name else self._maps)

    def holds(self, served: ServedMap) -> bool:
        """Return whether this map object is still served."""
        name = served.name
        return served is (self._edited if MARK in name else self._maps).get(name)

    def remove(self, name: str) -> None:
        """Stop serving a map."""
        self._maps.pop(name, None)
        self._edited.pop(name, None)

    def get(self, name: str) -> ServedMap:
        """Return the map of a name.

        Raises:
            Problem: there is none; the nearest are offered.
        """
        served = self._maps.get(name)
        if served is None and name in self._edited:
            self._edited.move_to_end(name)
            served = self._edited[name]
        if served is None and MARK in name:
            raise Problem(
                404,
                f"The edited map {name[:100]!r} is no longer kept; post its obstacles again.",
                field="id",
            )
        if served is None:
            raise Problem(
                404, f"There is no map {name!r}; {nearest(name, self._maps)}.", field="id"
            )
        return served


def slug(text: str) -> str:
    """Convert a text to a name for addresses: letters, digits, underscores and single dashes."""
    return re.sub(r"[^A-Za-z0-9_]+", "-", text).strip("-") or "map"


def layer_kind(layer: str) -> str:
    """Return the kind of a layer's values."""
    base = schema.base_name(layer)
    if base == "zone":
        return "zone"
    if base in ("free", "judged"):
        return "flag"
    if schema.is_axis(layer):
        return "axis"
    if base == "best_heading":
        return "angle"
    return "share" if schema.is_share(layer) else "amount"


def finite(value: float) -> float | None:
    """Return a number, or None if JSON cannot represent it."""
    return value if math.isfinite(value) else None


def zone_name(code: float) -> str | None:
    """Return the zone of a code; None where there is none."""
    return ZONES[int(code)] if math.isfinite(code) and 0 <= code < len(ZONES) else None


def check_layer(amap: AmbiguityMap, layer: str) -> None:
    """Raise a Problem unless the map has the layer."""
    if layer not in amap.layers:
        raise Problem(
            404, f"The map has no layer {layer!r}; {nearest(layer, amap.layers)}.", field="layer"
        )


def worse_end(amap: AmbiguityMap, layer: str) -> str | None:
    """Return the end of a layer that means badly localized: "high", "low" or neither."""
    from ambinav.maps.core_layers import CORE_LAYERS

    core = CORE_LAYERS.get(schema.base_name(layer))
    worse = amap.dataset[layer].attrs.get("worse") if core is None else core.worse
    return None if worse is None else str(worse)
