"""Tiles: windows of a pyramid as PNG, in the colours of the pictures."""

from __future__ import annotations

import io
import math
import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import Final

import matplotlib
import numpy as np
from matplotlib.colors import Normalize, to_rgb
from PIL import Image

from ambinav.maps.zones import ZONES
from ambinav.plotting import style
from ambinav.plotting.maps import layer_norm
from ambinav.runtime.array_types import Bytes, Floats32
from ambinav.server.problems import Problem
from ambinav.server.served import ServedMap, check_layer, layer_kind, worse_end
from ambinav.server.tiles.pyramid import TILE, WALLS, Stat
from ambinav.server.tiles.pyramids import Pyramids

SHADES: Final = 255
"""Colours of a scale; the first entry of a tile's palette is left transparent."""
STOPS: Final = 6
"""Number of colours of a scale in a legend."""
KEPT_TILES: Final = 4096
"""Encoded tiles of a map that are kept."""


@dataclass(frozen=True, eq=False)
class LayerStyle:
    """Mapping from a layer's values to colours.

    Attributes:
        norm: Normalization of values to 0 .. 1.
        palette: Colours 0 to 255, shape (shades, 3).
        classes: Whether values are numbers of the palette, not amounts.
    """

    norm: Normalize
    palette: Bytes
    classes: bool = False

    def indices(self, values: Floats32) -> Bytes:
        """Return each value's palette index, from 1; 0 where there is no value."""
        finite = np.isfinite(values)
        if self.classes:
            shades = np.nan_to_num(values).astype(np.uint8) + 1
            return np.asarray(shades * finite, dtype=np.uint8)
        low, high = float(self.norm.vmin or 0.0), float(self.norm.vmax or 1.0)
        clipped = np.clip(np.where(finite, values, low), low, high)
        share = np.asarray(self.norm(clipped), dtype=np.float64)
        top = len(self.palette) - 1
        return np.asarray(np.where(finite, 1 + np.rint(share * top), 0), dtype=np.uint8)


def layer_style(served: ServedMap, layer: str) -> LayerStyle:
    """Return the style of a layer, as in `ambinav.plotting.maps`."""
    if layer == WALLS:
        return LayerStyle(Normalize(0.0, 1.0), _colours([style.SOLID]), classes=True)
    kind = layer_kind(layer)
    if kind == "zone":
        colours = (*style.ZONE_COLOURS, style.UNREACHABLE)
        return LayerStyle(Normalize(0.0, len(ZONES) - 1.0), _colours(colours), True)
    if kind in ("axis", "angle"):
        top = math.pi if kind == "axis" else 2.0 * math.pi
        return LayerStyle(Normalize(0.0, top), _scale("twilight"))
    amap = served.amap
    name = "viridis" if worse_end(amap, layer) == "low" else "viridis_r"
    data = amap.dataset[layer]
    norm = layer_norm(layer, data.values.astype(np.float64), added="source" in data.attrs)
    return LayerStyle(norm, _scale(name))


def _colours(names: tuple[str, ...] | list[str]) -> Bytes:
    return np.array([np.rint(255 * np.array(to_rgb(name))) for name in names], dtype=np.uint8)


def _scale(name: str) -> Bytes:
    shades = matplotlib.colormaps[name](np.linspace(0.0, 1.0, SHADES))
    return np.asarray(np.rint(255 * shades[:, :3]), dtype=np.uint8)


class Tiles:
    """The tiles of a map.

    Args:
        served: The map.
        pyramids: Its pyramids.
        like: Tiles of another map whose colours they have; None: their own.
    """

    def __init__(self, served: ServedMap, pyramids: Pyramids, like: Tiles | None = None) -> None:
        self.served = served
        self.pyramids = pyramids
        self._like = like
        self._styles: dict[str, LayerStyle] = {}
        self._cache: OrderedDict[tuple[object, ...], bytes] = OrderedDict()
        self._lock = threading.Lock()

    def style(self, layer: str) -> LayerStyle:
        """Return the style of a layer; computed once."""
        layer_look = self._styles.get(layer)
        if layer_look is None:
            like = self._like
            layer_look = layer_style(self.served, layer) if like is None else like.style(layer)
            self._styles[layer] = layer_look
        return layer_look

    def is_ready(self, layer: str, heading: int | None) -> bool:
        """Return whether a tile of the layer needs only to be encoded."""
        return layer in self._styles and self.pyramids.has(layer, heading)

    def resolve(self, layer: str, theta: float | None) -> tuple[str, int | None]:
        """Return the layer to draw and the index of the heading.

        A layer with headings is drawn by its mean over them where no heading is given.

        Raises:
            Problem: there is no such layer, or it needs a heading.
        """
        if layer == WALLS:
            return layer, None
        amap = self.served.amap
        check_layer(amap, layer)
        data = amap.dataset[layer]
        if "theta" not in data.dims:
            return layer, None
        if theta is None:
            if f"{layer}_mean" not in amap.dataset:
                raise Problem(422, f"{layer} has no mean over headings; give theta.", field="theta")
            return f"{layer}_mean", None
        if not math.isfinite(theta):
            raise Problem(422, f"theta is {theta}; give radians.", field="theta")
        headings = amap.dataset["theta"].values
        step = 2.0 * math.pi / headings.size
        return layer, round((theta - float(headings[0])) / step) % headings.size

    def png(self, layer: str, heading: int | None, stat: Stat, z: int, tx: int, ty: int) -> bytes:
        """Return a tile, transparent where there is no value.

        Args:
            layer: Layer as returned by `resolve`, like the heading.
            heading: Its index, or None.
            stat: Statistic of a block of cells shown by a pixel.
            z: Zoom, from 0 (one tile holds the map) to the depth of the pyramids.
            tx: Column of the tile, from the smallest x.
            ty: Row of the tile, from the largest y downwards.

        Raises:
            Problem: there is no such tile.
        """
        key = (layer, heading, stat, z, tx, ty)
        with self._lock:
            stored = self._cache.get(key)
            if stored is not None:
                self._cache.move_to_end(key)
                return stored
        depth = self.pyramids.depth
        if not 0 <= z <= depth:
            raise Problem(404, f"There is no zoom {z}; there are 0 to {depth}.", field="z")
        values = self.pyramids.get(layer, heading).at(depth - z, stat)
        rows, columns = values.shape
        if not (0 <= tx * TILE < columns and 0 <= ty * TILE < rows):
            raise Problem(
                404, f"There is no tile {tx}, {ty} at zoom {z}; it lies outside of the map."
            )
        window = values[ty * TILE : (ty + 1) * TILE, tx * TILE : (tx + 1) * TILE]
        made = _encoded(window, self.style(layer), layer == WALLS)
        with self._lock:
            self._cache[key] = made
            while len(self._cache) > KEPT_TILES:
                self._cache.popitem(last=False)
        return made


def _encoded(window: Floats32, drawn: LayerStyle, is_mask: bool) -> bytes:
    """Encode a window of values as a PNG with a palette."""
    pixels = np.zeros((TILE, TILE), dtype=np.uint8)
    rows, columns = window.shape
    pixels[:rows, :columns] = np.isfinite(window) if is_mask else drawn.indices(window)
    image = Image.frombytes("P", (TILE, TILE), pixels.tobytes())
    image.putpalette(bytes(3) + drawn.palette.tobytes())
    out = io.BytesIO()
    image.save(out, "PNG", transparency=0, compress_level=1)
    return out.getvalue()


def legend(drawn: LayerStyle, layer: str) -> list[dict[str, object]]:
    """Return the legend of a layer: values with colours and, for classes, names."""
    if layer == WALLS:
        return [{"value": 1.0, "colour": style.SOLID.lower(), "label": "wall"}]
    if drawn.classes:
        return [
            {"value": float(code), "colour": _hex(colour), "label": name}
            for code, (name, colour) in enumerate(
                zip((*ZONES, "not counted"), drawn.palette, strict=True)
            )
        ]
    shares = np.linspace(0.0, 1.0, STOPS)
    values = np.asarray(drawn.norm.inverse(shares), dtype=np.float64)
    shades = np.rint(shares * (len(drawn.palette) - 1)).astype(np.intp)
    return [
        {"value": float(value), "colour": _hex(drawn.palette[shade]), "label": f"{value:.3g}"}
        for value, shade in zip(values, shades, strict=True)
    ]


def _hex(colour: Bytes) -> str:
    return "#" + bytes(colour).hex()
