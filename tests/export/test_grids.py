"""Covariance, GeoTIFF and NumPy, read by rasterio, GDAL's rules and numpy, place by place."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

import ambinav as an
from ambinav.export.formats.covariance import covariance_grid
from ambinav.export.formats.geotiff import LAYERS
from ambinav.localization.expected_covariance import expected_covariance

pytest.importorskip("tifffile")

Write = Callable[..., tuple[Path, ...]]
PLACES = [(0.55, 2.7), (2.1, 1.5), (7.1, 1.7), (14.3, 3.5), (17.7, -1.7)]


def close(first: object, second: object) -> None:
    np.testing.assert_allclose(first, second, rtol=1e-5, atol=1e-9)


def nearest_centre(amap: an.AmbiguityMap, x: float, y: float) -> tuple[float, float]:
    axes = (amap.dataset[name].values for name in ("x", "y"))
    cx, cy = (float(a[np.abs(a - v).argmin()]) for a, v in zip(axes, (x, y), strict=True))
    return cx, cy


def expected(amap: an.AmbiguityMap, x: float, y: float) -> np.ndarray:
    return expected_covariance(amap, [(*nearest_centre(amap, x, y), 0.0)])[0]


def test_covariance_npz(write: Write, amap: an.AmbiguityMap) -> None:
    with np.load(write("covariance-npz", "c.npz")[0]) as file:
        for x, y in PLACES:
            row, column = np.abs(file["y"] - y).argmin(), np.abs(file["x"] - x).argmin()
            close(file["covariance"][row, column], expected(amap, x, y))
        about = json.loads(str(file["about"]))
        assert (about["format"], about["environment"]) == ("ambinav-covariance/1", "house")
        nowhere = np.isnan(file["covariance"]).any(axis=(2, 3))
    np.testing.assert_array_equal(nowhere, ~amap.dataset["free"].values)


def test_covariance_raw_as_a_cpp_node_reads_it(write: Write, amap: an.AmbiguityMap) -> None:
    """By the YAML alone: a byte offset for each band, and its places in ROS's 36 numbers."""
    import struct

    header, data = write("covariance-raw", "c.yaml")
    about = yaml.safe_load(header.read_text())
    raw = (header.parent / about["data"]).read_bytes()
    assert data.name == about["data"]
    _, rows, columns = about["shape"]
    assert len(raw) == 4 * math.prod(about["shape"])
    for x, y in PLACES:
        column = math.floor((x - about["origin"][0]) / about["resolution"])
        row = math.floor((y - about["origin"][1]) / about["resolution"])
        ros = [0.0] * 36
        for k, band in enumerate(about["bands"]):
            (value,) = struct.unpack_from("<f", raw, 4 * ((k * rows + row) * columns + column))
            for index in band["ros_index"]:
                ros[index] = value
        full = np.array(ros).reshape(6, 6)
        close(full, full.T)
        close(full[np.ix_((0, 1, 5), (0, 1, 5))], expected(amap, x, y))


def test_covariance_geotiff(write: Write, amap: an.AmbiguityMap) -> None:
    rasterio = pytest.importorskip("rasterio")
    with rasterio.open(write("covariance-geotiff", "c.tif")[0]) as file:
        assert file.descriptions[:2] == ("xx [m2]", "xy [m2]")
        values = np.array(list(file.sample(PLACES, masked=True)))
    for found, (x, y) in zip(values, PLACES, strict=True):
        close(found, expected(amap, x, y)[np.triu_indices(3)])


def test_where_the_heading_matters_the_worst_is_written(headed_map: an.AmbiguityMap) -> None:
    worst = covariance_grid(headed_map)
    one = covariance_grid(headed_map, 0.0)
    both = np.isfinite(one[0]) & np.isfinite(worst[0])
    spread, of_one = worst[0] + worst[3], one[0] + one[3]
    assert (spread[both] >= of_one[both] - 1e-7).all()
    assert (spread[both] > of_one[both] + 1e-4).any()
    rows, columns = np.nonzero(both)
    x, y = headed_map.dataset["x"].values[columns], headed_map.dataset["y"].values[rows]
    found = expected_covariance(headed_map, np.column_stack([x, y, np.zeros(len(x))]))
    close(one[:, rows, columns].T, found[:, *np.triu_indices(3)])


def test_geotiff_of_layers(write: Write, amap: an.AmbiguityMap) -> None:
    rasterio = pytest.importorskip("rasterio")
    with rasterio.open(write("geotiff", "g.tif")[0]) as file:
        assert file.descriptions == LAYERS
        assert file.nodata == -9999.0
        assert file.res == pytest.approx((amap.spacing, amap.spacing))
        assert tuple(file.bounds) == pytest.approx(amap.bounds)
        assert file.crs is None or not file.crs.is_geographic
        places = [nearest_centre(amap, x, y) for x, y in PLACES]
        values = np.array(list(file.sample(places)))
    for k, name in enumerate(LAYERS):
        close(values[:, k], [amap.sample(name, x, y) for x, y in places])


def test_geotiff_keys_say_a_local_frame_of_metres(write: Write) -> None:
    import tifffile

    path = write("geotiff", "one.tif", layer="level")[0]
    with tifffile.TiffFile(path) as file:
        geokeys = file.geotiff_metadata
        assert file.pages[0].shape == (2, 41, 91)  # and the judged floor
    assert int(geokeys["GTModelTypeGeoKey"]) == 32767
    assert int(geokeys["ProjLinearUnitsGeoKey"]) == 9001
    assert "ambinav map frame" in geokeys["GTCitationGeoKey"]


def test_npz(write: Write, amap: an.AmbiguityMap) -> None:
    path, about = write("npz", "n.npz")
    with np.load(path) as file:
        assert set(amap.layers) <= set(file.files)
        for name in file.files:
            assert f"| `{name}` |" in about.read_text()
        np.testing.assert_array_equal(file["level"], amap.dataset["level"].values)
        row, column = np.abs(file["y"] - 1.7).argmin(), np.abs(file["x"] - 7.1).argmin()
        assert file["level"][row, column] == pytest.approx(
            amap.sample("level", *nearest_centre(amap, 7.1, 1.7))
        )
        assert json.loads(str(file["attributes"]))["environment"] == "house"
