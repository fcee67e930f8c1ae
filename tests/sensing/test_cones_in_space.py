"""Cones in space: a sonar reads the nearest surface of its cone, above and below its axis too."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.geometry.environment import Environment
from ambinav.geometry.extrude import extruded
from ambinav.localization.information import scan_information
from ambinav.runtime.errors import InputError
from ambinav.sensing.rays import WIDEST_SPACING
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav.sensing.sight import look
from tests.geometry import scenes

HALF = math.radians(15.0)
SONAR = RangeSensor(max_range=6.0, std=0.02, resolution=0.01, aperture=2.0 * HALF)
# What a ray may miss of a cone's true nearest point: half of the spacing, across and along.
MISS = 1.0 / math.cos(WIDEST_SPACING / math.sqrt(2.0)) - 1.0


def single(z: float, **fields: float) -> RangeScanner:
    sensor = RangeSensor(max_range=6.0, std=0.02, resolution=0.01, aperture=2.0 * HALF, **fields)
    return RangeScanner.planar(sensor, 1, 0.0, z=z)


def room(height: float = 3.0, solids: tuple[Solid, ...] = ()) -> Environment:
    """8 x 8 m."""
    plan = scenes.environment(shapely.box(0, 0, 8, 8))
    walls = extruded(plan, height)
    return plan.in_space(
        Prisms(
            walls.walls.xy, walls.wall_z, solids=solids, floor=0.0, ceiling=height, free=plan.free
        )
    )


def test_rings_fill_the_cone() -> None:
    scanner = single(1.0)
    rays, fan = scanner.rays(True), scanner.rays()
    u = np.column_stack([
        np.cos(rays.elevation) * np.cos(rays.angle), np.cos(rays.elevation) * np.sin(rays.angle),
        np.sin(rays.elevation),
    ])  # fmt: skip
    off = np.arccos(np.clip(u[:, 0], -1.0, 1.0))
    assert off.max() == pytest.approx(HALF)
    assert off[rays.edge] == pytest.approx(HALF)
    assert off[~rays.edge].max() < HALF - 0.01
    # Any direction within has a ray nearby.
    rng = np.random.default_rng(0)
    turn, tilt = rng.uniform(0.0, math.tau, 500), HALF * np.sqrt(rng.uniform(size=500))
    any_u = np.column_stack(
        [np.cos(tilt), np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn)]
    )
    nearest = np.arccos(np.clip((any_u @ u.T).max(axis=1), -1.0, 1.0))
    assert nearest.max() < WIDEST_SPACING / math.sqrt(2.0) + 1e-3
    level = np.sort(rays.angle[np.abs(rays.elevation) < 1e-12])
    assert level == pytest.approx(fan.angle, abs=1e-12)


@pytest.mark.parametrize("pitch", [-1.5, -0.7, 0.3, 1.4])
def test_a_tilted_cone_is_the_level_one_turned(pitch: float) -> None:
    def units(scanner: RangeScanner) -> np.ndarray:
        rays = scanner.rays(True)
        flat = np.cos(rays.elevation)
        return np.column_stack(
            [flat * np.cos(rays.angle), flat * np.sin(rays.angle), np.sin(rays.elevation)]
        )

    axis = np.array([[0.1, 0.2, 0.5]])
    level = RangeScanner.from_mounts(SONAR, axis, upright=[[1.0, 0.0]])
    tilted = RangeScanner.from_mounts(SONAR, axis, upright=[[1.0, pitch]])
    c, s = math.cos(0.5), math.sin(0.5)
    yaw = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    c, s = math.cos(pitch), math.sin(pitch)
    up = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    assert units(tilted) == pytest.approx(units(level) @ (yaw @ up @ yaw.T).T, abs=1e-9)
    assert np.array_equal(tilted.rays(True).edge, level.rays(True).edge)


@pytest.mark.parametrize(("pitch", "expected"), [
    (-90.0, 1.5),  # straight down
    (-80.0, 1.5),  # the foot is still within the cone
    (-60.0, 1.5 / math.sin(math.radians(75.0))),  # its lower edge
    (-30.0, 1.5 / math.sin(math.radians(45.0))),
    (60.0, 1.5 / math.sin(math.radians(75.0))),  # the ceiling, as far above
])  # fmt: skip
def test_a_tilted_cone_meets_floor_and_ceiling(pitch: float, expected: float) -> None:
    sonar = RangeScanner.from_mounts(SONAR, np.zeros((1, 3)), upright=[[1.5, math.radians(pitch)]])
    found = sonar.scan(room(), 2.0, 4.0, 0.0)[0]
    assert expected * (1.0 - 1e-5) <= found <= expected * (1.0 + MISS)


def test_what_a_tilted_cone_tells_is_how_its_range_changes() -> None:
    """Of a wall whose foot is within the cone, and of one that is met at its edge."""
    for pitch, turn in ((10.0, 0.1), (20.0, 0.05), (5.0, 0.5)):
        sonar = RangeScanner.from_mounts(
            SONAR, [[0.1, 0.05, 0.0]], upright=[[1.5, math.radians(pitch)]]
        )
        env, pose = room(8.0), np.array([[5.0, 4.0, turn]])
        step = 1e-3
        moved = pose + step * np.vstack([np.eye(3), -np.eye(3)])
        ranges = sonar.scan(env, *moved.T)[:, 0].astype(float)
        change = (ranges[:3] - ranges[3:]) / (2.0 * step)
        (found,) = scan_information(env, sonar, pose, 0.0)
        variance = 0.02**2 + 0.01**2 / 12.0
        # Which ray is nearest jumps by the spacing of the rays.
        assert found * variance == pytest.approx(np.outer(change, change), abs=0.08)


def test_a_plan_refuses_a_tilted_cone() -> None:
    sonar = RangeScanner.from_mounts(SONAR, np.zeros((1, 3)), upright=[[1.5, 0.2]])
    with pytest.raises(InputError, match="looks up and down"):
        sonar.scan(room().plan, 2.0, 4.0, 0.0)


def test_lasers_keep_their_rays() -> None:
    laser = RangeScanner.planar(RangeSensor(max_range=6.0, std=0.02, resolution=0.01), 7, 2.0)
    assert laser.rays(True) is laser.rays()
    assert laser.rays().edge.all()


@pytest.mark.parametrize(("z", "x", "expected"), [
    (1.5, 5.0, 3.0),  # the wall ahead
    (0.3, 2.0, 0.3 / math.sin(HALF)),  # the floor, at the lower edge of the cone
    (2.8, 2.0, 0.2 / math.sin(HALF)),  # the ceiling, at the upper edge
])  # fmt: skip
def test_walls_floor_and_ceiling(z: float, x: float, expected: float) -> None:
    assert single(z).scan(room(), x, 4.0, 0.0)[0] == pytest.approx(expected, rel=1e-5)


def test_a_floor_that_is_met_too_flatly_returns_no_echo() -> None:
    smooth = single(0.3, max_incidence=math.radians(60.0))
    assert smooth.scan(room(), 5.0, 4.0, 0.0)[0] == pytest.approx(3.0, rel=1e-5)


def test_a_beam_under_the_ceiling_within_the_cone() -> None:
    """Its lower edge at 2.2 m, 0.5 m above the axis, nearest straight ahead."""
    beam = Solid(shapely.box(4.0, 0.0, 4.3, 8.0), 2.2, 3.0)
    found = single(1.7).scan(room(solids=(beam,)), 1.5, 4.0, 0.0)[0]
    true = math.hypot(2.5, 0.5)
    assert true <= found + 1e-5
    assert found < true * (1.0 + 3.0 * MISS) + 0.02
    # Out of the cone, at 3.9 m it is not seen, in the plane never.
    assert single(1.0).scan(room(solids=(beam,)), 1.5, 4.0, 0.0)[0] > 3.0


def test_the_cone_sees_no_less_than_its_fan() -> None:
    """Where floor and ceiling are far, within what lies between the rays of the fan."""
    env = scenes.scene(5, size=20.0)
    rng = np.random.default_rng(1)
    x, y, theta = rng.uniform((0, 0, -3), (20, 20, 3), (200, 3)).T
    ring = RangeScanner.ring(SONAR, 8, 0.2).raised(5.0)
    flat = ring.scan(env, x, y, theta)
    space = ring.scan(env.in_space(extruded(env, 10.0)), x, y, theta)
    assert np.array_equal(np.isnan(flat), np.isnan(space))
    met = np.isfinite(flat)
    assert (space[met] <= flat[met] + 1e-4).all()
    assert np.median(flat[met] - space[met]) < 2e-3


def test_information_is_across_the_nearest_surface() -> None:
    """Of a wall straight ahead the distance alone, of the floor nothing."""
    variance = 0.02**2 + 0.01**2 / 12.0
    pose = np.array([[5.0, 4.0, 0.0]])
    (wall,) = scan_information(room(), single(1.5), pose, 0.0)
    assert wall[0, 0] == pytest.approx(1.0 / variance, rel=1e-4)
    assert np.abs(wall[1:, 1:]).max() < 1e-6 * wall[0, 0]
    (floor,) = scan_information(room(), single(0.3), np.array([[2.0, 4.0, 0.0]]), 0.0)
    assert np.abs(floor).max() < 1e-6


def test_the_audit_sees_what_the_sonar_reads() -> None:
    env, sonar = room(), single(0.3)
    sight = look(env, sonar, 2.0, 4.0, 0.2)
    assert sight.distance == pytest.approx(sonar.scan(env, 2.0, 4.0, 0.2), rel=1e-6)
    assert sight.surfaces == 0
