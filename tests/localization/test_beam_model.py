"""Ranges cast inside kernels against `RangeScanner.scan`, and the ray model against table 6.1."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ambinav.localization.beam_model import beam_factors
from ambinav.localization.casting import cast_tables, expected_ranges, work_space
from ambinav.localization.range_table import empty_range_table, looked_up, range_table
from ambinav.sensing.scanner import RangeScanner
from tests.geometry import scenes
from tests.localization import worlds

SCANNERS = {"laser": worlds.laser(), "sonar": worlds.sonar_ring(), "mixed": worlds.mixed()}
scanners = pytest.mark.parametrize("scanner", SCANNERS.values(), ids=SCANNERS.keys())


@scanners
@pytest.mark.parametrize("step", [1, 3])
def test_expected_ranges_are_the_scanners(scanner: RangeScanner, step: int) -> None:
    env = scenes.scene(3, size=15.0)
    # Some poses put a sensor, or the robot itself, outside the free space.
    poses = np.random.default_rng(1).uniform((0, 0, -4), (15, 15, 4), (150, 3))
    beams = np.arange(0, scanner.beams, step)
    tables = cast_tables(env, scanner, beams)
    work = work_space(len(tables.cosine))
    got = np.empty((len(poses), len(beams)))
    ray, edge = np.empty((2, len(beams)), dtype=np.int32)
    for pose, row in zip(poses, got, strict=True):
        expected_ranges(*pose, tables, work, row, ray, edge)
        assert ((ray >= 0) == np.isfinite(row)).all() and ((edge >= 0) == (ray >= 0)).all()
    expected = scanner.scan(env, *poses.T)[:, beams]
    assert np.isnan(expected).any() and np.isinf(expected).any()
    assert np.allclose(got, expected, atol=1e-5, equal_nan=True)


def likelihoods(reading: np.ndarray, expected: np.ndarray, far: np.ndarray) -> np.ndarray:
    """Of each beam by nav2's ray model, in NumPy; (N, B)."""
    p = 0.5 * np.exp(-((reading - expected) ** 2) / (2 * 0.2**2))
    p += np.where(reading < expected, 0.1 * 0.7 * np.exp(-0.7 * reading), 0.0)
    p += np.where(reading >= far, 0.15, 0.25 / far)
    return np.asarray(p)


@pytest.mark.parametrize("product", [False, True])
@scanners
def test_factors_are_those_of_the_ray_model(scanner: RangeScanner, product: bool) -> None:
    env = worlds.room()
    poses = worlds.free_poses(env, 100, seed=2)
    far = np.array([scanner.sensors[k].max_range for k in scanner.sensor_of_beam])
    reading = scanner.read(env, *poses[0], np.random.default_rng(3)).astype(float)
    reading = np.minimum(reading, far)
    reading[:2] = np.nan, 0.3
    near = np.full(scanner.beams, 0.8 if product else 0.0)
    particles = np.zeros((100, 5))
    particles[:, :3], particles[:, 3] = poses, 0.25
    tables = cast_tables(env, scanner, np.arange(scanner.beams))
    base = beam_factors(
        particles, 100, reading, near, far, 0.5, 0.1, 0.15, 0.25, 0.2, 0.7, tables,
        empty_range_table(), product, 0.4, np.empty(100),
    )  # fmt: skip
    p = likelihoods(reading, np.clip(scanner.scan(env, *poses.T), near, far), far)
    wanted = np.nanprod(p, axis=1) ** 0.4 if product else 1.0 + np.nansum(p**3, axis=1)
    assert np.allclose(particles[:, 3] / 0.25 * math.exp(base), wanted, rtol=1e-4)
    # The pose that the scan was made at is among the likeliest.
    assert (particles[:, 3] > particles[0, 3]).sum() <= 2


def test_outside_the_free_space_nothing_fits() -> None:
    env, scanner = worlds.room(), worlds.laser()
    particles = np.array([[2.0, 2.0, 0.0, 1.0, 0.0], [-3.0, 2.0, 0.0, 1.0, 0.0]])
    reading = scanner.scan(env, 2.0, 2.0, 0.0).astype(float)
    far = np.full(60, 12.0)
    tables = cast_tables(env, scanner, np.arange(60))
    beam_factors(
        particles, 2, reading, np.zeros(60), far, 0.5, 0.05, 0.05, 0.5, 0.2, 0.1, tables,
        empty_range_table(), False, 1.0, np.empty(2),
    )  # fmt: skip
    assert particles[0, 3] > 5.0 and particles[1, 3] == pytest.approx(1.0, abs=0.01)
    assert math.isfinite(particles[1, 3])


@pytest.mark.slow(kept=("laser", "sonar"))
@scanners
def test_a_table_holds_the_ranges_of_its_points_and_directions(scanner: RangeScanner) -> None:
    env = scenes.scene(3, size=15.0)
    beams = np.arange(0, scanner.beams, 2)
    table = range_table(env, scanner, beams, 0.1)
    directions = table.ranges.shape[2]
    rng = np.random.default_rng(1)
    alike = 0
    for _ in range(100):
        # A heading of the table for the beam, and a pose that puts the beam's sensor on a point.
        b = rng.integers(len(beams))
        mx, my, yaw = table.mount[b]
        theta = 2.0 * math.pi * rng.integers(directions) / directions - yaw
        row, column = rng.integers(np.array(table.cells.shape))
        x = table.x + 0.1 * column - math.cos(theta) * mx + math.sin(theta) * my
        y = table.y + 0.1 * row - math.sin(theta) * mx - math.cos(theta) * my
        got = np.empty(len(beams))
        looked_up(x, y, theta, table, got)
        want = scanner.scan(env, x, y, theta)[beams[b]]
        alike += bool(np.isclose(got[b], want, atol=1e-4, equal_nan=True))
    # Rounding decides whether a ray at the largest incidence, or through a corner, has its echo.
    assert alike >= 97


@pytest.mark.slow
def test_a_table_off_its_points_is_off_by_little() -> None:
    env, scanner = worlds.room(), worlds.sonar_ring()
    beams = np.arange(scanner.beams)
    table = range_table(env, scanner, beams, 0.05)
    poses = worlds.free_poses(env, 200, seed=2)
    got = np.empty((len(poses), len(beams)))
    for pose, row in zip(poses, got, strict=True):
        looked_up(*pose, table, row)
    want = scanner.scan(env, *poses.T)
    both = np.isfinite(got) & np.isfinite(want)
    assert both.mean() > 0.8 * np.isfinite(want).mean()
    assert np.median(np.abs(got[both] - want[both])) < 0.03
