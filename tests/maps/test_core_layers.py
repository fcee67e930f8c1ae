"""The records of the layers that every map has: a stored map says what they say."""

from __future__ import annotations

import math

import pytest

from ambinav.map_building.build import build_map
from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.core_layers import CORE_LAYERS
from ambinav.sensing import RangeScanner, RangeSensor
from tests.geometry import scenes


@pytest.fixture(scope="module")
def amap() -> AmbiguityMap:
    sensor = RangeSensor(max_range=2.0, std=0.03, resolution=0.01)
    scanner = RangeScanner.planar(sensor, 8, math.pi / 2)
    return build_map(scenes.room(3.0, 2.0), scanner, 0.4, headings=4)


def test_a_map_of_headings_is_made_of_the_recorded_layers(amap: AmbiguityMap) -> None:
    summaries = {
        f"{one.name}_{summary}" for one in CORE_LAYERS.values() for summary in one.summaries
    }
    # The mean of a class and of an axis is that of the mean tensor.
    apart = {"zone_mean", "direction_mean"}
    turning = {"heading", "heading_radius"}  # of maps without headings alone
    assert set(amap.layers) | turning == {*CORE_LAYERS, *summaries, *apart} | turning


def test_a_layer_is_called_as_its_record_says(amap: AmbiguityMap) -> None:
    for name in amap.layers:
        record = CORE_LAYERS[schema.base_name(name)]
        attrs = amap.dataset[name].attrs
        assert attrs["units"] == record.unit
        assert attrs["long_name"].startswith(record.title)
        robot = {"robot_radius", "robot_start"} if name == "judged" else set()
        assert set(attrs) == {"units", "long_name"} | robot


def test_shares_lie_between_0_and_1(amap: AmbiguityMap) -> None:
    shares = [name for name in amap.layers if schema.is_share(name)]
    assert "level_best" in shares and "major_radius" not in shares
    for name in shares:
        values = amap.dataset[name].values
        assert values[values == values].min() >= 0.0
        assert values[values == values].max() <= 1.0
