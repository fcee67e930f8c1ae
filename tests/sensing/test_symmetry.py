"""Symmetry of scanners, and fewer beams of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor

LASER = RangeSensor(name="laser", max_range=4.0, std=0.03, resolution=0.001)
SONAR = RangeSensor(
    name="sonar", max_range=6.0, std=0.02, resolution=0.01, aperture=math.radians(30)
)


@pytest.mark.parametrize(
    ("scanner", "order"),
    [
        (RangeScanner.planar(LASER, 60, 2 * math.pi), 60),
        (RangeScanner.planar(LASER, 60, 2 * math.pi, mount=(0, 0, 0.7)), 60),
        (RangeScanner.planar(LASER, 60, 2 * math.pi, mount=(0.2, 0, 0)), 1),
        (RangeScanner.planar(LASER, 60, math.radians(240)), 1),
        (RangeScanner.planar(LASER, 8, 2 * math.pi), 8),
        (RangeScanner.ring(SONAR, 16, 0.2), 16),
        (RangeScanner.ring(SONAR, 16, 0.2, start=0.123), 16),
        (
            RangeScanner.mixed(
                RangeScanner.ring(SONAR, 16, 0.2), RangeScanner.planar(LASER, 60, 2 * math.pi)
            ),
            4,
        ),
        (
            RangeScanner.mixed(
                RangeScanner.ring(SONAR, 24, 0.2), RangeScanner.ring(LASER, 24, 0.3, start=0.1)
            ),
            24,
        ),
    ],
)
def test_rotation_order(scanner: RangeScanner, order: int) -> None:
    assert scanner.rotation_order == order
    assert scanner.turns_in_place == (order >= 12)
    assert scanner.looks_all_around or order < 12
    shuffled = np.random.default_rng(1).permutation(scanner.beams)
    again = RangeScanner.from_mounts(
        scanner.sensors, scanner.mounts[shuffled], scanner.sensor_of_beam[shuffled]
    )
    assert again.rotation_order == order


@pytest.mark.parametrize(
    ("scanner", "around"),
    [
        (RangeScanner.planar(LASER, 60, 2 * math.pi, mount=(0.2, 0, 0.3)), True),
        (RangeScanner.planar(LASER, 60, 2 * math.pi, mount=(0.15, -0.16, 0)), False),
        (RangeScanner.planar(LASER, 60, math.radians(240), mount=(0.01, 0, 0)), False),
        # Sensors of two kinds, each about a centre of its own.
        (
            RangeScanner.mixed(
                RangeScanner.ring(SONAR, 24, 0.2),
                RangeScanner.planar(LASER, 48, 2 * math.pi, mount=(-0.03, 0.02, 0)),
            ),
            True,
        ),
        # Two lasers of one kind see from two places.
        (
            RangeScanner.mixed(
                RangeScanner.planar(LASER, 48, 2 * math.pi, mount=(0.1, 0, 0)),
                RangeScanner.planar(LASER, 48, 2 * math.pi, mount=(-0.1, 0, 0)),
            ),
            False,
        ),
    ],
)
def test_all_around_a_centre_near_the_robots(scanner: RangeScanner, around: bool) -> None:
    assert not scanner.turns_in_place
    assert scanner.looks_all_around == around
    moved = scanner.centred
    assert (moved is not scanner) == around
    if around:
        assert moved.turns_in_place
        assert moved.centred is moved
        off = moved.mounts - scanner.mounts
        for sensor in range(len(scanner.sensors)):
            rows = scanner.sensor_of_beam == sensor
            assert np.ptp(off[rows], axis=0) == pytest.approx(0.0, abs=1e-12)
            assert moved.mounts[rows, :2].mean(axis=0) == pytest.approx(0.0, abs=1e-12)
            assert np.hypot(*off[rows, :2].T).max() <= 0.2 + 1e-6


def test_ring_about_a_centre_of_its_own() -> None:
    ring = RangeScanner.ring(SONAR, 16, 0.2)
    mounts = ring.mounts + np.array([0.05, 0.02, 0.0])
    scanner = RangeScanner.from_mounts(SONAR, mounts)
    assert scanner.looks_all_around
    assert scanner.centred.mounts == pytest.approx(ring.mounts)


def test_opposite_directions_count_as_sixty_beams_whatever_their_turns() -> None:
    yaw = 2 * math.pi * np.arange(60) / 60 + 2 * math.pi * (np.arange(60) % 3)
    mounts = np.column_stack([np.zeros((60, 2)), yaw])
    assert RangeScanner.from_mounts(LASER, mounts).rotation_order == 60


# -- thinning ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("beams", "most", "kept"),
    [(360, 60, 60), (1440, 100, 96), (60, 60, 60), (60, 100, 60), (359, 60, 60), (64, 60, 32)],
)
def test_thinned_full_circle_stays_uniform(beams: int, most: int, kept: int) -> None:
    whole = RangeScanner.planar(LASER, beams, 2 * math.pi)
    thin = whole.thinned(most)
    assert thin.beams == kept == thin.rotation_order
    if beams % kept == 0:
        assert np.abs(thin.mounts[:, 2] - whole.mounts[:: beams // kept, 2]).max() < 1e-12


@pytest.mark.parametrize("beams", [181, 361, 541, 682, 683, 1081])
@pytest.mark.parametrize("most", [1, 2, 30, 60, 61, 100])
def test_thinned_fan_stays_symmetric_and_wide(beams: int, most: int) -> None:
    whole = RangeScanner.planar(LASER, beams, math.radians(240), mount=(0, 0, 0.5))
    thin = whole.thinned(most)
    yaw = thin.mounts[:, 2] - 0.5
    assert most / 2 < thin.beams <= most
    assert yaw == pytest.approx(-yaw[::-1], abs=1e-12)
    if most > 1:
        step, stride = math.radians(240) / (beams - 1), float(np.diff(yaw)[0])
        assert yaw[-1] >= math.radians(120) - stride / 2 - 1e-9
        nearest = np.abs(yaw[:, None] + 0.5 - whole.mounts[None, :, 2]).min(axis=1)
        assert nearest.max() <= step / 2 + 1e-9


def test_thinned_mixed_keeps_the_sonars() -> None:
    platform = RangeScanner.from_preset("pioneer-sonar-laser")
    thin = platform.thinned(60)
    assert thin.beams <= 60
    assert (thin.sensor_of_beam == 0).sum() == 16
    assert (thin.sensor_of_beam == 1).sum() > 30
    assert "of 197 beams" in thin.name


def test_thinned_mounts_do_not_depend_on_their_order() -> None:
    whole = RangeScanner.planar(LASER, 120, 2 * math.pi)
    shuffled = np.random.default_rng(0).permutation(120)
    thin = RangeScanner.from_mounts(LASER, whole.mounts[shuffled]).thinned(60)
    assert thin.rotation_order == 60
    fan = RangeScanner.planar(LASER, 121, math.pi)
    yaw = RangeScanner.from_mounts(LASER, fan.mounts).thinned(61).mounts[:, 2]
    assert yaw == pytest.approx(fan.mounts[::2, 2])


def test_thinned_ring_and_too_few() -> None:
    assert RangeScanner.ring(SONAR, 16, 0.2).thinned(8).rotation_order == 8
    with pytest.raises(InputError, match="has 2 parts"):
        RangeScanner.from_preset("pioneer-sonar-laser").thinned(1)
    with pytest.raises(InputError, match="max_beams is 0; give a whole number"):
        RangeScanner.ring(SONAR, 16, 0.2).thinned(0)
