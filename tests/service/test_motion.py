"""Integrals over motions of every kind: against dense NumPy sums along the same motions."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from ambinav.geometry.motion.steering import Steering
from ambinav.service.field import Field
from ambinav.service.motion import motion_integral, motion_integrals

SPACES = [
    Steering(), Steering("se2"), Steering("dubins", 0.7), Steering("reeds-shepp", 0.7)
]  # fmt: skip
steerings = pytest.mark.parametrize("steering", SPACES, ids=lambda steering: steering.space)
SPACING = 0.1


def rough(headings: int) -> Field:
    """A field between 1 and 6 that changes from cell to cell and from heading to heading."""
    rng = np.random.default_rng(3)
    values = rng.uniform(1.0, 6.0, (120, 150, headings)).astype(np.float32)
    return Field(values, np.ones((120, 150), dtype=np.bool_), (-3.0, -2.0), SPACING)


def random_poses(count: int) -> NDArray[np.float64]:
    rng = np.random.default_rng(4)
    return rng.uniform([0.0, 0.0, -7.0], [9.0, 7.0, 7.0], (count, 3))


def summed(
    field: Field, steering: Steering, a: NDArray[np.float64], b: NDArray[np.float64]
) -> float:
    """Integral by the trapezoid rule on a motion in steps of a 200th of a cell."""
    pose, _, along = steering.dense(np.stack([a, b]), SPACING / 200)
    return float(np.trapezoid(field.at(*pose.T.copy()), along))


@steerings
@pytest.mark.parametrize("headings", [1, 8])
def test_integrals_are_those_of_dense_sums(steering: Steering, headings: int) -> None:
    field = rough(headings)
    a, b = random_poses(60)[:30], random_poses(60)[30:]
    expected = np.array([summed(field, steering, *pair) for pair in zip(a, b, strict=True)])
    got = field.integral(*a.T, *b.T, steering)
    # Noise from cell to cell is the worst that the points on an arc can meet.
    exact = 1e-4 if not steering.turns else 1e-3
    np.testing.assert_allclose(got, expected, rtol=exact)
    assert abs(got.sum() / expected.sum() - 1) < 1e-3


@steerings
@pytest.mark.parametrize("headings", [1, 8])
def test_integrals_over_a_smooth_field_are_those_of_dense_sums(
    steering: Steering, headings: int
) -> None:
    x, y, t = np.meshgrid(
        np.arange(150), np.arange(120), np.arange(headings) * 2 * np.pi / headings
    )
    values = 2.0 + np.sin(0.12 * x) * np.cos(0.15 * y) + 0.5 * np.cos(t)
    field = replace(rough(headings), values=values.astype(np.float32))
    a, b = random_poses(60)[:30], random_poses(60)[30:]
    expected = np.array([summed(field, steering, *pair) for pair in zip(a, b, strict=True)])
    np.testing.assert_allclose(field.integral(*a.T, *b.T, steering), expected, rtol=2e-4)


@steerings
@pytest.mark.parametrize("headings", [1, 8])
def test_a_field_of_seven_costs_seven_times_the_length(steering: Steering, headings: int) -> None:
    field = replace(rough(headings), values=np.full((120, 150, headings), 7.0, dtype=np.float32))
    a, b = random_poses(600)[:300], random_poses(600)[300:]
    got = field.integral(*a.T, *b.T, steering)
    np.testing.assert_allclose(got, 7.0 * steering.lengths(a, b), rtol=1e-9)


@pytest.mark.parametrize("space", ["r2", "se2"])
@pytest.mark.parametrize("headings", [1, 8])
def test_beyond_the_map_costs_are_those_of_its_border(space: str, headings: int) -> None:
    """The same field with a border of copies all around must give the same integrals."""
    field, wide = rough(headings), 100
    around = np.pad(field.values, ((wide, wide), (wide, wide), (0, 0)), mode="edge")
    origin = (field.origin[0] - wide * SPACING, field.origin[1] - wide * SPACING)
    padded = Field(around, np.ones(around.shape[:2], dtype=np.bool_), origin, SPACING)
    ends = np.random.default_rng(6).uniform([-12, -11, -7], [21, 19, 7], (2, 400, 3))
    ends[:, :40, 1] = 2.0  # along a row of the lattice
    ends[:, 40:80, 0] = -3.0  # along its border
    a, b = ends
    expected = padded.integral(*a.T, *b.T, Steering(space))
    np.testing.assert_allclose(field.integral(*a.T, *b.T, Steering(space)), expected, rtol=1e-7)


@pytest.mark.parametrize("headings", [1, 8])
def test_a_motion_that_leaves_the_map_ends_early(headings: int) -> None:
    """A hundred million kilometres of lattice lines would take hours."""
    field = replace(rough(headings), values=np.full((120, 150, headings), 7.0, dtype=np.float32))
    for sign in (1.0, -1.0):
        ends = [np.array([value]) for value in (4.0, 4.0, 0.0, sign * 1e11, sign * 3e10, 0.0)]
        expected = 7.0 * math.hypot(ends[3][0] - 4.0, ends[4][0] - 4.0)
        for pair in (ends, ends[3:] + ends[:3]):
            assert field.integral(*pair, Steering("se2"))[0] == pytest.approx(expected, rel=1e-9)


@steerings
def test_a_motion_is_read_at_its_heading(steering: Steering) -> None:
    """A field of 1 when looking along +x and 3 when looking along -x, everywhere."""
    values = np.empty((120, 150, 4), dtype=np.float32)
    values[:] = [1.0, 2.0, 3.0, 2.0]
    field = replace(rough(4), values=values)

    def cost(theta: float, x1: float) -> float:
        ends = [np.array([value]) for value in (4.0, 4.0, theta, x1, 4.0, theta)]
        return float(field.integral(*ends, steering)[0])

    assert cost(0.0, 6.0) == pytest.approx(2.0)
    # Two metres to the left: r2 turns round, se2 slides, reeds-shepp goes backwards.
    back = {"r2": 6.0, "se2": 2.0, "reeds-shepp": 2.0}
    if steering.space in back:
        assert cost(0.0, 2.0) == pytest.approx(back[steering.space])
    assert cost(math.pi, 2.0) == pytest.approx(6.0)


@steerings
def test_one_motion_and_a_batch_are_the_same(steering: Steering) -> None:
    field = rough(8)
    a, b = random_poses(200)[:100], random_poses(200)[100:]
    values, _, left, low, inverse = field.arrays
    out = np.empty(100)
    field_arrays = (values, left, low, inverse)
    motion_integrals(steering.kind, steering.radius, a, b, *field_arrays, out)
    for i in range(100):
        one = motion_integral(steering.kind, steering.kernel_radius, *a[i], *b[i], *field_arrays)
        # A curve without a radius has no cost, and not that of a straight line.
        assert not steering.turns or math.isnan(
            motion_integral(steering.kind, None, *a[i], *b[i], *field_arrays)
        )
        assert one == out[i]
    np.testing.assert_array_equal(field.integral(*a.T, *b.T, steering), out)


@steerings
def test_no_motion_costs_nothing(steering: Steering) -> None:
    ends = [np.array([value]) for value in (2.0, 3.0, 0.5)]
    assert rough(1).integral(*ends, *ends, steering)[0] == 0.0


def test_reeds_shepp_costs_the_same_both_ways() -> None:
    field, steering = rough(8), SPACES[3]
    a, b = random_poses(200)[:100], random_poses(200)[100:]
    there, back = field.integral(*a.T, *b.T, steering), field.integral(*b.T, *a.T, steering)
    # Few have two curves of the same length, of which either may be taken.
    assert np.isclose(there, back, rtol=1e-6).mean() > 0.9
