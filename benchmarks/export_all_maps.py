"""Write every raster export of every recorded map and read it back, point by point.

    AMBINAV_DATA=/path/to/data python benchmarks/export_all_maps.py [NAME ...]

For each map: the building as map_server image, its free and occupied cells against those of the map
that it came from; masks, covariance and GeoTIFF, at 2000 random places, against the ambiguity map
read there. The reader of each is another than what wrote it: PGM and raw files by numpy alone,
GeoTIFF by rasterio, polygons by shapely. Prints a line of a table for each map.
"""

from __future__ import annotations

import math
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import shapely
import yaml
from numpy.typing import NDArray

import ambinav as an
from ambinav.buildings.map_server import load_map_server
from ambinav.export.formats.exporting import export_map
from ambinav.localization.expected_covariance import expected_covariance

PLACES = 2000
CELLS = 40_000
"""About so many free cells has each ambiguity map: the spacing follows."""
FOLDERS = ("maps", "maps_from_logs", "maps_research_only", "planner_maps")


def grid_of(path: Path) -> tuple[NDArray[np.uint8], float, float, float]:
    """Return pixels, row 0 at the bottom, and x, y, resolution, using the two files alone."""
    header = yaml.safe_load(path.read_text())
    raw = (path.parent / header["image"]).read_bytes()
    width, height = map(int, raw.split(maxsplit=4)[1:3])
    pixels = np.frombuffer(raw[-width * height :], dtype=np.uint8).reshape(height, width)[::-1]
    assert header["origin"][2] == 0.0
    return pixels, header["origin"][0], header["origin"][1], header["resolution"]


def at(grid: tuple[Any, float, float, float], x: Any, y: Any) -> Any:
    """Return the pixels at points."""
    pixels, x0, y0, size = grid
    return pixels[np.floor((y - y0) / size).astype(int), np.floor((x - x0) / size).astype(int)]


def examine(file: Path, folder: Path) -> str:
    """Return figures of one map, as a line of the table."""
    environment = an.load_environment(file)
    spacing = max(0.1, round(math.sqrt(environment.free.area / CELLS), 2))
    sensor = an.RangeSensor(max_range=20 * spacing, std=0.03, resolution=0.01)
    scanner = an.RangeScanner.planar(sensor=sensor, beams=32, aperture=2 * math.pi)
    amap = an.build_map(environment, scanner, spacing=spacing, radius=3 * spacing, store=False)
    begun = time.perf_counter()

    before = load_map_server(file)
    # From the stored map, which has no grid in it.
    amap.save(folder / "map.zarr")
    amap = an.AmbiguityMap.open(folder / "map.zarr")
    house = grid_of(export_map(amap, "map-server", folder / "house.yaml")[0])
    pixels = house[0]
    same = pixels.shape == before.state.shape and house[1:3] == before.origin[:2]
    wall_lost = int(((pixels == 254) & (before.state == 1)).sum()) if same else -1
    free_kept = float((pixels == 254)[before.state == 0].mean()) if same else math.nan

    # Places, not cells: anywhere in a cell, the reader of a file looks up the cell's own value.
    rng = np.random.default_rng(0)
    rows, columns = np.nonzero(amap.dataset["free"].values)
    pick = rng.integers(len(rows), size=PLACES)
    cx, cy = amap.dataset["x"].values[columns[pick]], amap.dataset["y"].values[rows[pick]]
    x, y = (c + rng.uniform(-0.49, 0.49, PLACES) * spacing for c in (cx, cy))
    level = np.asarray(amap.sample("level", cx, cy))
    zone = np.asarray(amap.sample("zone", cx, cy))
    wrong = 0
    mask = grid_of(export_map(amap, "nav2-speed", folder / "speed.yaml")[0])
    wrong += int((np.abs(at(mask, x, y) - 70.0 * level) > 0.501).sum())
    mask = grid_of(export_map(amap, "nav2-preference", folder / "cost.yaml")[0])
    wrong += int((np.abs(at(mask, x, y) - 90.0 * level) > 0.501).sum())
    mask = grid_of(export_map(amap, "nav2-keepout", folder / "keepout.yaml")[0])
    wrong += int(((at(mask, x, y) == 100) != (zone == 3)).sum())
    mask = grid_of(export_map(amap, "nav2-binary", folder / "binary.yaml")[0])
    wrong += int(((at(mask, x, y) == 100) != (zone >= 2)).sum())

    expected = expected_covariance(amap, np.column_stack([cx, cy, np.zeros(PLACES)]))
    bands = expected[:, *np.triu_indices(3)]
    header, data = export_map(amap, "covariance-raw", folder / "c.yaml")
    about = yaml.safe_load(header.read_text())
    raw = np.fromfile(data, "<f4").reshape(about["shape"])
    x0, y0, _ = about["origin"]
    row = np.floor((y - y0) / about["resolution"]).astype(int)
    column = np.floor((x - x0) / about["resolution"]).astype(int)
    wrong += int((~np.isclose(raw[:, row, column].T, bands, rtol=1e-4, atol=1e-7)).any(1).sum())
    for kind, values in (("covariance-geotiff", bands), ("geotiff", np.c_[level, zone])):
        path = export_map(amap, kind, folder / f"{kind}.tif")[0]
        with rasterio.open(path) as tiff:
            read_back = np.array(list(tiff.sample(zip(x, y, strict=True))))
        read_back = read_back if kind != "geotiff" else read_back[:, [0, 4]]
        wrong += int((~np.isclose(read_back, values, rtol=1e-4, atol=1e-7)).any(1).sum())
    with np.load(export_map(amap, "covariance-npz", folder / "c.npz")[0]) as arrays:
        row = np.abs(arrays["y"][:, None] - y).argmin(axis=0)
        column = np.abs(arrays["x"][:, None] - x).argmin(axis=0)
        read_back = arrays["covariance"][row, column]
    wrong += int((~np.isclose(read_back, expected, rtol=1e-4, atol=1e-7)).any((1, 2)).sum())

    path = export_map(amap, "zones-geojson", folder / "z.geojson")[0]
    shapes = shapely.from_geojson(path.read_text())
    union = shapely.union_all(shapely.get_parts(shapes))
    shapely.prepare(union)
    inside = shapely.contains_xy(union, x, y)
    # Pieces under half a square metre are left out, so that only what is in is asked.
    wrong += int((inside & (zone < 2)).sum())
    seconds = time.perf_counter() - begun
    state = "same lattice" if same else "other lattice"
    return (
        f"| {file.stem} | {spacing:g} | {len(rows)} | {state} | {100 * free_kept:.1f} | "
        f"{wall_lost} | {wrong} of {9 * PLACES} | {seconds:.1f} |"
    )


def main() -> None:
    """Print the table."""
    root = Path(os.environ["AMBINAV_DATA"])
    files = [file for name in FOLDERS for file in sorted((root / name).glob("*.yaml"))]
    named = sys.argv[1:]
    print("| map | spacing, m | free cells | image | free kept, % | walls lost | wrong | s |")
    print("|---|---:|---:|---|---:|---:|---:|---:|")
    for file in files:
        if not named or file.stem in named:
            with tempfile.TemporaryDirectory() as folder:
                print(examine(file, Path(folder)), flush=True)


if __name__ == "__main__":
    main()
