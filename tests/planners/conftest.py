"""Maps and robots that the tests of planning share, each built once."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from ambinav import AmbiguityMap, RangeScanner, RangeSensor, build_map, load_environment
from ambinav.service.service import AmbiguityService
from ambinav_planners.planning import RoutePlanner

DEMO = Path(__file__).parents[2] / "configs" / "demo.geojson"
LASER = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)


@pytest.fixture(autouse=True)
def seeded_plans(request: pytest.FixtureRequest) -> None:
    """Fork where plans are seeded, but in the tests of just this."""
    if request.path.name != "test_seeded.py":
        request.getfixturevalue("forked_plans")


@pytest.fixture(scope="session")
def demo_map() -> AmbiguityMap:
    """The demo building for a laser that looks all around; it has no headings."""
    scanner = RangeScanner.planar(sensor=LASER, beams=60, aperture=2.0 * math.pi)
    return build_map(load_environment(DEMO), scanner, spacing=0.2)


@pytest.fixture(scope="session")
def heading_map() -> AmbiguityMap:
    """The demo building for a laser that looks ahead only: the heading counts."""
    scanner = RangeScanner.planar(sensor=LASER, beams=60, aperture=math.pi)
    return build_map(load_environment(DEMO), scanner, spacing=0.4, headings=8)


@pytest.fixture(scope="session")
def demo(demo_map: AmbiguityMap) -> AmbiguityService:
    """What a metre costs in the demo building, at weight 5."""
    return AmbiguityService(demo_map, weight=5.0)


@pytest.fixture(scope="session")
def robot(demo: AmbiguityService) -> RoutePlanner:
    """A round robot in the demo building, in r2."""
    return RoutePlanner(demo)
