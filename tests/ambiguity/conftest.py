"""The demo building, the laser that most tests use, and its map, built once."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.sensing import RangeScanner, RangeSensor

DEMO = Path(__file__).parents[2] / "configs" / "demo.geojson"


@pytest.fixture(scope="session")
def demo() -> Environment:
    return load_environment(DEMO)


@pytest.fixture(scope="session")
def laser() -> RangeScanner:
    """60 beams of 4 m around the robot."""
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    return RangeScanner.planar(sensor, 60, 2 * math.pi)


@pytest.fixture(scope="session")
def demo_map(demo: Environment, laser: RangeScanner) -> AmbiguityMap:
    return build_map(demo, laser)
