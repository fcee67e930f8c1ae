"""Spaces: lengths, dense routes, headings, and what a user may get wrong."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import ambinav as an
from ambinav.geometry.motion.steering import DUBINS, FACING, REEDS_SHEPP, STRAIGHT, Steering
from ambinav.runtime.errors import InputError

SPACES = [
    Steering(), Steering("se2"), Steering("dubins", 0.7), Steering("reeds-shepp", 0.7)
]  # fmt: skip
ROUTE = np.array([[0, 0, 0.2], [3, 0, 1.0], [3, 4, 3.0], [3, 4, 3.0], [3, 4, -2.0], [-1, 2, 0.0]])

routes = st.lists(
    st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.floats(-4, 4)), min_size=2, max_size=5
)
steerings = pytest.mark.parametrize("steering", SPACES, ids=lambda steering: steering.space)


def test_kinds() -> None:
    assert [steering.kind for steering in SPACES] == [FACING, STRAIGHT, DUBINS, REEDS_SHEPP]
    assert [steering.turns for steering in SPACES] == [False, False, True, True]


def test_a_step_that_is_much_too_small_is_refused() -> None:
    """Its points would fill any memory, or their number an integer."""
    route = [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]]
    for space in ("r2", "dubins"):
        steering = Steering(space, 0.5 if space == "dubins" else 0.0)
        for step in (1e-9, 1e-30, 1e-300):
            with pytest.raises(InputError, match=r"on a route of 10 m; give at least 2e-07 m"):
                steering.dense(route, step)


@pytest.mark.slow
@steerings
@settings(max_examples=60, deadline=None)
@given(routes, st.floats(0.05, 2.0))
def test_a_dense_route_keeps_its_ends_and_its_step(
    steering: Steering, route: list[tuple[float, float, float]], step: float
) -> None:
    poses = np.array(route)
    dense, leg, along = steering.dense(poses, step)
    metres = steering.lengths(poses[:-1], poses[1:])
    assert along[-1] == pytest.approx(metres.sum(), abs=1e-9)
    assert (np.diff(along) >= 0.0).all()
    assert np.diff(along).max() <= step * (1 + 1e-9)
    assert (np.hypot(*np.diff(dense[:, :2], axis=0).T) <= step * (1 + 1e-9) + 1e-8).all()
    assert set(leg) == set(range(len(poses) - 1))
    for i in range(len(poses) - 1):
        on = np.flatnonzero(leg == i)
        assert along[on[-1]] - along[on[0]] == pytest.approx(metres[i], abs=1e-9)
        np.testing.assert_allclose(dense[on[0], :2], poses[i, :2], atol=1e-8)
        np.testing.assert_allclose(dense[on[-1], :2], poses[i + 1, :2], atol=5e-6)
        if steering.kind != FACING:
            ends = dense[[on[0], on[-1]], 2] - poses[[i, i + 1], 2]
            np.testing.assert_allclose(np.cos(ends), 1.0, atol=1e-9)


def test_r2_looks_along_the_way() -> None:
    dense, leg, _ = Steering().dense(ROUTE, 0.5)
    np.testing.assert_allclose(dense[leg == 0, 2], 0.0)
    np.testing.assert_allclose(dense[leg == 1, 2], math.pi / 2)
    np.testing.assert_allclose(dense[leg == 4, 2], math.atan2(-2, -4))
    oriented = Steering().oriented(ROUTE)
    back = math.atan2(-2, -4)
    np.testing.assert_allclose(oriented[:, 2], [0, math.pi / 2, back, back, back, back])
    np.testing.assert_array_equal(oriented[:, :2], ROUTE[:, :2])
    stays = Steering().oriented([[1, 1, 0.5], [1, 1, 0.7]])
    np.testing.assert_array_equal(stays[:, 2], [0.5, 0.7])


@pytest.mark.parametrize("steering", SPACES[1:], ids=lambda steering: steering.space)
def test_other_spaces_keep_their_headings(steering: Steering) -> None:
    np.testing.assert_array_equal(steering.oriented(ROUTE), ROUTE)


def test_se2_turns_the_short_way_round() -> None:
    dense, _, _ = Steering("se2").dense([[0, 0, 3.0], [1, 0, -3.0]], 0.25)
    assert np.abs(np.diff(dense[:, 2])).max() < 0.1
    assert dense[2, 2] == pytest.approx(math.pi)
    turned, _, along = Steering("se2").dense([[0, 0, 0.0], [0, 0, 1.0]], 0.25)
    np.testing.assert_array_equal(turned[:, 2], [0.0, 1.0])
    np.testing.assert_array_equal(along, 0.0)


def test_curves_bend_no_more_than_their_radius() -> None:
    for steering in SPACES[2:]:
        dense, _, along = steering.dense(ROUTE, 0.01)
        bend = np.abs(np.diff(np.unwrap(dense[:, 2])))
        assert (bend <= np.diff(along) / steering.radius + 1e-8).all()
        # Between the points the robot moves the way that it looks, or the opposite way.
        step = np.diff(dense[:, :2], axis=0)
        middle = 0.5 * (dense[1:, 2] + dense[:-1, 2])
        aside = step[:, 1] * np.cos(middle) - step[:, 0] * np.sin(middle)
        assert np.abs(aside).max() < 1e-8


def test_one_pose_is_a_route() -> None:
    dense, leg, along = Steering().dense([[1, 2, 0.5]], 0.1)
    np.testing.assert_array_equal(dense, [[1, 2, 0.5]])
    assert leg.tolist() == [0]
    assert along.tolist() == [0.0]
    assert Steering().lengths(np.empty((0, 3)), np.empty((0, 3))).shape == (0,)


@pytest.mark.parametrize(
    ("space", "radius", "word"),
    [
        ("r3", 0.0, "r3"),
        ("dubins", 0.0, "radius"),
        ("dubins", math.nan, "radius"),
        ("reeds-shepp", -1.0, "radius"),
        ("reeds-shepp", math.inf, "radius"),
        ("r2", 0.5, "radius"),
        ("se2", math.nan, "radius"),
    ],
)
def test_bad_spaces(space: str, radius: float, word: str) -> None:
    with pytest.raises(an.InputError, match=word):
        Steering(space, radius)


def test_bad_poses() -> None:
    steering = Steering()
    with pytest.raises(an.InputError, match=r"shape \(3,\)"):
        steering.dense([0, 0, 0], 0.1)
    with pytest.raises(an.InputError, match=r"poses\[1\]"):
        steering.dense([[0, 0, 0], [1, math.nan, 0]], 0.1)
    with pytest.raises(an.InputError, match="step"):
        steering.dense(ROUTE, 0.0)
    with pytest.raises(an.InputError, match="as many"):
        steering.lengths(ROUTE, ROUTE[:-1])


def test_the_way_back_of_reeds_and_shepp_is_the_same_curve() -> None:
    # L+R-L+ and R-L+R- are equally long; planners count on getting the same one both ways.
    rng = np.random.default_rng(3)
    car = Steering("reeds-shepp", 0.5)
    for _ in range(500):
        ends = rng.uniform((-0.5, -0.5, -math.pi), (0.5, 0.5, math.pi), size=(2, 3))
        there, back = (
            shapely.LineString(car.dense(pair, 0.01)[0][:, :2]) for pair in (ends, ends[::-1])
        )
        assert shapely.hausdorff_distance(there, back) < 0.02
