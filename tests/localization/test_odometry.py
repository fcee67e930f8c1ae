"""The odometry model against its formulas, and its linear form against what is drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambinav.localization.odometry import (
    OdometryModel,
    apply_motion,
    apply_motions,
    deviations,
    motion_between,
    wrapped,
)
from ambinav.localization.random import states
from ambinav.runtime.errors import InputError
from tests.localization.worlds import turned

EXACT = OdometryModel(alpha1=0.0, alpha2=0.0, alpha3=0.0, alpha4=0.0, alpha5=0.0)
angles = st.floats(-10.0, 10.0)
metres = st.floats(-5.0, 5.0)


def relative(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Pose b in the frame of pose a."""
    c, s = math.cos(a[2]), math.sin(a[2])
    dx, dy = b[:2] - a[:2]
    return np.array([c * dx + s * dy, -s * dx + c * dy, b[2] - a[2]])


@pytest.mark.slow
@settings(deadline=None)  # the first call compiles
@given(metres, metres, angles, metres, metres, angles)
def test_without_errors_the_motion_is_odometrys(
    x0: float, y0: float, t0: float, x1: float, y1: float, t1: float
) -> None:
    before, after, pose = np.array([x0, y0, t0]), np.array([x1, y1, t1]), np.array([1.0, 2.0, 0.7])
    there = EXACT.moved(pose, before, after)[0]
    off = relative(before, after) - relative(pose, there)
    # Below a centimetre the direction of the motion is not looked at.
    limit = 0.02 if math.hypot(x1 - x0, y1 - y0) < 0.01 else 1e-9
    assert np.abs(off[:2]).max() <= limit
    assert abs(float(turned(off[2]))) < 1e-9
    sampled = EXACT.sampled(pose, before, after, states(np.random.default_rng(1), 1)[0])[0]
    assert np.allclose(sampled, there, atol=1e-12)


@settings(deadline=None)
@given(angles)
def test_wrapped(angle: float) -> None:
    assert -math.pi <= wrapped(angle) < math.pi
    assert math.isclose(math.cos(wrapped(angle)), math.cos(angle), abs_tol=1e-9)


def test_parts_of_a_motion() -> None:
    # Straight ahead, turning on the spot (no direction), backward (half a turn and back).
    assert motion_between(0.0, 0.0, 0.5, math.cos(0.5), math.sin(0.5), 0.9) == pytest.approx(
        (0.0, 1.0, 0.4)
    )
    assert motion_between(0.0, 0.0, 0.5, 0.0, 0.005, -0.5) == pytest.approx((0.0, 0.005, -1.0))
    # Back by so little that it has no direction.
    assert motion_between(0.0, 0.0, 0.0, -0.005, 0.0, 0.1) == pytest.approx((0.0, -0.005, 0.1))
    rot1, trans, rot2 = motion_between(0.0, 0.0, 0.0, -1.0, 0.0, 0.0)
    assert (abs(rot1), trans, abs(rot2)) == pytest.approx((math.pi, 1.0, math.pi))


@pytest.mark.parametrize("step", [0.004, 0.02])
def test_small_steps_back_and_forth_end_where_they_began(step: float) -> None:
    """However finely odometry is read: errors of a robot that stands have both signs."""
    model, pose, odometry = OdometryModel(), np.array([1.0, 2.0, 0.7]), np.zeros(3)
    for k in range(40):
        ahead = step if k % 2 else -step
        change = ahead * math.cos(odometry[2]), ahead * math.sin(odometry[2]), 0.01
        moved = odometry + np.array(change)
        pose, odometry = model.moved(pose, odometry, moved)[0], moved
    c, s = math.cos(0.7), math.sin(0.7)
    assert pose[:2] == pytest.approx(
        [1.0 + c * odometry[0] - s * odometry[1], 2.0 + s * odometry[0] + c * odometry[1]],
        abs=40 * step * 0.01,
    )
    assert pose[2] == pytest.approx(0.7 + 0.4)


def test_driving_backward_is_as_exact_as_forward() -> None:
    alpha = OdometryModel(alpha1=0.1, alpha2=0.2, alpha3=0.3, alpha4=0.4).array
    forward = deviations(0.0, 1.0, 0.1, alpha)
    backward = deviations(math.pi, 1.0, 0.1 - math.pi, alpha)
    assert backward == pytest.approx(forward)
    assert forward == pytest.approx(
        (math.sqrt(0.2), math.sqrt(0.3 + 0.4 * 0.01), math.sqrt(0.1 * 0.01 + 0.2))
    )


def test_covariance_is_that_of_the_samples() -> None:
    model = OdometryModel(alpha1=0.004, alpha2=0.003, alpha3=0.002, alpha4=0.005)
    pose, before, after = np.array([1.0, 2.0, 0.3]), np.zeros(3), np.array([0.5, 0.2, 0.8])
    first = np.array([[0.01, 0.002, 0.001], [0.002, 0.02, -0.003], [0.001, -0.003, 0.004]])
    rng = np.random.default_rng(5)
    cloud = rng.multivariate_normal(pose, first, 200_000)
    moved = model.sampled(cloud, before, after, states(rng, 1)[0])
    off = moved - model.moved(pose, before, after)
    off[:, 2] = turned(off[:, 2])
    expected = model.covariances(pose, first, before, after)[0]
    got = off.T @ off / len(off)
    assert np.abs(got - expected).max() < 0.03 * expected.max()
    assert np.allclose(expected, expected.T)


def test_many_motions_are_each_as_one() -> None:
    rng = np.random.default_rng(8)
    poses, errors = rng.uniform(-3.0, 3.0, (100, 5)), rng.normal(0.0, 0.5, (3, 100))
    expected = poses.copy()
    for pose, (turn1, straight, turn2) in zip(expected, errors.T, strict=True):
        pose[:3] = apply_motion.py_func(*pose[:3], 0.4 + turn1, 0.6 + straight, turn2 - 0.2)
    apply_motions(poses, 0.4, 0.6, -0.2, *errors)
    np.testing.assert_allclose(poses, expected, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("value", [-0.1, math.nan, "much"])
def test_bad_shares_are_refused(value: object) -> None:
    with pytest.raises(InputError, match="alpha3"):
        OdometryModel(alpha3=value)
