"""Expected covariance of a localizer at each point of a map, in three file formats.

For monitors that compare what a localizer reports with what is to be expected where it says that it
is (`localization.expected_covariance` defines the figures).
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from numpy.typing import NDArray

from ambinav.export.formats.geotiff import save_geotiff
from ambinav.export.options import MapExport
from ambinav.export.raster import Raster
from ambinav.export.registry import Exporter
from ambinav.localization.expected_covariance import expected_covariance
from ambinav.maps.ambiguity_map import AmbiguityMap

BANDS: Final = ("xx", "xy", "xt", "yy", "yt", "tt")
"""The upper triangle of the covariance of x, y, theta, row by row."""
UNITS: Final = ("m2", "m2", "m rad", "m2", "m rad", "rad2")
ROS_INDEX: Final = ((0,), (1, 6), (5, 30), (7,), (11, 31), (35,))
"""Index of each band in the 36 numbers of a geometry_msgs/PoseWithCovariance."""
FORMAT: Final = "ambinav-covariance/1"
FLOOR: Final = "judged, or explored but too close to walls, where an estimate can lie; else nan"
"""Floor that has values, for readers."""
BLOCK: Final = 1_000_000

Grid = NDArray[np.float32]


def covariance_grid(amap: AmbiguityMap, heading: float | None = None) -> Grid:
    """Compute each cell centre's expected covariance, float32, (6, ny, nx), as `BANDS`.

    Args:
        amap: The map.
        heading: Heading of the robot, radians. None: where the heading matters, the one at which
            the position is known least (the largest xx + yy).

    Returns:
        Square metres and radians in the map frame, row 0 at the smallest y; nan off `FLOOR`.
    """
    # The estimate of a robot beside a wall can be too close to it, but none is outside, or in a
    # room that it cannot reach.
    floor = (amap.judged.counted | amap.judged.beside_walls) & ~amap.unexplored
    rows, columns = np.nonzero(floor)
    x, y = amap.dataset["x"].values[columns], amap.dataset["y"].values[rows]
    headings = [0.0 if heading is None else heading]
    if heading is None and amap.has_theta:
        headings = amap.dataset["theta"].values.tolist()
    bands = np.full((len(BANDS), *floor.shape), np.nan, dtype=np.float32)
    upper = np.triu_indices(3)
    for first in range(0, len(x), BLOCK):
        part = slice(first, first + BLOCK)
        best = np.full((len(x[part]), 3, 3), np.nan)
        for theta in headings:
            poses = np.column_stack([x[part], y[part], np.full(len(best), theta)])
            expected = expected_covariance(amap, poses)
            spread, worst = (
                covariance[:, 0, 0] + covariance[:, 1, 1] for covariance in (expected, best)
            )
            worse = np.isnan(worst) | (spread > worst)
            best[worse] = expected[worse]
        bands[:, rows[part], columns[part]] = best[:, upper[0], upper[1]].T
    return bands


def _grid(export: MapExport) -> Grid:
    heading = export.options.heading
    return covariance_grid(export.amap, None if heading is None else math.radians(heading))


def _about(export: MapExport) -> dict[str, Any]:
    attrs, heading = export.amap.dataset.attrs, export.options.heading
    matters = "the worst" if export.amap.has_theta else "any"
    return {
        "format": FORMAT,
        "frame": "map",
        "environment": str(attrs["environment"]),
        "environment_sha256": str(attrs.get("environment_sha256", "")),
        "scanner": str(attrs["scanner"]),
        "parameters": export.amap.parameters,
        "heading_deg": matters if heading is None else heading,
        "floor": FLOOR,
        "robot_radius": export.amap.judged.radius,
        "units": dict(zip(BANDS, UNITS, strict=True)),
    }


def write_npz(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write `covariance`, float32, shape (ny, nx, 3, 3), the cells' centres, and `about`."""
    full = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
    covariance = np.moveaxis(_grid(export)[full], (0, 1), (2, 3))
    x, y = (export.amap.dataset[name].values for name in ("x", "y"))
    about = np.array(json.dumps(_about(export)))
    with path.open("wb") as file:
        np.savez_compressed(file, covariance=covariance, x=x, y=y, about=about)
    return (path,)


def write_raw(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write a YAML file, and the bands one after the other as float32, little-endian."""
    grid, raster = _grid(export), Raster.of_map(export.amap)
    data = path.with_suffix(".f32")
    data.write_bytes(np.ascontiguousarray(grid, dtype="<f4").tobytes())
    about = _about(export) | {
        "data": data.name,
        "dtype": "float32, little-endian",
        "shape": list(grid.shape),
        "index": "(band * rows + row) * columns + column; row 0 at the smallest y",
        "resolution": raster.resolution,
        "origin": [raster.x, raster.y, 0.0],
        "bands": [
            {"name": name, "ros_index": list(index)}
            for name, index in zip(BANDS, ROS_INDEX, strict=True)
        ],
    }
    path.write_text(yaml.safe_dump(about, sort_keys=False), encoding="utf-8")
    return path, data


def write_geotiff(export: MapExport, path: Path) -> tuple[Path, ...]:
    """Write the bands as bands of a GeoTIFF."""
    names = [f"{name} [{unit}]" for name, unit in zip(BANDS, UNITS, strict=True)]
    save_geotiff(path, _grid(export), Raster.of_map(export.amap), names)
    return (path,)


TITLE: Final = "expected covariance of x, y, heading per cell"

NPZ: Final = Exporter(
    subject="map",
    format="covariance-npz",
    title=f"{TITLE}, 3 x 3, NumPy",
    reader="Python: evaluation of logged covariances",
    write=write_npz,
    suffixes=(".npz",),
    uses=frozenset({"heading"}),
)
RAW: Final = replace(
    NPZ,
    format="covariance-raw",
    title=f"{TITLE}, YAML and float32",
    reader="C++ nodes: AMCL, beluga, MRPT, Cartographer and Autoware monitors",
    write=write_raw,
    suffixes=(".yaml", ".f32"),
)
GEOTIFF: Final = replace(
    NPZ,
    format="covariance-geotiff",
    title=f"{TITLE}, six bands",
    reader="QGIS, GDAL, grid_map",
    write=write_geotiff,
    suffixes=(".tif",),
    needs=("tifffile",),
    extra="geotiff",
)
