"""Maps from logs: the counts against a slow reference, and rooms that are known beforehand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ambinav.geometry.environment import MAPPING_STD
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, UNKNOWN
from ambinav.geometry.segments import WALL
from ambinav.logs.carmen import read_carmen
from ambinav.logs.grid_map import RayCounts, map_from_log, ray_counts
from ambinav.logs.log import Log
from ambinav.runtime.errors import InputError
from tests.logs.logs import room


def one_scan(pose, angles, ranges, max_range=50.0) -> Log:
    pose = [pose]
    return Log("one", angles, max_range, [ranges], [0.0], pose, pose)


def reference(log: Log, reach: float, counts: RayCounts) -> tuple[np.ndarray, np.ndarray]:
    """Cells whose square a beam cuts, by shapely: those where it ends, and the others."""
    rows, columns = counts.hits.shape
    cell, (left, low) = counts.resolution, counts.origin
    x = left + cell * np.arange(columns)
    y = (low + cell * np.arange(rows))[:, None]
    squares = shapely.box(x, y, x + cell, y + cell)
    hits, passes = np.zeros((rows, columns), int), np.zeros((rows, columns), int)
    for pose, scan in zip(log.laser_poses, log.ranges.astype(float), strict=True):
        for angle, length in zip(log.angles, scan, strict=True):
            if not math.isfinite(length):
                continue
            bearing, span = pose[2] + angle, min(length, reach)
            end = pose[0] + span * math.cos(bearing), pose[1] + span * math.sin(bearing)
            line = shapely.LineString([pose[:2], end])
            cut = shapely.length(shapely.intersection(squares, line)) > 0.0
            last = shapely.contains(squares, shapely.Point(end))
            hits += last & (length <= reach)
            passes += cut & ~(last & (length <= reach))
    return hits, passes


def test_the_cells_of_a_beam():
    # From the middle of a cell along x: two cells passed, the third hit; and one beam too long.
    log = one_scan((0.5, 0.5, 0.0), [0.0, math.pi / 2], [2.0, 9.0])
    counts = ray_counts(log, 1.0, reach=3.0)
    assert counts.origin == (-1.0, -1.0)
    # Row 0 and column 0 are the margin; rows count upwards.
    np.testing.assert_array_equal(
        counts.hits, [[0] * 5, [0, 0, 0, 1, 0], [0] * 5, [0] * 5, [0] * 5, [0] * 5]
    )
    np.testing.assert_array_equal(
        counts.passes,
        [[0] * 5, [0, 2, 1, 0, 0], [0, 1, 0, 0, 0], [0, 1, 0, 0, 0], [0, 1, 0, 0, 0], [0] * 5],
    )
    state = counts.grid().state
    assert state[1].tolist() == [UNKNOWN, FREE, FREE, OCCUPIED, UNKNOWN]
    assert state[4].tolist() == [UNKNOWN, FREE, UNKNOWN, UNKNOWN, UNKNOWN]


def test_beams_without_return_tell_nothing():
    log = one_scan((0.5, 0.5, 0.0), [0.0, 1.0, 2.0], [2.0, np.inf, -np.inf])
    counts = ray_counts(log, 1.0)
    assert (counts.hits.sum(), counts.passes.sum()) == (1, 2)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_counts_against_a_slow_reference(seed):
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-math.pi, math.pi, 12)
    log = Log(
        "random",
        angles,
        10.0,
        rng.uniform(0.05, 6.0, (2, 12)),
        [0.0, 1.0],
        np.zeros((2, 3)),
        rng.uniform(-2.0, 2.0, (2, 3)),
        mount=(0.2, -0.1, 0.4),
    )
    counts = ray_counts(log, 0.7, reach=4.0)
    hits, passes = reference(log, 4.0, counts)
    np.testing.assert_array_equal(counts.hits, hits)
    # A corner cut by less than rounding may be counted on either side.
    assert np.abs(counts.passes - passes).sum() <= 1


@pytest.mark.parametrize("turn", range(8))
def test_beams_along_the_grid_and_its_diagonals(turn):
    log = one_scan((0.0, 0.0, 0.0), [turn * math.pi / 4], [5.0])
    counts = ray_counts(log, 1.0)
    assert counts.hits.sum() == 1
    assert 3 <= counts.passes.sum() <= 10
    assert counts.passes.max() == 1


def test_a_share_of_the_beams_makes_a_wall():
    hits = np.array([[0, 0, 1, 3, 1]], dtype=np.int32)
    passes = np.array([[0, 5, 0, 7, 3]], dtype=np.int32)
    counts = RayCounts(hits, passes, 0.1, (0.0, 0.0))
    assert counts.grid().state[0].tolist() == [UNKNOWN, FREE, OCCUPIED, OCCUPIED, FREE]
    assert counts.grid(0.2).state[0].tolist()[-1] == OCCUPIED
    for share in (0.0, 1.1, math.nan):
        with pytest.raises(InputError, match="occupied_share"):
            counts.grid(share)


def test_a_square_room_comes_out_square():
    env = map_from_log(room(40), 0.05)
    assert env.name == "room"
    # The near side of the cells that are hit is the wall: up to a cell less on each side.
    assert 15.2 < env.free.area < 16.1
    np.testing.assert_allclose(env.bounds, (0, 0, 4, 4), atol=0.06)
    assert (env.segments.kind == WALL).all()
    assert env.resolution == 0.05 and env.map_std == MAPPING_STD
    ranges = room(40).scanner().scan(env, *room(40).poses.T)
    assert float(np.quantile(np.abs(ranges - room(40).ranges), 0.9)) < 0.08


def test_turned_and_shifted_logs_give_the_same_room():
    log = room(40)
    c, s = math.cos(0.4), math.sin(0.4)
    x, y, theta = log.poses.T
    moved = np.column_stack([c * x - s * y + 7.0, s * x + c * y - 3.0, theta + 0.4])
    env = map_from_log(replace(log, poses=moved))
    expected = map_from_log(log).transformed(0.4, 7.0, -3.0)
    assert env.free.symmetric_difference(expected.free).area < 0.05 * 16.0


def test_where_the_map_ends_and_what_is_solid_in_it_is_known():
    log = room(40)
    env, grid = map_from_log(log), ray_counts(log, 0.05).grid()
    assert env.extent is not None and env.extent.equals(shapely.Polygon(grid.outline()))
    assert env.occupancy is not None
    np.testing.assert_array_equal(env.occupancy.state, grid.state)


def test_bad_input():
    log = room(3)
    for changes, words in (
        ({"resolution": 0.0}, "resolution is 0"),
        ({"resolution": math.nan}, "resolution is nan"),
        ({"reach": -1.0}, "reach is -1"),
        ({"resolution": 0.0002}, "give a coarser one"),
        ({"occupied_share": 2.0}, "occupied_share is 2"),
        ({"gap": -1.0}, "gap is -1"),
    ):
        with pytest.raises(InputError, match=words):
            map_from_log(log, **changes)
    with pytest.raises(InputError, match=r"a pose is 1e.300 m from the origin"):
        map_from_log(replace(log, poses=np.full((3, 3), 1e300)))
    with pytest.raises(InputError, match="the log has no poses"):
        map_from_log(replace(log, poses=None))
    with pytest.raises(InputError, match="no beam of it returns"):
        map_from_log(replace(log, ranges=np.full((3, 361), np.inf)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["aces", "intel"])
def test_a_map_of_every_second_scan_explains_the_others(data_dir, name):
    log = read_carmen(data_dir / "logs" / f"{name}-corrected.log.gz")
    first, rest = log.every(2)
    env = map_from_log(first)
    assert env.is_free(rest.poses[:, 0], rest.poses[:, 1]).mean() > 0.99
    ranges = rest.scanner().scan(env, *rest.poses.T)
    both = np.isfinite(ranges) & np.isfinite(rest.ranges)
    apart = np.abs(ranges - rest.ranges)[both]
    assert float(np.median(apart)) < 0.06
    assert float((apart < 0.2).mean()) > 0.85
