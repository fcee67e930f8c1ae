from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ambinav.layers.context import LayerContext
from ambinav.layers.position import position_radius
from ambinav.layers.registry import LAYERS
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav.service.service import AmbiguityService
from tests.geometry import scenes
from tests.maps import synthetic

NAMES = ("major", "minor", "major_radius", "minor_radius", "direction")


@pytest.fixture(scope="module")
def laser() -> RangeScanner:
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.01)
    return RangeScanner.planar(sensor, 60, 2.0 * math.pi)


@pytest.fixture(scope="module")
def fan() -> RangeScanner:
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.01)
    return RangeScanner.planar(sensor, 20, math.radians(120.0))


def made(headings: int, **values: NDArray[np.float64] | float) -> AmbiguityMap:
    """The synthetic map with these values in every free cell, of each heading if they are many."""
    data = synthetic.dataset(headings)
    for name, value in values.items():
        layer = data[name]
        data[name] = (layer.dims, np.where(np.isnan(layer.values), np.nan, value))
    return AmbiguityMap(data)


def free(amap: AmbiguityMap, values: NDArray[np.float64]) -> NDArray[np.float64]:
    inside = amap.dataset["free"].values
    assert np.isnan(values[~inside]).all()
    return np.asarray(values[inside])


def test_a_scanner_that_looks_all_around_has_the_trace_of_the_tensor() -> None:
    amap = made(0, major_radius=0.3, minor_radius=0.04)
    assert free(amap, position_radius(amap)) == pytest.approx(0.05 * math.sqrt(36.64), rel=1e-6)
    assert (free(amap, position_radius(amap, 7.0)) == free(amap, position_radius(amap))).all()


@pytest.mark.parametrize("views", [1.0, 2.0, 8.0])
def test_without_information_the_neighbourhood_is_left(views: float) -> None:
    amap = made(4, major=1.0, minor=1.0, major_radius=0.25, minor_radius=0.2)
    still = made(4, major=1.0, minor=1.0, major_radius=0.25, minor_radius=0.2, direction=0.3)
    assert free(still, position_radius(still, views)) == pytest.approx(math.hypot(0.25, 0.2))
    # The mean of inverse tensors turned any way is no larger than that.
    assert (free(amap, position_radius(amap, views)) <= math.hypot(0.25, 0.2) + 1e-9).all()


@pytest.mark.slow
def test_views_add_up_as_independent_scans_do() -> None:
    # With a share of next to nothing the neighbourhood plays no part: information times views.
    amap = made(4, major=1e-4, minor=1e-4, major_radius=0.2, minor_radius=0.1, direction=1.0)
    once, four = (free(amap, position_radius(amap, views)) for views in (1.0, 4.0))
    assert once == pytest.approx(math.hypot(0.2, 0.1), rel=1e-6)
    assert four == pytest.approx(once / 2.0, rel=1e-6)


def test_headings_that_are_weak_across_each_other_leave_little() -> None:
    weak = dict(major=1.0, minor=0.04, major_radius=0.25, minor_radius=0.01)
    along = made(2, **weak, direction=0.0)
    crossed = made(2, **weak, direction=np.array([0.0, math.pi / 2]))
    a, b = (free(m, position_radius(m, 2.0)) for m in (along, crossed))
    assert (a > 0.24).all() and (b < 0.02).all()


def test_is_the_trace_of_the_mean_of_inverse_tensors() -> None:
    rng = np.random.default_rng(4)
    minor = rng.uniform(0.01, 0.1, 4)
    major = minor + rng.uniform(0.0, 0.1, 4)
    direction = rng.uniform(0.0, math.pi, 4)
    shares = rng.uniform(0.1, 1.0, (2, 4))
    amap = made(4, major=shares[0], minor=shares[1], major_radius=major, minor_radius=minor,
                direction=direction)  # fmt: skip
    total = np.zeros((2, 2))
    for k in range(4):
        axes = np.array([[math.cos(direction[k]), -math.sin(direction[k])],
                         [math.sin(direction[k]), math.cos(direction[k])]])  # fmt: skip
        inverse = axes @ np.diag([major[k] ** -2.0, minor[k] ** -2.0]) @ axes.T
        whole = axes @ np.diag((shares[:, k] / [major[k], minor[k]]) ** 2) @ axes.T
        total += (whole + 3.0 * (inverse - whole)) / 4
    expected = math.sqrt(np.trace(np.linalg.inv(total)))
    # The map keeps float32.
    assert free(amap, position_radius(amap, 3.0)) == pytest.approx(expected, rel=1e-5)


def test_views_are_checked() -> None:
    with pytest.raises(InputError, match="views is 0"):
        position_radius(made(2), 0.0)


@pytest.mark.slow
def test_as_a_layer_it_is_a_share_of_a_featureless_disc(laser: RangeScanner) -> None:
    # A hall so wide that its middle sees nothing: the free disc, but for the lattice's corners.
    amap = build_map(scenes.room(14.0, 14.0), laser, 0.1, layers=["position"])
    expected = position_radius(amap)
    radius = amap.dataset["position_radius"].values
    np.testing.assert_allclose(radius, expected, rtol=1e-6)
    share = amap.dataset["position"].values
    np.testing.assert_allclose(share, np.minimum(expected / (0.5 / math.sqrt(2.0)), 1.0), rtol=1e-6)
    assert amap.sample("position", 7.0, 7.0) == pytest.approx(1.0, abs=0.05)
    assert amap.sample("position", 0.5, 0.5) < 0.1


def test_a_scanner_with_headings_has_one_value_a_place(fan: RangeScanner) -> None:
    amap = build_map(scenes.room(4.0, 3.0), fan, 0.2, headings=6, layers=["position"])
    assert amap.dataset["position"].dims == ("y", "x")
    service = AmbiguityService(amap, layer="position", weight=4.0)
    x, y = 1.0, 1.4
    assert service.cost(x, y, 0.3) == pytest.approx(1.0 + 4.0 * amap.sample("position", x, y))


def test_ground_without_a_map_has_no_position(laser: RangeScanner) -> None:
    amap = build_map(scenes.room(4.0, 3.0), laser, 0.5)
    context = replace(LayerContext.of(amap), amap=None)
    with pytest.raises(InputError, match="build the map first"):
        LAYERS.get("position").compute(context)
