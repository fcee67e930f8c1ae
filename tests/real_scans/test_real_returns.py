"""Scans as the kernel takes them: slopes of surfaces, readings in another's directions."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from real_scans.real_returns import STEEPEST, returns_of_scans, surface_slopes

import ambinav as an
from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.returns import BEYOND, BLIND, beam_returns
from tests.real_scans.rooms import HALF_TURN, environment, log_of

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

ROOM = shapely.box(0, 0, 4, 4)
EYES = np.linspace(-1.4, 1.4, 24)


def returns(log, turn, heading, directions=EYES, limit=30.0, scan=0):
    spread = np.linspace(1.0, 2.0, 1024, dtype=np.float32)
    slopes = surface_slopes(log.ranges, log.angles)
    return returns_of_scans(
        log.ranges, slopes, log.angles, np.array([scan]), np.array([turn]), np.array([heading]),
        directions, limit, spread, len(directions),
    )[0]  # fmt: skip


@pytest.mark.parametrize("slant", [0.0, 0.3, -0.7])
def test_slope_of_a_straight_wall_is_the_tangent_of_incidence(slant):
    angles = HALF_TURN[40:-40]
    ranges = 2.0 / np.cos(angles - slant)
    sound = np.abs(angles - slant) < 1.4
    found = surface_slopes(ranges[None, sound].astype(np.float32), angles[sound])[0]
    np.testing.assert_allclose(found, np.tan(angles[sound] - slant), rtol=1e-3, atol=1e-3)


def test_slope_beside_an_edge_is_that_of_its_own_surface():
    ranges = np.where(HALF_TURN < 0.2, 2.0, 6.0) / np.cos(HALF_TURN)
    near = np.abs(HALF_TURN) < 0.5
    found = surface_slopes(ranges[None].astype(np.float32), HALF_TURN)[0]
    np.testing.assert_allclose(found[near], np.tan(HALF_TURN[near]), atol=0.02)


def test_slopes_bear_noise_and_lost_readings():
    rng = np.random.default_rng(3)
    ranges = 3.0 / np.cos(HALF_TURN) + rng.normal(0.0, 0.01, (20, len(HALF_TURN)))
    ranges[:, 90] = np.inf
    found = surface_slopes(ranges.astype(np.float32), HALF_TURN)
    near = np.abs(HALF_TURN) < 0.6
    assert found[0, 90] == 0.0
    assert np.median(np.abs(found - np.tan(HALF_TURN))[:, near]) < 0.1
    assert np.abs(found).max() <= STEEPEST


def test_an_exact_scan_gives_what_the_map_gives():
    env = environment(ROOM)
    log = log_of(env, [(1.3, 1.8, 0.4)])
    sensor = an.RangeSensor(max_range=30.0, std=0.02, resolution=0.01)
    mounts = np.column_stack([np.zeros(24), np.zeros(24), EYES])
    scanner = an.RangeScanner.from_mounts(sensor, mounts)
    table = BeamTable.of(scanner, 0.0, 0.05)
    expected = np.zeros((1, 5, 24), dtype=np.float32)
    beam_returns(env, scanner, table, np.array([1.3]), np.array([1.8]), 0.4, expected)
    found = returns(log, 0.0, 0.4)
    # Corners are rounded off by the fit, so not every beam must agree.
    alike = np.isclose(found[:4], expected[0, :4], rtol=5e-3, atol=5e-3).all(axis=0)
    np.testing.assert_allclose(found[0], expected[0, 0], atol=0.05)
    assert alike.mean() > 0.8


def test_a_turned_scan_reads_the_same_world():
    env = environment(ROOM)
    log = log_of(env, [(1.3, 1.8, 0.4), (1.3, 1.8, -0.1)])
    straight, turned = returns(log, 0.0, 0.4), returns(log, -0.5, 0.4, scan=1)
    seen = turned[4] < BLIND
    np.testing.assert_array_equal(seen, math.pi / 2 + 0.02 >= EYES + 0.5)
    np.testing.assert_allclose(straight[0, seen], turned[0, seen], atol=0.02)


def test_what_is_out_of_range_or_lost():
    env = environment(ROOM)
    log = log_of(env, [(1.3, 1.8, 0.4)])
    log.ranges[0, 88:93] = np.inf
    found = returns(log, 0.0, 0.4, np.array([-0.8, 0.0, 0.8]), limit=0.5)
    assert found[4, 1] == np.float32(BLIND)
    np.testing.assert_array_equal(found[0, [0, 2]], 0.5 + BEYOND)
    np.testing.assert_array_equal(found[1:4, [0, 2]], 0.0)
    np.testing.assert_array_equal(found[4, [0, 2]], 2.0)
