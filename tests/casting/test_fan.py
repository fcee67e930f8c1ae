"""Whole scans through the triangulation, against single rays over the segments."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from ambinav.casting.plane.fan import counter_clockwise, distinct_rows, first_edges, scan_plan
from ambinav.geometry.environment import Environment
from tests.geometry import scenes

REACH = 12.0
CIRCLE = -math.pi + 2 * math.pi * np.arange(100) / 100
CENTRE = np.zeros(2)


@pytest.fixture(scope="module", params=[1, 2, 3])
def env(request: pytest.FixtureRequest) -> Environment:
    return scenes.scene(request.param)


def poses(env: Environment, count: int, seed: int = 1) -> tuple[scenes.Array, ...]:
    xy = scenes.points_inside(env, count, seed)
    theta = np.random.default_rng(seed).uniform(-7, 7, count)
    return np.ascontiguousarray(xy[:, 0]), np.ascontiguousarray(xy[:, 1]), theta


def check(
    env: Environment,
    x: scenes.Array,
    y: scenes.Array,
    theta: scenes.Array,
    origin: scenes.Array,
    angle: scenes.Array,
    reach: float = REACH,
) -> None:
    """Scans are single rays: distance, segment, incidence, what is out of range or outside."""
    origin = np.broadcast_to(origin, (len(angle), 2))
    distance, segment, incidence = scan_plan(env, x, y, theta, origin, angle, reach)
    assert distance.dtype == np.float32 and segment.dtype == np.int32
    assert distance.shape == segment.shape == incidence.shape == (len(x), len(angle))
    c, s = np.cos(theta)[:, None], np.sin(theta)[:, None]
    px = x[:, None] + c * origin[:, 0] - s * origin[:, 1]
    py = y[:, None] + s * origin[:, 0] + c * origin[:, 1]
    inside = np.asarray(env.is_free(px, py))
    expected, which = env.cast_hits(px, py, theta[:, None] + angle, reach)
    seen = which >= 0
    assert (np.isnan(distance) == ~inside).all()
    # A ray past a corner may come out either side: few, and only within float64's noise.
    near = inside & seen & np.isfinite(distance)
    assert (inside & (seen != np.isfinite(distance))).sum() <= 1e-4 * inside.sum()
    wrong = near & (np.abs(distance - expected) > 1e-5)
    assert wrong.sum() == 0
    assert (np.isposinf(distance) | np.isnan(distance) | (segment >= 0)).all()
    assert (segment[~np.isfinite(distance)] == -1).all()
    assert np.isnan(incidence[~np.isfinite(distance)]).all()
    same = near & (segment == which)
    assert same.sum() >= 0.999 * near.sum()
    normal = env.normals(which)
    ray = np.stack([np.cos(theta[:, None] + angle), np.sin(theta[:, None] + angle)], axis=-1)
    facing = np.abs((normal * ray).sum(axis=-1))
    assert np.abs(np.cos(incidence[same]) - facing[same]).max() < 1e-5


def test_full_circle(env: Environment) -> None:
    check(env, *poses(env, 300), CENTRE, CIRCLE)


def test_full_circle_far(env: Environment) -> None:
    check(env, *poses(env, 100), CENTRE, CIRCLE, reach=100.0)


@pytest.mark.parametrize("aperture", [0.3, 1.0, math.pi, 4.0, 6.0])
@pytest.mark.parametrize("middle", [0.0, 2.0, math.pi, -math.pi / 2, 11.0])
def test_partial_fans_wherever_they_begin(aperture: float, middle: float) -> None:
    env = scenes.scene(1)
    angle = middle + np.linspace(-aperture / 2, aperture / 2, 37)
    check(env, *poses(env, 40), CENTRE, angle)


@pytest.mark.parametrize("angle", [0.0, 3.0, -3.2, 9.0])
def test_a_single_ray(angle: float) -> None:
    env = scenes.scene(2)
    check(env, *poses(env, 200), CENTRE, np.array([angle]))


@pytest.mark.parametrize("angles", [(0.0, math.pi), (0.0, 3.0), (1.0, -2.0), (0.0, 2.1, 4.2)])
def test_few_rays_far_apart(angles: tuple[float, ...]) -> None:
    env = scenes.scene(3)
    check(env, *poses(env, 200), CENTRE, np.array(angles))


def test_the_same_ray_many_times() -> None:
    env = scenes.scene(3)
    check(env, *poses(env, 50), CENTRE, np.full(9, 1.5))


def test_cones_from_mounts_off_the_centre(env: Environment) -> None:
    yaw = 2 * math.pi * np.arange(16) / 16
    cone = np.linspace(-0.26, 0.26, 15)
    origin = np.repeat(0.2 * np.column_stack([np.cos(yaw), np.sin(yaw)]), len(cone), axis=0)
    # The robot's centre is free, a sensor may be within a wall: nan.
    x, y, theta = poses(env, 300, seed=2)
    check(env, x, y, theta, origin, (yaw[:, None] + cone).ravel())


def test_outside_the_free_space_is_nan_and_nothing_else() -> None:
    env = scenes.room(4.0, 3.0)
    x, y = np.array([-1.0, 1.0, 3.9]), np.full(3, 1.0)
    origin = np.array([[0.0, 0.0], [0.2, 0.0]])
    distance, segment, incidence = scan_plan(
        env, x, y, np.zeros(3), origin, np.array([0.0, 0.0]), 10.0
    )
    assert np.isnan(distance).tolist() == [[True, True], [False, False], [False, True]]
    assert distance[1] == pytest.approx([3.0, 2.8])
    assert (segment[np.isnan(distance)] == -1).all()
    assert np.isnan(incidence[np.isnan(distance)]).all()


def test_out_of_range_is_inf() -> None:
    env = scenes.room(4.0, 3.0)
    one = np.ones(1)
    distance, segment, incidence = scan_plan(
        env, one, one, np.zeros(1), np.zeros((2, 2)), np.array([0.0, math.pi]), 2.0
    )
    assert distance[0].tolist() == [math.inf, 1.0]
    assert segment[0, 0] == -1 and segment[0, 1] >= 0
    assert np.isnan(incidence[0, 0]) and incidence[0, 1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("reach", [0.5, 2.0, 5.0])
def test_a_shorter_reach_leaves_out_what_is_beyond_and_nothing_else(
    env: Environment, reach: float
) -> None:
    x, y, theta = poses(env, 200)
    origin = np.zeros((100, 2))
    whole, walls, oblique = scan_plan(env, x, y, theta, origin, CIRCLE, 100.0)
    beyond = whole > reach
    distance, segment, incidence = scan_plan(env, x, y, theta, origin, CIRCLE, reach)
    assert np.array_equal(distance, np.where(beyond, np.inf, whole), equal_nan=True)
    assert np.array_equal(segment, np.where(beyond, -1, walls))
    assert np.array_equal(incidence, np.where(beyond, np.nan, oblique), equal_nan=True)


def test_rays_all_around_stay_in_their_order() -> None:
    for count in (3, 60, 61, 1080):
        turned = -math.pi + 2 * math.pi * np.arange(count) / count
        assert counter_clockwise(turned).tolist() == list(range(count))
        assert counter_clockwise(turned + 0.3).tolist() == list(range(count))
    # Three quarters: the widest gap decides.
    assert counter_clockwise(np.array([2.0, 3.0, -3.0, -1.0])).tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("angle", [0.0, 0.4, 1.0, 1.5])
def test_incidence_is_the_angle_to_the_normal(angle: float) -> None:
    free = shapely.box(0.0, -200.0, 5.0, 200.0)
    _, _, incidence = scan_plan(
        scenes.environment(free), np.ones(1), np.zeros(1), np.zeros(1), np.zeros((1, 2)),
        np.array([angle]), 100.0,
    )  # fmt: skip
    assert incidence[0, 0] == pytest.approx(angle, abs=1e-6)


def test_incidence_only_if_asked_for() -> None:
    env = scenes.room(4.0, 3.0)
    _, _, incidence = scan_plan(
        env, np.ones(1), np.ones(1), np.zeros(1), np.zeros((1, 2)), np.zeros(1), 9.0,
        incidence=False,
    )  # fmt: skip
    assert incidence.shape == (0, 0)


def test_permuted_rays_give_the_permuted_result(env: Environment) -> None:
    x, y, theta = poses(env, 100)
    rng = np.random.default_rng(5)
    origin = rng.choice([[0.0, 0.0], [0.1, 0.05], [-0.2, 0.0]], 80)
    angle = rng.uniform(-9, 9, 80)
    shuffled = rng.permutation(80)
    one = scan_plan(env, x, y, theta, origin, angle, REACH)
    two = scan_plan(env, x, y, theta, origin[shuffled], angle[shuffled], REACH)
    for a, b in zip(one, two, strict=True):
        assert np.array_equal(a[:, shuffled], b, equal_nan=True)


def test_threads_change_nothing(env: Environment, monkeypatch: pytest.MonkeyPatch) -> None:
    x, y, theta = poses(env, 150)
    found = []
    for threads in (1, 2):
        monkeypatch.setattr("numba.get_num_threads", lambda threads=threads: threads)
        found.append(scan_plan(env, x, y, theta, np.zeros((100, 2)), CIRCLE, REACH))
    for one, other in zip(*found, strict=True):
        assert np.array_equal(one, other, equal_nan=True)


# -- thin walls and corners ----------------------------------------------------------------------


def test_thin_walls_stop_scans_from_both_sides() -> None:
    env = scenes.room(10.0, 4.0, np.array([[1.0, 2.0, 9.0, 2.0], [5.0, 2.0, 5.0, 4.0]]))
    angle = np.linspace(0, 2 * math.pi, 721)[:-1] + 0.001
    x, y = (np.ascontiguousarray(v.ravel()) for v in np.meshgrid(
        np.linspace(0.5, 9.5, 7), [1e-4, 1.0, 1.99999, 2.00001, 3.0, 3.9999]))  # fmt: skip
    x = np.where(x == 5.0, 5.00001, x)
    check(env, x, y, np.zeros(len(x)), CENTRE, angle, reach=50.0)


def test_grazing_a_thin_wall() -> None:
    env = scenes.room(10.0, 4.0, np.array([1.0, 2.0, 9.0, 2.0]))
    slopes = np.array([-1e-2, -1e-3, -1e-4, 1e-4, 1e-3, 1e-2])  # one half meets the wall
    for side in (1.0, -1.0):
        # From 4 m before the point where the ray meets the wall.
        y = 2.0 + side * 4.0 * np.abs(slopes)
        distance, segment, incidence = scan_plan(
            env, np.full(6, 1.0), y, np.zeros(6), np.zeros((6, 2)), np.arctan(slopes), 50.0
        )
        meets = side * slopes < 0
        exact = 4.0 * np.hypot(1.0, slopes[meets])
        # The triangulation knows the wall as a slit of 2 micrometres, which a ray at this slope
        # meets a centimetre before the wall itself.
        assert np.abs(np.diag(distance)[meets] - exact).max() < 1e-5
        assert (np.diag(distance)[~meets] > 8.9).all()
        assert (np.diag(incidence)[meets] > 1.56).all()
        assert (np.diag(segment) >= 0).all()


def test_no_ray_leaks_through_corners() -> None:
    # Rays straight at the corners of a star, from its middle and from lattice points.
    around = 2 * math.pi * np.arange(40) / 40
    far = np.where(np.arange(40) % 2, 2.0, 4.0)
    env = scenes.environment(shapely.Polygon((far * np.array([np.cos(around), np.sin(around)])).T))
    for x, y in ((0.0, 0.0), (0.5, 0.5), (-0.3, 0.9), (1.0, 0.0)):
        ends = env.segments.xy[:, :2]
        angle = np.arctan2(ends[:, 1] - y, ends[:, 0] - x)
        distance, segment, _ = scan_plan(
            env, np.array([x]), np.array([y]), np.zeros(1), np.zeros((40, 2)), angle, 50.0
        )
        away = np.hypot(ends[:, 0] - x, ends[:, 1] - y)
        nearest, _ = scenes.cast_slowly(env.segments.xy, np.full(40, x), np.full(40, y), angle)
        assert (distance[0] < away + 5.0).all() and (distance[0] > nearest - 1e-5).all()
        assert (segment >= 0).all()


def test_from_the_corners_of_triangles_and_on_their_edges() -> None:
    env = scenes.room(4.0, 4.0)
    x, y = np.array([2.0, 1.0, 3.0, 2.0]), np.array([2.0, 1.0, 1.0, 1e-9])
    check(env, x, y, np.zeros(4), CENTRE, CIRCLE + 0.01, reach=50.0)


def edges_by_definition(
    apex: scenes.Array, rays: scenes.Array, at: scenes.Array
) -> NDArray[np.int64]:
    """Which edge of a triangle each ray leaves through: between the edge's ends, else the last."""
    left = [(a[0] - at[0]) * rays[:, 1] - (a[1] - at[1]) * rays[:, 0] >= 0 for a in apex]
    return np.where(left[0] & ~left[1], 0, np.where(left[1] & ~left[2], 1, 2))


@pytest.mark.parametrize("where", ["inside", "on an edge", "at a corner"])
def test_a_fan_parts_at_the_corners_of_its_first_triangle(where: str) -> None:
    """Wherever it begins: from a corner, one edge has no ends to lie between."""
    rng = np.random.default_rng(3)
    edges, lows, highs = (np.empty(64, dtype=np.int32) for _ in range(3))
    twin = np.array([7, 8, 9], dtype=np.int32)
    for _ in range(300):
        apex = rng.uniform(0.0, 5.0, (3, 2))
        (ax, ay), (bx, by) = apex[1:] - apex[0]
        area = ax * by - ay * bx
        if abs(area) < 0.5:
            continue
        apex = apex if area > 0.0 else apex[::-1].copy()
        share = {"inside": rng.dirichlet(np.ones(3)), "at a corner": np.eye(3)[rng.integers(3)]}
        weights = share.get(where, np.roll([0.3, 0.7, 0.0], rng.integers(3)))
        at = weights @ apex
        n = int(rng.integers(1, 60))
        angle = rng.uniform(-4.0, 4.0) + np.sort(rng.uniform(0.0, 2.0 * math.pi, n))
        ux, uy = np.cos(angle), np.sin(angle)
        through = np.empty(n, dtype=np.int32)
        pieces = first_edges(*at, ux, uy, n, 0, apex, twin, edges, lows, highs, through)
        got = np.concatenate([np.full(highs[k] - lows[k], edges[k]) for k in range(pieces)])
        expected = edges_by_definition(apex, np.stack([ux, uy], axis=1), at)
        np.testing.assert_array_equal(got, twin[expected])
        assert lows[0] == 0 and (highs[: pieces - 1] == lows[1:pieces]).all()
        assert (highs[:pieces] > lows[:pieces]).all() and (through == -1).all()


@pytest.mark.parametrize("rows", [[[0.1, 0.2]] * 3, [[0.2, 0.1], [0.1, 0.2], [0.2, 0.1]], []])
def test_distinct_rows_are_those_of_numpy(rows: list[list[float]]) -> None:
    given = np.array(rows).reshape(-1, 2)
    for ours, theirs in zip(
        distinct_rows(given), np.unique(given, axis=0, return_inverse=True), strict=True
    ):
        assert np.array_equal(ours, theirs)
