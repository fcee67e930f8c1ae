"""What a page without a server holds: rasters, parameters, modules."""

from __future__ import annotations

import base64
import io
import json
import re

import numpy as np
import pytest
from PIL import Image

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.reports.page import rasters
from ambinav.reports.page.map_data import map_data
from ambinav.reports.page.single_file import modules, page_parts
from ambinav.reports.parameters import map_parameters, scenario_parameters
from ambinav.studies.compare.document import _parameters
from ambinav.studies.compare.scenario import Scenario
from tests.maps import synthetic


def decoded(uri: str, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
    """Values and classes of a raster, as the page reads them."""
    head, _, text = uri.partition(",")
    assert head == "data:image/png;base64"
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(text)))).astype(int)
    step = pixels[..., 0] * 256 + pixels[..., 1]
    values = np.where(step > rasters.LEVELS, np.nan, low + step / rasters.LEVELS * (high - low))
    return values, pixels[..., 2]


def test_a_raster_keeps_values_to_a_65534th():
    rng = np.random.default_rng(1)
    values = rng.normal(3.0, 10.0, (40, 57))
    values[rng.random(values.shape) < 0.2] = np.nan
    codes = rng.integers(0, 8, values.shape).astype(np.uint8)
    uri, low, high = rasters.encode(values, codes)
    found, classes = decoded(uri, low, high)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(values))
    np.testing.assert_allclose(found, values, atol=0.51 * (high - low) / rasters.LEVELS)
    np.testing.assert_array_equal(classes, codes)
    for flat in (np.full((2, 3), 4.5), np.full((2, 3), np.nan)):
        again, _ = decoded(*rasters.encode(flat, codes[:2, :3])[:3])
        np.testing.assert_allclose(again, flat)


@pytest.mark.parametrize(("most", "block"), [(10**9, 1), (600, 2), (150, 4)])
def test_of_a_large_lattice_the_worst_cell_stands_for_its_block(monkeypatch, most, block):
    monkeypatch.setattr(rasters, "MOST_CELLS", most)
    rng = np.random.default_rng(2)
    free = np.zeros((60, 70), dtype=bool)
    free[10:40, 15:61] = rng.random((30, 46)) < 0.7
    level = np.where(free, rng.random(free.shape), np.nan)
    x, y = 0.5 * np.arange(70), 2.0 + 0.5 * np.arange(60)
    window = rasters.Window.around(x, y, 0.5, free, level)
    assert window.block == block
    taken = window.take(level)
    rows, columns = np.nonzero(free)
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        i = int((window.bounds[3] - y[row]) / (0.5 * block))
        j = int((x[column] - window.bounds[0]) / (0.5 * block))
        assert taken[i, j] >= level[row, column]
    assert np.nanmax(taken) == np.nanmax(level)


@pytest.mark.parametrize("headings", [0, 4])
def test_the_map_is_told_in_the_form_of_the_service(headings):
    amap = AmbiguityMap(synthetic.dataset(headings=headings))
    data = map_data(amap, _scanner())
    assert json.loads(json.dumps(data, allow_nan=False)) is not None
    about = data["map"]
    assert about["headings"] == (headings or None)
    raster = data["rasters"]["level"]
    values, codes = decoded(raster["png"], raster["low"], raster["high"])
    assert values.shape == tuple(about["shape"])
    left, _, _, top = about["bounds"]
    for x, y in ((2.05, 2.05), (10.05, 2.05), (21.05, 5.05)):
        row, column = int((top - y) / amap.spacing), int((x - left) / amap.spacing)
        assert values[row, column] == pytest.approx(amap.sample("level", x, y), abs=2e-5)
        assert codes[row, column] == amap.sample("zone", x, y)


def _scanner():
    from ambinav.sensing.scanner import RangeScanner

    return RangeScanner.from_preset("polaroid-6500-ring")


def test_every_parameter_has_a_sentence(plan_map):
    amap = AmbiguityMap.open(plan_map)
    listed = map_parameters(json.loads(amap.dataset.attrs["parameters"]) | {"cost_layer": "level"})
    assert [one.name for one in listed if not one.text] == []
    assert next(one for one in listed if one.name == "spacing").unit == "m"
    pairs = [{"name": "p", "start": [0, 0], "goal": [1, 1]}]
    scenario = Scenario(name="n", environment="e", scanner="s", pairs=pairs, routes=["shortest"])
    parameters = scenario_parameters(_parameters(scenario))
    assert [one.name for one in parameters if not one.text] == []
    assert next(one for one in parameters if one.name == "robot.max speed").unit == "m/s"


def test_one_file_holds_every_module_and_text_cannot_end_a_script():
    parts = page_parts({"map": {"name": "</script><b>"}})
    found = re.search(r'<script type="importmap">(.*?)</script>', parts.scripts)
    assert found
    imports = json.loads(found[1])["imports"]
    assert {f"page/{name}" for name in modules("report.js")} == set(imports)
    for address in imports.values():
        text = base64.b64decode(address.partition(",")[2]).decode()
        assert not re.search(r'from "\./', text)
    assert parts.scripts.count("</script>") == 4
    data = re.search(r'id="ambinav-data">(.*?)</script>', parts.scripts)
    assert data and json.loads(data[1])["map"]["name"] == "</script><b>"
