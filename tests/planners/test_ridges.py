"""Ridges of the clearance against the same by NumPy, clearance by clearance."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

import ambinav as an
from ambinav.casting.plane.raycast import clearances
from ambinav_planners.search.ridges import ACROSS, GOLDEN, NARROWINGS, decreases, ridge

Floats = NDArray[np.float64]


def cluttered(seed: int, lines: int) -> an.Environment:
    """A room with thin walls all over it."""
    rng = np.random.default_rng(seed)
    ends = rng.uniform(1.0, 9.0, (lines, 2, 2))
    ends[:, 1] = ends[:, 0] + rng.uniform(-1.0, 1.0, (lines, 2))
    walls = shapely.union_all(shapely.buffer(shapely.linestrings(ends), 0.02))
    floor = shapely.box(0, 0, 10, 10).difference(walls)
    return an.environment_from_shapes([max(shapely.get_parts(floor), key=lambda part: part.area)])


@pytest.mark.parametrize(("lines", "step"), [(3, 0.3), (40, 0.05), (400, 0.4)])
def test_as_numpy_finds_them(lines: int, step: float) -> None:
    grid = cluttered(lines, lines).grid
    points = np.random.default_rng(1).uniform(-1.0, 11.0, (300, 2))

    def clearance(points: Floats) -> Floats:
        return clearances(grid, points[:, 0], points[:, 1], math.inf)

    here = clearance(points)
    each = np.array([
        2.0 * here - clearance(points + step * u) - clearance(points - step * u) for u in ACROSS
    ])  # fmt: skip
    most, direction = decreases(grid, points, here, step)
    np.testing.assert_allclose(most, each.max(axis=0), atol=1e-12)
    np.testing.assert_array_equal(direction, ACROSS[each.argmax(axis=0)])
    low, high = np.full(len(points), -step), np.full(len(points), step)

    def at(offset: Floats) -> Floats:
        return clearance(points + offset[:, np.newaxis] * direction)

    for _ in range(NARROWINGS):
        width = GOLDEN * (high - low)
        left, right = high - width, low + width
        rising = at(left) < at(right)
        low, high = np.where(rising, left, low), np.where(rising, high, right)
    found, highest = ridge(grid, points, here, direction, step)
    np.testing.assert_allclose(
        found, points + (0.5 * (low + high))[:, np.newaxis] * direction, atol=1e-12
    )
    np.testing.assert_allclose(highest, clearance(found), atol=1e-12)


def test_between_two_walls_it_is_in_their_middle() -> None:
    corridor = an.environment_from_shapes([shapely.box(0, 0, 20, 2)])
    points = np.array([[10.0, 0.9], [7.3, 1.15]])
    here = np.array([0.9, 0.85])
    fall, across = decreases(corridor.grid, points, here, 0.2)
    np.testing.assert_allclose(fall, [2 * 0.9 - 0.7 - 0.9, 2 * 0.85 - 0.65 - 0.95], atol=1e-12)
    np.testing.assert_allclose(np.abs(across), [[0.0, 1.0], [0.0, 1.0]], atol=1e-12)
    found, high = ridge(corridor.grid, points, here, across, 0.2)
    np.testing.assert_allclose(found[:, 1], 1.0, atol=1e-4)
    np.testing.assert_allclose(high, 1.0, atol=1e-4)
