"""Beams cast inside kernels: what lasers do without changes nothing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numba import njit

from ambinav.geometry.environment import Environment
from ambinav.localization.casting import CastTables, cast_tables, expected_ranges, work_space
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
        told = np.isfinite(lines[0][:, 4])
        assert (told == np.isfinite(lines[1][:, 4])).all()
        assert np.allclose(lines[0][told], lines[1][told], rtol=1e-12, atol=1e-12)
