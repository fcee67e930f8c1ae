"""Obstacles in buildings in space: against the plan with them, closed forms, and a mesh."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.drive.clutter import OBSTACLE_HEIGHT, scattered_boxes, with_obstacles
from ambinav.drive.drive import drive_route
from ambinav.drive.robot import Robot
from ambinav.geometry.environment import Environment
from ambinav.geometry.extrude import extruded
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.drive.cases import route_through
from tests.geometry import scenes
from tests.geometry.furnished import furnished
from tests.localization import worlds

SENSOR = RangeSensor(max_range=12.0, std=0.03, resolution=0.001)
LIDAR = RangeScanner.layered(SENSOR, 36, np.radians([-40.0, -15.0, 0.0, 10.0]), z=1.3)
HEIGHT = 2.5


def laser(z: float) -> RangeScanner:
    # Turned by a hair: no beam looks along a wall.
    return RangeScanner.planar(SENSOR, 90, math.tau, (0.05, 0.0, 0.003)).raised(z)


def poses(env: Environment, count: int, seed: int = 0) -> np.ndarray:
    """Anywhere in the bounds, in walls and obstacles too; shape (3, count)."""
    rng = np.random.default_rng(seed)
    xmin, ymin, xmax, ymax = env.bounds
    return rng.uniform((xmin, ymin, -3.0), (xmax, ymax, 3.0), (count, 3)).T


@pytest.mark.parametrize("seed", range(3))
def test_full_obstacles_in_an_extruded_plan_are_those_of_the_plan(seed: int) -> None:
    plan = scenes.scene(seed, size=15.0, blocks=6, thin=3)
    rng = np.random.default_rng(seed)
    boxes = scattered_boxes(plan, 8, rng)
    # One in a wall and out of the building, one across a wall without thickness, two that overlap.
    x, y = plan.thin_walls[0, :2]
    boxes += [shapely.box(-1, 3, 1, 4), shapely.box(x - 0.3, y - 0.2, x + 0.3, y + 0.3)]
    boxes += [shapely.affinity.translate(boxes[0], 0.2, 0.1)]
    flat = with_obstacles(plan, boxes)
    tall = with_obstacles(plan.in_space(extruded(plan, HEIGHT)), boxes, height=HEIGHT)
    assert tall.free.equals(flat.free) and tall.segments.same_as(flat.segments)
    where = poses(plan, 200, seed)
    for z in (0.2, 2.3):
        wanted, found = (laser(z).scan(env, *where) for env in (flat, tall))
        assert np.isnan(wanted).any() and np.array_equal(np.isnan(wanted), np.isnan(found))
        finite = np.isfinite(wanted)
        assert np.array_equal(finite, np.isfinite(found))
        assert np.abs(wanted[finite] - found[finite]).max() < 1e-4


def test_rays_pass_over_obstacles_and_end_on_their_tops() -> None:
    plan = scenes.room(10.0, 6.0)
    tall = plan.in_space(extruded(plan, HEIGHT))
    box = shapely.box(5.0, 2.0, 6.0, 4.0)
    world = with_obstacles(tall, [box])
    assert not world.is_free(5.5, 3.0) and world.is_free(4.9, 3.0)
    where = np.array([[2.0, 3.0, 0.0]]).T

    def ahead(z: float, elevation: float) -> float:
        up = [[z, elevation]]
        scanner = RangeScanner.from_mounts(SENSOR, [[0.0, 0.0, 0.0]], upright=up)
        return float(scanner.scan(world, *where)[0, 0])

    assert ahead(OBSTACLE_HEIGHT - 0.01, 0.0) == pytest.approx(3.0, abs=1e-6)
    assert ahead(OBSTACLE_HEIGHT + 0.01, 0.0) == pytest.approx(8.0, abs=1e-6)
    # Down to the middle of the top, 3.5 m ahead and 1 m below.
    angle = math.atan2(1.0, 3.5)
    assert ahead(OBSTACLE_HEIGHT + 1.0, -angle) == pytest.approx(math.hypot(1.0, 3.5), abs=1e-6)
    assert ahead(OBSTACLE_HEIGHT + 1.0, -math.atan2(2.0, 2.5)) == pytest.approx(
        math.hypot(2.0, 2.5), abs=1e-6
    )


def test_a_mesh_and_prisms_get_the_same_obstacles() -> None:
    pytest.importorskip("embreex", reason="embreex is not installed")
    boxes = [shapely.box(1.0, 0.5, 1.6, 1.2), shapely.Point(3.0, 3.0).buffer(0.4)]
    prisms, mesh = furnished()
    bare = LIDAR.scan(prisms, 2.0, 2.5, 0.3)
    one, other = (with_obstacles(env, boxes) for env in (prisms, mesh))
    where = np.array([(2.0, 2.5, 0.3), (5.0, 1.0, 2.0), (0.5, 3.0, -1.0)]).T
    scans = [LIDAR.scan(env, *where) for env in (one, other)]
    assert np.abs(scans[0] - scans[1]).max() < 1e-4
    assert np.abs(scans[0][0] - bare).max() > 0.5


@pytest.mark.slow
def test_drives_among_full_obstacles_are_those_of_the_plan() -> None:
    plan = worlds.room()
    boxes = [shapely.box(3.0, 2.5, 3.6, 3.1), shapely.box(8.2, 2.0, 8.8, 2.6)]
    drives = []
    for env in (plan, plan.in_space(extruded(plan, HEIGHT))):
        route = route_through([(1.0, 1.0), (7.5, 1.5), (7.5, 3.0)])
        drives.append(
            drive_route(
                env, laser(0.4), Robot(radius=0.2), route, "mcl", np.random.default_rng(5), runs=2,
                world=with_obstacles(env, boxes, height=HEIGHT), keep_ranges=True,
            )
        )  # fmt: skip
    flat, solid = drives
    assert np.array_equal(flat.outcome, solid.outcome)
    assert np.allclose(flat.estimate, solid.estimate, rtol=0.0, atol=1e-6, equal_nan=True)
    assert flat.ranges is not None and solid.ranges is not None
    assert np.allclose(flat.ranges, solid.ranges, rtol=0.0, atol=1e-4, equal_nan=True)


@pytest.mark.parametrize("height", [0.0, -1.0, math.nan, math.inf])
def test_a_height_that_is_none_is_refused(height: float) -> None:
    with pytest.raises(InputError, match=r"height is .*above 0 m"):
        with_obstacles(scenes.room(4.0, 4.0), [shapely.box(1, 1, 2, 2)], height=height)
