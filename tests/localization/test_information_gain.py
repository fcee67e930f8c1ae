"""Information gain against its definition: joint Gaussians, and samples of scans."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambinav.localization.information import scan_information
from ambinav.localization.information_gain import information_gain
from ambinav.localization.odometry import OdometryModel
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from tests.localization import worlds

PRIOR = np.array([[0.04, 0.01, 0.0], [0.01, 0.03, 0.002], [0.0, 0.002, 0.01]])
ODOMETRY = OdometryModel(**{f"alpha{k}": 0.01 for k in range(1, 5)})
LASER = worlds.laser(beams=12, reach=5.0)


def log_det(matrix: np.ndarray) -> float:
    sign, value = np.linalg.slogdet(matrix)
    assert sign > 0
    return float(value)


def motion(pose: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Derivative of a motion by the pose before it, and the covariance that it adds."""
    h, g = 1e-6, np.empty((3, 3))
    for axis in range(3):
        moved = [ODOMETRY.moved(pose + s * h * np.eye(3)[axis], pose, after)[0] for s in (1, -1)]
        difference = moved[0] - moved[1]
        difference[2] = worlds.turned(difference[2])
        g[:, axis] = difference / (2 * h)
    return g, ODOMETRY.covariances(pose, np.zeros((3, 3)), pose, after)[0]


def test_the_total_is_the_mutual_information_of_all_poses_and_all_scans() -> None:
    env, poses = worlds.room(), worlds.figure_eight(40)[:7]
    got = information_gain(env, LASER, poses, PRIOR, ODOMETRY, unit="nats")
    # Information of the whole trajectory, 21 numbers, without scans: prior and motions.
    joint = np.zeros((21, 21))
    joint[:3, :3] = np.linalg.inv(PRIOR)
    for k in range(6):
        g, added = motion(poses[k], poses[k + 1])
        residual = np.hstack([-g, np.eye(3)])
        part = slice(3 * k, 3 * k + 6)
        joint[part, part] += residual.T @ np.linalg.inv(added) @ residual
    information = scan_information(env, LASER, poses)
    seen = joint.copy()
    for k in range(7):
        seen[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += information[k]
    assert got.total == pytest.approx((log_det(seen) - log_det(joint)) / 2.0, rel=1e-6)
    # Each scan: what it takes away of the entropy of the pose, given all before it.
    before = joint.copy()
    for k in range(7):
        part = slice(3 * k, 3 * k + 3)
        after = before.copy()
        after[part, part] += information[k]
        gain = (log_det(np.linalg.inv(before)[part, part])
                - log_det(np.linalg.inv(after)[part, part])) / 2.0  # fmt: skip
        assert got.gain[k] == pytest.approx(gain, rel=1e-5)
        np.testing.assert_allclose(
            got.covariance[k], np.linalg.inv(after)[part, part], rtol=1e-4, atol=1e-9
        )
        before = after
    last = slice(18, 21)
    lone, known = np.linalg.inv(joint)[last, last], np.linalg.inv(seen)[last, last]
    np.testing.assert_allclose(got.without[-1], lone, rtol=1e-4, atol=1e-9)
    assert got.at_goal == pytest.approx((log_det(lone) - log_det(known)) / 2.0, rel=1e-5)


@pytest.mark.slow
def test_one_scan_by_sampling() -> None:
    # I = E[ln p(z | x) - ln p(z)], over poses drawn from the prior and readings made there.
    env, rng = worlds.box(6.0, 4.0), np.random.default_rng(1)
    sensor = RangeSensor(max_range=8.0, std=0.05, resolution=0.001, random_share=0.0)
    scanner = RangeScanner.planar(sensor, 5, math.radians(200.0))
    pose, prior = np.array([2.0, 1.5, 0.2]), np.diag([0.05**2, 0.08**2, 0.03**2])
    poses = rng.multivariate_normal(pose, prior, 3000)
    mounts = scanner.mounts[:, 2]
    x, y, theta = (v[:, np.newaxis] for v in poses.T)
    means = np.asarray(env.cast(x, y, theta + mounts, 100.0)) / 0.05
    readings = means[:1500] + rng.normal(0.0, 1.0, (1500, 5))
    terms = np.empty(1500)
    for i, z in enumerate(readings):
        logs = -0.5 * ((z - means) ** 2).sum(axis=1)
        # Without its own pose, which would be one of few that fit.
        rest = np.delete(logs, i)
        terms[i] = logs[i] - (np.logaddexp.reduce(rest) - math.log(len(rest)))
    error = terms.std() / math.sqrt(1500)
    got = information_gain(env, scanner, pose, prior, map_std=0.0, unit="nats")
    assert got.total == pytest.approx(terms.mean(), abs=4 * error + 0.03)
    assert got.total > 1.5 and error < 0.05


def test_closed_forms() -> None:
    # One beam square to a wall: only y is gained, 1/2 ln(1 + prior / variance).
    sensor = RangeSensor(max_range=5.0, std=0.03, resolution=0.001, random_share=0.0)
    scanner = RangeScanner.planar(sensor, 1, 0.0)
    pose, prior = [20.0, 2.0, -math.pi / 2], np.diag([0.5, 0.04, 0.01])
    got = information_gain(worlds.box(40.0, 40.0), scanner, pose, prior, map_std=0.0, unit="nats")
    expected = 0.5 * math.log(1.0 + 0.04 / (0.03**2 + 0.001**2 / 12))
    assert got.total == pytest.approx(expected, rel=1e-6)
    assert got.at_goal == pytest.approx(expected, rel=1e-6)
    bits = information_gain(worlds.box(40.0, 40.0), scanner, pose, prior, map_std=0.0)
    assert bits.total == pytest.approx(expected / math.log(2.0), rel=1e-6)
    # Nothing in range, or no scan made: nothing.
    far = information_gain(worlds.box(40.0, 40.0), scanner, [20.0, 20.0, 0.0], prior)
    blind = information_gain(worlds.room(), LASER, worlds.figure_eight(9), PRIOR, seen=[False] * 9)
    for none in (far, blind):
        assert none.total == 0.0 and none.at_goal == 0.0
    np.testing.assert_array_equal(blind.covariance, blind.without)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 8))
def test_more_scans_tell_more(seed: int, number: int) -> None:
    rng = np.random.default_rng(seed)
    poses = worlds.figure_eight(40)[:number]
    some = rng.random(number) < 0.5
    fewer = information_gain(worlds.room(), LASER, poses, PRIOR, ODOMETRY, seen=some)
    all_of = information_gain(worlds.room(), LASER, poses, PRIOR, ODOMETRY)
    assert (fewer.gain[~some] == 0.0).all() and (all_of.gain >= 0.0).all()
    assert all_of.total >= fewer.total - 1e-9 and all_of.at_goal >= fewer.at_goal - 1e-9
    # What is known beforehand is no gain.
    known = information_gain(worlds.room(), LASER, poses, 0.25 * PRIOR, ODOMETRY)
    assert known.total <= all_of.total + 1e-9


def test_bad_input_is_refused() -> None:
    env, poses = worlds.room(), worlds.figure_eight(5)
    with pytest.raises(InputError, match="unit is 'bit'; did you mean bits"):
        information_gain(env, LASER, poses, PRIOR, unit="bit")
    with pytest.raises(InputError, match="poses is empty"):
        information_gain(env, LASER, np.empty((0, 3)), PRIOR)
    with pytest.raises(InputError, match="prior has the eigenvalue 0"):
        information_gain(env, LASER, poses, np.diag([1.0, 0.0, 1.0]))
    with pytest.raises(InputError, match="no scanner is given"):
        information_gain(env, None, poses, PRIOR)
    with pytest.raises(InputError, match="seen has the shape"):
        information_gain(env, LASER, poses, PRIOR, seen=[True])
