"""CARMEN logs: what the lines mean, and what is said of damaged ones."""

from __future__ import annotations

import gzip
import math

import numpy as np
import pytest

from ambinav.geometry.frames import between, compose
from ambinav.logs.carmen import read_carmen
from ambinav.runtime.errors import InputError, InputWarning
from tests.logs.logs import flaser, odom, robotlaser, write

THREE = (math.radians(-90), 0.0, math.radians(90))


def many(count: int = 150, beams: int = 180) -> list[str]:
    """Sound lines, each with its number as the first reading in centimetres."""
    rest = [1.0] * (beams - 2) + [9.9]
    return [flaser([(k + 1) / 100, *rest], (0.1 * k, 0, 0), time=k) for k in range(count)]


def test_flaser_line(tmp_path):
    path = write(
        tmp_path,
        "# a remark",
        flaser([1.5, 5.0, 0.0], (1.0, 2.0, 0.5), (1.1, 2.2, 0.6), 10.0),
        flaser([1.6, 4.99, 5.0], (2.0, 2.0, 0.5), (2.4, 2.2, 0.6), 11.0),
        name="walk.log",
    )
    log = read_carmen(path, angles=THREE)
    assert log.name == "walk"
    assert log.ranges.dtype == np.float32
    # The largest value of the log is no return, and so is what is just below it.
    np.testing.assert_array_equal(
        log.ranges, np.float32([[1.5, np.inf, -np.inf], [1.6, np.inf, np.inf]])
    )
    assert log.max_range == 5.0
    np.testing.assert_array_equal(log.time, [10.0, 11.0])
    np.testing.assert_array_equal(log.poses, [[1.0, 2.0, 0.5], [2.0, 2.0, 0.5]])
    np.testing.assert_array_equal(log.odometry, [[1.1, 2.2, 0.6], [2.4, 2.2, 0.6]])


def test_headings_in_degrees_are_named(tmp_path):
    path = write(tmp_path, *(flaser([1.0, 2.0, 3.0], (k, 0, 90.0 + k)) for k in range(5)))
    with pytest.warns(InputWarning, match=r"beyond two turns in radians, up to 94; if they are"):
        read_carmen(path, angles=THREE)


def test_headings_of_the_laser_alone_in_degrees_are_named(tmp_path):
    path = write(tmp_path, *(flaser([1.0], (k, 0, 90.0 + k), (k, 0, 1.0)) for k in range(5)))
    with pytest.warns(InputWarning, match="beyond two turns in radians, up to 94"):
        read_carmen(path, angles=(0.0,), max_range=8.0)


def test_a_laser_that_turns_clockwise(tmp_path):
    """It hangs upside down, and reads the same walls in reverse order."""
    readings = [1.0, 2.0, 3.0]
    hanging = read_carmen(write(tmp_path, robotlaser(readings[::-1], start=0.0, step=-0.5)))
    upright = read_carmen(write(tmp_path, robotlaser(readings, start=-1.0, step=0.5)))
    np.testing.assert_allclose(hanging.angles, [0.0, -0.5, -1.0])
    np.testing.assert_array_equal(hanging.angles[::-1], upright.angles)
    np.testing.assert_array_equal(hanging.ranges[:, ::-1], upright.ranges)
    mounts = hanging.scanner().mounts[::-1]
    np.testing.assert_allclose(mounts, upright.scanner().mounts, atol=1e-12)


def test_max_range_that_is_given(tmp_path):
    path = write(tmp_path, flaser([1.0, 3.0, 3.5]))
    log = read_carmen(path, angles=THREE, max_range=3.0)
    np.testing.assert_array_equal(log.ranges, np.float32([[1.0, np.inf, np.inf]]))
    assert read_carmen(path, angles=THREE, max_range=4.0).ranges.max() == 3.5


@pytest.mark.parametrize(("beams", "last"), [(180, 89.0), (181, 90.0), (360, 89.5), (361, 90.0)])
def test_angles_of_flaser_lines(tmp_path, beams, last):
    angles = read_carmen(write(tmp_path, flaser([1.0] * beams)), max_range=8.0).angles
    assert len(angles) == beams
    np.testing.assert_allclose(np.degrees(angles[[0, -1]]), [-90.0, last])
    np.testing.assert_allclose(np.diff(angles), np.diff(angles)[0])


def test_robotlaser_line(tmp_path):
    """The laser looks back from behind the centre, so the two poses differ without correction."""
    robot = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 2.0], [1.0, 1.0, -3.0]])
    laser = compose(robot, (-0.2, 0.1, math.pi))
    path = write(
        tmp_path,
        *(
            robotlaser([1.0, 7.9, 8.0], a, b, time=k, remissions=(3, 4))
            for k, (a, b) in enumerate(zip(laser, robot, strict=True))
        ),
    )
    log = read_carmen(path)
    np.testing.assert_allclose(log.angles, [-1.0, -0.5, 0.0])
    np.testing.assert_array_equal(log.ranges[0], np.float32([1.0, 7.9, np.inf]))
    assert log.max_range == 8.0
    assert log.poses is None
    np.testing.assert_allclose(log.odometry, robot)
    np.testing.assert_allclose(log.mount[:2], (-0.2, 0.1), atol=1e-9)
    assert abs(log.mount[2]) == pytest.approx(math.pi)


def test_poses_of_the_robot_behind_its_laser(tmp_path):
    path = write(
        tmp_path,
        "PARAM robot_frontlaser_offset 0.25 host 0",
        robotlaser([1.0, 2.0], (0.25, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0),
        robotlaser([1.0, 2.0], (1.0, 0.25, math.pi / 2), (0.8, 0.1, 1.5), 1.0),
    )
    log = read_carmen(path)
    assert log.mount == (0.25, 0.0, 0.0)
    np.testing.assert_allclose(log.poses, [[0, 0, 0], [1.0, 0.0, math.pi / 2]], atol=1e-12)
    np.testing.assert_allclose(log.laser_poses[1], [1.0, 0.25, math.pi / 2])
    assert read_carmen(path, mount=(0.0, 0.0, 0.0)).poses[1, 1] == 0.25


def test_odometry_that_goes_on_from_the_corrected_pose(tmp_path):
    """As GMapping writes it: after each scan a line of odometry that repeats the scan's pose."""
    raw = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.1], [2.0, 0.2, 0.2], [2.5, 0.4, 2.0]])
    fixed = np.array([[0.1, 0.1, 0.05], [1.2, 0.2, 0.0], [2.1, 0.1, 0.3], [2.8, 0.6, 2.2]])
    lines = [odom(raw[0])]
    for k in range(4):
        if k > 0:
            step = between(raw[k - 1], raw[k])
            half = (step[0] / 2, step[1] / 2, step[2] / 2)
            lines += [odom(compose(fixed[k - 1], half)), odom(compose(fixed[k - 1], step))]
        lines += [flaser([1.0, 2.0, 9.0], fixed[k]), odom(fixed[k])]
    log = read_carmen(write(tmp_path, *lines), angles=THREE)
    np.testing.assert_allclose(log.poses, fixed)
    np.testing.assert_allclose(log.odometry, raw, atol=1e-9)


def test_a_damaged_scan_does_not_tear_the_odometry_apart(tmp_path):
    turn = np.array([0.1, 0.0, 0.02])
    lines, pose = [], np.zeros(3)
    for k in range(120):
        moved = compose(pose, turn)
        pose = moved + np.array([0.01, -0.02, 0.003])
        lines += [odom(moved), flaser([1.0, 2.0, 9.0], pose), odom(pose)]
        if k == 60:
            lines[-2] = lines[-2][:30]
    with pytest.warns(InputWarning, match=r"1 damaged line was left out; line 182: FLASER: .*"):
        log = read_carmen(write(tmp_path, *lines), angles=THREE)
    assert log.scans == 119
    steps = between(log.odometry[:-1], log.odometry[1:])
    np.testing.assert_allclose(np.delete(steps, 59, axis=0), np.tile(turn, (117, 1)), atol=1e-9)
    np.testing.assert_allclose(steps[59], compose(turn, turn), atol=1e-9)


def test_plain_odometry_lines_are_not_needed(tmp_path):
    poses = [(0.1 * k, 0.0, 0.0) for k in range(5)]
    lines = [line for p in poses for line in (odom(p), flaser([1.0, 2.0, 9.0], p))]
    log = read_carmen(write(tmp_path, *lines), angles=THREE)
    assert log.poses is None
    np.testing.assert_allclose(log.odometry, poses)


@pytest.mark.parametrize(
    ("stamps", "useful"),
    [((0, 1, 2, 3), True), ((1e9, 1e9, 1e9, 1e9), False), ((-1, 5, 2, 1), False), ((7,), True)],
)
def test_time_stamps(tmp_path, stamps, useful):
    path = write(tmp_path, *(flaser([1.0, 2.0, 9.0], time=t) for t in stamps))
    time = read_carmen(path, angles=THREE).time
    np.testing.assert_array_equal(time, stamps if useful else np.full(len(stamps), np.nan))


def test_gzip_is_recognised_by_its_content(tmp_path):
    path = write(tmp_path, *many(5))
    plain = read_carmen(path)
    path.write_bytes(gzip.compress(path.read_bytes()))
    np.testing.assert_array_equal(read_carmen(path).ranges, plain.ranges)
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match=r"small\.log: the compressed log is damaged or cut off"):
        read_carmen(path)


def spoil(line: str, how: str) -> str:
    words = line.split()
    changed = {
        "cut": words[:100],
        "word": [*words[:5], "1.0x", *words[6:]],
        "nan": [*words[:5], "nan", *words[6:]],
        "below": [*words[:5], "-1", *words[6:]],
        "above": [*words[:5], "8183", *words[6:]],
        "pose": [*words[:182], "inf", *words[183:]],
        "count": ["FLASER", "many", *words[2:]],
        "none": ["FLASER"],
        "odd": ["FLASER", "181", "1.0", *words[2:]],
        "merged": words + words,
    }
    return " ".join(changed[how])


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("cut", "it has 100 values; with 180 readings it must be 191"),
        ("word", "'1.0x' is not a number"),
        ("nan", "a reading is nan"),
        ("below", "a reading is -1"),
        ("above", "a reading is 8183, not 0 to 1000 m"),
        ("pose", "a value of it is not finite"),
        ("count", "its number of readings is 'many'"),
        ("none", "it ends too early"),
        ("odd", "it has 181 readings where most have 180"),
        ("merged", "it has 382 values"),
    ],
)
def test_a_damaged_line_is_left_out_with_its_number(tmp_path, how, reason):
    lines = many()
    lines[41] = spoil(lines[41], how)
    with pytest.warns(InputWarning, match="1 damaged line was left out") as caught:
        log = read_carmen(write(tmp_path, *lines))
    assert f"line 42: FLASER: {reason}" in str(caught[0].message)
    assert caught[0].filename == __file__
    assert (log.scans, log.skipped) == (149, 1)
    assert np.float32(0.42) not in log.ranges[:, 0]


def test_too_many_damaged_lines_are_refused(tmp_path):
    lines = many()
    lines[10] = lines[20] = "FLASER 180 1.0"
    with pytest.raises(InputError, match=r"line 11: .*2 of 150 FLASER lines are damaged, more "):
        read_carmen(write(tmp_path, *lines))
    lines = [*many(), *(odom((0.1, 0, 0)) for _ in range(50)), "ODOM 1 2"]
    with pytest.raises(InputError, match=r"line 201: ODOM: .*1 of 51 ODOM lines"):
        read_carmen(write(tmp_path, *lines))
    for word in ("", "far"):
        lines = [f"PARAM robot_frontlaser_offset {word}", *many()]
        with pytest.raises(InputError, match=r"line 1: PARAM: .*1 of 1 PARAM lines"):
            read_carmen(write(tmp_path, *lines))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "there is no scan in it"),
        ("ODOM 0 0 0 0 0 0 0 h 0\n", "there is no scan in it"),
        ("\x00\x01\x02 binary", "there is no scan in it"),
        (flaser([1.0] * 7), "7 readings, and only 180, 181, 360 and 361 say where they look"),
        (flaser([0.0] * 180), "no reading is above 0"),
    ],
)
def test_files_that_are_refused(tmp_path, text, words):
    path = tmp_path / "bad.log"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_carmen(path)


def test_missing_files_and_bad_arguments(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_carmen(tmp_path / "none.log")
    with pytest.raises(InputError, match="cannot be read"):
        read_carmen(tmp_path)
    path = write(tmp_path, *many(3))
    with pytest.raises(InputError, match=r"max_range is -1"):
        read_carmen(path, max_range=-1.0)
    with pytest.raises(InputError, match=r"angles have the shape \(3,\); its scans have 180"):
        read_carmen(path, angles=THREE)


# Scans, beams, largest value, share without return, median range, path and extent of the poses,
# and whether time stamps are useful, from the README of the data.
REAL = {
    "intel-corrected": (910, 180, 81.83, 0.025, 2.06, 500, (25.8, 26.0), True),
    "aces-corrected": (440, 180, 50.00, 0.008, 2.34, 323, (44.9, 40.2), True),
    "freiburg-079-corrected": (4791, 360, 81.91, 0.021, 1.92, 422, (36.0, 14.8), True),
    "infinite-corridor-corrected": (1941, 180, 51.16, 0.013, 1.99, 1920, (231.7, 197.7), False),
    "belgioioso-corrected": (395, 361, 81.91, 0.005, 3.12, 219, (21.0, 84.5), False),
    "edmonton-corrected": (340, 180, 51.16, 0.055, 7.10, 324, (71.8, 78.2), True),
    "mrpt_uwb_hall_gt": (342, 361, 81.89, None, 2.64, 112, None, True),
}


@pytest.mark.slow(
    kept=(
        "intel-corrected",
        "infinite-corridor-corrected",
        "mrpt_uwb_hall_gt",
        "belgioioso-corrected",
    )
)
@pytest.mark.parametrize("name", REAL)
def test_real_logs(data_dir, name):
    scans, beams, top, lost, median, path, extent, timed = REAL[name]
    log = read_carmen(data_dir / "logs" / f"{name}.log.gz")
    assert (log.name, log.scans, log.beams, log.skipped) == (name, scans, beams, 0)
    assert log.max_range == top
    assert float(np.median(log.ranges)) == pytest.approx(median, abs=0.005)
    if lost is not None:
        assert float(np.isinf(log.ranges).mean()) == pytest.approx(lost, abs=0.0006)
    steps = np.diff(log.poses[:, :2], axis=0)
    assert float(np.hypot(*steps.T).sum()) == pytest.approx(path, abs=0.7)
    if extent is not None:
        np.testing.assert_allclose(np.ptp(log.poses[:, :2], axis=0), extent, atol=0.051)
    assert np.isfinite(log.time).all() == timed
    # Odometry is odometry: near the corrected motion from scan to scan, and drifting in the end.
    moved, true = (between(p[:-1], p[1:]) for p in (log.odometry, log.poses))
    apart = np.abs(moved - true)
    assert float(np.median(np.hypot(apart[:, 0], apart[:, 1]))) < 0.06
    assert math.degrees(float(np.median(apart[:, 2]))) < 3.0
    away = between(log.poses[0], log.poses) - between(log.odometry[0], log.odometry)
    assert float(np.hypot(away[:, 0], away[:, 1]).max()) > 0.4


PARAMETERS = (
    "PARAM robot_frontlaser_offset 0.2 host 1",
    "PARAM robot_frontlaser_side_offset 0.0 host 1",
    "PARAM robot_frontlaser_angular_offset 0.0 host 1",
)


@pytest.mark.parametrize("scans", [1, 5])
def test_a_frame_of_odometry_is_no_mount(tmp_path, scans):
    """Where the parameters say where the laser sits, a constant offset is another frame's."""
    odometry = np.column_stack([np.arange(scans) * 0.5, np.zeros((scans, 2))])
    poses = compose((5.0, 3.0, 0.0), odometry)
    path = write(
        tmp_path,
        *PARAMETERS,
        *(
            flaser([1.0] * 180, compose(pose, (0.2, 0.0, 0.0)), robot, k)
            for k, (pose, robot) in enumerate(zip(poses, odometry, strict=True))
        ),
    )
    log = read_carmen(path, max_range=8.0)
    assert log.mount == (0.2, 0.0, 0.0)
    np.testing.assert_allclose(log.poses, poses, atol=1e-6)
    np.testing.assert_allclose(log.odometry, odometry, atol=1e-6)
