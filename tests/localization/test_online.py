"""Online localizability: against NumPy, closed forms and limits; and what it does to a filter."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambinav.geometry.environment import Environment
from ambinav.localization.information import scan_information
from ambinav.localization.localizability_filter import localizability_filtered
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.online import OnlineLocalizability, online_localizability
from ambinav.localization.parameters import MclParameters
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from tests.localization import crowds, worlds
from tests.localization.test_mcl import odometry_of

SURE = MclParameters(z_short=0.0, z_rand=0.0)
CORRIDOR = worlds.box(60.0, 2.5)
MIDDLE = np.array([[30.0, 1.0, 0.3]])
# Deviation of a laser's reading, its bins and a wall of a drawn building.
VARIANCE = 0.03**2 + 0.001**2 / 12.0


def online(env: Environment, scanner: RangeScanner, poses: object, ranges: object,
           **given: object) -> OnlineLocalizability:  # fmt: skip
    return online_localizability(env, scanner, poses, ranges, **{"map_std": 0.0, **given})  # type: ignore[arg-type]


def seen(env: Environment, scanner: RangeScanner, poses: np.ndarray) -> np.ndarray:
    return np.asarray(scanner.scan(env, *poses.T), dtype=np.float64)


# -- definition --------------------------------------------------------------------------------


@pytest.mark.parametrize("unsure", [False, True])
def test_against_numpy(unsure: bool) -> None:
    env, scanner = worlds.room(), worlds.laser(beams=24, reach=5.0)
    poses = np.array([[2.0, 3.0, 0.5], [7.1, 1.7, -2.0]])
    yaw = scanner.mounts[:, 2]

    def cast(x: float, y: float, theta: float) -> np.ndarray:
        return np.asarray(env.cast(x, y, theta + yaw, 100.0))

    ends = np.array([cast(*pose) for pose in poses])
    truth = np.where(ends > 5.0, math.inf, ends)
    readings = ends + np.random.default_rng(1).normal(0.0, 0.05, ends.shape)
    readings[truth == math.inf] = math.inf
    readings[0, ::5] *= 0.6
    readings[1, 3] = math.nan
    readings[1, 4] = -math.inf
    readings[:, 7] = math.inf
    spread = np.array([[0.01, 0.002, 0.0], [0.002, 0.02, 0.001], [0.0, 0.001, 0.003]])
    got = online(env, scanner, poses, readings, uncertainty=spread if unsure else None)
    h = 1e-6
    for p, pose in enumerate(poses):
        g = np.empty((24, 3))
        for axis in range(3):
            step = h * np.eye(3)[axis]
            g[:, axis] = (cast(*(pose + step)) - cast(*(pose - step))) / (2 * h)
        information, weights = np.zeros((3, 3)), np.full(24, math.nan)
        for b in range(24):
            z, mean = readings[p, b], truth[p, b]
            if not math.isfinite(mean) or math.isnan(z) or z == -math.inf:
                continue
            weights[b] = 0.0
            if z >= 5.0:
                continue
            v = VARIANCE + (g[b] @ spread @ g[b] if unsure else 0.0)
            hit = 0.5 * math.exp(-((z - mean) ** 2) / (2 * v)) / math.sqrt(2 * math.pi * v)
            short = 0.05 * 0.1 * math.exp(-0.1 * z) / (1 - math.exp(-0.1 * mean))
            weights[b] = hit / (hit + short * (z < mean) + 0.5 / 5.0)
            information += weights[b] * np.outer(g[b], g[b]) / VARIANCE
        np.testing.assert_allclose(got.weights[p], weights, rtol=1e-4, atol=1e-9)
        np.testing.assert_allclose(got.information[p], information, rtol=1e-4, atol=1e-2)
        prior = np.diag([0.25, 0.25, (math.pi / 12) ** 2])
        left = np.linalg.inv(np.linalg.inv(prior) + information)
        np.testing.assert_allclose(got.covariance[p], left, rtol=1e-3, atol=1e-8)
        assert got.explained[p] == pytest.approx(np.nanmean(weights), rel=1e-4)


@pytest.mark.parametrize("scanner", [worlds.laser(), worlds.sonar_ring(), worlds.mixed()])
def test_without_obstacles_it_is_the_fisher_information(scanner: RangeScanner) -> None:
    env = worlds.room()
    poses = worlds.free_poses(env, 40, 3, clearance=0.6)
    plain = scan_information(env, scanner, poses, 0.0)
    readings = seen(env, scanner, poses)
    got = online(env, scanner, poses, readings, parameters=SURE)
    np.testing.assert_allclose(got.information, plain, rtol=1e-9, atol=1e-9 * plain.max())
    assert set(np.unique(got.weights[~np.isnan(got.weights)])) == {1.0}
    # AMCL's shares leave nearly all of it.
    usual = online(env, scanner, poses, readings).information
    assert (np.trace(usual, axis1=1, axis2=2) > 0.95 * np.trace(plain, axis1=1, axis2=2)).all()


def test_with_all_beams_blocked_nothing_is_left() -> None:
    env, scanner = worlds.room(), worlds.laser()
    poses = worlds.free_poses(env, 10, 4, clearance=0.8)
    prior = np.diag([0.04, 0.09, 0.01])
    blocked = online(env, scanner, poses, np.full((10, 60), 0.3), prior=prior)
    np.testing.assert_allclose(blocked.covariance, np.tile(prior, (10, 1, 1)), atol=1e-12)
    assert (blocked.explained < 1e-9).all()
    for missing in (math.inf, -math.inf, math.nan):
        none = online(env, scanner, poses, np.full((10, 60), missing), prior=prior)
        assert (none.information == 0.0).all() and (none.index == 0.0).all()
    assert np.isnan(none.explained).all()


# -- closed forms ------------------------------------------------------------------------------


def test_a_corridor_tells_nothing_along_itself() -> None:
    scanner = worlds.laser(reach=8.0)
    got = online(CORRIDOR, scanner, MIDDLE, seen(CORRIDOR, scanner, MIDDLE))
    assert np.abs(got.information[0, 0]).max() < 1e-6
    assert got.covariance[0, 0, 0] == pytest.approx(0.25)
    assert got.covariance[0, 1, 1] < 0.01**2
    major, minor, direction = got.radii
    assert major[0] == pytest.approx(0.5) and minor[0] < 0.01
    assert math.sin(direction[0]) == pytest.approx(0.0, abs=1e-6)


def test_one_beam_at_one_wall() -> None:
    env = worlds.box(40.0, 40.0)
    sensor = RangeSensor(max_range=5.0, std=0.03, resolution=0.001, random_share=0.0)
    scanner = RangeScanner.planar(sensor, 1, 0.0)
    off = 0.4  # from the wall's normal
    pose = np.array([[20.0, 2.0, -math.pi / 2 + off]])
    got = online(env, scanner, pose, [[2.0 / math.cos(off)]], parameters=SURE)
    # The range is y / cos(off), and off grows with theta.
    g = np.array([0.0, 1.0 / math.cos(off), 2.0 * math.sin(off) / math.cos(off) ** 2])
    np.testing.assert_allclose(got.information[0], np.outer(g, g) / VARIANCE, atol=1e-6)


def test_a_crowd_before_the_end_of_a_corridor_takes_the_end_away() -> None:
    scanner, pose = worlds.laser(reach=8.0), np.array([[55.0, 1.25, 0.0]])
    clear = seen(CORRIDOR, scanner, pose)
    crowd = clear.copy()
    ahead = np.abs(scanner.mounts[:, 2]) < math.atan2(1.25, 5.0) + 0.05
    crowd[:, ahead] = 1.5
    free, full = online(CORRIDOR, scanner, pose, clear), online(CORRIDOR, scanner, pose, crowd)
    assert free.radii[0][0] < 0.02
    assert full.radii[0][0] == pytest.approx(0.5, rel=1e-6)
    assert full.covariance[0, 1, 1] < 0.02**2
    # One who is not sure of the pose by a metre cannot tell people half a metre off from the wall.
    crowd[:, ahead] = clear[:, ahead] - 0.5
    unsure = online(CORRIDOR, scanner, pose, crowd, uncertainty=np.diag([1.0, 0.0, 0.0]))
    sure = online(CORRIDOR, scanner, pose, crowd)
    assert unsure.weights[0, ahead].min() > 0.5 > 1e-6 > sure.weights[0, ahead].max()


def test_turning_everything_turns_the_matrix() -> None:
    scanner, angle = worlds.mixed(), 0.7
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    ring = np.array(worlds.L_ROOM) @ turn[:2, :2].T
    other = worlds.walls(tuple((float(x), float(y)) for x, y in ring))
    poses = worlds.free_poses(worlds.room(), 12, 5, clearance=0.6)
    x, y, theta = poses.T
    readings = scanner.read(worlds.room(), x, y, theta, np.random.default_rng(6))
    readings[:, ::4] *= 0.7
    there = poses @ turn.T + [0.0, 0.0, angle]
    one, two = (online(worlds.room(), scanner, poses, readings),
                online(other, scanner, there, readings))  # fmt: skip
    # A cone's nearest ray may change where two are equally near: hence not to the last digit.
    np.testing.assert_allclose(two.weights, one.weights, atol=1e-6)
    expected = turn @ one.information @ turn.T
    np.testing.assert_allclose(two.information, expected, atol=1e-6 * expected.max())


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
def test_people_only_take_away(seed: int, share: float) -> None:
    rng, scanner = np.random.default_rng(seed), worlds.laser(beams=30)
    poses = worlds.free_poses(worlds.room(), 3, seed, clearance=0.4)
    x, y, theta = poses.T
    readings = scanner.read(worlds.room(), x, y, theta, rng).astype(float)
    readings[rng.random(readings.shape) < share] *= rng.uniform(0.1, 0.95)
    got = online(worlds.room(), scanner, poses, readings)
    assert ((got.weights >= 0.0) & (got.weights <= 1.0) | np.isnan(got.weights)).all()
    plain = scan_information(worlds.room(), scanner, poses, 0.0)
    tolerance = 1e-9 * plain.max()
    assert np.linalg.eigvalsh(plain - got.information).min() > -tolerance
    assert np.linalg.eigvalsh(got.information).min() > -tolerance
    prior = np.diag([0.25, 0.25, (math.pi / 12) ** 2])
    assert np.linalg.eigvalsh(prior - got.covariance).min() > -1e-9
    one = online(worlds.room(), scanner, poses[1], readings[1])
    np.testing.assert_array_equal(one.information[0], got.information[1])


def test_bad_input_is_refused() -> None:
    scanner, full = worlds.laser(), np.ones((1, 60))
    with pytest.raises(InputError, match="poses"):
        online(CORRIDOR, scanner, [[0.0, 1.0]], full)
    with pytest.raises(InputError, match=r"ranges have the shape \(1, 59\); give \(1, 60\)"):
        online(CORRIDOR, scanner, MIDDLE, np.ones((1, 59)))
    with pytest.raises(InputError, match="prior has the eigenvalue -1"):
        online(CORRIDOR, scanner, MIDDLE, full, prior=-np.eye(3))
    with pytest.raises(InputError, match="uncertainty is not symmetric"):
        online(CORRIDOR, scanner, MIDDLE, full, uncertainty=np.triu(np.ones((3, 3))))
    with pytest.raises(InputError, match="prior: the shape"):
        online(CORRIDOR, scanner, MIDDLE, full, prior=np.ones(3))
    with pytest.raises(InputError, match="map_std"):
        online(CORRIDOR, scanner, MIDDLE, full, map_std=-1.0)
    with pytest.raises(InputError, match=r"localizability_weighting is 1\.5; give 0 to 1"):
        MclParameters(localizability_weighting=1.5)


# -- in the filter -----------------------------------------------------------------------------


def test_particles_are_weighed_where_the_gain_puts_them() -> None:
    scanner = worlds.laser(reach=8.0)
    parameters = MclParameters(localizability_weighting=True, likelihood_resolution=0.05)
    assert parameters.localizability_weighting == 1.0
    loc = MonteCarloLocalizer(CORRIDOR, scanner, parameters, rng=np.random.default_rng(2))
    prior = np.array([[0.04, 0.001, 0.0], [0.001, 0.01, 0.0005], [0.0, 0.0005, 0.001]])
    loc.start([30.0, 1.2, 0.1], prior)
    particles = loc.state.particles[0]
    particles[7, 4] = 1.0
    particles[7, :3] = 10.0, 0.5, 3.0
    readings = seen(CORRIDOR, scanner, np.array([[30.0, 1.2, 0.1]]))[0].astype(np.float32)
    readings[5], readings[6] = 0.7, math.inf
    out, inliers = np.zeros_like(particles), np.zeros_like(readings)
    assert localizability_filtered(particles, 2000, readings, loc.model, loc.cast, out, inliers)
    assert np.isnan(inliers[5]) and (np.delete(inliers, 5) == np.delete(readings, 5)).all()
    kept = np.delete(particles[:2000], 7, axis=0)
    mean, spread = kept[:, :3].mean(axis=0), np.cov(kept[:, :3].T, bias=True)
    information = online_localizability(
        CORRIDOR, scanner, mean, readings, uncertainty=spread
    ).information
    ideal = np.linalg.inv(np.linalg.inv(spread) + information[0]) @ information[0]
    moved = mean + (kept[:, :3] - mean) @ ideal.T
    np.testing.assert_allclose(np.delete(out[:2000], 7, axis=0)[:, :3], moved, atol=2e-3)
    assert np.ptp(np.delete(out[:2000, 0], 7)) < 0.1 < np.ptp(kept[:, 0])
    assert (out[7] == particles[7]).all() and (out[:, 3:] == particles[:, 3:]).all()
    # Not where hardly a reading fits, nor where the particles are all over the place.
    readings[:55] = 0.6
    assert not localizability_filtered(particles, 2000, readings, loc.model, loc.cast, out, inliers)
    loc.start([30.0, 1.2, 0.1], np.diag([4.0, 0.01, 0.01]))
    assert not localizability_filtered(particles, 2000, readings, loc.model, loc.cast, out, inliers)


def study(spoilt: str, model: str, power: float) -> list[tuple[np.ndarray, float]]:
    """Root mean square errors (x, y, theta) and mean NEES, without the weighting and with it."""
    found = []
    for weighting in (0.0, 1.0):
        parameters = MclParameters(
            alpha1=0.001, alpha2=0.001, alpha3=0.001, alpha4=0.001, likelihood_resolution=0.05,
            laser_model_type=model, importance_factor=power, localizability_weighting=weighting,
        )  # fmt: skip
        errors, squares = [], []
        for seed in range(3):
            env, scanner, truth, scans = crowds.drive(spoilt, seed, steps=80)
            rng, odometry = np.random.default_rng(seed), odometry_of(truth, 8, seed, alpha=0.001)
            loc = MonteCarloLocalizer(env, scanner, parameters, runs=8, rng=rng)
            loc.start(truth[0], np.diag([0.05**2, 0.05**2, 0.03**2]))
            for k, pose in enumerate(truth):
                loc.update(odometry[:, k], scans[k])
                off = loc.mean - pose
                off[:, 2] = worlds.turned(off[:, 2])
                errors.append(off)
                squares.append(np.einsum("ri,rij,rj->r", off, np.linalg.inv(loc.covariance), off))
        rms = np.sqrt((np.array(errors) ** 2).mean(axis=(0, 1)))
        found.append((rms, float(np.mean(squares))))
        print(f"{spoilt:7s} {model:22s} {power:3g} weighting {weighting:g}: rms along "
              f"{rms[0]:.3f} m, across {rms[1]:.4f} m, heading {rms[2]:.4f} rad, NEES "
              f"{found[-1][1]:.1f}")  # fmt: skip
    return found


@pytest.mark.slow(kept=("aged",))
@pytest.mark.parametrize("spoilt", ["people", "aged"])
def test_a_sure_filter_errs_less_where_the_map_is_wrong(spoilt: str) -> None:
    (off, off_nees), (on, on_nees) = study(spoilt, "likelihood_field_prob", 1.0)
    # Along the corridor by boxes that are elsewhere, across it by people taken for walls.
    assert on[0] < (0.8 * off[0] if spoilt == "aged" else off[0])
    assert on[1] < 0.7 * off[1]
    # 3 if the covariance is right.
    assert on_nees < 4.0 and on_nees < 0.5 * off_nees


@pytest.mark.slow(kept=("model1-aged",))
@pytest.mark.parametrize("spoilt", crowds.SPOILT)
@pytest.mark.parametrize(
    "model", [("likelihood_field", 0.1), ("likelihood_field_prob", 0.1), ("beam", 0.1)]
)
def test_a_filter_that_is_less_sure_hardly_notices(model: tuple[str, float], spoilt: str) -> None:
    (off, off_nees), (on, on_nees) = study(spoilt, *model)
    assert (on < 1.3 * off).all()
    assert on_nees < max(3.0, 1.1 * off_nees)


@pytest.mark.slow
def test_where_the_map_is_right_the_weighting_costs_little() -> None:
    (off, _), (on, nees) = study("clean", "likelihood_field_prob", 1.0)
    assert (on < 1.3 * off).all() and nees < 3.0


@pytest.mark.slow
def test_a_kidnapped_robot_is_still_recovered() -> None:
    env, scanner = worlds.room(), worlds.laser()
    truth = worlds.figure_eight(60)
    parameters = MclParameters(
        alpha1=0.02, alpha2=0.02, alpha3=0.02, alpha4=0.02, likelihood_resolution=0.05,
        recovery_alpha_slow=0.001, recovery_alpha_fast=0.1, max_particles=3000,
        localizability_weighting=1.0,
    )  # fmt: skip
    loc = MonteCarloLocalizer(env, scanner, parameters, runs=6, rng=np.random.default_rng(1))
    wrong = np.array([7.5, 2.0, truth[0, 2] + 2.5])
    loc.start(wrong, np.diag([0.01, 0.01, 0.01]))
    rng, odometry = np.random.default_rng(6), odometry_of(np.tile(truth, (3, 1)), 6, 6, 0.02)
    for k in range(180):
        pose = wrong if k < 3 else truth[k % 60]
        x, y, theta = np.tile(pose, (6, 1)).T
        loc.update(odometry[:, k], scanner.read(env, x, y, theta, rng))
    assert (np.hypot(*(loc.mean - truth[-1])[:, :2].T) < 0.3).sum() >= 5
