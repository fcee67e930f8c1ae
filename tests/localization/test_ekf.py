"""The filter on scans: its information against finite differences, its consistency on drives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from ambinav.ambiguity import reference
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.ekf_update import posterior
from ambinav.localization.information import beam_noise, scan_information
from ambinav.localization.odometry import OdometryModel
from ambinav.localization.random import states
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from tests.localization import worlds
from tests.localization.worlds import turned

SCANNERS = {"laser": worlds.laser(), "sonar": worlds.sonar_ring(), "mixed": worlds.mixed()}
MODEL = OdometryModel(alpha1=0.01, alpha2=0.002, alpha3=0.004, alpha4=0.002)


def information_slowly(scanner: RangeScanner, pose: np.ndarray, map_std: float) -> np.ndarray:
    """Sum of g g^T / variance with the ambiguity model's reference beams."""
    env = worlds.room()
    model = AmbiguityModel(radius=0.5, map_std=map_std, tau=1.0)
    ranges, gradients, variances, _ = reference.beams(env, scanner, model, *pose)
    limit = np.array([scanner.sensors[k].max_range for k in scanner.sensor_of_beam])
    seen = (ranges <= limit) & (variances < 1e10)
    g = gradients[seen] / np.sqrt(variances[seen])[:, np.newaxis]
    return np.asarray(g.T @ g)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCANNERS)
def test_information_is_the_sum_over_the_beams(name: str) -> None:
    poses = worlds.free_poses(worlds.room(), 25, seed=1)
    got = scan_information(worlds.room(), SCANNERS[name], poses, map_std=0.01)
    for pose, information in zip(poses, got, strict=True):
        expected = information_slowly(SCANNERS[name], pose, 0.01)
        assert np.allclose(information, expected, rtol=1e-3, atol=1e-3 * expected.max())


def test_information_of_ranges_by_finite_differences() -> None:
    env, scanner = worlds.room(), worlds.laser(beams=24)
    pose, step = np.array([2.3, 3.1, 0.4]), 1e-3
    gradient = np.empty((24, 3))
    for k in range(3):
        off = step * np.eye(3)[k]
        ahead, back = (scanner.scan(env, *p).astype(float) for p in (pose + off, pose - off))
        gradient[:, k] = (ahead - back) / (2 * step)
    variance = 0.03**2 + 0.001**2 / 12 + 0.02**2
    expected = gradient.T @ gradient / variance
    got = scan_information(env, scanner, pose)[0]
    assert np.allclose(got, expected, rtol=0.01, atol=0.01 * expected.max())


def test_what_tells_nothing() -> None:
    # Between two long walls nothing tells of x; before frontiers and out of range, of nothing.
    corridor, scanner = worlds.box(40.0, 2.0), worlds.laser(reach=4.0)
    information = scan_information(corridor, scanner, [20.0, 1.0, 0.0])[0]
    assert (
        abs(information[0, 0]) < 1e-9 and information[1, 1] > 1000.0 and information[2, 2] > 100.0
    )
    unknown = worlds.box(4.0, 4.0, frontiers=(0, 1, 2, 3))
    assert (scan_information(unknown, scanner, [1.0, 1.0, 0.0]) == 0.0).all()
    hall = worlds.box(20.0, 20.0)
    assert (scan_information(hall, scanner, [10.0, 10.0, 0.0]) == 0.0).all()


def run_filter(
    count: int, steps: int, seed: int, scanner: RangeScanner = SCANNERS["laser"]
) -> tuple[np.ndarray, np.ndarray]:
    """Errors (R, S, 3) and covariances (R, S, 3, 3) of the filter on drives with its noise."""
    env = worlds.room()
    rng = np.random.default_rng(seed)
    generator = states(rng, 1)[0]
    wanted = worlds.figure_eight(steps)
    start = np.diag([0.05**2, 0.05**2, 0.03**2])
    ekf = ExtendedKalmanFilter(env, scanner, MODEL, runs=count, map_std=0.0, gate=5.0)
    truth = rng.multivariate_normal(wanted[0], start, count)
    ekf.start(wanted[0], start)
    odometry = np.tile(wanted[0], (count, 1))
    errors, covariances = np.empty((count, steps, 3)), np.empty((count, steps, 3, 3))
    for k in range(steps):
        if k > 0:
            # The robot tries to follow the loop from where it is: odometry is that wish.
            c, s = np.cos(truth[:, 2]), np.sin(truth[:, 2])
            dx, dy = (wanted[k, :2] - truth[:, :2]).T
            ahead = np.column_stack((c * dx + s * dy, -s * dx + c * dy))
            turn = turned(wanted[k, 2] - truth[:, 2])
            co, so = np.cos(odometry[:, 2]), np.sin(odometry[:, 2])
            after = odometry + np.column_stack(
                (co * ahead[:, 0] - so * ahead[:, 1], so * ahead[:, 0] + co * ahead[:, 1], turn)
            )
            truth = MODEL.sampled(truth, odometry, after, generator)
            odometry = after
        ekf.update(odometry, scanner.read(env, *truth.T, rng))
        errors[:, k] = ekf.mean - truth
        covariances[:, k] = ekf.covariance
    errors[..., 2] = turned(errors[..., 2])
    return errors, covariances


@pytest.mark.slow
def test_errors_are_as_large_as_the_filter_says() -> None:
    runs, steps = 100, 40
    errors, covariances = run_filter(runs, steps, seed=3)
    nees = np.einsum("rsi,rsij,rsj->rs", errors, np.linalg.inv(covariances), errors)
    # Averaged over runs, runs * NEES is chi-squared with 3 runs degrees of freedom at each step.
    low, high = stats.chi2.ppf((0.0005, 0.9995), 3 * runs) / runs
    inside = (nees.mean(axis=0) > low) & (nees.mean(axis=0) < high)
    assert inside.mean() > 0.9
    assert np.median(nees.mean(axis=0)) == pytest.approx(3.0, abs=0.25)
    # Single errors too: a beam that slips past a corner may spoil one in a thousand.
    assert (nees < stats.chi2.ppf(0.99, 3)).mean() > 0.98


def test_cramer_rao_bound_is_respected_and_nearly_reached() -> None:
    # Without prior knowledge to speak of, one scan: no better than the bound, and not far off.
    env, scanner, count = worlds.room(), worlds.laser(), 400
    pose = np.array([2.3, 3.1, 0.4])
    bound = np.linalg.inv(scan_information(env, scanner, pose, map_std=0.0)[0])
    rng = np.random.default_rng(4)
    ekf = ExtendedKalmanFilter(env, scanner, runs=count, map_std=0.0, gate=20.0)
    ekf.start(rng.multivariate_normal(pose, np.diag([1e-4, 1e-4, 1e-5]), count), 10.0 * np.eye(3))
    ekf.update(np.zeros((count, 3)), scanner.read(env, *np.tile(pose, (count, 1)).T, rng))
    error = ekf.mean - pose
    ratio = np.linalg.eigvals(np.linalg.solve(bound, error.T @ error / count)).real
    assert ratio.min() > 0.85 and ratio.max() < 1.3


def test_predicted_covariances_are_those_of_the_drive() -> None:
    env, scanner = worlds.room(), worlds.laser()
    route = worlds.figure_eight(20)
    start = np.diag([0.1**2, 0.1**2, 0.05**2])
    ekf = ExtendedKalmanFilter(env, scanner, MODEL)
    seen = np.arange(20) % 4 == 0
    predicted = ekf.predicted_covariances(route, start, seen)
    # The same drive with scans as expected keeps the estimate on the route.
    ekf.start(route[0], start)
    for k, pose in enumerate(route):
        scan = scanner.scan(env, *pose) if seen[k] else np.full(60, np.nan)
        ekf.update(pose, scan)
        assert np.allclose(ekf.covariance[0], predicted[k], rtol=1e-3, atol=1e-9)
        assert np.allclose(ekf.mean[0], pose, atol=1e-4)


def test_outliers_are_left_out() -> None:
    env, scanner = worlds.room(), worlds.laser()
    ekf = ExtendedKalmanFilter(env, scanner)
    ekf.start([2.0, 3.0, 0.0], np.diag([0.01, 0.01, 0.01]))
    reading = scanner.scan(env, 2.0, 3.0, 0.0)
    reading[10:30] = 0.4
    assert ekf.update([0.0, 0.0, 0.0], reading) == 40
    assert np.allclose(ekf.mean[0], (2.0, 3.0, 0.0), atol=1e-4)


def test_certain_filters_stay_certain() -> None:
    env, scanner = worlds.room(), worlds.laser()
    ekf = ExtendedKalmanFilter(env, scanner, OdometryModel(alpha1=0, alpha2=0, alpha3=0, alpha4=0))
    ekf.start([2.0, 3.0, 0.0], np.zeros((3, 3)))
    ekf.update([0.0, 0.0, 0.0], scanner.scan(env, 2.0, 3.0, 0.0))
    assert (ekf.covariance == 0.0).all()


def test_posterior_adds_information() -> None:
    rng = np.random.default_rng(5)
    for _ in range(200):
        sizes = 10.0 ** rng.uniform(-2.0, 1.0, (2, 3))
        A, B = rng.normal(size=(2, 3, 3)) * sizes[:, None, :]
        prior, information = A @ A.T, B @ B.T
        got = prior.copy()
        posterior(got, information)
        wanted = np.linalg.inv(np.linalg.inv(prior) + information)
        assert np.allclose(got, wanted, rtol=1e-6, atol=1e-9 * np.abs(wanted).max())
        assert (got == got.T).all() and np.linalg.eigvalsh(got)[0] > -1e-12 * np.abs(got).max()


@pytest.mark.parametrize("known", [(0,), (1,), (2,), (0, 1), (0, 2), (0, 1, 2)])
def test_posterior_leaves_alone_what_is_known_exactly(known: tuple[int, ...]) -> None:
    rng = np.random.default_rng(6)
    A, B = rng.normal(size=(2, 3, 3))
    A[list(known)] = 0.0
    got, information = A @ A.T, B @ B.T
    wanted = got @ np.linalg.inv(np.eye(3) + information @ got)
    posterior(got, information)
    assert np.allclose(got, wanted, rtol=1e-9, atol=1e-12)
    assert (got[list(known)] == 0.0).all()


def test_bad_input_is_refused() -> None:
    env, scanner = worlds.room(), worlds.laser()
    ekf = ExtendedKalmanFilter(env, scanner)
    with pytest.raises(InputError, match="call start"):
        ekf.update([0.0, 0.0, 0.0], np.ones(60))
    with pytest.raises(InputError, match="poses"):
        ekf.start([0.0, math.nan, 0.0], np.eye(3))
    with pytest.raises(InputError, match=r"covariance has the eigenvalue -0\.01"):
        ekf.start([1.0, 1.0, 0.0], -0.01 * np.eye(3))
    ekf.start([1.0, 1.0, 0.0], np.eye(3))
    with pytest.raises(InputError, match="covariance has the eigenvalue -1"):
        ekf.predicted_covariances(np.zeros((4, 3)), -np.eye(3))
    with pytest.raises(InputError, match="shapes"):
        ekf.update([0.0, 0.0, 0.0], np.ones(59))
    with pytest.raises(InputError, match="map_std"):
        scan_information(env, scanner, [1.0, 1.0, 0.0], map_std=-0.1)
    with pytest.raises(InputError, match="gate"):
        ExtendedKalmanFilter(env, scanner, gate=0.0)
    with pytest.raises(InputError, match="seen"):
        ekf.predicted_covariances(np.zeros((4, 3)), np.eye(3), [True])
    assert beam_noise(env, scanner, 0.02).variance.min() > 0.02**2
