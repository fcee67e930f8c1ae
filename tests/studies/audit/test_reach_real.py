"""On every real map: the reachable share is stated, and no worst place lies elsewhere.

What is reachable is checked on the map's raw cells, by a flood fill that knows nothing of polygons.
"""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from scipy import ndimage
from shapely import Point

from ambinav.buildings.boundary import GAP_CELLS, LARGEST_DEFAULT_GAP, TOLERANCE_CELLS
from ambinav.geometry.collision.reach import find_reach
from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED
from ambinav.geometry.segments import FRONTIER
from ambinav.map_building.build import build_map
from ambinav.runtime.errors import InputWarning
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav.studies.audit.audit import audit
from ambinav.studies.audit.document import document
from tests import recorded

FOLDERS = ("maps", "maps_from_logs", "maps_research_only", "planner_maps")
POSES = 600


def laser(spacing: float) -> RangeScanner:
    """Sees about ten cells far, so that there are bad places."""
    sensor = RangeSensor(max_range=max(3.0, 6.0 * spacing), std=0.03, resolution=0.01)
    return RangeScanner.planar(sensor, 24, math.tau)


def reached_cells(environment: Environment, radius: float, start: tuple[float, float]):
    """Raw cells that a disc can reach, generously: for all that reading a map may move a wall.

    Walls move by up to `TOLERANCE_CELLS` and one more, and small specks are taken for noise.
    """
    grid = environment.occupancy
    assert grid is not None
    blocked = grid.state != FREE
    if grid.resolution <= LARGEST_DEFAULT_GAP:
        labels, count = ndimage.label(blocked, np.ones((3, 3)))
        index = np.arange(1, count + 1)
        size = ndimage.sum_labels(blocked, labels, index)
        solid = ndimage.sum_labels(grid.state == OCCUPIED, labels, index)
        noise = np.flatnonzero(size <= np.where(solid > 0, GAP_CELLS, 9 * GAP_CELLS)) + 1
        blocked &= ~np.isin(labels, noise)
    away = ndimage.distance_transform_edt(~np.pad(blocked, 1, constant_values=True))[1:-1, 1:-1]
    room = away >= max(radius / grid.resolution - TOLERANCE_CELLS - 1.0, 1.0)
    column, row = (int(v) for v in grid.to_cells(*start))
    labels, _ = ndimage.label(room, np.ones((3, 3)))
    # The deepest place near the start: the start itself may lie where a wall was moved.
    r0, c0 = max(row - 3, 0), max(column - 3, 0)
    near = labels[r0 : row + 4, c0 : column + 4]
    depth = np.where(near > 0, away[r0 : row + 4, c0 : column + 4], -1.0)
    assert depth.max() > 0.0
    return grid, labels == near.ravel()[depth.argmax()]


@pytest.mark.slow(kept=("planner_maps",))
@pytest.mark.parametrize("folder", FOLDERS)
def test_worst_places_lie_on_reachable_explored_floor(data_dir, folder):
    files = sorted((data_dir / folder).glob("*.yaml"))
    assert len(files) >= 5
    for file in files:
        environment, _ = recorded.read(file)
        cell = environment.resolution or 0.0
        # Wide enough that what is closed to the robot is closed to the generous flood fill.
        radius = max(0.3, 5.0 * cell)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)
            reach = find_reach(environment, radius)
        spacing = max(math.sqrt(reach.floor.area / POSES), 0.25)
        if environment.free.area > 50 * reach.floor.area / 2:
            spacing *= 4.0  # the map is mostly other floor
        scanner = laser(spacing)
        amap = build_map(environment, scanner, spacing=spacing, radius=1.5 * spacing)
        found = audit(amap, environment, scanner, places=100, reach=reach)
        report = document(found)
        floor = report.floor
        assert 0.0 < floor.counted_share <= 1.0, file
        assert f"m² of explored floor that it can reach in {environment.name}" in report.summary
        total = floor.counted_share + floor.unexplored_share + floor.unreachable_share
        total += floor.outside_share
        assert total == pytest.approx(1.0, abs=1e-3), file
        # By area: cells stand for polygons.
        reached = floor.counted_area_m2 + floor.unexplored_area_m2
        assert reached == pytest.approx(reach.floor.area, rel=0.25 if spacing < 0.5 else 0.35), file
        deep = reach.floor.buffer(-0.5 * radius)
        start = (reach.floor if deep.is_empty else deep).representative_point()
        grid, cells = reached_cells(environment, radius, (start.x, start.y))
        for finding in found.findings:
            place = finding.place
            assert reach.floor.distance(Point(place.x, place.y)) < 1e-5, (file, place)
            column, row = (int(v) for v in grid.to_cells(place.x, place.y))
            around = cells[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
            assert around.any(), (file, place)
            angle = np.arange(24) * math.tau / 24
            distance, hit = environment.cast_hits(place.x, place.y, angle, scanner.max_range)
            unknown = (hit >= 0) & (environment.segments.kind[hit] == FRONTIER)
            assert unknown.mean() < 0.5 + 1e-9, (file, place)
            assert np.isfinite(distance).all()
