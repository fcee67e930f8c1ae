from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ambinav.geometry.frames import between, compose
from ambinav.logs.replay import replay
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from tests.logs.logs import room


class DeadReckoning:
    """Adds up odometry from `starts`, shape (R, 3); says that it uses every `pace`-th scan."""

    def __init__(self, starts, pace=1):
        self.mean = np.array(starts, dtype=float)
        self.pace, self.calls, self.last = pace, 0, None

    def update(self, odometry, ranges):
        assert odometry.shape == self.mean.shape
        assert ranges.dtype == np.float32
        assert len(ranges) == len(odometry)
        used = self.calls % self.pace == 0
        self.calls += 1
        if self.last is not None:
            self.mean = compose(self.mean, between(self.last, odometry))
        self.last = odometry
        return np.full(len(odometry), used)


@pytest.mark.parametrize("pace", [1, 3])
def test_an_estimate_for_each_scan_and_run(pace):
    log = room(10)
    starts = [log.poses[0], log.poses[0] + (0.3, -0.4, 0.1)]
    result = replay(log, DeadReckoning(starts, pace))
    assert result.estimates.shape == (2, 10, 3)
    assert result.updated[:, ::pace].all()
    assert result.updated.sum() == 2 * len(range(0, 10, pace))
    steps = between(log.odometry[0], log.odometry)
    for run, start in enumerate(starts):
        expected = compose(start, steps)
        np.testing.assert_allclose(result.estimates[run, :, :2], expected[:, :2], atol=1e-9)
        assert np.abs(between(expected, result.estimates[run])).max() < 1e-9
    assert result.seconds >= 0.0


def test_errors_against_the_poses_of_the_log():
    log = replace(room(4), odometry=room(4).poses)
    result = replay(log, DeadReckoning([log.poses[0], log.poses[0] + (0.0, 0.0, 0.2)]))
    np.testing.assert_allclose(result.position_error[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(result.position_error[1, 0], 0.0, atol=1e-9)
    np.testing.assert_allclose(result.heading_error[1], 0.2)
    errors = result.errors()
    assert errors.heading_max == pytest.approx(0.2)
    assert errors.heading_median == pytest.approx(0.1)
    assert errors.position_max == pytest.approx(result.position_error[1, 3])
    late = result.errors(3)
    assert late.position_median == pytest.approx(result.position_error[:, 3].mean())
    with pytest.raises(InputError, match="first is 4; the log 'room' has the scans 0 to 3"):
        result.errors(4)


def test_a_frame_that_is_turned_is_taken_out():
    log = room(8)
    frame = (3.0, -2.0, 0.6)
    moved = replace(log, poses=compose(frame, log.poses), odometry=log.poses)
    result = replay(moved, DeadReckoning([log.poses[0], log.poses[0] + (1.0, 0.0, 0.5)]))
    assert result.position_error.min() > 1.0
    aligned = result.aligned()
    np.testing.assert_allclose(aligned.position_error, 0.0, atol=1e-9)
    np.testing.assert_allclose(aligned.heading_error, 0.0, atol=1e-9)
    # One estimate that is far away stays far away.
    torn = result.estimates.copy()
    torn[:, 4, :2] += 5.0
    assert replace(result, estimates=torn).aligned().errors().position_max > 3.0


def test_heading_errors_do_not_jump_at_half_a_turn():
    log = room(1)
    poses = np.array([[1.0, 1.0, math.pi - 0.01]])
    log = replace(log, poses=poses, odometry=poses)
    result = replay(log, DeadReckoning([(1.0, 1.0, 0.01 - math.pi)]))
    assert result.heading_error[0, 0] == pytest.approx(0.02)


def test_what_does_not_fit_is_said():
    log = room(3)
    sensor = RangeSensor(max_range=8.0, resolution=0.01, std=0.02)
    with pytest.raises(InputError, match="361 beams and scanner 'planar scanner' has 60"):
        replay(log, DeadReckoning([log.poses[0]]), RangeScanner.planar(sensor, 60, math.pi))
    replay(log, DeadReckoning([log.poses[0]]), log.scanner())
    bare = replay(replace(log, poses=None), DeadReckoning([log.poses[0]]))
    with pytest.raises(InputError, match="the log has no poses"):
        bare.errors()


def test_lost_is_who_is_off_in_two_scans_on_end():
    log = replace(room(8), odometry=room(8).poses)
    result = replay(log, DeadReckoning([log.poses[0], log.poses[0]]))
    assert not result.lost.any()
    off = result.estimates.copy()
    off[0, [1, 4, 5], 0] += 0.51
    off[1, 6, 2] += 0.53
    off[1, 7, 1] += 0.6
    off[1, :3, 2] += 0.52
    lost = replace(result, estimates=off).lost
    np.testing.assert_array_equal(np.flatnonzero(lost[0]), [4, 5])
    np.testing.assert_array_equal(np.flatnonzero(lost[1]), [6, 7])
