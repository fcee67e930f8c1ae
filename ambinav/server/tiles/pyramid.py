"""A layer at decreasing resolution, for tiles: mean and worst value of each block of cells."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.judged_floor import LAYER as JUDGED
from ambinav.maps.zones import NOT_FREE, ZONES
from ambinav.runtime.array_types import Bools
from ambinav.server.served import layer_kind

Values = NDArray[np.float32]
Stat = Literal["mean", "worst"]

TILE: Final = 256
"""Pixels along the side of a tile."""
STATS: Final[tuple[Stat, ...]] = ("mean", "worst")
WALLS: Final = "walls"
"""Layer of the tiles that shows solid cells."""
NOT_COUNTED: Final = len(ZONES)
"""Among tiles of zones: free floor that is not judged."""


def depth_of(shape: tuple[int, int]) -> int:
    """Count the halvings of a lattice, shape (ny, nx), until one tile contains it."""
    return max(math.ceil(math.log2(max(*shape, 1) / TILE)), 0)


@dataclass(frozen=True, eq=False)
class Pyramid:
    """A layer over the floor, and its halvings. Rows run from the largest y downwards.

    Attributes:
        base: The layer, shape (ny, nx), NaN where there is no value.
        mean: Mean of the cells with a value in each block of 2^k x 2^k cells, k from 1 on. Of axes
            and angles it is that of their vectors, of zones the one with the most cells (of equals
            the worse).
        worst: The highest of the block, or the lowest of a layer that is good where it is high.
    """

    base: Values
    mean: tuple[Values, ...]
    worst: tuple[Values, ...]

    def at(self, halvings: int, stat: Stat) -> Values:
        """Return the layer after a number of halvings."""
        return self.base if halvings == 0 else getattr(self, stat)[halvings - 1]

    @property
    def bytes(self) -> int:
        """Approximate memory use, bytes."""
        return sum(part.nbytes for part in (self.base, *self.mean, *self.worst))


def floor_values(amap: AmbiguityMap, layer: str, heading: int | None) -> Values:
    """Return a layer on the floor, largest y first, NaN where there is no value.

    Args:
        amap: The map.
        layer: One of its layers, or `WALLS`.
        heading: Index of the heading of a layer that has headings.
    """
    if layer == WALLS:
        return np.where(amap.solid, np.float32(1.0), np.float32(np.nan))[::-1]
    data = amap.dataset[layer]
    values = data.values if heading is None else data.isel(theta=heading).values
    out = values.astype(np.float32)
    if layer_kind(layer) == "zone":
        out[~amap.judged.counted] = NOT_COUNTED
        out[values == NOT_FREE] = np.nan
    elif layer == JUDGED:
        out[values == NOT_FREE] = np.nan
    return np.ascontiguousarray(out[::-1])


def build(values: Values, layer: str, lowest_is_worst: bool) -> Pyramid:
    """Halve a layer until one tile contains it.

    Args:
        values: See `floor_values`.
        layer: Its name, which determines how its values are combined.
        lowest_is_worst: Whether low values mean badly localized.
    """
    depth = depth_of((values.shape[0], values.shape[1]))
    kind = "amount" if layer == WALLS else layer_kind(layer)
    if kind == "zone":
        mean = tuple(_commonest(values, depth))
    elif kind in ("axis", "angle"):
        mean = tuple(_mean_angles(values, depth, 2.0 if kind == "axis" else 1.0))
    else:
        mean = tuple(
            np.divide(t, n, out=np.full_like(t, np.nan), where=n > 0).astype(np.float32)
            for t, n in zip(
                _sums(np.nan_to_num(values), depth), _sums(_has_value(values), depth), strict=True
            )
        )
    worst = mean if kind in ("axis", "angle") else tuple(_extremes(values, depth, lowest_is_worst))
    return Pyramid(values, mean, worst)


def _has_value(values: Values) -> Bools:
    return np.isfinite(values)


def _quarters(values: NDArray[Any], fill: float) -> tuple[NDArray[Any], ...]:
    """Return the four cells of each block of 2 x 2 as four arrays."""
    rows, columns = values.shape
    if rows % 2 or columns % 2:
        values = np.pad(values, ((0, rows % 2), (0, columns % 2)), constant_values=fill)
    return values[::2, ::2], values[::2, 1::2], values[1::2, ::2], values[1::2, 1::2]


def _sums(values: NDArray[Any], depth: int) -> Iterator[NDArray[Any]]:
    """Sum blocks of 2, 4, 8 ... cells along the side: float64, of masks int32."""
    kind = np.int32 if values.dtype in (np.bool_, np.int32) else np.float64
    for _ in range(depth):
        a, b, c, d = _quarters(values, 0)
        values = np.add(a, b, dtype=kind)
        values += np.add(c, d, dtype=kind)
        yield values


def _extremes(values: Values, depth: int, lowest: bool) -> Iterator[Values]:
    """Yield the highest or lowest value of each block."""
    pick = np.fmin if lowest else np.fmax
    for _ in range(depth):
        a, b, c, d = _quarters(values, math.nan)
        values = np.asarray(pick(pick(a, b), pick(c, d)), dtype=np.float32)
        yield values


def _mean_angles(values: Values, depth: int, fold: float) -> Iterator[Values]:
    """Compute mean directions of period 2 pi / fold."""
    turned = np.float32(fold) * np.nan_to_num(values)
    finite = _has_value(values)
    parts = (_sums(np.sin(turned) * finite, depth), _sums(np.cos(turned) * finite, depth))
    for sine, cosine, count in zip(*parts, _sums(finite, depth), strict=True):
        angle = np.mod(np.arctan2(sine, cosine), 2.0 * math.pi) / fold
        yield np.where(count > 0, angle, np.nan).astype(np.float32)


def _commonest(values: Values, depth: int) -> Iterator[Values]:
    """Yield the most frequent zone of each block."""
    # Of equals argmax takes the first: worse zones come first, uncounted floor last.
    codes = (*range(len(ZONES) - 1, -1, -1), NOT_COUNTED)
    each = [_sums(values == code, depth) for code in codes]
    for counts in zip(*each, strict=True):
        stacked = np.stack(counts)
        zones = np.array(codes, dtype=np.float32)[stacked.argmax(axis=0)]
        zones[stacked.max(axis=0) == 0] = np.nan
        yield zones
