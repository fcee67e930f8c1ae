"""Networks that are built again from a file compute what the trained ones do, bit for bit."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.policies import MultiInputActorCriticPolicy
from stable_baselines3.common.torch_layers import CombinedExtractor
from stable_baselines3.common.vec_env import VecNormalize

from ambinav.runtime.errors import InputError
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies import ModelPolicy, load_policy, save_policy
from ambinav_envs.policies.network import Network, _count, _make, _options
from ambinav_envs.policies.policy import ROWS
from ambinav_envs.policies.shapes import described, space_of
from ambinav_envs.sb3 import make_sb3
from ambinav_envs.spaces import action_space, observation_space
from ambinav_envs.training.features import NavigationFeatures
from tests.envs.policies.models import NAME, OPTIONS

NAVIGATION = {
    "features_extractor_class": NavigationFeatures,
    "features_extractor_kwargs": {"scan": "conv", "window": "dense", "scan_features": 5},
}
ROLLOUT: dict[str, Any] = {"n_steps": 4, "batch_size": 8, "n_epochs": 1}
CASES: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    "ppo": ("PPO", {}, {"net_arch": [8, 9]}),
    "by default": ("PPO", {}, {}),
    "as we train": ("PPO", {}, {**NAVIGATION, "net_arch": {"pi": [8], "vf": [6, 7]}}),
    "ReLU, features apart": (
        "PPO", {},
        {**NAVIGATION, "activation_fn": torch.nn.ReLU, "share_features_extractor": False},
    ),
    "discrete": ("PPO", {"discrete": True}, {"net_arch": [8]}),
    "gSDE": ("PPO", {}, {"net_arch": [8], "use_sde": True, "squash_output": True}),
    "sac": ("SAC", {}, {**NAVIGATION, "net_arch": [8]}),
    "sac with gSDE": ("SAC", {}, {"net_arch": {"pi": [8], "qf": [9]}, "use_sde": True}),
    "recurrent": ("RecurrentPPO", {}, {**NAVIGATION, "net_arch": [8], "lstm_hidden_size": 6}),
    "recurrent, one memory": (
        "RecurrentPPO", {},
        {"lstm_hidden_size": 6, "shared_lstm": True, "enable_critic_lstm": False},
    ),
}  # fmt: skip


def trained(kind: str, options: Mapping[str, Any], network: Mapping[str, Any]) -> Any:
    """A model after a few steps, so that nothing in it is as it began."""
    from tests.envs.cases import room

    envs = make_sb3(NAME, 2, seed=1, map=room(), **{**OPTIONS, **options})
    arguments = dict(network)
    use_sde = arguments.pop("use_sde", False)
    common: dict[str, Any] = {"seed": 3, "policy_kwargs": arguments, "use_sde": use_sde}
    if kind == "SAC":
        made: Any = SAC(
            "MultiInputPolicy", envs, buffer_size=64, learning_starts=2, batch_size=4, **common
        )
    elif kind == "RecurrentPPO":
        contrib = pytest.importorskip("sb3_contrib")
        made = contrib.RecurrentPPO("MultiInputLstmPolicy", envs, **ROLLOUT, **common)
    else:
        made = PPO("MultiInputPolicy", envs, **ROLLOUT, **common)
    return made.learn(8)


def observations(space: spaces.Dict, count: int = 16) -> dict[str, Any]:
    rng = np.random.default_rng(0)
    return {
        name: rng.uniform(-1.0, 1.0, (count, *part.shape)).astype(np.float32)
        for name, part in space.items()
    }


def same_actions(one: Any, other: Any, seen: dict[str, Any]) -> bool:
    """Three steps, with what a recurrent one remembers."""
    states: list[Any] = [None, None]
    starts = np.ones(len(next(iter(seen.values()))), dtype=bool)
    for _ in range(3):
        both = []
        for k, policy in enumerate((one, other)):
            actions, states[k] = policy.predict(seen, states[k], starts, deterministic=True)
            both.append(actions)
        if not np.array_equal(*both):
            return False
        starts[:] = False
    return True


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_actions_are_those_of_the_model(case: Any, tmp_path: Path) -> None:
    made = trained(*case)
    seen = observations(made.observation_space)
    save_policy(made, tmp_path / "p.zip", environment={"id": NAME, **OPTIONS, **case[1]})
    before = torch.get_rng_state()
    policy = load_policy(tmp_path / "p.zip")
    assert torch.equal(before, torch.get_rng_state())
    assert isinstance(policy, ModelPolicy) and same_actions(made, policy.model, seen)
    # All of it, so that training on begins where it ended.
    state, again = made.policy.state_dict(), policy.model.state_dict()
    assert state.keys() == again.keys()
    assert all(torch.equal(state[name], again[name]) for name in state)


@pytest.mark.parametrize("kind", ["PPO", "SAC", "RecurrentPPO"])
@pytest.mark.parametrize("layers", ["conv", "dense"])
def test_weights_are_counted_before_there_are_any(kind: str, layers: str) -> None:
    parameters = NavigationParameters()
    features = {"kind": "navigation", "scan": layers, "window": layers}
    network: dict[str, Any] = {
        "net_arch": {"pi": [200, 300], "qf" if kind == "SAC" else "vf": [100, 200]},
        "activation": "ReLU",
        "features": features, "share_features_extractor": False, "n_lstm_layers": 2,
        "lstm_hidden_size": 90 if kind == "RecurrentPPO" else None,
    }  # fmt: skip
    observation, action = observation_space(parameters), action_space(parameters)
    options = _options(kind, asked := Network(**network))
    total = sum(one.numel() for one in _make(kind, observation, action, options).parameters())
    # Of convolutions it is a bound.
    most = 1.1 if layers == "dense" else 10.0
    assert 0.98 * total < _count(kind, asked, observation, action) < most * total


@pytest.mark.slow
def test_one_row(tmp_path: Path) -> None:
    """As from `FlattenObservation`, normalised."""
    from gymnasium.wrappers import FlattenObservation
    from stable_baselines3.common.vec_env import DummyVecEnv

    from ambinav_envs.navigation import NavigationEnv
    from tests.envs.cases import room

    envs = VecNormalize(
        DummyVecEnv([lambda: FlattenObservation(NavigationEnv(map=room(), **OPTIONS))])
    )
    made = PPO("MlpPolicy", envs, seed=3, n_steps=8, batch_size=8).learn(8)
    save_policy(made, tmp_path / "p.zip", environment={"id": NAME, **OPTIONS}, normalization=envs)
    policy = load_policy(tmp_path / "p.zip")
    env = NavigationEnv(map=room(), **OPTIONS)
    policy.prepare(env.observation_space, env.action_space)
    seen, _ = env.reset(seed=1)
    row = spaces.flatten(env.observation_space, seen)
    # A row alone would be added up in another order, see `policy.ROWS`.
    rows = np.tile(envs.normalize_obs(row), (ROWS, 1))
    wanted, _ = made.predict(rows, deterministic=True)
    given = {name: part[None] for name, part in seen.items()}
    assert np.array_equal(policy.act(given, np.ones(1, dtype=np.bool_))[0], wanted[0])


class Other(CombinedExtractor):
    """A features extractor of a user's own."""


class Own(MultiInputActorCriticPolicy):
    """A policy of a user's own."""


@pytest.mark.parametrize(
    ("policy", "network", "message"),
    [
        ("MultiInputPolicy", {"features_extractor_class": Other}, "features extractor Other"),
        ("MultiInputPolicy", {"activation_fn": type("Mine", (torch.nn.Tanh,), {})}, "Mine"),
        (Own, {}, "the policy is a Own"),
    ],
)
def test_what_a_file_cannot_hold_is_refused(
    policy: Any, network: dict[str, Any], message: str, tmp_path: Path
) -> None:
    made = PPO(policy, make_sb3(NAME, 2, **OPTIONS), policy_kwargs=network, **ROLLOUT)
    with pytest.raises(InputError, match=message):
        save_policy(made, tmp_path / "p.zip", environment={})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "space",
    [
        spaces.Discrete(9),
        spaces.Box(-1.0, 1.0, (2,), np.float32),
        spaces.Box(np.float32([-np.inf, 1e-7]), np.float32([np.inf, 0.1]), (2,), np.float32),
        spaces.Dict({"b": spaces.Box(0, 1, (3,)), "a": spaces.Box(-np.inf, np.inf, (1,))}),
        spaces.Dict([("z", spaces.Box(0, 1, (3,))), ("a", spaces.Box(0, 0.3, (1,)))]),
    ],
)
def test_spaces_come_back(space: spaces.Space[Any]) -> None:
    space_again = space_of(json.loads(json.dumps(described(space))))
    assert space_again == space and str(space_again) == str(space)
    if isinstance(space, spaces.Box):
        assert isinstance(space_again, spaces.Box)
        assert np.array_equal(space_again.low, space.low)
        assert np.array_equal(space_again.high, space.high)
