"""The action of a trained policy does not depend on how many robots act with it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ambinav_envs.policies.policy import Actions, ModelPolicy
from tests.envs.policies.models import normalized

pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO, SAC

ROBOTS, STEPS = 64, 3


def observations(space: Any) -> list[dict[str, Any]]:
    """Return what many robots observe in a few steps; any numbers will do."""
    rng = np.random.default_rng(1)
    return [
        {
            name: rng.uniform(-1.0, 1.0, (ROBOTS, *part.shape)).astype(np.float32)
            for name, part in space.spaces.items()
        }
        for _ in range(STEPS)
    ]


def actions_of(model: Any, seen: list[dict[str, Any]], rows: int) -> Actions:
    """Return the actions in all steps, of so many robots at a time, shape (STEPS, ROBOTS, 2)."""
    policy, done = ModelPolicy(model), []
    for low in range(0, ROBOTS, rows):
        policy.prepare(model.observation_space, model.action_space)
        part = slice(low, low + rows)
        steps = []
        for k, step in enumerate(seen):
            starts = np.full(len(range(ROBOTS)[part]), k == 0)
            steps.append(policy.act({name: values[part] for name, values in step.items()}, starts))
        done.append(np.stack(steps))
    return np.concatenate(done, axis=1)


def recurrent() -> Any:
    return pytest.importorskip("sb3_contrib").RecurrentPPO


@pytest.mark.slow
@pytest.mark.parametrize(
    ("algorithm", "widths", "options"),
    [
        (lambda: PPO, [64, 64], {}),
        (lambda: PPO, [36, 300], {}),
        (lambda: SAC, [64, 64], {"buffer_size": 10}),
        (recurrent, [32], {}),
    ],
)
def test_actions_do_not_depend_on_the_number_of_rows(
    algorithm: Any, widths: list[int], options: dict[str, Any]
) -> None:
    made = algorithm()
    kind = "MultiInputPolicy" if made in (PPO, SAC) else "MultiInputLstmPolicy"
    model = made(kind, normalized(), seed=3, policy_kwargs={"net_arch": widths}, **options)
    seen = observations(model.observation_space)
    together = actions_of(model, seen, ROBOTS)
    assert together.shape == (STEPS, ROBOTS, 2)
    assert np.abs(np.diff(together, axis=0)).max() > 1e-4
    for rows in (1, 3, 8, 15, 25, 47, 63):
        np.testing.assert_array_equal(actions_of(model, seen, rows), together)
