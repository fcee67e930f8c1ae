"""The building of a map as an occupancy grid in map_server's format."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from ambinav.export.occupancy import TRINARY, occupancy, raster_of, save_map_server
from ambinav.export.options import MapExport
from ambinav.export.registry import Exporter


def write(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write the building of a map."""
    environment = export.amap.environment
    raster = raster_of(environment, export.options.resolution, export.amap.spacing)
    return save_map_server(path, occupancy(environment, raster), raster, "trinary", **TRINARY)


MAP_SERVER: Final = Exporter(
    subject="map",
    format="map-server",
    title="the building as an occupancy grid: YAML and PGM",
    reader="Nav2, AMCL, slam_toolbox, every program that reads map_server's files",
    write=write,
    suffixes=(".yaml", ".pgm"),
    uses=frozenset({"resolution"}),
)
