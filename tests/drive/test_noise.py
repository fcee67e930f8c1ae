"""Noise in the motion (`sample_ground`) against noise in the report (`sample_odometry`)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from ambinav.drive.noise import OdometryNoise, sample_ground, sample_odometry
from ambinav.drive.world import unicycle
from ambinav.localization.random import normals, states
from ambinav.runtime.kernels import kernel

RUNS = 2000
# Small enough that second-order terms stay below the sampling error over 10 m.
NOISE = OdometryNoise(scale=0.05)
# Speed and turn rate for 20 s: 10 m straight on, backwards, on arcs, 6 turns on the spot.
DRIVES = {
    "straight": (0.5, 0.0), "backwards": (-0.5, 0.0), "left": (0.4, 0.3), "right": (0.3, -0.5),
    "spot": (0.0, 2.0),
}  # fmt: skip


@kernel
def drive(
    speed: Any, rate: Any, dt: Any, steps: Any, noise: Any, random: Any, reported: Any, driven: Any
) -> None:
    """Write where runs end that drive the same: by either model, all from (0, 0, 0)."""
    for k in range(random.shape[0]):
        ox, oy, ot = 0.0, 0.0, 0.0
        x, y, t = 0.0, 0.0, 0.0
        gx, gy, gt = 0.0, 0.0, 0.0
        for _ in range(steps):
            x1, y1, t1 = unicycle(x, y, t, speed, rate, dt)
            ox, oy, ot = sample_odometry(ox, oy, ot, x, y, t, x1, y1, t1, noise, random[k])
            x, y, t = x1, y1, t1
            ground, turning = sample_ground(speed, rate, dt, noise, random[k])
            gx, gy, gt = unicycle(gx, gy, gt, ground, turning, dt)
        reported[k, 0], reported[k, 1], reported[k, 2] = ox, oy, ot
        driven[k, 0], driven[k, 1], driven[k, 2] = gx, gy, gt


def ends(name: str, dt: float, noise: OdometryNoise = NOISE) -> tuple[np.ndarray, np.ndarray]:
    """Poses after a drive as odometry reports it, and as the robot drives it, shape (RUNS, 3)."""
    random = states(np.random.default_rng(0), RUNS)
    reported, driven = np.empty((RUNS, 3)), np.empty((RUNS, 3))
    drive(*DRIVES[name], dt, round(20.0 / dt), noise.packed, random, reported, driven)
    return reported, driven


def predicted(name: str, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Pose after a drive without noise, and its covariance to first order."""
    pose, covariance = np.zeros((1, 3)), np.zeros((1, 3, 3))
    for _ in range(round(20.0 / dt)):
        after = np.array([unicycle(*pose[0], *DRIVES[name], dt)])
        covariance = NOISE.spread(pose, covariance, pose, after)
        pose = after
    return pose[0], covariance[0]


def spread_about(poses: np.ndarray, nominal: np.ndarray) -> np.ndarray:
    off = poses - nominal
    off[:, 2] = np.remainder(off[:, 2] + math.pi, 2.0 * math.pi) - math.pi
    return np.cov(off.T)


@pytest.mark.slow
@pytest.mark.parametrize("name", DRIVES)
def test_both_models_spread_the_pose_alike(name: str) -> None:
    """Whichever of report and motion errs, at either time step: to 5 sampling deviations."""
    nominal, wanted = predicted(name, 0.05)
    variance = np.diag(wanted)
    sampling = np.sqrt((np.outer(variance, variance) + wanted**2) / RUNS)
    for dt in (0.05, 0.2):
        for poses in ends(name, dt):
            assert (np.abs(spread_about(poses, nominal) - wanted) <= 5.0 * sampling + 1e-9).all()


def test_straight_on_the_spread_is_that_of_a_wiener_process() -> None:
    """Closed forms of the module's head, over L = 10 m."""
    square, length = NOISE.scale**2, 10.0
    wanted = (
        square * 0.2 * 0.25 * length,
        2.0 / 3.0 * square * 0.2 * 0.25 * length**3,
        2.0 * square * 0.2 * 0.25 * length,
    )
    for poses in ends("straight", 0.1):
        assert np.var(poses, axis=0) == pytest.approx(wanted, rel=5.0 * math.sqrt(2.0 / RUNS))


@pytest.mark.parametrize(("speed", "rate"), [(0.5, 0.0), (-0.4, 0.6), (0.3, -1.0), (0.0, 0.8)])
def test_moments_of_one_step(speed: float, rate: float) -> None:
    noise, dt = OdometryNoise(bias_distance=0.1, bias_turn=0.3, alpha4=0.1), 0.1
    random = states(np.random.default_rng(1), 1)[0]
    count = 20_000
    drawn = dt * np.array(
        [sample_ground(speed, rate, dt, noise.packed, random) for _ in range(count)]
    )
    square, trans, turn = noise.scale**2, abs(speed) * dt, abs(rate) * dt
    variance = (
        square * (0.2 * trans * 0.25 + 0.1 * turn * 0.2),
        square * (0.2 * turn * 0.2 + 2.0 * 0.2 * trans * 0.25),
    )
    # Odometry reports 1.1 m and 0.3 rad to the left for a metre driven straight on.
    mean = np.array([speed * dt / 1.1, rate * dt - 0.3 * trans / 1.1])
    assert (np.abs(drawn.mean(axis=0) - mean) < 5.0 * np.sqrt(np.array(variance) / count)).all()
    assert drawn.var(axis=0) == pytest.approx(variance, rel=5.0 * math.sqrt(2.0 / count))
    both = (drawn - mean).prod(axis=1) / math.sqrt(math.prod(variance))
    assert abs(both.mean()) < 5.0 / math.sqrt(count)


@pytest.mark.parametrize("seed", range(5))
def test_the_kernel_is_its_reference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    speed, rate, dt = rng.uniform((-1.0, -1.0, 0.01), (1.0, 1.0, 0.3)).tolist()
    noise = OdometryNoise(bias_distance=-0.2, bias_turn=0.1).packed
    random = states(rng, 1)[0]
    along, turned = normals(random.copy())
    metres, radians = np.abs([speed, rate]) * dt
    deviation = np.sqrt(
        [
            noise.trans_trans * metres + noise.trans_turn * radians,
            2.0 * noise.turn_trans * metres + noise.turn_turn * radians,
        ]
    )
    ground = speed / (1.0 + noise.bias_distance)
    mean = np.array([ground, rate - noise.bias_turn * abs(ground)])
    wanted = mean + deviation * (along, turned) / dt
    assert sample_ground(speed, rate, dt, noise, random) == pytest.approx(wanted, rel=1e-12)


def test_standing_still_is_no_motion() -> None:
    """Exactly, with biases, and the random numbers go on as if it had driven."""
    noise = OdometryNoise(scale=3.0, bias_distance=0.5, bias_turn=1.0).packed
    random = states(np.random.default_rng(2), 1)[0]
    other = random.copy()
    assert sample_ground(0.0, 0.0, 0.1, noise, random) == (0.0, 0.0)
    sample_ground(0.5, -0.3, 0.1, noise, other)
    assert (random == other).all()
