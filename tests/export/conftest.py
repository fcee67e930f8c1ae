"""Maps that the tests of exports share, each built once, and what writes one of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest
import shapely

import ambinav as an
from ambinav.export.formats.exporting import export_map
from ambinav.export.options import ExportOptions

LASER = an.RangeSensor(max_range=2.0, std=0.02, resolution=0.01)
FLOOR = [(0, 0), (3, 0), (3, 1), (11, 1), (11, 2.5), (3, 2.5), (3, 3), (0, 3)]


def building() -> an.Environment:
    """A room with a corridor and a hall wider than the laser's range, a pillar in the hall."""
    corridor = shapely.Polygon(FLOOR)
    hall = shapely.box(11, -2, 18, 6).difference(shapely.box(12, 0, 12.5, 0.5))
    return an.environment_from_shapes(
        [corridor.union(hall)],
        walls=[shapely.LineString([(1.0, 0.0), (1.0, 1.5)])],
        openings=[shapely.LineString([(0, 1), (0, 2)])],
        name="house",
    )


@pytest.fixture(scope="session")
def amap() -> an.AmbiguityMap:
    """The building for a laser that looks all around."""
    scanner = an.RangeScanner.planar(sensor=LASER, beams=36, aperture=math.tau)
    return an.build_map(building(), scanner, spacing=0.2, radius=1.2)


@pytest.fixture(scope="session")
def headed_map() -> an.AmbiguityMap:
    """The building for a laser that looks ahead: the heading matters."""
    scanner = an.RangeScanner.planar(sensor=LASER, beams=18, aperture=math.pi)
    return an.build_map(building(), scanner, spacing=0.5, radius=0.6, headings=4)


@pytest.fixture
def write(tmp_path: Path, amap: an.AmbiguityMap) -> Callable[..., tuple[Path, ...]]:
    """What exports the map into the test's folder: kind, name of the file, options."""

    def written(
        kind: str, name: str, of: an.AmbiguityMap = amap, **options: object
    ) -> tuple[Path, ...]:
        chosen = ExportOptions(**options)  # type: ignore[arg-type]
        return export_map(of, kind, tmp_path / name, chosen)

    return written


@pytest.fixture
def route(tmp_path: Path, amap: an.AmbiguityMap) -> Path:
    """A route through the corridor: the file."""
    from ambinav.geometry.motion.steering import Steering
    from ambinav.routes.evaluate import evaluate_route
    from ambinav.routes.files import save_route

    poses = [(2.0, 1.5, 0.0), (10.0, 1.5, 0.0), (14.0, 4.0, 0.0)]
    found = evaluate_route(an.AmbiguityService(amap), poses, Steering("r2"), planner="test")
    save_route(found, tmp_path / "route.csv")
    return tmp_path / "route.csv"


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """A drive through the corridor, as the exports of a comparison write it: the file."""
    import numpy as np

    from ambinav.drive.drives import Drives
    from ambinav.logs.export_drive import export_drive

    count = 5
    truth = np.column_stack([np.linspace(2.0, 6.0, count), np.full(count, 1.5), np.zeros(count)])
    covariance = np.tile(np.diag([0.04, 0.01, 0.001]), (1, count, 1, 1))
    covariance[0, :, 0, 2] = covariance[0, :, 2, 0] = 0.002
    drives = Drives(
        time=np.arange(count) * 0.5,
        truth=truth[np.newaxis],
        odometry=(truth - truth[0])[np.newaxis],
        estimate=(truth + np.array([0.1, 0.0, 0.01]))[np.newaxis],
        covariance=covariance,
        updated=np.array([[True, False, True, False, True]]),
        samples=np.array([count]),
        outcome=np.array([1]),
        goal=(6.0, 1.5, 0.0),
        length=4.0,
        open_loop=False,
        ranges=None,
    )
    export_drive(drives, 0, tmp_path / "run-001", formats=["csv"])
    return tmp_path / "run-001" / "drive.csv"
