"""The made-up building as an environment, with scanners to look at it."""

from __future__ import annotations

import math

import pytest
from shapely import Polygon

from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav.studies.audit.audit import Audit, audit
from tests.maps import synthetic


@pytest.fixture(scope="session")
def building() -> Environment:
    return Environment(
        Segments(*synthetic.segments()),
        Polygon(synthetic.OUTLINE),
        name="synthetic <building>",
        checksum="ab" * 32,
        notes=("one ring was not closed",),
    )


@pytest.fixture(scope="session")
def laser() -> RangeScanner:
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    return RangeScanner.planar(sensor, 60, 2 * math.pi, name="test laser")


@pytest.fixture(scope="session")
def sonar() -> RangeScanner:
    sensor = RangeSensor(max_range=2.5, std=0.03, resolution=0.01, aperture=math.radians(30.0))
    return RangeScanner.ring(sensor, 4, 0.2, name="test sonar")


@pytest.fixture(scope="session")
def examined(building, laser) -> Audit:
    return audit(AmbiguityMap(synthetic.dataset()), building, laser, places=4)


@pytest.fixture(autouse=True)
def coarse_unless_reported(request: pytest.FixtureRequest) -> None:
    """Draw coarse pictures, but in the tests of reports."""
    if "report" not in request.node.nodeid:
        request.getfixturevalue("coarse_pictures")
