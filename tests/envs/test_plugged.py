"""Terms of the reward and parts of the observation that are functions, not kernels."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv

from ambinav.runtime.errors import InputError
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.observations import OBSERVATIONS, ObservationPart
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.rewards import REWARD_TERMS, RewardTerm
from ambinav_envs.robot_states import Seen, Stepped
from ambinav_envs.vector import NavigationVectorEnv
from tests.envs.cases import equal, room


def turning(stepped: Stepped) -> np.ndarray:
    return -np.abs(stepped.seen.speeds[:, 1]) * stepped.dt


def nearest(seen: Seen) -> np.ndarray:
    return seen.readings.min(axis=1, keepdims=True).clip(0.0, 4.0)


TURNING = RewardTerm(name="turning", unit="rad", meaning="minus the turn", function=turning)
NEAREST = ObservationPart(
    name="nearest", unit="m", meaning="nearest reading", size=lambda parameters: 1, low=0.0,
    high=4.0, function=nearest,
)  # fmt: skip


@pytest.fixture
def options(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    monkeypatch.setitem(REWARD_TERMS._registered, "turning", TURNING)
    monkeypatch.setitem(OBSERVATIONS._registered, "nearest", NEAREST)
    return {
        "map": room(), "localizer": "odometry", "max_steps": 12, "window": False,
        "reward": {"progress": 1.0, "turning": 0.5}, "observations": ["nearest"],
    }  # fmt: skip


def test_a_term_and_a_part_of_ones_own(options: dict[str, Any]) -> None:
    env = NavigationEnv(**options)
    seen, info = env.reset(seed=3)
    assert env.observation_space.contains(seen) and seen["nearest"].dtype == np.float32
    assert info["terms"]["turning"] == 0.0
    for _ in range(5):
        seen, reward, *_, info = env.step(np.array([1.0, 0.5], dtype=np.float32))
        turn = abs(env.simulation.state["speeds"][0, 1]) * 0.2
        assert info["terms"]["turning"] == -turn < 0.0
        assert info["reward_terms"]["turning"] == -0.5 * turn
        assert reward == pytest.approx(sum(info["reward_terms"].values()))
        assert seen["nearest"][0] == np.float32(env.simulation.readings[0].min().clip(0.0, 4.0))
    check_env(env, skip_render_check=True)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_many_robots_have_them_too(options: dict[str, Any], mode: str) -> None:
    many = NavigationVectorEnv(3, autoreset_mode=mode, **options)
    single = SyncVectorEnv([lambda: NavigationEnv(**options)] * 3, autoreset_mode=mode)
    assert many.observation_space == single.observation_space
    equal(many.reset(seed=5), single.reset(seed=5))
    rng = np.random.default_rng(0)
    for _ in range(30):
        action = rng.uniform(-1.0, 1.0, (3, 2)).astype(np.float32)
        equal(many.step(action), single.step(action))


def test_a_copy_goes_on_alike(options: dict[str, Any]) -> None:
    env = NavigationEnv(**options)
    env.reset(seed=1)
    other = pickle.loads(pickle.dumps(env))
    equal(env.step(np.zeros(2)), other.step(np.zeros(2)))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"reward": {"turnin": 1.0}}, "the term 'turnin' is unknown; did you mean turning"),
        ({"observations": ["neares"]}, "no part of the observation 'neares'; did you mean nearest"),
        ({"observations": "nearest"}, "give a list of names"),
        ({"observations": ["scan"]}, "'scan' is one of ours"),
    ],
)
def test_names_that_cannot_be(options: dict[str, Any], given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        NavigationParameters(**given)


def test_another_shape_is_refused(options: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = RewardTerm(name="turning", unit="1", meaning="", function=lambda stepped: np.zeros(7))
    monkeypatch.setitem(REWARD_TERMS._registered, "turning", wrong)
    env = NavigationEnv(**options)
    env.reset(seed=0)
    with pytest.raises(
        ValueError, match=r"'turning' gave an array of the shape \(7,\), not \(1,\)"
    ):
        env.step(np.zeros(2))
