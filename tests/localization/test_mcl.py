"""Monte Carlo localization: one step by hand, and what it must be able to do on drives."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from ambinav.geometry.environment import Environment
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.mcl_update import update_run
from ambinav.localization.odometry import OdometryModel
from ambinav.localization.parameters import LASER_MODELS, MclParameters
from ambinav.localization.random import states
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from tests.localization import worlds
from tests.localization.worlds import turned

SMALL = {f"alpha{k}": 0.02 for k in range(1, 5)}
SCANNERS = {"laser": worlds.laser(), "sonar": worlds.sonar_ring(), "mixed": worlds.mixed()}


def localizer(
    env: Environment, scanner: RangeScanner, runs: int = 1, seed: int = 1, **given: Any
) -> MonteCarloLocalizer:
    values = {**SMALL, "likelihood_resolution": 0.05, **given}
    parameters = MclParameters(**values)
    rng = np.random.default_rng(seed)
    return MonteCarloLocalizer(env, scanner, parameters, runs=runs, rng=rng)


def odometry_of(truth: np.ndarray, runs: int, seed: int, alpha: float = 0.02) -> np.ndarray:
    """What odometry reports along a true drive, for each run, (R, S, 3), from the origin on."""
    model = OdometryModel(**{f"alpha{k}": alpha for k in range(1, 5)})
    generator = states(np.random.default_rng(seed), 1)[0]
    out = np.zeros((runs, len(truth), 3))
    for k in range(1, len(truth)):
        out[:, k] = model.sampled(out[:, k - 1], truth[k - 1], truth[k], generator)
    return out


def drive(loc: MonteCarloLocalizer, env: Environment, truth: np.ndarray, seed: int) -> np.ndarray:
    """Errors of the estimate along a drive, (R, S, 3)."""
    rng = np.random.default_rng(seed)
    odometry = odometry_of(truth, loc.runs, seed)
    errors = np.empty((loc.runs, len(truth), 3))
    poses = np.repeat(truth[:, np.newaxis], loc.runs, axis=1)
    scans = loc.scanner.read(env, *np.moveaxis(poses, 2, 0), rng)
    for k, pose in enumerate(truth):
        loc.update(odometry[:, k], scans[k])
        errors[:, k] = loc.mean - pose
    errors[..., 2] = turned(errors[..., 2])
    return errors


# -- one step ----------------------------------------------------------------------------------


def test_start_has_the_mean_and_covariance_asked_for() -> None:
    loc = localizer(worlds.room(), worlds.laser(), runs=2, min_particles=20000,
                    max_particles=20000, estimate="mean")  # fmt: skip
    poses = np.array([[2.0, 3.0, 3.0], [5.0, 1.0, -1.0]])
    cov = np.array([[0.04, 0.02, 0.003], [0.02, 0.09, -0.01], [0.003, -0.01, 0.02]])
    loc.start(poses, cov)
    assert np.allclose(loc.mean, poses, atol=0.01)
    assert np.allclose(loc.covariance, cov, atol=0.003)
    loc.start(poses[0])
    assert np.allclose(np.diag(loc.covariance[1]), (0.25, 0.25, (math.pi / 12) ** 2), rtol=0.05)


@pytest.mark.filterwarnings("ignore:the localizer's laser_model_type")
def test_a_scan_weighs_by_the_field() -> None:
    env, scanner = worlds.room(), worlds.mixed()
    loc = localizer(env, scanner, min_particles=300, max_particles=300, resample_interval=2,
                    max_beams=10)  # fmt: skip
    loc.start([2.0, 3.0, 0.5], np.diag([0.04, 0.04, 0.02]))
    poses, weights = loc.particles()
    assert weights == pytest.approx(1 / 300)
    reading = scanner.read(env, 2.0, 3.0, 0.5, np.random.default_rng(2))
    reading[[0, 5]] = np.nan, -np.inf
    assert loc.update([0.0, 0.0, 0.0], reading).all()
    after, got = loc.particles()
    assert (poses == after).all()
    # Every 5th of 47 beams; without those that are out of range.
    rays, total = scanner.mounts, np.ones(300)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    field = loc.model.hits
    for b in range(0, 47, 5):
        far = scanner.sensors[scanner.sensor_of_beam[b]].max_range
        z = float(reading[b])
        if not 0.0 < z < far:
            continue
        ex, ey = rays[b, 0] + z * math.cos(rays[b, 2]), rays[b, 1] + z * math.sin(rays[b, 2])
        u = (poses[:, 0] + c * ex - s * ey - loc.model.field_x) / 0.05
        v = (poses[:, 1] + s * ex + c * ey - loc.model.field_y) / 0.05
        hit = field[np.floor(v + 0.5).astype(int), np.floor(u + 0.5).astype(int)]
        total += (0.5 * hit + 0.5 / far) ** 3
    assert np.allclose(got, total / total.sum(), rtol=1e-4)
    assert loc.state.averages[0] == pytest.approx(total.mean(), rel=1e-4)


def test_thresholds_and_the_motion_in_between() -> None:
    env, scanner = worlds.room(), worlds.laser()
    loc = localizer(env, scanner)
    reading = scanner.scan(env, 2.0, 3.0, 0.0)
    loc.start([2.0, 3.0, 0.0], np.diag([0.01, 0.01, 0.01]))
    assert loc.update([5.0, 5.0, math.pi / 2], reading).all()
    base, cov = loc.mean[0], loc.covariance[0]
    # 0.2 m straight ahead, which is along y for odometry.
    assert not loc.update([5.0, 5.2, math.pi / 2], reading).any()
    ahead = base + 0.2 * np.array([math.cos(base[2]), math.sin(base[2]), 0.0])
    assert loc.mean[0] == pytest.approx(ahead)
    model = loc.parameters.odometry
    grown = model.covariances(base, cov, [5.0, 5.0, math.pi / 2], [5.0, 5.2, math.pi / 2])
    assert np.allclose(loc.covariance, grown)
    # As in AMCL each axis counts by itself: 0.34 m aslant is not enough, 0.26 m along y is.
    assert not loc.update([5.24, 5.24, math.pi / 2], reading).any()
    assert not loc.update([5.0, 5.0, math.pi / 2 + 0.19], reading).any()
    assert loc.update([5.0, 5.26, math.pi / 2], reading).all()
    assert loc.update([5.0, 5.26, math.pi / 2 + 0.21 - 2 * math.pi], reading).all()


def test_runs_are_their_own() -> None:
    env, scanner = worlds.room(), worlds.laser()
    truth = worlds.figure_eight(40)[:8]
    several, alone = localizer(env, scanner, runs=8), localizer(env, scanner, runs=1)
    reading = scanner.read(env, *truth.T, np.random.default_rng(3))
    for loc in (several, alone):
        loc.start(truth[0])
        for pose, z in zip(truth, reading, strict=True):
            loc.update(np.tile(pose, (loc.runs, 1)), np.tile(z, (loc.runs, 1)))
    assert (several.mean[0] == alone.mean[0]).all()
    assert len(np.unique(several.mean[:, 0])) == 8
    # The kernel that others call does the same.
    kernel = localizer(env, scanner, runs=8)
    kernel.start(truth[0])
    for pose, z in zip(truth, reading, strict=True):
        for r in range(8):
            update_run(r, *pose, z, kernel.model, kernel.cast, kernel.state, None, z)
    assert (kernel.state.mean == several.mean).all()


@pytest.mark.parametrize(
    "model",
    [
        # Rays are other kernels.
        pytest.param(name, marks=pytest.mark.slow) if name.startswith("beam") else name
        for name in LASER_MODELS
    ],
)
def test_a_scan_that_says_nothing_changes_nothing(model: str) -> None:
    loc = localizer(worlds.room(), worlds.laser(), laser_model_type=model, resample_interval=2)
    loc.start([2.0, 3.0, 0.0])
    loc.update([0.0, 0.0, 0.0], np.full(60, np.nan))
    assert loc.particles()[1] == pytest.approx(1 / 2000)
    assert (loc.state.averages == 0.0).all()


# -- drives ------------------------------------------------------------------------------------


@pytest.mark.slow(
    kept=(
        "laser-likelihood_field",
        "laser-beam_prob",
        "sonar-likelihood_field_prob",
        "sonar-beam",
        "mixed-likelihood_field",
        "mixed-beam_prob",
    )
)
@pytest.mark.filterwarnings("ignore:the localizer's laser_model_type")
@pytest.mark.parametrize("model", LASER_MODELS)
@pytest.mark.parametrize("name", SCANNERS)
def test_tracks_with_every_model_and_scanner(model: str, name: str) -> None:
    env, scanner = worlds.room(), SCANNERS[name]
    loc = localizer(env, scanner, runs=4, laser_model_type=model)
    truth = worlds.figure_eight(45)
    loc.start(truth[0], np.diag([0.04, 0.04, 0.01]))
    errors = np.abs(drive(loc, env, truth, seed=4)[:, 10:])
    limit = 0.1 if name == "laser" else 0.3
    assert np.median(np.hypot(errors[..., 0], errors[..., 1])) < limit
    assert np.median(errors[..., 2]) < (0.05 if name == "laser" else 0.15)
    assert (loc.counts >= 500).all() and (loc.counts <= 2000).all()


def test_errors_respect_the_bound_and_the_covariance_covers_them() -> None:
    env, scanner = worlds.room(), worlds.laser()
    truth, start = worlds.figure_eight(60), np.diag([0.05**2, 0.05**2, 0.03**2])
    loc = localizer(env, scanner, runs=6, laser_model_type="likelihood_field_prob", sigma_hit=0.1,
                    update_min_d=0.0, likelihood_resolution=0.025)  # fmt: skip
    loc.start(truth[0], start)
    rng, odometry = np.random.default_rng(9), odometry_of(truth, 6, 9)
    errors, covariances = np.empty((60, 6, 3)), np.empty((60, 6, 3, 3))
    for k, pose in enumerate(truth):
        loc.update(odometry[:, k], scanner.read(env, *np.tile(pose, (6, 1)).T, rng))
        errors[k], covariances[k] = loc.mean - pose, loc.covariance
    errors[..., 2] = turned(errors[..., 2])
    nees = np.einsum("kri,krij,krj->kr", errors, np.linalg.inv(covariances), errors)
    # The field trusts the beams less than it could: errors are rather smaller than it says.
    assert 0.2 < nees.mean() < 4.0
    ekf = ExtendedKalmanFilter(env, scanner, loc.parameters.odometry, map_std=0.0)
    bound = ekf.predicted_covariances(truth, start)
    least = np.sqrt(bound[10:, (0, 1, 2), (0, 1, 2)].mean(axis=0))
    rms = np.sqrt((errors[10:] ** 2).mean(axis=(0, 1)))
    assert (rms > 0.9 * least).all() and rms[:2].max() < 0.08


@pytest.mark.slow
@pytest.mark.parametrize("resampling", ["systematic", "low_variance", "multinomial"])
def test_global_start_finds_the_robot(resampling: str) -> None:
    env, scanner = worlds.room(), worlds.laser()
    loc = localizer(env, scanner, runs=6, max_particles=10000, resampling=resampling)
    loc.start_globally()
    assert (loc.counts == 10000).all()
    errors = drive(loc, env, worlds.figure_eight(60), seed=5)[:, -1]
    assert (np.hypot(errors[:, 0], errors[:, 1]) < 0.3).sum() >= 5
    assert (loc.counts < 3000).all()


@pytest.mark.slow
def test_kidnapped_robot_is_recovered_only_with_recovery() -> None:
    env, scanner = worlds.room(), worlds.laser()
    truth = worlds.figure_eight(60)
    found = {}
    for on in (False, True):
        rates = {"recovery_alpha_slow": 0.001, "recovery_alpha_fast": 0.1} if on else {}
        loc = localizer(env, scanner, runs=6, max_particles=3000, **rates)
        # Sure of being somewhere else: in the right arm, looking back.
        loc.start([7.5, 2.0, truth[0, 2] + 2.5], np.diag([0.01, 0.01, 0.01]))
        rng, odometry = np.random.default_rng(6), odometry_of(np.tile(truth, (3, 1)), 6, 6)
        # First a while with scans that agree with where it believes it is.
        for k in range(3):
            mean = loc.mean
            inside = np.asarray(env.is_free(mean[:, 0], mean[:, 1]))
            mean[~inside] = 7.5, 2.0, 0.0
            loc.update(odometry[:, k], scanner.read(env, *mean.T, rng))
        poses = np.repeat(truth[np.arange(180) % 60, np.newaxis], 6, axis=1)
        scans = scanner.read(env, *np.moveaxis(poses, 2, 0), rng)
        for k in range(3, 180):
            loc.update(odometry[:, k], scans[k])
        found[on] = int((np.hypot(*(loc.mean - truth[-1])[:, :2].T) < 0.3).sum())
    assert found[True] >= 5
    assert found[False] <= 2


# -- bad input ---------------------------------------------------------------------------------


def test_bad_input_is_refused() -> None:
    env, scanner = worlds.room(), worlds.laser()
    loc = localizer(env, scanner, runs=2)
    zeros, ranges = np.zeros((2, 3)), np.ones((2, 60))
    with pytest.raises(InputError, match="call start"):
        loc.update(zeros, ranges)
    with pytest.raises(InputError, match="eigenvalue -1"):
        loc.start([1.0, 1.0, 0.0], -np.eye(3))
    with pytest.raises(InputError, match="poses"):
        loc.start(np.zeros((3, 3)))
    loc.start([1.0, 1.0, 0.0])
    with pytest.raises(InputError, match="60 beams"):
        loc.update(zeros, np.ones((2, 59)))
    with pytest.raises(InputError, match="odometry"):
        loc.update(np.full((2, 3), np.nan), ranges)
    with pytest.raises(InputError, match="runs"):
        localizer(env, scanner, runs=0)
    with pytest.raises(InputError, match="laser_max_range"):
        localizer(env, scanner, laser_min_range=5.0, laser_max_range=4.0)
