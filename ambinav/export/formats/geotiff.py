"""Layers as the bands of a GeoTIFF in a local frame of metres."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from ambinav.export.options import MapExport
from ambinav.export.raster import Raster
from ambinav.export.registry import Exporter
from ambinav.maps.judged_floor import LAYER as JUDGED
from ambinav.runtime.array_types import Floats32
from ambinav.runtime.errors import InputError

LAYERS: Final = ("level", "major_radius", "minor_radius", "direction", "zone", "judged")
"""The bands where no layer is named; otherwise the layer and the last of them."""
NO_DATA: Final = -9999.0
# Tags and keys of OGC GeoTIFF 1.1, chapters 7 and 8.
PIXEL_SCALE, TIE_POINT, DIRECTORY, TEXTS = 33550, 33922, 34735, 34737
GDAL_METADATA, GDAL_NODATA = 42112, 42113
MODEL_TYPE, RASTER_TYPE, CITATION, LINEAR_UNITS = 1024, 1025, 1026, 3076
USER_DEFINED, PIXEL_IS_AREA, METRE = 32767, 1, 9001
NAME: Final = "ambinav map frame: local, x right, y up, metres|"


def save_geotiff(path: Path, bands: Floats32, raster: Raster, names: Sequence[str]) -> None:
    """Write float32 bands, shape (B, ny, nx), row 0 at the smallest y, nan where there is no value.

    The image has its first row at the top, as GeoTIFF has it, and no geographic reference: its
    coordinates are metres in the map frame (a user-defined model, as of an engineering frame).
    """
    import tifffile  # optional

    image = np.nan_to_num(bands[:, ::-1], nan=NO_DATA).astype(np.float32)
    _, _, _, top = raster.bounds
    size = raster.resolution
    keys = [
        (MODEL_TYPE, 0, 1, USER_DEFINED),
        (RASTER_TYPE, 0, 1, PIXEL_IS_AREA),
        (CITATION, TEXTS, len(NAME), 0),
        (LINEAR_UNITS, 0, 1, METRE),
    ]
    directory = [value for row in ((1, 1, 1, len(keys)), *keys) for value in row]
    items = "".join(
        f'<Item name="DESCRIPTION" sample="{k}" role="description">{name}</Item>'
        for k, name in enumerate(names)
    )
    tags: list[tuple[int, str, int, Any, bool]] = [
        (PIXEL_SCALE, "d", 3, (size, size, 0.0), True),
        (TIE_POINT, "d", 6, (0.0, 0.0, 0.0, raster.x, top, 0.0), True),
        (DIRECTORY, "H", len(directory), tuple(directory), True),
        (TEXTS, "s", 0, NAME, True),
        (GDAL_METADATA, "s", 0, f"<GDALMetadata>{items}</GDALMetadata>", True),
        (GDAL_NODATA, "s", 0, f"{NO_DATA:g}", True),
    ]
    tifffile.imwrite(
        path,
        image,
        photometric="minisblack",
        planarconfig="separate" if len(image) > 1 else None,
        compression="zlib",
        tile=(256, 256),
        extratags=tags,
        metadata=None,
    )


def write(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write `LAYERS`, or the named layer and the judged floor."""
    amap = export.amap
    named = export.options.layer
    names = LAYERS if named is None else tuple(dict.fromkeys((named, JUDGED)))
    missing = [name for name in names if name not in (*amap.layers, JUDGED)]
    if missing and named is None:
        raise InputError(f"{amap.source}: the map lacks {missing[0]}; make it with `ambinav map`.")
    bands = np.stack([export.floor(name).astype(np.float32) for name in names])
    save_geotiff(path, bands, Raster.of_map(amap), names)
    return (path,)


GEOTIFF: Final = Exporter(
    subject="map",
    format="geotiff",
    title="layers as bands of a GeoTIFF, metres in the map frame",
    reader="QGIS, GDAL, rasterio",
    write=write,
    suffixes=(".tif",),
    uses=frozenset({"layer", "heading"}),
    needs=("tifffile",),
    extra="geotiff",
)
