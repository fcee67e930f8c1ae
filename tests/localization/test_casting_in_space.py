"""Beams cast inside kernels in a building of prisms."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.geometry.environment import Environment
from ambinav.geometry.extrude import extruded
from ambinav.geometry.segments import FRONTIER, REFLECTOR
from ambinav.localization.casting import CastTables, cast_tables, work_space
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.information import beam_lines, beam_noise, line_space, scan_information
from ambinav.localization.prism_tables import edge_kinds
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from tests.casting.prism_reference import cast_slowly
from tests.geometry import scenes
from tests.geometry.furnished import TABLES, furnished
from tests.localization import worlds
from tests.localization.test_casting import cast, counted_at, rays_at

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

SENSOR = RangeSensor(max_range=6.0, std=0.03, resolution=0.001, random_share=0.0)
LIDAR = RangeScanner.layered(SENSOR, 24, [-0.5, -0.1, 0.0, 0.2, 0.6], mount=(0.1, -0.1, 0.2), z=0.9)
TILTED = RangeScanner.planar(SENSOR, 12, math.tau, (0.05, 0.1, 0.0), z=1.3, pitch=0.4, roll=-0.3)
SCANNERS = {"layers": LIDAR, "mixed": RangeScanner.mixed(LIDAR, TILTED)}


def tables_of(env: Environment, scanner: RangeScanner) -> CastTables:
    return cast_tables(env, scanner, np.arange(scanner.beams))


def room_poses(count: int, seed: int, most: float = 3.8) -> np.ndarray:
    """Poses in the furnished room; some are in the cupboard."""
    return np.random.default_rng(seed).uniform((0.2, 0.2, -3.0), (5.8, most, 3.0), (count, 3))


@pytest.mark.parametrize("name", SCANNERS)
def test_ranges_are_those_of_the_scanner(name: str) -> None:
    env, scanner = furnished()[0], SCANNERS[name]
    poses = room_poses(80, 1)
    tables = tables_of(env, scanner)
    assert tables.plain[0]
    ranges, ray, surface = cast(tables, poses, scanner.beams)
    expected = scanner.scan(env, *poses.T)
    assert np.isnan(expected).any() and np.isinf(expected).any()
    assert np.allclose(ranges, expected, atol=1e-5, equal_nan=True)
    met = ranges < math.inf
    assert ((ray >= 0) == met).all() and ((surface >= 0) == met).all()


def test_ranges_are_those_of_the_slow_caster() -> None:
    env = furnished()[0].in_space(furnished()[0].space, floor=0.2)
    poses = room_poses(40, 2, most=2.5)
    poses = poses[~np.isnan(LIDAR.scan(env, *poses.T)).any(axis=1)]
    ranges, _, _ = cast(tables_of(env, LIDAR), poses, LIDAR.beams)
    walls = [(0, 0, 6, 0, 0, 2.5), (6, 0, 6, 4, 0, 2.5), (6, 4, 0, 4, 0, 2.5), (0, 4, 0, 0, 0, 2.5)]
    solids = [Solid(shapely.box(*a[:2], *b[:2]), a[2], b[2]) for a, b in TABLES]
    azimuth, (z, elevation) = LIDAR.mounts[:, 2], LIDAR.upright.T
    for (x, y, theta), mine in zip(poses, ranges, strict=True):
        c, s = math.cos(theta), math.sin(theta)
        origin = np.column_stack([
            np.full(LIDAR.beams, x + c * 0.1 + s * 0.1),
            np.full(LIDAR.beams, y + s * 0.1 - c * 0.1), z + 0.2,
        ])  # fmt: skip
        look = np.column_stack([
            np.cos(elevation) * np.cos(azimuth + theta),
            np.cos(elevation) * np.sin(azimuth + theta), np.sin(elevation),
        ])  # fmt: skip
        slow = cast_slowly(solids, walls, 0.0, 2.5, origin, look)
        assert np.allclose(mine, np.where(slow > 6.0, math.inf, slow), atol=1e-6)


def test_a_level_scanner_reads_what_it_reads_in_the_plan() -> None:
    plan = worlds.room()
    tall = plan.in_space(extruded(plan, 2.5))
    scanner = RangeScanner.mixed(
        RangeScanner.planar(SENSOR, 24, math.tau, (0.1, 0.05, 0.003)),
        RangeScanner.planar(SENSOR, 7, 2.0, (-0.1, 0.0, 1.0)),
    ).raised(0.4)
    # Turned by a hair: none looks along a wall.
    poses = worlds.free_poses(plan, 200, seed=3, clearance=0.02)
    flat, solid = (cast(tables_of(env, scanner), poses, scanner.beams) for env in (plan, tall))
    assert np.allclose(flat[0], solid[0], atol=1e-9, equal_nan=True)
    assert np.array_equal(flat[1] < 0, solid[1] < 0)
    some = (scan_information(env, scanner, poses) for env in (plan, tall))
    assert np.allclose(*some, rtol=1e-9, atol=1e-6)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32))
def test_derivatives_of_ranges_are_finite_differences(seed: int) -> None:
    plan = scenes.scene(seed % 5, size=12.0, blocks=6, thin=3)
    solids = [Solid(shapely.Point(6.0, 6.0).buffer(2.0, quad_segs=2), 1.6, 1.8)]
    walls = extruded(plan, 2.5)
    env = plan.in_space(
        Prisms(walls.walls.xy, walls.wall_z, solids=solids, floor=0.0, ceiling=2.5, free=plan.free)
    )
    scanner = RangeScanner.mixed(LIDAR, TILTED)
    tables, noise = tables_of(env, scanner), beam_noise(env, scanner, 0.02)
    x, y = scenes.points_inside(env, 1, seed=seed, margin=0.4)[0]
    pose = np.array([x, y, np.random.default_rng(seed).uniform(-3.0, 3.0)])
    space = line_space(scanner.beams, tables.cosine.size)
    beam_lines(*pose, tables, noise, *space)
    line = space[-1].copy()
    step = 1e-6
    shifts = [sign * step * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
    ranges, _, surface = cast(tables, np.array([pose, *(pose + s for s in shifts)]), scanner.beams)
    # The same surface all about, met no flatter than the model takes it to be.
    same = (surface == surface[0]).all(axis=0) & np.isfinite(line[:, 4])
    ranges[:, ~same] = 0.0
    slope = (ranges[1::2] - ranges[2::2]).T / (2.0 * step)
    steep = same & (np.abs(line[:, 1:3]).max(axis=1) < 13.0)
    assert steep.sum() > scanner.beams / 3
    assert np.allclose(line[steep, 1:4], slope[steep], rtol=1e-3, atol=1e-4)
    assert isinstance(env.space, Prisms)
    level = same & (surface[0] >= len(env.space.walls))
    assert (line[level, 1:4] == 0.0).all()


@pytest.mark.sweep
@pytest.mark.parametrize("name", SCANNERS)
def test_columns_without_a_reading_meet_nothing(name: str) -> None:
    env, scanner = furnished()[0], SCANNERS[name]
    tables = tables_of(env, scanner)
    size = tables.cosine.size
    every, some, picked = work_space(size), work_space(size), np.empty(size, np.int32)
    reading = np.where(np.random.default_rng(3).random(scanner.beams) < 0.2, 1.0, math.inf)
    needed = np.isfinite(reading)[tables.beam]
    for pose in room_poses(8, 4):
        rays_at(pose, tables, every)
        assert counted_at(pose, reading, tables, some, picked) == size
        assert np.array_equal(picked, np.arange(size))
        assert np.array_equal(some[2][needed], every[2][needed], equal_nan=True)
        assert np.array_equal(some[3][needed], every[3][needed])
        left = ~needed & ~np.isnan(every[2]) & (some[2] != every[2])
        assert np.isinf(some[2][left]).all() and (some[3][left] == -1).all()
        assert np.isnan(every[2]).all() or name == "layers" or left.any()


def test_kinds_are_those_of_what_rays_meet() -> None:
    plan = worlds.box(6.0, 4.0, frontiers=(2,))
    assert (edge_kinds(plan) == FRONTIER).sum() == 1
    lamp = Solid(shapely.box(2, 1, 3, 2), 2.0, 2.2, REFLECTOR)
    tall = plan.in_space(
        Prisms(plan.segments.xy, [(0.0, 2.5)] * 4, plan.segments.kind, solids=[lamp], floor=0.0)
    )
    assert edge_kinds(tall).tolist() == [0, 0, FRONTIER, 0, *[REFLECTOR] * 6, 0, 0]
    # What is unknown tells nothing of the pose.
    down, up = (scan_information(tall, LIDAR, (3.0, 2.0, t)) for t in (0.0, 0.5))
    assert (np.linalg.eigvalsh(down)[0] > 0.0).all() and (np.linalg.eigvalsh(up)[0] > 0.0).all()


RING = RangeScanner.ring(
    RangeSensor(
        max_range=5.0, std=0.03, resolution=0.001, aperture=math.radians(25.0),
        max_incidence=math.radians(40.0),
    ),
    8, 0.15,
).raised(0.6)  # fmt: skip


@pytest.mark.parametrize("scanner", [LIDAR, TILTED, RING], ids=["layers", "tilted", "cones"])
def test_a_mesh_tells_what_prisms_tell(scanner: RangeScanner) -> None:
    prisms, mesh = furnished()
    poses = room_poses(60, 7, most=2.5)
    poses = poses[~np.isnan(scanner.scan(prisms, *poses.T)).any(axis=1)]
    one, other = (scan_information(env, scanner, poses) for env in (prisms, mesh))
    # Where a ray meets an edge, which surface it is on is not said.
    same = np.isclose(one, other, rtol=1e-3, atol=1e-3 * np.abs(one).max()).all(axis=(1, 2))
    assert same.mean() > 0.9
    start = poses + np.random.default_rng(1).normal(0.0, (0.05, 0.05, 0.02), poses.shape)
    readings = scanner.scan(prisms, *poses.T)
    after = []
    for env in (prisms, mesh):
        tracker = ExtendedKalmanFilter(env, scanner, runs=len(poses))
        tracker.start(start, np.diag([0.05**2, 0.05**2, 0.02**2]))
        used = tracker.update(poses, readings)
        after.append((tracker.mean, tracker.covariance, used))
    close = np.abs(after[0][0] - after[1][0]).max(axis=1) < 2e-3
    assert close.mean() > 0.9
    better = np.hypot(*(after[1][0] - poses)[:, :2].T) < np.hypot(*(start - poses)[:, :2].T)
    assert better.mean() > 0.8


def test_a_slope_in_a_mesh_tells_how_ranges_change() -> None:
    """A wall that leans by 40 degrees, met by rays that look up and down, and by cones."""
    lean = math.tan(math.radians(40.0))
    corners = [(4.0, -9, -3), (4.0, 9, -3), (4 + 6 * lean, 9, 3), (4 + 6 * lean, -9, 3)]
    mesh = Mesh(corners, [(0, 1, 2), (0, 2, 3)])
    env = worlds.box(8.0, 8.0).in_space(mesh)
    for scanner in (LIDAR, TILTED, RING):
        pose, step = np.array([3.0, 4.0, 0.3]), 1e-3
        moved = pose + step * np.vstack([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
        ranges = scanner.scan(env, *moved.T).astype(float)
        met = np.isfinite(ranges).all(axis=0)
        assert met.sum() >= 2
        ranges = np.where(met, ranges, 0.0)
        change = (ranges[1:4] - ranges[4:]) / (2.0 * step)
        (found,) = scan_information(env, scanner, pose, 0.0)
        variance = 0.03**2 + 0.001**2 / 12.0
        expected = change @ change.T / variance
        assert np.allclose(found, expected, atol=0.03 * np.abs(expected).max())


def test_cones_are_tracked_in_prisms_as_in_the_plan() -> None:
    plan = worlds.room()
    tall = plan.in_space(extruded(plan, 20.0), floor=0.0)
    high = RING.raised(9.0)
    poses = worlds.free_poses(plan, 80, seed=3, clearance=0.3)
    readings = high.scan(plan, *poses.T)
    start = poses + np.random.default_rng(1).normal(0.0, (0.05, 0.05, 0.02), poses.shape)
    means = []
    for env in (plan, tall):
        tracker = ExtendedKalmanFilter(env, high, runs=len(poses))
        tracker.start(start, np.diag([0.05**2, 0.05**2, 0.02**2]))
        tracker.update(poses, readings)
        means.append(tracker.mean)
    # In space there are rays between those of the plan's fan.
    off = np.hypot(*(means[0] - means[1])[:, :2].T)
    assert np.median(off) < 0.01
    assert np.quantile(off, 0.9) < 0.04


def test_what_cannot_be_cast_is_refused() -> None:
    prisms, mesh = furnished()
    with pytest.raises(InputError, match=r"it is a mesh.*give prisms.*beam_table_resolution"):
        tables_of(mesh, LIDAR)
    with pytest.raises(InputError, match="it is a plan, and the scanner looks up"):
        ExtendedKalmanFilter(prisms.plan, LIDAR)
    with pytest.raises(InputError, match="give the mount a height"):
        ExtendedKalmanFilter(prisms, worlds.laser())
