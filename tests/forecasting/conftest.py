"""A map with a hall that a laser of 4 m does not reach across, and routes through it."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from ambinav import AmbiguityMap, RangeScanner, RangeSensor, build_map, load_environment

DEMO = Path(__file__).parents[2] / "configs" / "demo.geojson"


@pytest.fixture(scope="session")
def demo_map() -> AmbiguityMap:
    """The demo building for a laser that looks all around; it has no headings."""
    laser = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    scanner = RangeScanner.planar(sensor=laser, beams=60, aperture=2.0 * math.pi)
    return build_map(load_environment(DEMO), scanner, spacing=0.2)
