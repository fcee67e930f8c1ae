"""A small picture of a floor, in the colours of the zones."""

from __future__ import annotations

import io
import math
from typing import Final

import numpy as np
from PIL import Image

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting import style
from ambinav.reports.page.map_data import floor_classes
from ambinav.reports.page.rasters import UNKNOWN, Window

PIXELS: Final = 160 * 120
"""Pixels of a picture, about."""

_COLOURS: Final = (
    *style.ZONE_COLOURS, style.UNEXPLORED, style.UNREACHABLE, style.UNKNOWN, style.SOLID, "#FFFFFF",
)  # fmt: skip
"""By class, see `ambinav.reports.page.rasters`; what is unknown is paper."""


def thumbnail(amap: AmbiguityMap) -> bytes:
    """Return a PNG of the floor, a pixel for a block of cells: its worst one.

    Where the heading matters, the zone over all headings decides.
    """
    data = amap.dataset
    level = amap.floor("level", "mean").values.astype(np.float64)
    classes = floor_classes(amap, "mean", amap.judged)
    window = Window.around(
        data["x"].values, data["y"].values, amap.spacing, data["free"].values, level, PIXELS
    )
    pixels = window.take(classes)
    factor = max(math.isqrt(PIXELS // pixels.size), 1)
    picture = Image.fromarray(pixels.repeat(factor, axis=0).repeat(factor, axis=1))
    palette = [int(colour[k : k + 2], 16) for colour in _COLOURS for k in (1, 3, 5)]
    picture.putpalette(palette)
    file = io.BytesIO()
    picture.save(file, "PNG", optimize=True, transparency=UNKNOWN)
    return file.getvalue()
