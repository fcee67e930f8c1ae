"""A ring of 16 sonars with cones of 30 degrees: a finite, sensible map, corners included."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import CORRIDOR, LOCALIZABLE, OPEN
from ambinav.sensing import RangeScanner
from tests.geometry import scenes


@pytest.fixture(scope="module")
def ring() -> RangeScanner:
    return RangeScanner.from_preset("polaroid-6500-ring")


@pytest.fixture(scope="module")
def demo_sonar(demo: Environment, ring: RangeScanner) -> AmbiguityMap:
    return build_map(demo, ring, spacing=0.2)


def test_every_free_cell_has_a_value_and_no_other(demo_sonar: AmbiguityMap) -> None:
    dataset = demo_sonar.dataset
    free = dataset["free"].values
    assert free.sum() > 19_000
    for name, layer in dataset.data_vars.items():
        if layer.dims == ("y", "x") and layer.dtype == np.float32:
            assert np.isfinite(layer.values[free]).all(), name
            assert np.isnan(layer.values[~free]).all() or name == "clearance", name
    for name in ("ambiguity", "major", "minor", "level", "heading"):
        values = dataset[name].values[free]
        assert values.min() >= 0.0 and values.max() <= 1.0


def test_the_demo_is_mostly_localizable_and_its_bare_corridors_are_weak(
    demo_sonar: AmbiguityMap,
) -> None:
    share = {zone.zone: zone.share for zone in demo_sonar.zone_shares()}
    assert share["localizable"] > 0.6
    assert share["open"] < 0.05, "the ring reaches 10 m: in this building it always sees a wall"
    t = np.linspace(4.5, 7.5, 13)
    x, y = 22.4 + t * math.cos(math.radians(33)), 1.81 + t * math.sin(math.radians(33))
    assert (demo_sonar.sample("zone", x, y) == CORRIDOR).mean() > 0.8
    direction = np.asarray(demo_sonar.sample("direction", x, y))
    assert np.abs(direction - math.radians(33)).max() < math.radians(3)


@pytest.mark.parametrize("degrees", [0, 17, 40])
def test_a_room_and_its_corners(ring: RangeScanner, degrees: float) -> None:
    amap = build_map(scenes.room(5.0, 4.0).transformed(math.radians(degrees)), ring)
    free = amap.dataset["free"].values
    # Nearer than the ring's own radius to a wall some sensors would be inside it.
    clear = free & (amap.dataset["clearance"].values > 0.25)
    assert np.isfinite(amap.dataset["level"].values[free]).all()
    assert (amap.dataset["zone"].values[clear] == LOCALIZABLE).mean() > 0.95
    assert np.nanmedian(amap.dataset["level"].values[clear]) < 0.2


@pytest.mark.parametrize("degrees", [0, 5, 17, 33])
def test_a_long_corridor(ring: RangeScanner, degrees: float) -> None:
    angle = math.radians(degrees)
    amap = build_map(scenes.room(30.0, 2.4).transformed(angle), ring)
    c, s = math.cos(angle), math.sin(angle)
    x, y = np.meshgrid(np.linspace(13, 17, 9), np.linspace(0.5, 1.9, 8))
    x, y = c * x - s * y, s * x + c * y
    assert np.asarray(amap.sample("major", x, y)).min() > 0.8
    assert np.asarray(amap.sample("minor", x, y)).max() < 0.15
    off = np.asarray(amap.sample("direction", x, y)) - angle
    assert np.degrees(np.abs(np.arctan(np.tan(off)))).max() < 2.0


@pytest.mark.slow
def test_a_hall_beyond_its_range_and_its_walls(ring: RangeScanner) -> None:
    amap = build_map(scenes.room(30.0, 30.0), ring, spacing=0.25)
    x, y = np.meshgrid(np.linspace(13, 17, 5), np.linspace(13, 17, 5))
    assert (amap.sample("zone", x, y) == OPEN).all()
    assert np.asarray(amap.sample("ambiguity", x, y)).min() > 0.99
    away = np.array([1.0, 2.0, 4.0])
    assert (amap.sample("zone", np.full(3, 15.0), away) == CORRIDOR).all()
    assert (amap.sample("zone", away, away) == LOCALIZABLE).all()
