"""Which layer is read where nobody names one: by maps, services, drives, environments."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import ambinav as an
from ambinav.ambiguity.cost_layer import cost_layer
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.policy import seen_in
from ambinav_planners import RoutePlanner
from tests.geometry import scenes
from tests.maps import synthetic

LASER = an.RangeSensor(max_range=4.0, std=0.03, resolution=0.01)
SONAR = an.RangeSensor(max_range=3.0, std=0.05, resolution=0.02, aperture=math.radians(30.0))
AROUND = an.RangeScanner.planar(sensor=LASER, beams=36, aperture=math.tau)
AHEAD = an.RangeScanner.planar(sensor=LASER, beams=12, aperture=math.radians(60.0))
RING = an.RangeScanner.ring(SONAR, 8, 0.1)
MIXED = an.RangeScanner.mixed(RING, AHEAD)


@pytest.fixture(scope="module")
def amap() -> an.AmbiguityMap:
    return an.build_map(scenes.room(6.0, 4.0), MIXED, spacing=0.5, headings=4)


@pytest.mark.parametrize(
    ("scanner", "layer"),
    [
        (AROUND, "level"),
        (AHEAD, "level"),
        (RING, "level"),
        (MIXED, "position"),
        # Whichever way the robot turns, it has both.
        (an.RangeScanner.mixed(AROUND, an.RangeScanner.ring(SONAR, 36, 0.0)), "level"),
    ],
)
def test_sensors_that_differ_and_do_not_look_all_around(
    scanner: an.RangeScanner, layer: str
) -> None:
    assert cost_layer(scanner) == layer
    parameters = NavigationParameters(scanner=scanner)
    assert parameters.cost_layer == seen_in({"scanner": scanner})["layer"] == layer
    assert NavigationParameters(scanner=scanner, layer="major").cost_layer == "major"


@pytest.mark.slow
def test_a_map_has_it_says_so_and_keeps_it(amap: an.AmbiguityMap, tmp_path: Path) -> None:
    amap.save(tmp_path / "map.zarr")
    for one in (amap, an.AmbiguityMap.open(tmp_path / "map.zarr")):
        assert one.cost_layer == "position"
        assert "position" in one.layers
    # Maps that were made before maps said so.
    assert an.AmbiguityMap(synthetic.dataset()).cost_layer == "level"


@pytest.mark.slow
def test_services_and_planners_read_it(amap: an.AmbiguityMap) -> None:
    service = an.AmbiguityService(amap)
    assert service.layer == RoutePlanner(amap).service.layer == "position"
    assert an.AmbiguityService(amap, "level").layer == "level"
    x, y = np.array([1.0, 3.0, 5.0]), np.full(3, 2.0)
    expected = 1.0 + 5.0 * amap.sample("position", x, y)
    np.testing.assert_allclose(service.cost(x, y), expected, rtol=1e-6)
    route = RoutePlanner(amap).plan((1.0, 1.0), (5.0, 3.0), planner_name="reference")
    assert route.layer == "position"


@pytest.mark.slow
def test_environments_read_it() -> None:
    seen, info = {}, {}
    for layer in (None, "position", "level"):
        env = NavigationEnv(map=scenes.room(9.0, 7.0), scanner=MIXED, layer=layer)
        seen[layer], _ = env.reset(seed=0)
        *_, info[layer] = env.step(np.array([1.0, 0.0]))
    assert np.array_equal(seen[None]["window"], seen["position"]["window"])
    assert not np.array_equal(seen[None]["window"], seen["level"]["window"])
    assert info[None]["exposure"] == info["position"]["exposure"] != info["level"]["exposure"]
