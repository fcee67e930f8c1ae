"""ROS messages as arrays and back: order of rows, angles, what a range means, what poses cost."""

from __future__ import annotations

import math

import numpy as np
import pytest
from ambinav_ros import conversions
from ambinav_ros.conversions import FREE, NOT_FINITE, NOT_FREE, OUTSIDE
from hypothesis import given
from hypothesis import strategies as st

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav.service.service import AmbiguityService
from tests.maps import synthetic

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
ANGLES = st.floats(-math.pi, math.pi)


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Rotation matrix Rz(yaw) Ry(pitch) Rx(roll), written out apart from any quaternion."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """The product of the three half-angle rotations."""

    def times(a, b):
        ax, ay, az, aw = a
        bx, by, bz, bw = b
        return (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        )

    def about(axis: int, angle: float):
        parts = [0.0, 0.0, 0.0, math.cos(angle / 2)]
        parts[axis] = math.sin(angle / 2)
        return tuple(parts)

    return times(times(about(2, yaw), about(1, pitch)), about(0, roll))


def same_angle(a, b) -> np.ndarray:
    return np.abs(np.angle(np.exp(1j * (np.asarray(a) - np.asarray(b)))))


@pytest.mark.parametrize("headings", [0, 4])
def test_the_grid_begins_at_the_smallest_y(headings):
    amap = AmbiguityMap(synthetic.dataset(headings))
    grid = conversions.occupancy_grid(amap)
    assert grid.data.dtype == np.int8 and grid.data.size == grid.width * grid.height
    assert grid.resolution == pytest.approx(0.1)
    assert grid.origin == pytest.approx((-0.5, -0.5))
    # Cell (column, row) of the message covers [origin + k * resolution, ... + resolution].
    for x, y in ((2.0, 2.0), (8.0, 1.5), (21.0, 5.0), (5.0, 3.5), (25.9, 9.9), (-0.4, -0.4)):
        column = int((x - grid.origin[0]) / grid.resolution)
        row = int((y - grid.origin[1]) / grid.resolution)
        level = amap.sample("level", x, y)
        value = grid.data[row * grid.width + column]
        if math.isnan(level):
            assert value == conversions.UNKNOWN
        else:
            assert value == pytest.approx(100 * level, abs=0.51)
    assert grid.data.min() == -1 and grid.data.max() <= 100


def test_only_shares_make_a_grid():
    with pytest.raises(InputError, match="does not run from 0 to 1"):
        conversions.occupancy_grid(AmbiguityMap(synthetic.dataset()), "major_radius")
    with pytest.raises(InputError, match="no such layer"):
        conversions.occupancy_grid(AmbiguityMap(synthetic.dataset()), "levle")


@given(ANGLES, st.floats(-1.2, 1.2), ANGLES, st.floats(0.2, 3.0))
def test_yaw_is_that_of_the_rotation_matrix(roll, pitch, yaw, scale):
    matrix = rotation(roll, pitch, yaw)
    found = conversions.yaw_of(tuple(scale * part for part in quaternion(roll, pitch, yaw)))
    assert same_angle(found, math.atan2(matrix[1, 0], matrix[0, 0])) < 1e-6
    assert same_angle(conversions.yaw_of(quaternion(0.0, 0.0, yaw)), yaw) < 1e-6


@pytest.mark.parametrize("bad", [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, math.nan, 1.0)])
def test_no_rotation_is_refused(bad):
    with pytest.raises(InputError, match="not a rotation"):
        conversions.yaw_of(bad)


@given(ANGLES, st.floats(-0.7, 0.7), ANGLES, ANGLES, st.sampled_from([0.1, -0.1]))
def test_directions_are_those_of_turned_vectors(roll, pitch, yaw, first, step):
    found = conversions.directions(first, step, 9, quaternion(roll, pitch, yaw))
    angles = first + step * np.arange(9)
    turned = rotation(roll, pitch, yaw) @ np.array([np.cos(angles), np.sin(angles), 0 * angles])
    flat = np.hypot(turned[0], turned[1]) > 0.05  # seen from above a steep beam has no direction
    assert same_angle(found, np.arctan2(turned[1], turned[0]))[flat].max(initial=0.0) < 1e-6


def test_a_scanner_that_hangs_upside_down_turns_the_other_way():
    hanging = quaternion(math.pi, 0.0, 0.0)
    found = conversions.directions(0.0, 0.1, 3, hanging)
    assert same_angle(found, [0.0, -0.1, -0.2]).max() < 1e-9


def test_angles_that_do_not_differ_are_refused():
    with pytest.raises(InputError, match="angle_increment"):
        conversions.directions(0.0, 0.0, 3, UPRIGHT)


def test_what_a_range_means():
    given_ranges = [1.0, math.inf, -math.inf, math.nan, 0.0, -1.0, 0.05, 8.0, 9.0, 0.1]
    found = conversions.readings(given_ranges, range_min=0.1, range_max=8.0)
    inf, nan = math.inf, math.nan
    wanted = [1.0, inf, -inf, nan, nan, nan, -inf, inf, inf, 0.1]
    np.testing.assert_array_equal(found, wanted)
    assert given_ranges[4] == 0.0  # what was given stays as it was


def scanner(beams: int, aperture: float, yaw: float = 0.0) -> RangeScanner:
    sensor = RangeSensor(max_range=6.0, std=0.02, resolution=0.001)
    return RangeScanner.planar(sensor, beams, aperture, mount=(0.1, 0.0, yaw))


@pytest.mark.parametrize("clockwise", [False, True])
@pytest.mark.parametrize("aperture", [math.tau, math.radians(240.0)])
@pytest.mark.parametrize("turned", [0.0, 2.0, -3.0])
def test_each_beam_gets_the_reading_in_its_direction(clockwise, aperture, turned):
    """A scan of 360 readings whose range tells its direction, from whatever frame."""
    ours = scanner(30, aperture)
    first, step = (math.pi, -math.tau / 360) if clockwise else (-math.pi, math.tau / 360)
    # The scanner's frame is turned in the robot's: its reading at angle a looks to a + turned.
    towards = conversions.directions(first, step, 360, quaternion(0.0, 0.0, turned))
    ranges = 2.0 + towards / math.tau
    found = conversions.beams_of(ours, ranges, towards, step)
    wanted = np.angle(np.exp(1j * ours.mounts[:, 2]))
    at_seam = np.abs(np.abs(wanted) - math.pi) < 0.02
    off = same_angle((found - 2.0) * math.tau, wanted)
    assert off[~at_seam].max() <= 0.5 * math.tau / 360 + 1e-9


def test_beams_outside_of_the_scan_have_no_reading():
    ours = scanner(36, math.tau)
    count, step = 91, math.radians(1.0)
    towards = conversions.directions(-math.radians(45.0), step, count, UPRIGHT)
    found = conversions.beams_of(ours, np.full(count, 1.0), towards, step)
    inside = same_angle(ours.mounts[:, 2], 0.0) <= math.radians(46.0)
    np.testing.assert_array_equal(np.isfinite(found), inside)
    assert np.isnan(found[~inside]).all()
    assert np.isnan(conversions.beams_of(ours, [], [], step)).all()


def test_ranges_beyond_the_sensor_are_no_echo():
    ours = scanner(4, math.tau)
    towards = conversions.directions(-math.pi, math.pi / 2, 4, UPRIGHT)
    found = conversions.beams_of(ours, [7.0, 5.0, -math.inf, math.nan], towards, math.pi / 2)
    np.testing.assert_array_equal(found, [math.inf, 5.0, -math.inf, math.nan])


@pytest.mark.parametrize("headings", [0, 4])
def test_what_poses_cost(headings):
    amap = AmbiguityMap(synthetic.dataset(headings))
    service = AmbiguityService(amap, weight=5.0)
    x, y = [2.0, 8.0, 8.0, 99.0, math.nan], [2.0, 2.0, 0.2, 0.0, 0.0]
    theta = [0.0] * 5 if headings else []
    cost, level, state = conversions.ask(service, x, y, theta)
    assert state.tolist() == [FREE, FREE, NOT_FREE, OUTSIDE, NOT_FINITE]
    assert cost[:2].tolist() == [service.cost(a, b, 0.0) for a, b in zip(x[:2], y[:2], strict=True)]
    assert np.isinf(cost[2:]).all() and np.isnan(level[2:]).all()
    if headings:
        cost, level, _ = conversions.ask(service, x[:2], y[:2], [])
        every = [service.cost(2.0, 2.0, one) for one in amap.dataset["theta"].values]
        assert cost[0] == pytest.approx(np.mean(every))
        assert level[0] == pytest.approx(amap.sample("level", 2.0, 2.0))
    assert [part.size for part in conversions.ask(service, [], [], [])] == [0, 0, 0]


def test_poses_that_do_not_match_are_refused():
    service = AmbiguityService(AmbiguityMap(synthetic.dataset()))
    for x, y, theta in (([1.0], [], []), ([1.0], [1.0], [0.0, 0.0])):
        with pytest.raises(InputError, match="give as many of each"):
            conversions.ask(service, x, y, theta)
