"""A sphere and a cylinder among triangles: against sampled points and a minimizer."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import minimize

from ambinav.geometry.collision.sphere import SphereChecker, segment_triangle
from ambinav.geometry.collision.upright_cylinder import cylinder_meets
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
    with pytest.raises(InputError, match=r"radius is 0\.0; give metres above 0"):
        SphereChecker(wall, 0.0)


def nearest_between(p: np.ndarray, q: np.ndarray, triangle: np.ndarray, half: float) -> float:
    """Least distance from the axis, seen from above, of points that a cylinder's height reaches.

    Over the share of the motion and the two weights of a point of the triangle, a convex problem;
    inf where no point is at such a height.
    """
    a, b, c = triangle

    def gap(w: np.ndarray) -> np.ndarray:
        return np.asarray(a + w[1] * (b - a) + w[2] * (c - a) - p - w[0] * (q - p))

    limits = [
        {"type": "ineq", "fun": lambda w: half - gap(w)[2]},
        {"type": "ineq", "fun": lambda w: half + gap(w)[2]},
        {"type": "ineq", "fun": lambda w: 1.0 - w[1] - w[2]},
    ]
    best = math.inf
    for start in ((0.5, 0.3, 0.3), (0.1, 0.1, 0.1), (0.9, 0.1, 0.8)):
        found = minimize(
            lambda w: float((gap(w)[:2] ** 2).sum()), start, bounds=[(0.0, 1.0)] * 3,
            constraints=limits, options={"ftol": 1e-14, "maxiter": 300},
        )  # fmt: skip
        if max(abs(gap(found.x)[2]) - half, found.x[1] + found.x[2] - 1.0) < 1e-7:
            best = min(best, math.sqrt(max(found.fun, 0.0)))
    return best


@pytest.mark.sweep
def test_a_cylinder_against_a_minimizer() -> None:
    rng = np.random.default_rng(11)
    ends = np.empty((18, 2))
    seen = [0, 0, 0]
    for case in range(80):
        a, b, *triangle = rng.uniform(-1.0, 1.0, (5, 3))
        if case % 5 == 0:
            b = a  # at rest
        if case % 5 == 1:
            b = np.array([*a[:2], b[2]])  # straight up
        if case % 5 == 2:
            triangle[1][:2] = triangle[0][:2]  # part of a wall
        if case % 5 == 3:
            triangle[1][2] = triangle[2][2] = triangle[0][2]  # level
        corners, half = np.array(triangle), float(rng.uniform(0.05, 0.4))
        near = nearest_between(a, b, corners, half)
        seen[0 if near == math.inf else 1 if near < 1e-3 else 2] += 1
        for radius in (near - 1e-3, near + 1e-3) if near < math.inf else (5.0,):
            if radius > 0.0:
                meets = cylinder_meets(tuple(a), tuple(b), corners, half, radius**2, ends)
                assert meets == (radius > near), case
    assert min(seen) >= 4, "of each kind: none at that height, through it, beside it"


def test_a_flat_body_passes_where_a_sphere_does_not() -> None:
    """A slot 0.3 m high and 0.7 m wide in a wall at x = 1, and the floor at z = 0."""
    quads = [
        [(1, -5, 0), (1, 5, 0), (1, 5, 1), (1, -5, 1)],
        [(1, -5, 1.3), (1, 5, 1.3), (1, 5, 3), (1, -5, 3)],
        [(1, -5, 1), (1, -0.35, 1), (1, -0.35, 1.3), (1, -5, 1.3)],
        [(1, 0.35, 1), (1, 5, 1), (1, 5, 1.3), (1, 0.35, 1.3)],
        [(-5, -5, 0), (5, -5, 0), (5, 5, 0), (-5, 5, 0)],
    ]
    walls = np.array(
        [[q[0], q[1], q[2]] for q in quads] + [[q[0], q[2], q[3]] for q in quads], float
    )
    flat, ball = SphereChecker(walls, 0.35, 0.1), SphereChecker(walls, 0.35)
    level = ((0.0, 0.0, 1.15), (2.0, 0.0, 1.15))
    assert flat.motions_free(*level)[0] and not ball.motions_free(*level)[0]
    # Up to 5 cm of play above and below, none to the sides, and 0.1 m in 2 m of climb.
    for dz, free in ((0.05, True), (0.051, False)):
        for sign in (1.0, -1.0):
            a, b = (np.add(end, (0.0, 0.0, sign * dz)) for end in level)
            assert flat.motions_free(a, b)[0] == free
    assert not flat.motions_free((0.0, 0.01, 1.15), (2.0, 0.01, 1.15))[0]
    assert not flat.motions_free((0.0, 0.0, 1.0), (2.0, 0.0, 1.3))[0]
    # On the floor, and up from there; not any lower.
    assert flat.motions_free((-1.0, 0.0, 0.1), (-1.0, 2.0, 2.0))[0]
    assert not flat.free([(-1.0, 0.0, 0.099)])[0]
    rng = np.random.default_rng(5)
    a, b = rng.uniform((-1.0, -1.0, 0.2), (2.0, 1.0, 2.0), (2, 300, 3))
    free = flat.motions_free(a, b)
    assert 30 < free.sum() < 270
    # A low cylinder is in the sphere that has both its sizes, and holds one of half its height.
    assert free[SphereChecker(walls, math.hypot(0.35, 0.1)).motions_free(a, b)].all()
    assert SphereChecker(walls, 0.1).motions_free(a, b)[free].all()
    with pytest.raises(InputError, match=r"half_height is -0\.1; give metres above 0"):
        SphereChecker(walls, 0.35, -0.1)
