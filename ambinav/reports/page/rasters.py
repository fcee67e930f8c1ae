"""Layers as PNG pictures that store values: 16 bits of value, 8 bits of class."""

from __future__ import annotations

import base64
import io
import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ambinav.runtime.array_types import Bools, Floats, Indices

Codes = NDArray[np.uint8]

LEVELS: Final = 65534
"""Steps of a value between the ends of its raster; the code above says that there is none."""
MOST_CELLS: Final = 6_000_000
"""Cells of a raster; in a larger lattice one cell represents a square of them."""

UNEXPLORED, UNREACHABLE, OUTSIDE, SOLID, UNKNOWN = range(4, 9)
"""Classes after those of the zones, which are `ambinav.maps.zones.ZONES`."""


@dataclass(frozen=True, eq=False)
class Window:
    """Selection of the embedded cells: those around free floor, one for each block.

    Attributes:
        rows: (ny, nx) row in the lattice of the cell that represents each block, from the top.
        columns: (ny, nx) its column.
        bounds: (xmin, ymin, xmax, ymax) of the blocks, metres.
        block: Cells along the side of a block.
    """

    rows: Indices
    columns: Indices
    bounds: tuple[float, float, float, float]
    block: int

    @classmethod
    def around(
        cls,
        x: Floats,
        y: Floats,
        spacing: float,
        free: Bools,
        level: Floats,
        most: int | None = None,
    ) -> Window:
        """Choose the cells.

        Args:
            x: (nx,) cell centres, metres.
            y: (ny,) cell centres, rising.
            spacing: Metres.
            free: (ny, nx) which cells are free.
            level: (ny, nx) the worst cell, by this, represents its block; nan where none is.
            most: Number of blocks, about; None: `MOST_CELLS`.
        """
        margin = 3
        used_y, used_x = (np.nonzero(free.any(axis=axis))[0] for axis in (1, 0))
        low = [max(int(used[0]) - margin, 0) if used.size else 0 for used in (used_y, used_x)]
        high = [
            min(int(used[-1]) + margin + 1, size) if used.size else size
            for used, size in zip((used_y, used_x), free.shape, strict=True)
        ]
        shape = [b - a for a, b in zip(low, high, strict=True)]
        block = max(math.ceil(math.sqrt(shape[0] * shape[1] / (most or MOST_CELLS))), 1)
        ny, nx = (-(-size // block) for size in shape)
        badness = np.full((ny * block, nx * block), -2.0)
        inside = np.nan_to_num(level[low[0] : high[0], low[1] : high[1]], nan=-1.0)
        badness[: shape[0], : shape[1]] = inside
        tiles = badness.reshape(ny, block, nx, block).swapaxes(1, 2).reshape(ny, nx, -1)
        worst = tiles.argmax(axis=2)
        rows = low[0] + np.arange(ny)[:, None] * block + worst // block
        columns = low[1] + np.arange(nx)[None, :] * block + worst % block
        left, bottom = float(x[low[1]]) - spacing / 2, float(y[low[0]]) - spacing / 2
        side = block * spacing
        return cls(
            rows[::-1], columns[::-1], (left, bottom, left + nx * side, bottom + ny * side), block
        )

    def take(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the chosen cells of a lattice (ny, nx, ...), the largest y first."""
        return values[self.rows, self.columns]


def encode(values: Floats, codes: Codes) -> tuple[str, float, float]:
    """Encode values and classes as the data URI of a PNG.

    A pixel is red * 256 + green = `LEVELS` * (value - low) / (high - low), `LEVELS` + 1 where the
    value is not finite; blue is the class.

    Args:
        values: (ny, nx), the largest y first.
        codes: (ny, nx).

    Returns:
        A data URI, and the values low and high.
    """
    is_finite = np.isfinite(values)
    low = float(values[is_finite].min()) if is_finite.any() else 0.0
    high = float(values[is_finite].max()) if is_finite.any() else 1.0
    high = high if high > low else low + 1.0
    scaled = np.full(values.shape, LEVELS + 1, dtype=np.uint16)
    scaled[is_finite] = np.rint((values[is_finite] - low) / (high - low) * LEVELS).astype(np.uint16)
    pixels = np.stack([scaled >> 8, scaled & 255, codes], axis=-1).astype(np.uint8)
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG", compress_level=6)
    text = base64.b64encode(file.getvalue()).decode("ascii")
    return f"data:image/png;base64,{text}", low, high


def base64_of(values: NDArray[Any]) -> str:
    """Encode the bytes of an array, little endian, as base64 text."""
    little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
    return base64.b64encode(little.tobytes()).decode("ascii")
