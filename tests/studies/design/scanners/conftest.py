"""A hall with a corridor, and scanners that differ in all that matters."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.environment import Environment
from ambinav.routes.route import Route
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav.studies.design.scanners.compare import ScannerTable, compare_scanners
from ambinav.studies.design.scanners.costs import Cost, Costs

SPACING = 0.25


@pytest.fixture(scope="session")
def hall() -> Environment:
    hall, corridor = shapely.box(0, 0, 7, 5), shapely.box(7, 1.5, 17, 3)
    return environment_from_shapes([hall, corridor], [shapely.box(1, 3.6, 1.6, 4.4)], name="hall")


@pytest.fixture(scope="session")
def scanners() -> dict[str, RangeScanner]:
    def laser(name: str, far: float, beams: int, degrees: float = 360.0) -> RangeScanner:
        sensor = RangeSensor(max_range=far, std=0.03, resolution=0.001)
        return RangeScanner.planar(sensor, beams, math.radians(degrees), name=name)

    sonar = RangeSensor(max_range=2.0, std=0.03, resolution=0.01, aperture=math.radians(30.0))
    every = (
        laser("long", 9.0, 40),
        laser("short", 1.5, 40),
        laser("ahead", 4.0, 20, 120.0),
        RangeScanner.ring(sonar, 12, 0.1, name="ring"),
    )
    return {scanner.name: scanner for scanner in every}


@pytest.fixture(scope="session")
def routes() -> list[tuple[str, Route]]:
    """One through the corridor, one across the hall."""
    points = ([(1.0, 1.0), (7.2, 2.25), (16.5, 2.25)], [(3.0, 4.5), (6.5, 0.5)])
    return [(f"route {i}.csv", Route.through(one)) for i, one in enumerate(points)]


@pytest.fixture(scope="session")
def costs() -> Costs:
    return Costs(
        {
            "long": Cost(price=900.0, power=8.0),
            "short": Cost(price=80.0),
            "ring": Cost(price=40.0, power=1.0),
        },
        "costs.csv",
    )


@pytest.fixture(scope="session")
def table(hall, scanners, routes, costs) -> ScannerTable:
    return compare_scanners(
        hall, scanners.values(), spacing=SPACING, routes=routes, costs=costs, layers=["gfm"],
        store=False,
    )  # fmt: skip


@pytest.fixture(scope="session")
def sampled(hall, scanners) -> ScannerTable:
    return compare_scanners(
        hall, [scanners["short"]], spacing=SPACING, pairs=3, rng=np.random.default_rng(5),
        store=False,
    )  # fmt: skip
