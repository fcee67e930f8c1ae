"""A sphere among triangles: against distances of many sampled points."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ambinav.geometry.collision.sphere import SphereChecker, segment_triangle
from ambinav.runtime.errors import InputError

SHARE = np.linspace(0.0, 1.0, 41)
# Weights of points all over a triangle.
U, V = (part[SHARE[:, None] + SHARE <= 1.0] for part in np.meshgrid(SHARE, SHARE))


def sampled(p: np.ndarray, q: np.ndarray, triangle: np.ndarray) -> float:
    """Distance of points on a segment from points on a triangle."""
    a, b, c = triangle
    face = a + U[:, None] * (b - a) + V[:, None] * (c - a)
    line = p + SHARE[:, None] * (q - p)
    return float(np.linalg.norm(face[:, None] - line, axis=2).min())


def test_distance_of_a_segment_from_a_triangle() -> None:
    rng = np.random.default_rng(4)
    for case in range(60):
        ends = rng.uniform(-1.0, 1.0, (5, 3))
        if case % 6 == 0:
            ends[1] = ends[0]  # a point
        if case % 6 == 1:
            ends[1] = ends[0] + 0.7 * (ends[3] - ends[2])  # along a side
        if case % 6 == 2:
            ends[4] = 0.4 * ends[2] + 0.6 * ends[3]  # a triangle without area
        exact = math.sqrt(segment_triangle(*map(tuple, ends)))
        brute = sampled(ends[0], ends[1], ends[2:])
        # Samples lie within a step of every point, and never nearer than the nearest one.
        assert exact - 1e-9 <= brute <= exact + 0.09


def test_motions_among_many_triangles() -> None:
    rng = np.random.default_rng(7)
    triangles = rng.uniform(0.0, 4.0, (40, 1, 3)) + rng.uniform(-0.6, 0.6, (40, 3, 3))
    triangles[0] = [[-9.0, -9.0, 2.0], [20.0, -9.0, 2.1], [0.0, 20.0, 2.2]]
    checker = SphereChecker(triangles, 0.2)
    ends = rng.uniform(-0.5, 4.5, (400, 2, 3))
    ends[:200, 1] = ends[:200, 0] + 0.3 * (ends[:200, 1] - ends[:200, 0])
    expected = [
        min(segment_triangle(*map(tuple, (a, b, *t))) for t in triangles) >= 0.04 for a, b in ends
    ]
    free = checker.motions_free(ends[:, 0], ends[:, 1])
    assert free.tolist() == expected
    assert 40 < free.sum() < 360
    np.testing.assert_array_equal(
        checker.motions_free(ends[:, 1], ends[:, 0]), free, "the same both ways"
    )


def test_touching_is_free_and_passing_through_is_not() -> None:
    wall = np.array([[[1.0, -5.0, -5.0], [1.0, 5.0, -5.0], [1.0, 0.0, 9.0]]])
    checker = SphereChecker(wall, 0.25)
    assert checker.free([(0.75, 0.0, 0.0), (0.76, 0.0, 0.0)]).tolist() == [True, False]
    assert not checker.motions_free([(0.0, 0.0, 0.0)], [(2.0, 0.0, 0.0)])[0]
    assert checker.motions_free([(0.0, 0.0, 0.0)], [(0.0, 30.0, 40.0)])[0]
    assert not checker.free([(math.nan, 0.0, 0.0)])[0]
    with pytest.raises(InputError, match=r"radius is 0\.0; give a positive number of metres"):
        SphereChecker(wall, 0.0)
