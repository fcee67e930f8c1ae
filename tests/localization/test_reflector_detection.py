"""Reflectors in scans: clusters of bright beams against closed forms and rays of shapely."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
import shapely

from ambinav.localization.reflector_detection import (
    BEARING,
    EXTENT,
    RANGE,
    SIZE,
    VARIANCE,
    reflector_beams,
)
from ambinav.sensing import RangeScanner
from tests.localization.reflector_scenes import detected, exact, hall, laser

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow


def test_straight_ahead() -> None:
    """A strip 4 m ahead, square to the robot, and a post 3 m ahead: known in closed form."""
    environment = hall((15.0, 6.0), strips=(10.0,))
    scanner = laser(beams=1440)
    step = math.pi / 720
    pose = np.array([10.0, 4.0, -math.pi / 2])
    strip = detected(scanner, *exact(environment, scanner, pose))
    (ahead,) = strip[np.abs(strip[:, BEARING]) < 0.1]
    half = math.atan2(0.15, 4.0)
    assert ahead[BEARING] == pytest.approx(0.0, abs=1e-9)
    assert ahead[SIZE] == 2 * math.floor(half / step) + 1
    assert ahead[EXTENT] == pytest.approx(2 * math.floor(half / step) * step)
    # Mean of 4 / cos over the angle.
    assert ahead[RANGE] == pytest.approx(4.0 * math.asinh(math.tan(half)) / half, abs=1e-4)
    assert ahead[VARIANCE] == pytest.approx((0.01**2 + 0.001**2 / 12) / ahead[SIZE])
    fine = laser(beams=14400)
    post = detected(fine, *exact(environment, fine, np.array([12.0, 6.0, 0.0])))
    (ahead,) = post[np.abs(post[:, BEARING]) < 0.1]
    # A disc's mean depth, seen from afar, is pi / 4 of its radius.
    assert ahead[RANGE] == pytest.approx(3.0 - math.pi / 4 * 0.05, abs=1e-3)


@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.3, -0.2, 2.0)])
def test_detections_are_the_beams_that_meet_each_post(mount: tuple[float, float, float]) -> None:
    """Rays of shapely against the posts' discs, at poses drawn all over the hall."""
    places = [(4.0, 4.0), (15.0, 3.0), (9.0, 9.0), (17.0, 10.5)]
    environment, scanner = hall(*places), laser(mount=mount)
    discs = shapely.union_all([shapely.Point(place).buffer(0.05, 64) for place in places])
    rng = np.random.default_rng(2)
    for x, y, theta in rng.uniform((1.0, 1.0, -3.0), (19.0, 11.0, 3.0), (60, 3)):
        if not environment.is_free(x, y, 0.6):
            continue
        clusters = detected(scanner, *exact(environment, scanner, np.array([x, y, theta])))
        hx = x + math.cos(theta) * mount[0] - math.sin(theta) * mount[1]
        hy = y + math.sin(theta) * mount[0] + math.cos(theta) * mount[1]
        angle = theta + scanner.mounts[:, 2]
        ends = np.column_stack([hx + 25 * np.cos(angle), hy + 25 * np.sin(angle)])
        met = shapely.intersects(shapely.linestrings([[(hx, hy), end] for end in ends]), discs)
        expected = []
        for place in places:
            to = math.atan2(place[1] - hy, place[0] - hx)
            off = (angle - to + math.pi) % (2 * math.pi) - math.pi
            near = np.abs(off) <= math.asin(0.05 / math.dist(place, (hx, hy))) + 1e-4
            if (met & near).any():
                low, high = off[met & near].min(), off[met & near].max()
                expected.append((to - theta + 0.5 * (low + high), high - low))
        hidden = len(expected) - len(clusters)
        assert hidden >= 0
        close = 0
        for bearing, extent in expected:
            off = np.abs((clusters[:, BEARING] - bearing + math.pi) % (2 * math.pi) - math.pi)
            # The world's posts are polygons: one beam at the edge may pass them.
            close += bool(
                ((off < 0.6 * math.pi / 360) & (np.abs(clusters[:, EXTENT] - extent) < 0.01)).any()
            )
        assert close == len(expected) - hidden


def test_a_cluster_survives_a_dark_beam_and_a_random_range() -> None:
    scanner = laser()
    ranges, read = np.full(720, 8.0, np.float32), np.full(720, 0.3, np.float32)
    # Across the direction in which the beams begin.
    for k in (717, 718, 719, 0, 1, 2):
        ranges[k], read[k] = 5.0, 1.0
    (unbroken,) = detected(scanner, ranges, read)
    read[718], ranges[1] = 0.3, 2.0
    cluster, odd = sorted(detected(scanner, ranges, read).tolist(), key=lambda row: -row[SIZE])
    assert cluster[BEARING] == pytest.approx(unbroken[BEARING])
    assert cluster[EXTENT] == pytest.approx(5 * math.pi / 360)
    assert (cluster[SIZE], odd[SIZE]) == (4, 1)
    assert (cluster[RANGE], odd[RANGE]) == (5.0, 2.0)


def test_reflectors_in_adjacent_beams_are_two_if_their_ranges_differ() -> None:
    scanner = laser()
    ranges, read = np.full(720, 8.0, np.float32), np.full(720, 0.3, np.float32)
    read[100:106] = 1.0
    ranges[100:103], ranges[103:106] = 5.0, 5.6
    assert sorted(detected(scanner, ranges, read)[:, RANGE].tolist()) == pytest.approx([5.0, 5.6])


def test_the_bias_of_the_sensor_is_taken_away() -> None:
    scanner = laser(bias=0.05)
    ranges, read = np.full(720, 8.0, np.float32), np.full(720, 0.3, np.float32)
    ranges[100:103], read[100:103] = 5.05, 1.0
    assert detected(scanner, ranges, read)[0, RANGE] == pytest.approx(5.0, abs=1e-6)


def test_two_sensors_detect_apart() -> None:
    both = RangeScanner.mixed(laser(360, (0.3, 0.0, 0.0)), laser(360, (-0.3, 0.0, math.pi)))
    beams = reflector_beams(both)
    assert sorted(beams.head[:, 0].tolist()) == [-0.3, 0.3]
    assert beams.step == pytest.approx([math.pi / 180] * 2)
    environment = hall((10.0, 4.0))
    scan = exact(environment, both, np.array([10.0, 6.0, 0.0]))
    for head in (0, 1):
        (row,) = detected(both, *scan, head)
        assert row[RANGE] == pytest.approx(math.hypot(0.3, 2.0) - math.pi / 4 * 0.05, abs=0.01)


def test_beams_are_sorted_by_sensor_and_direction() -> None:
    beams = reflector_beams(RangeScanner.mixed(laser(16), laser(8, (1.0, 0.0, 0.5))))
    assert beams.first.tolist() == [0, 16, 24]
    for low, high in pairwise(beams.first.tolist()):
        turns = np.mod(beams.yaw[low:high], 2 * math.pi)
        assert (np.diff(turns) > 0.0).all()
