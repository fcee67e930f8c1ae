"""Pieces of floor by zone, and their GeoJSON in the map frame."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import shapely

from ambinav.export.formats.covariance import covariance_grid
from ambinav.export.options import MapExport
from ambinav.export.raster import Raster
from ambinav.export.registry import Exporter
from ambinav.geometry.map_frame import MAP_FRAME
from ambinav.maps.zones import ZONES
from ambinav.runtime.array_types import Bools, Floats, Floats32

NO_ZONES: Final = "no judged floor of the map lies in the zones"
LEAST_AREA: Final = 0.5
"""Smaller pieces are left out where nobody says otherwise, square metres."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Connected piece of floor.

    Attributes:
        polygon: Its cells, map frame, metres.
        covariance: Mean expected covariance of x and y of its cells, shape (2, 2), square metres.
        heading_std: Mean deviation of the heading, radians.
    """

    polygon: shapely.Polygon
    covariance: Floats
    heading_std: float

    @property
    def axes(self) -> tuple[float, float, float]:
        """Deviation along the weak direction and across it, metres, and that direction, radians."""
        values, vectors = np.linalg.eigh(self.covariance)
        minor, major = np.sqrt(np.maximum(values, 0.0)).tolist()
        return major, minor, math.atan2(vectors[1, 1], vectors[0, 1]) % math.pi


def pieces(mask: Bools, raster: Raster, grid: Floats32, least_area: float) -> list[Piece]:
    """Return the connected pieces of a mask (ny, nx) of at least an area, the largest first.

    Args:
        mask: The cells.
        raster: Where they lie.
        grid: `covariance_grid` of the map.
        least_area: Square metres.
    """
    from scipy.ndimage import label, mean  # takes a third of a second

    labels, count = label(mask)
    number = np.arange(1, count + 1)
    xx, xy, yy, tt = (mean(np.nan_to_num(grid[k]), labels, number) for k in (0, 1, 3, 5))
    result = []
    for polygon in raster.outline(mask).geoms:
        # An area of whole cells is as many times theirs but for rounding.
        if polygon.area < least_area * (1.0 - 1e-9):
            continue
        point = polygon.representative_point()
        column = int((point.x - raster.x) / raster.resolution)
        row = int((point.y - raster.y) / raster.resolution)
        k = int(labels[row, column]) - 1
        covariance = np.array([[xx[k], xy[k]], [xy[k], yy[k]]])
        result.append(Piece(polygon, covariance, math.sqrt(max(float(tt[k]), 0.0))))
    return sorted(result, key=lambda piece: (-piece.polygon.area, piece.polygon.bounds))


def zone_pieces(export: MapExport) -> list[tuple[str, Piece]]:
    """Return pieces of each named zone, or of corridor and open, with the zone's name.

    They lie on judged floor (`MapExport.counted`).
    """
    options = export.options
    heading = None if options.heading is None else math.radians(options.heading)
    raster, grid = Raster.of_map(export.amap), covariance_grid(export.amap, heading)
    zone = export.counted("zone")
    return [
        (ZONES[code], piece)
        for code in export.zone_codes()
        for piece in pieces(zone == code, raster, grid, least_area(export))
    ]


def least_area(export: MapExport) -> float:
    """Return the area of the smallest pieces that are written, square metres."""
    least = export.options.least_area
    return LEAST_AREA if least is None else least


def area_left_out(export: MapExport, written: list[tuple[str, Piece]]) -> float:
    """Return the judged floor of the zones that is in none of their pieces, square metres."""
    cells = np.isin(export.counted("zone"), export.zone_codes()).sum()
    area = cells * export.amap.cell_area - sum(piece.polygon.area for _, piece in written)
    return max(0.0, float(area))


def note_no_pieces(export: MapExport, path: Path, area: float, none: str) -> None:
    """Warn that a file holds no piece.

    Args:
        export: The export.
        path: The file.
        area: Floor in pieces that are too small, square metres.
        none: What there is none of, if there are no such pieces either.
    """
    if area < 1e-6:
        export.note_empty(path, none)
    else:
        export.note_empty(
            path,
            f"there is no piece of {least_area(export):g} m² or more; {area:.3g} m² are in smaller "
            "ones (--least-area)",
        )


def feature(polygon: shapely.Polygon, **properties: Any) -> dict[str, Any]:
    """Return a GeoJSON Feature."""
    geometry = json.loads(shapely.to_geojson(polygon))
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def collection(
    export: MapExport, features: list[dict[str, Any]], name: str, **members: float
) -> str:
    """Return a GeoJSON FeatureCollection that states where its coordinates lie."""
    attrs = export.amap.dataset.attrs
    document = {
        "type": "FeatureCollection",
        "name": name,
        **MAP_FRAME,
        "environment": str(attrs["environment"]),
        "environment_sha256": str(attrs.get("environment_sha256", "")),
        "scanner": str(attrs["scanner"]),
        **members,
        "features": features,
    }
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def figures(piece: Piece) -> dict[str, float]:
    """Return the properties of a piece in the files."""
    major, minor, direction = piece.axes
    return {
        "area_m2": round(piece.polygon.area, 3),
        "std_along_m": round(major, 4),
        "std_across_m": round(minor, 4),
        "std_heading_rad": round(piece.heading_std, 5),
        "weak_direction_deg": round(math.degrees(direction), 1) % 180.0,
    }


def write(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write the zones, one Feature per connected piece, and the area of those left out."""
    written = zone_pieces(export)
    features = [feature(piece.polygon, zone=name, **figures(piece)) for name, piece in written]
    left_out = area_left_out(export, written)
    if not features:
        note_no_pieces(export, path, left_out, NO_ZONES)
    text = collection(export, features, "zones", left_out_m2=round(left_out, 3))
    path.write_text(text, encoding="utf-8")
    return (path,)


GEOJSON: Final = Exporter(
    subject="map",
    format="zones-geojson",
    title="corridor and open floor as polygons in the map frame",
    reader="QGIS, web maps, shapely",
    write=write,
    suffixes=(".geojson",),
    uses=frozenset({"zones", "least_area", "heading"}),
)
