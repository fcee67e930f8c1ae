"""Beams cast inside kernels: what lasers do without changes nothing."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from ambinav.geometry.environment import Environment
from ambinav.localization.casting import (
    APART,
    CastTables,
    cast_observed,
    cast_rays,
    cast_tables,
    expected_ranges,
    spread_observed,
    work_space,
)
from ambinav.localization.information import beam_lines, beam_noise, line_space
from ambinav.sensing.curves import Polynomial
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from tests.localization import worlds

SCANNERS = {"laser": worlds.laser(), "sonar": worlds.sonar_ring(), "mixed": worlds.mixed()}


@njit
def ranges_at(poses: Any, tables: Any, ranges: Any, ray: Any, edge: Any) -> None:
    work = work_space(tables.cosine.size)
    for p in range(poses.shape[0]):
        expected_ranges(
            poses[p, 0], poses[p, 1], poses[p, 2], tables, work, ranges[p], ray[p], edge[p]
        )


def cast(tables: CastTables, poses: np.ndarray, beams: int) -> tuple[np.ndarray, ...]:
    shape = len(poses), beams
    made = np.empty(shape), np.empty(shape, np.int32), np.empty(shape, np.int32)
    ranges_at(poses, tables, *made)
    return made


def scene(name: str) -> tuple[Environment, RangeScanner, CastTables, np.ndarray]:
    env, scanner = worlds.room(), SCANNERS[name]
    poses = worlds.free_poses(env, 200, seed=2)
    # Some of them outside.
    poses[:3, 0] += 100.0
    return env, scanner, cast_tables(env, scanner, np.arange(scanner.beams)), poses


@pytest.mark.slow
@pytest.mark.parametrize("name", SCANNERS)
def test_ranges_are_those_of_the_scanner(name: str) -> None:
    env, scanner, tables, poses = scene(name)
    ranges, ray, edge = cast(tables, poses, scanner.beams)
    for pose, mine in zip(poses, ranges, strict=True):
        assert np.allclose(mine, scanner.scan(env, *pose), atol=1e-5, equal_nan=True)
    seen = ranges < math.inf
    assert ((ray >= 0) == seen).all() and ((edge >= 0) == seen).all()
    owner = np.broadcast_to(np.arange(scanner.beams), ray.shape)
    assert (tables.beam[ray[seen]] == owner[seen]).all()


@pytest.mark.slow
def test_a_laser_is_plain_and_gets_what_any_scanner_would() -> None:
    _, scanner, tables, poses = scene("laser")
    assert tables.plain[0] and not scene("sonar")[2].plain[0]
    # Half of the beams are numbered as they come, all the same.
    assert cast_tables(worlds.room(), scanner, np.arange(0, scanner.beams, 2)).plain[0]
    slowly = cast(tables._replace(plain=np.array([False])), poses, scanner.beams)
    for mine, other in zip(cast(tables, poses, scanner.beams), slowly, strict=True):
        assert np.array_equal(mine, other, equal_nan=mine.dtype == np.float64)


def test_steady_sensors_need_no_tables() -> None:
    env, scanner, tables, poses = scene("mixed")
    noise = beam_noise(env, scanner, 0.02)
    growing = RangeSensor(max_range=4.0, std=Polynomial((0.01, 0.02)), resolution=0.001)
    assert noise.steady.all()
    assert not beam_noise(env, RangeScanner.planar(growing, 8, 1.0), 0.02).steady.any()
    space = line_space(scanner.beams, tables.cosine.size)
    for pose in poses[3:]:
        lines = []
        for steady in (noise.steady, np.zeros_like(noise.steady)):
            beam_lines(*pose, tables, noise._replace(steady=steady), *space)
            lines.append(space[-1].copy())
        finite = np.isfinite(lines[0][:, 4])
        assert (finite == np.isfinite(lines[1][:, 4])).all()
        assert np.allclose(lines[0][finite], lines[1][finite], rtol=1e-12, atol=1e-12)


@njit
def rays_at(pose: Any, tables: Any, work: Any) -> None:
    cast_rays(pose[0], pose[1], pose[2], tables, work)


@njit
def counted_at(pose: Any, reading: Any, tables: Any, work: Any, picked: Any) -> int:
    return cast_observed(pose[0], pose[1], pose[2], reading, tables, work, picked)


@njit
def spread(count: int, work: Any, picked: Any) -> None:
    spread_observed(count, work, picked)


def check_counted(tables: CastTables, pose: np.ndarray, reading: np.ndarray) -> None:
    """The rays of beams with a reading meet what they do among all, and the others nothing."""
    size = tables.cosine.size
    every, some, picked = work_space(size), work_space(size), np.empty(size, np.int32)
    rays_at(pose, tables, every)
    count = counted_at(pose, reading, tables, some, picked)
    needed = np.isfinite(reading)[tables.beam] | tables.anchor
    assert np.array_equal(picked[:count], np.flatnonzero(needed))
    if not np.isnan(every[2]).any():
        # Where a ray starts outside it has no direction.
        assert np.array_equal(some[0][:count], every[0][needed])
        assert np.array_equal(some[1][:count], every[1][needed])
    spread(count, some, picked)
    # Beyond its limit a ray has some distance or other.
    limit = np.nextafter(tables.limit, math.inf)
    mine, all_of_them = np.minimum(some[2], limit), np.minimum(every[2], limit)
    assert np.allclose(mine[needed], all_of_them[needed], rtol=0.0, atol=1e-9, equal_nan=True)
    near = needed & (every[2] < tables.limit)
    assert np.array_equal(some[3][near], every[3][near])
    assert np.isposinf(some[2][~needed]).all() and (some[3][~needed] == -1).all()


@pytest.mark.slow
@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 2**32), name=st.sampled_from(sorted(SCANNERS)), share=st.floats(0, 1))
def test_beams_without_a_reading_need_not_be_cast(seed: int, name: str, share: float) -> None:
    _, scanner, tables, poses = scene(name)
    rng = np.random.default_rng(seed)
    lost = rng.choice([math.inf, -math.inf, math.nan], scanner.beams)
    reading = np.where(rng.random(scanner.beams) < share, 1.0, lost)
    check_counted(tables, poses[rng.integers(len(poses))], reading)


@pytest.mark.parametrize("name", SCANNERS)
def test_anchors_leave_no_gap_of_half_a_turn(name: str) -> None:
    tables = scene(name)[2]
    angle = np.arctan2(tables.sine, tables.cosine)
    for low, high in pairwise(tables.first):
        mine = angle[low:high]
        chosen = tables.anchor[low:high]
        assert chosen[0] and (high - low < 10 or chosen.sum() <= 4)
        ends = np.append(mine[chosen], mine[-1])
        assert (np.mod(np.diff(ends), 2 * math.pi) <= APART).all()


@pytest.mark.slow
def test_rays_that_begin_and_end_within_one_edge() -> None:
    # A room of two triangles; the beams look to one wall alone, and the list of all of them begins
    # in their middle.
    tables = cast_tables(worlds.box(6.0, 6.0), SCANNERS["laser"], np.arange(60))
    reading = np.full(60, math.inf)
    reading[:5] = reading[-5:] = 1.0
    for theta in np.linspace(-math.pi, math.pi, 25):
        for x, y in ((3.0, 4.0), (0.5, 2.0), (5.9, 5.9)):
            check_counted(tables, np.array([x, y, theta]), reading)
