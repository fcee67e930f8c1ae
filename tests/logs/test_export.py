"""What other people's tools get, and what comes back."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambinav.geometry.frames import wrap_angles
from ambinav.logs.carmen import read_carmen
from ambinav.logs.export import load_tum, save_carmen, save_tum
from ambinav.runtime.errors import InputError
from tests.logs.logs import room

number = st.floats(-1e3, 1e3)


def test_tum_lines_are_as_evo_reads_them(tmp_path):
    """Eight numbers parted by single blanks, no blank at the end, remarks begin with #."""
    path = tmp_path / "track.tum"
    save_tum(path, [0.0, 0.5], [(1.0, -2.0, 0.0), (1.5, -2.0, math.pi / 2)])
    rows = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    assert rows[0] == "0.0 1.0 -2.0 0.0 0.0 0.0 0.0 1.0"
    values = [float(word) for word in rows[1].split(" ")]
    np.testing.assert_allclose(values, [0.5, 1.5, -2, 0, 0, 0, math.sqrt(0.5), math.sqrt(0.5)])


@pytest.mark.slow
@given(st.lists(st.tuples(number, number, st.floats(-20, 20)), min_size=1, max_size=5))
def test_tum_round_trip(tmp_path_factory, poses):
    path = tmp_path_factory.mktemp("tum") / "t.txt"
    time = 1.7e9 + 0.1 * np.arange(len(poses))
    save_tum(path, time, poses)
    back_time, back = load_tum(path)
    np.testing.assert_array_equal(back_time, time)
    np.testing.assert_array_equal(back[:, :2], np.array(poses)[:, :2])
    np.testing.assert_allclose(wrap_angles(back[:, 2] - np.array(poses)[:, 2]), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("time", "poses", "words"),
    [
        ([0.0, 1.0], [(0, 0, 0)], r"time has the shape \(2,\) and poses \(1, 3\)"),
        ([], np.zeros((0, 3)), "N at least 1"),
        ([math.nan], [(0, 0, 0)], "time or pose 0 is not finite"),
        ([0.0, 1.0], [(0, 0, 0), (0, math.inf, 0)], "time or pose 1 is not finite"),
        ([1.0, 1.0], [(0, 0, 0), (0, 0, 0)], "time goes from 1.0 to 1.0 at pose 1;"),
    ],
)
def test_tum_refuses(tmp_path, time, poses, words):
    with pytest.raises(InputError, match=words):
        save_tum(tmp_path / "t.tum", time, poses)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("# nothing\n", "there is no pose in it"),
        ("0 0 0 0 0 0 0 1\n1 2 3\n", "line 2: it has 3 values"),
        ("0 0 0 0 0 0 zero 1\n", "line 1: .* is not 8 finite numbers"),
        ("0 0 nan 0 0 0 0 1\n", "line 1: .* is not 8 finite numbers"),
        ("0 0 0 0 0 0 0 0\n", "the quaternion 0 0 0 0 has the length 0"),
    ],
)
def test_bad_tum_files(tmp_path, text, words):
    path = tmp_path / "bad.tum"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        load_tum(path)


def assert_same(a, b):
    assert a.max_range == b.max_range
    np.testing.assert_array_equal(a.ranges, b.ranges)
    np.testing.assert_array_equal(a.time, b.time)
    np.testing.assert_array_equal(a.odometry, b.odometry)
    np.testing.assert_allclose(a.angles, b.angles, atol=1e-12)
    assert a.mount == b.mount
    assert (a.poses is None) == (b.poses is None)
    if a.poses is not None:
        np.testing.assert_allclose(a.poses, b.poses, atol=1e-12)


@pytest.mark.parametrize("name", ["room.log", "room.log.gz"])
@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (0.1, -0.05, 0.2), (-0.2, 0.0, math.pi)])
@pytest.mark.parametrize("poses", [True, False])
def test_carmen_round_trip(tmp_path, name, mount, poses):
    log = room(5, mount=mount)
    ranges = log.ranges.copy()
    ranges[1, :4] = np.inf
    ranges[2, 7] = -np.inf
    log = replace(log, ranges=ranges, poses=log.poses if poses else None)
    save_carmen(tmp_path / name, log)
    back = read_carmen(tmp_path / name)
    assert back.name == "room"
    assert_same(back, log)


@pytest.mark.parametrize("beams", [1, 2, 60])
def test_carmen_round_trip_of_few_beams_without_time(tmp_path, beams):
    log = replace(room(4, beams=beams), time=np.full(4, np.nan), max_range=7.3000001)
    log = replace(log, ranges=np.where(log.ranges > 2.0, np.inf, log.ranges))
    save_carmen(tmp_path / "few.log", log)
    assert_same(read_carmen(tmp_path / "few.log"), log)


def test_exact_odometry_from_elsewhere_is_no_mount(tmp_path):
    straight = np.column_stack([0.5 * np.arange(5), np.zeros((5, 2))])
    log = replace(room(5), odometry=straight, poses=straight + np.array([0.3, 0.2, 0.0]))
    save_carmen(tmp_path / "exact.log", log)
    assert_same(read_carmen(tmp_path / "exact.log"), log)


def test_the_same_log_gives_the_same_bytes(tmp_path):
    for name in ("a.log.gz", "b.log.gz"):
        save_carmen(tmp_path / name, room(3))
    assert (tmp_path / "a.log.gz").read_bytes() == (tmp_path / "b.log.gz").read_bytes()


def test_carmen_refuses_uneven_beams(tmp_path):
    log = replace(room(3, beams=3), angles=(-1.0, 0.0, 0.5))
    with pytest.raises(InputError, match="the beams of 'room' are not evenly spread"):
        save_carmen(tmp_path / "u.log", log)


def test_a_real_log_comes_back(tmp_path, data_dir):
    log = read_carmen(data_dir / "logs" / "aces-corrected.log.gz")
    save_carmen(tmp_path / "aces.log.gz", log)
    assert_same(read_carmen(tmp_path / "aces.log.gz"), log)
