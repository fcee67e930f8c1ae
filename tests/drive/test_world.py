"""Motion and collision of the true robot, and what its odometry makes of it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.stats import chi2

from ambinav.drive.localizers import compose_motion
from ambinav.drive.noise import OdometryNoise, propagate_covariance
from ambinav.drive.world import moved, report_all, unicycle
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.localization.random import states
from ambinav.runtime.errors import InputError
from tests.geometry.scenes import points_inside, room, scene

RADIUS = 0.25


def arrays(env: Environment, radius: float = RADIUS) -> tuple:
    return CollisionChecker(env, Footprint.disc(radius), Steering()).arrays[:2]


@pytest.fixture(scope="module")
def hall() -> Environment:
    return scene(3, size=20.0, blocks=15, thin=8)


@settings(max_examples=40, deadline=None)
@given(st.floats(-1.0, 1.0), st.floats(-2.0, 2.0), st.floats(-3.0, 3.0))
def test_the_unicycle_drives_an_exact_arc(speed: float, rate: float, t: float) -> None:
    def flow(_: float, q: np.ndarray) -> list[float]:
        return [speed * math.cos(q[2]), speed * math.sin(q[2]), rate]

    want = solve_ivp(flow, (0.0, 0.7), [1.0, 2.0, t], rtol=1e-10, atol=1e-12).y[:, -1]
    x, y, heading = unicycle(1.0, 2.0, t, speed, rate, 0.7)
    assert (x, y) == pytest.approx(want[:2], abs=1e-8)
    assert math.cos(heading - want[2]) == pytest.approx(1.0)


@pytest.mark.parametrize("speed", [0.5, -0.5])
def test_a_disc_stops_where_it_touches_the_wall(speed: float) -> None:
    walls = arrays(room(10.0, 4.0))
    t = 0.0 if speed > 0 else math.pi
    x, y, _, met = moved(9.6, 2.0, t, speed, 0.0, 1.0, RADIUS, *walls)
    assert met and (x, y) == pytest.approx((10.0 - RADIUS, 2.0), abs=1e-8)
    # Up to the wall itself it is free.
    x, _, _, met = moved(9.6, 2.0, t, speed, 0.0, 0.3, RADIUS, *walls)
    assert not met and x == pytest.approx(9.75)


def test_a_disc_touches_the_end_of_a_thin_wall() -> None:
    # The wall ends at (5, 1); the disc passes at y = 1.15 and touches it where
    # (5 - x)^2 + 0.15^2 = 0.25^2, so at x = 4.8.
    walls = arrays(room(10.0, 4.0, np.array([[5.0, 0.5, 5.0, 1.0]])))
    x, y, _, met = moved(4.0, 1.15, 0.0, 1.0, 0.0, 2.0, RADIUS, *walls)
    assert met and (x, y) == pytest.approx((4.8, 1.15), abs=1e-8)
    assert not moved(4.0, 1.2501, 0.0, 1.0, 0.0, 2.0, RADIUS, *walls)[3]


def test_an_arc_touches_the_wall_where_its_circle_does() -> None:
    # A left turn of radius 1 about (8.5, 2): its foremost point x = 9.5 needs 0.25 m, but the
    # wall stands at 9.6. Contact: 8.5 + sin(a) = 9.35.
    walls = arrays(room(9.6, 4.0))
    x, y, t, met = moved(8.5, 1.0, 0.0, 1.0, 1.0, 1.5, RADIUS, *walls)
    a = math.asin(0.85)
    assert met
    assert (x, y, t) == pytest.approx((9.35, 2.0 - math.cos(a), a), abs=1e-8)


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(st.integers(0, 10_000), st.floats(-1.5, 1.5), st.floats(-2.0, 2.0))
def test_collisions_are_those_of_the_swept_disc(
    hall: Environment, seed: int, speed: float, rate: float
) -> None:
    x, y = points_inside(hall, 1, seed, margin=RADIUS + 0.001)[0]
    t = float(np.random.default_rng(seed).uniform(-3.0, 3.0))
    ex, ey, et, met = moved(x, y, t, speed, rate, 1.0, RADIUS, *arrays(hall))
    gone = 1.0
    if met:
        turned = (et - t + math.pi) % (2 * math.pi) - math.pi
        gone = turned / rate if abs(rate) > 0.01 else math.dist((x, y), (ex, ey)) / abs(speed)
    path = np.array([unicycle(x, y, t, speed, rate, s) for s in np.linspace(0.0, gone, 200)])
    room_left = np.asarray(hall.clearance(path[:, 0], path[:, 1]))
    assert room_left.min() >= RADIUS - 1e-4
    if met:
        assert float(hall.clearance(ex, ey)) == pytest.approx(RADIUS, abs=1e-6)
    else:
        assert (ex, ey, et) == pytest.approx(unicycle(x, y, t, speed, rate, 1.0))


def drifted(noise: OdometryNoise, runs: int, step: float, length: float) -> np.ndarray:
    """Odometry poses after driving straight on along x, shape (runs, 3)."""
    odometry, truth = np.zeros((runs, 3)), np.zeros((runs, 3))
    table = states(np.random.default_rng(7), runs)
    for _ in range(round(length / step)):
        after = truth + np.array([step, 0.0, 0.0])
        report_all(odometry, truth, after, noise.packed, table)
        truth = after
    return odometry


def within(values: np.ndarray, variance: float) -> bool:
    """Whether the second moment about 0 fits, at 99.99 %."""
    low, high = chi2.ppf([5e-5, 1 - 5e-5], len(values))
    return bool(low < (values**2).sum() / variance < high)


@pytest.mark.parametrize("step", [0.02, 0.1])
def test_dead_reckoning_drifts_as_the_model_says_whatever_the_step(step: float) -> None:
    noise, length = OdometryNoise(scale=0.05), 8.0
    error = drifted(noise, 3000, step, length) - [length, 0.0, 0.0]
    square = 0.05**2 * 0.2 * 0.25
    assert within(error[:, 2], 2.0 * square * length)
    assert within(error[:, 0], square * length + _bend(2.0 * square, length))
    # Half of a step's turn comes before its way: the rest of the sum is of the order of the step.
    assert within(error[:, 1], 2.0 / 3.0 * square * length**3 * (1.0 + 0.75 * step / length))


def _bend(per_metre: float, length: float) -> float:
    """Second moment of the distance lost to a wandering heading, E (int theta^2 / 2)^2."""
    return 0.25 * per_metre**2 * length**4 * 7.0 / 12.0


def test_after_one_update_s_way_the_variances_are_amcl_s() -> None:
    noise = OdometryNoise(scale=1.0, alpha1=0.01, alpha2=0.01, alpha3=0.02, alpha4=0.0)
    error = drifted(noise, 4000, 0.25, 0.25)
    assert within(error[:, 2], 2 * 0.01 * 0.25**2)
    away = np.hypot(error[:, 0], error[:, 1])
    assert within(away - 0.25, 0.02 * 0.25**2)


def test_turning_on_the_spot_drifts_with_the_angle() -> None:
    noise = OdometryNoise(scale=0.5)
    odometry, truth = np.zeros((4000, 3)), np.zeros((4000, 3))
    table = states(np.random.default_rng(1), 4000)
    for _ in range(20):
        after = truth + np.array([0.0, 0.0, 0.1])
        report_all(odometry, truth, after, noise.packed, table)
        truth = after
    assert within(odometry[:, 2] - 2.0, 0.25 * 0.2 * 2.0 * 0.2)


def test_without_noise_odometry_is_the_truth() -> None:
    odometry = np.zeros((1, 3))
    table = states(np.random.default_rng(0), 1)
    truth = np.zeros((1, 3))
    for speed, rate in [(0.5, 0.3), (0.0, 1.0), (-0.4, -0.6), (0.02, 2.0), (0.0, 0.0)]:
        after = np.array([unicycle(*truth[0], speed, rate, 0.5)])
        report_all(odometry, truth, after, OdometryNoise(scale=0.0).packed, table)
        truth = after
        assert odometry[0] == pytest.approx(truth[0], abs=1e-12)


def test_biases_bend_and_stretch_the_way() -> None:
    noise = OdometryNoise(scale=0.0, bias_distance=0.02, bias_turn=0.01)
    x, y, t = drifted(noise, 1, 0.01, 10.0)[0]
    # Reported: 1.02 of the distance, on an arc that turns by 0.01 a metre truly driven.
    assert t == pytest.approx(0.1)
    assert (x, y) == pytest.approx(
        (10.2 * math.sin(0.1) / 0.1, 10.2 * (1 - math.cos(0.1)) / 0.1), abs=1e-3
    )


def test_the_spread_is_that_of_the_reports() -> None:
    """Covariances to first order against 20 000 drives along an arc."""
    noise = OdometryNoise(scale=0.1)
    runs, steps = 20_000, 40
    odometry, table = np.zeros((runs, 3)), states(np.random.default_rng(5), runs)
    truth = np.zeros((1, 3))
    mean, covariance = np.zeros((1, 3)), np.zeros((1, 3, 3))
    for _ in range(steps):
        after = np.array([unicycle(*truth[0], 0.5, 0.25, 0.2)])
        report_all(
            odometry, np.tile(truth, (runs, 1)), np.tile(after, (runs, 1)), noise.packed, table
        )
        covariance = noise.spread(mean, covariance, truth, after)
        truth = mean = after
    found = np.cov(odometry.T)
    assert found == pytest.approx(covariance[0], rel=0.06, abs=2e-4)


def test_reckoning_in_a_kernel_is_the_spread() -> None:
    noise = OdometryNoise(alpha1=0.3, alpha2=0.1, alpha3=0.4, alpha4=0.2)
    rng = np.random.default_rng(8)
    for still in (False, True):
        for _ in range(50):
            before, step = rng.uniform(-3.0, 3.0, (2, 3))
            after = before + step * (0.0 if still else 0.1, 0.0 if still else 0.1, 0.3)
            mean, root = rng.uniform(-2.0, 2.0, 3), rng.normal(size=(3, 3))
            cov = root @ root.T
            spread = noise.spread(mean[None], cov[None], before[None], after[None])[0]
            place = compose_motion(mean[None], before[None], after[None])[0]
            propagate_covariance(mean, cov, *before, *after, noise.packed)
            assert np.allclose(cov, spread, atol=1e-12) and np.allclose(mean, place, atol=1e-12)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"alpha1": -0.1}, "alpha1 is -0.1"),
        ({"scale": math.nan}, "scale"),
        ({"bias_turn": "x"}, "bias_turn"),
    ],
)
def test_bad_noise_is_refused(values: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        OdometryNoise(**values)
    assert OdometryNoise(bias_turn=-0.01).bias_turn == -0.01
