"""No part of the observation knows more of the true motion than odometry and scan do."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from numpy.typing import NDArray

from ambinav.drive.world import unicycle
from ambinav_envs.registration import IDS

Floats = NDArray[np.float64]

# Twins of the true pose know it by design.
EVERY = sorted(name for name in IDS if "-TruePose-" not in name and "-NoMap-" not in name)
ROBOTS, STEPS, LAG = 32, 120, 2


def driven(name: str) -> tuple[Floats, Floats, Floats, Floats]:
    """Drive about; return per step and robot what was seen of the speeds, and what was true.

    Returns:
        `velocity` and `remaining`, shape (S, N, 3); the wheels' speeds and those over ground, shape
        (S, N, 2); and by how far the sum of `velocity` differs from odometry, metres.
    """
    envs: Any = gym.make_vec(
        name, num_envs=ROBOTS, vectorization_mode="vector_entry_point", buildings=2
    )
    simulation = envs.simulation
    limits = np.array(
        [simulation.parameters.robot.max_speed, simulation.parameters.robot.max_turn_rate]
    )
    envs.reset(seed=0)
    rng, off = np.random.default_rng(0), 0.0
    seen, wheels, ground = [], [], []
    command = rng.uniform(-1.0, 1.0, (ROBOTS, 2))
    for _ in range(STEPS):
        change = rng.random((ROBOTS, 1)) < 0.2
        command = np.where(change, rng.uniform(-0.3, 1.0, (ROBOTS, 2)) * (1.0, 0.5), command)
        before = simulation.state["odometry"].copy()
        observation, *_, info = envs.step(command.astype(np.float32))
        speeds = observation["velocity"] * limits
        for i in np.flatnonzero(~info["lost"] & (simulation.state["outcome"] == 0)):
            if simulation.state["steps"][i] == 0:
                continue
            after = unicycle(*before[i], *speeds[i].astype(float), simulation.parameters.dt)
            off = max(off, float(np.hypot(*(simulation.state["odometry"][i, :2] - after[:2]))))
        seen.append(np.concatenate([observation["velocity"], observation["remaining"]], axis=1))
        wheels.append(simulation.state["speeds"].copy())
        ground.append(simulation.state["ground"].copy())
    return np.array(seen), np.array(wheels), np.array(ground), np.array(off)


def explained(history: Floats, wanted: Floats) -> float:
    """Return the largest R^2, on robots that were not fitted, of a ridge regression.

    Args:
        history: Shape (S, N, K); what is seen from `LAG` steps before to `LAG` steps after.
        wanted: Shape (S, N, 2).
    """
    rows = np.concatenate(
        [history[k : len(history) - 2 * LAG + k] for k in range(2 * LAG + 1)], axis=2
    )
    rows = np.concatenate([rows, rows**2, np.ones((*rows.shape[:2], 1))], axis=2)
    target = wanted[LAG:-LAG]
    half = ROBOTS // 2
    X, y = rows[:, :half].reshape(-1, rows.shape[2]), target[:, :half].reshape(-1, 2)
    weights = np.linalg.solve(X.T @ X + 1e-3 * np.eye(X.shape[1]), X.T @ y)
    left = target[:, half:] - rows[:, half:] @ weights
    return float((1.0 - left.var(axis=(0, 1)) / target[:, half:].var(axis=(0, 1))).max())


@pytest.mark.parametrize("name", EVERY)
def test_speeds_tell_nothing_but_odometry(name: str) -> None:
    seen, wheels, ground, off = driven(name)
    assert off < 1e-6
    # Where it slips the wheels turn faster all the time, by a share that anybody may know.
    error = ground - wheels
    slips = "Slippery" in name
    limit = 0.05
    assert explained(seen, error[..., 1:].repeat(2, axis=2)) < limit
    assert slips or explained(seen, error) < limit
    # The test would notice: the true speeds, as `velocity` once was, explain the errors.
    leaked = np.concatenate([seen, ground], axis=2)
    assert explained(leaked, error) > 0.9
