from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.logs.log import Log
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from tests.logs.logs import room

SENSOR = RangeSensor(max_range=8.0, resolution=0.01, std=0.02)


def test_every_second_scan_and_the_rest():
    log = room(7)
    first, rest = log.every(2)
    assert (first.scans, rest.scans) == (4, 3)
    np.testing.assert_array_equal(first.poses, log.poses[::2])
    np.testing.assert_array_equal(rest.odometry, log.odometry[1::2])
    np.testing.assert_array_equal(log.thinned(3).time, log.time[[0, 3, 6]])
    assert log.every(1)[1].scans == 7
    with pytest.raises(InputError, match=r"^every is 2\.5; give a whole number"):
        log.every(2.5)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="every is 0 and the log has 7 scans"):
        log.thinned(0)
    with pytest.raises(InputError, match="every is 2 and the log has 1 scans"):
        log.chosen(slice(0, 1)).every(2)


@pytest.mark.parametrize("mount", [(0.1, 0.0, 0.0), (-0.2, 0.1, math.pi), (0.0, 0.0, 0.5)])
@pytest.mark.parametrize("beams", [1, 2, 180, 361])
def test_the_scanner_has_the_beams_of_the_log(mount, beams):
    log = room(3, beams=beams, mount=mount)
    scanner = log.scanner(std=0.03, resolution=0.02)
    assert scanner.max_range == 8.0
    assert (scanner.sensors[0].std, scanner.sensors[0].resolution) == (0.03, 0.02)
    log.check_scanner(scanner)


def test_uneven_and_full_circles_of_beams():
    uneven = replace(room(3, beams=3), angles=(-1.0, 0.0, 0.5))
    uneven.check_scanner(uneven.scanner())
    assert uneven.spacing is None
    full = replace(room(3, beams=5), angles=np.linspace(-math.pi, math.pi, 5))
    full.check_scanner(full.scanner())


def test_the_scanner_measures_what_the_log_holds():
    log = room(6)
    square = environment_from_shapes([[(0, 0), (4, 0), (4, 4), (0, 4)]], name="square")
    ranges = log.scanner().scan(square, *log.poses.T)
    np.testing.assert_allclose(ranges, log.ranges, atol=1e-4)


def test_beams_that_do_not_match_are_named():
    log = room(3, beams=181)
    with pytest.raises(InputError, match=r"181 beams and scanner 'planar scanner' has 60"):
        log.check_scanner(RangeScanner.planar(SENSOR, 60, math.pi))
    with pytest.raises(InputError, match=r"beam 0 looks to -90\.00 degrees from \(0\.1, 0\) m and"):
        log.check_scanner(RangeScanner.planar(SENSOR, 181, math.pi))
    with pytest.raises(InputError, match=r"beam 0 looks to -90\.00 degrees .* to -45\.00 degrees"):
        log.check_scanner(RangeScanner.planar(SENSOR, 181, math.pi / 2, (0.1, 0.0, 0.0)))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"ranges": np.ones((0, 361))}, "there is no scan"),
        ({"ranges": np.ones(361)}, r"ranges \(361,\)"),
        ({"ranges": np.ones((3, 7))}, r"ranges have the shape \(3, 7\)"),
        ({"time": np.zeros(4)}, r"time have the shape \(4,\)"),
        ({"odometry": np.zeros((3, 2))}, "odometry have the shape"),
        ({"poses": np.full((3, 3), np.nan)}, "poses hold a value that is not finite"),
        ({"ranges": np.full((3, 361), np.nan)}, "a range is nan"),
        ({"ranges": np.full((3, 361), 9.0)}, "a range is 9"),
        ({"ranges": np.full((3, 361), -1.0)}, "a range is -1"),
        ({"max_range": 0.0}, "max_range is 0"),
    ],
)
def test_bad_logs(changes, words):
    with pytest.raises(InputError, match=words):
        replace(room(3), **changes)


def test_a_log_without_poses_says_so():
    log = replace(room(3), poses=None)
    assert log.thinned(2).poses is None
    with pytest.raises(InputError, match="the log has no poses"):
        _ = log.laser_poses
    assert "no poses" in repr(log)
    assert isinstance(log, Log)
