"""The face for Stable-Baselines3: its conventions, held against its own `DummyVecEnv`."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from ambinav.runtime.errors import InputError
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.vector import NavigationVectorEnv
from tests.envs.cases import equal, room

pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecFrameStack, VecMonitor, VecNormalize

from ambinav_envs.sb3 import NavigationVecEnv, infos_of, make_sb3

OPTIONS: dict[str, Any] = {"longest": 8.0, "max_steps": 25, "obstacles": 2}
NAME = "ambinav/Navigation-v1"


@pytest.mark.slow
def test_tells_what_theirs_tells() -> None:
    ours = make_sb3(NAME, 3, seed=6, all_info=True, map=room(), **OPTIONS)
    theirs = DummyVecEnv([lambda: NavigationEnv(map=room(), **OPTIONS)] * 3)
    theirs.seed(6)
    equal(ours.reset(), theirs.reset())
    equal(ours.reset_infos, theirs.reset_infos)
    ends = 0
    rng = np.random.default_rng(0)
    for _ in range(80):
        action = rng.uniform(-1.0, 1.0, (3, 2)).astype(np.float32)
        got, wanted = ours.step(action), theirs.step(action)
        equal(dict(got[0]), dict(wanted[0]))
        equal(got[1:], wanted[1:])
        equal(ours.reset_infos, theirs.reset_infos)
        ends += int(got[2].sum())
    assert ends > 6


def test_short_infos_are_long_at_the_end() -> None:
    envs = VecMonitor(make_sb3(NAME, 4, seed=0, map=room(), **OPTIONS), info_keywords=("outcome",))
    envs.reset()
    ended = []
    for _ in range(26):
        _, _, done, infos = envs.step(np.tile(np.float32([-1.0, 0.5]), (4, 1)))
        for over, info in zip(done, infos, strict=True):
            assert {"cost", "lost", "TimeLimit.truncated"} <= set(info)
            assert over == ("terminal_observation" in info) == ("episode" in info)
            ended += [info] if over else []
    assert [info["episode"]["l"] for info in ended] == [25] * 4
    assert all(info["TimeLimit.truncated"] and info["outcome"] == "timeout" for info in ended)
    assert all(info["is_success"] is False for info in ended)


def test_seeds_and_options_of_each() -> None:
    envs = make_sb3(NAME, 3, map=room(), **OPTIONS)
    envs.seed(4)
    envs.set_options([{"goal": (2.0, 2.0)}, {}, {"goal": (2.0, 2.0)}])
    seen = envs.reset()
    goals = envs.get_attr("simulation")[0].state["goal"]
    assert np.allclose(goals[[0, 2]], 2.0) and not np.allclose(goals[1], 2.0)
    alone = NavigationEnv(map=room(), **OPTIONS)
    for i, options in ((1, {}), (2, {"goal": (2.0, 2.0)})):
        wanted, info = alone.reset(seed=4 + i, options=options)
        equal({key: part[i] for key, part in seen.items()}, wanted)
        equal(envs.reset_infos[i], info)


def test_options_of_each_before_anything_has_begun() -> None:
    """Also around somebody's wrapper, which Gymnasium's own vector runs one by one."""
    register_wrapped = "mine/Doubled-v0"
    gym.register(
        register_wrapped,
        entry_point=lambda **given: gym.wrappers.TransformReward(
            NavigationEnv(map=room(), **OPTIONS, **given), lambda reward: 2.0 * reward
        ),
    )
    try:
        envs = make_sb3(register_wrapped, 3, seed=3)
        envs.set_options([{"goal": (2.0, 2.0)}, {}, {"goal": (2.0, 2.0)}])
        seen = envs.reset()
        alone = NavigationEnv(map=room(), **OPTIONS)
        for i, options in ((0, {"goal": (2.0, 2.0)}), (1, {})):
            wanted, _ = alone.reset(seed=3 + i, options=options)
            equal({key: part[i] for key, part in seen.items()}, wanted)
    finally:
        del gym.registry[register_wrapped]


def test_attributes_and_methods() -> None:
    envs = make_sb3("ambinav/Hall-v1", 2, buildings=1)
    assert envs.get_attr("spec", 1)[0].id == "ambinav/Hall-v1"
    assert envs.get_attr("action_space") == [envs.action_space] * 2
    assert not envs.has_attr("height")
    envs.set_attr("height", 3)
    assert envs.get_attr("height", [0]) == [3]
    assert envs.env_method("get_wrapper_attr", "height") == [3, 3]
    with pytest.raises(InputError, match="indices"):
        envs.set_attr("height", 3, indices=0)
    assert envs.env_is_wrapped(Monitor) == [False, False]
    wrapped = gym.wrappers.vector.RecordEpisodeStatistics(envs.envs)
    assert NavigationVecEnv(wrapped).env_is_wrapped(type(wrapped)) == [True, True]
    envs.close()


def test_tells_what_wrappers_add() -> None:
    inner = NavigationVectorEnv(3, map=room(), autoreset_mode="SameStep", **OPTIONS)
    envs = NavigationVecEnv(gym.wrappers.vector.RecordEpisodeStatistics(inner))
    envs.seed(0)
    envs.reset()
    ended = []
    for _ in range(26):
        _, _, done, infos = envs.step(np.tile(np.float32([-1.0, 0.5]), (3, 1)))
        ended += [info for over, info in zip(done, infos, strict=True) if over]
    assert [info["episode"]["l"] for info in ended] == [25] * 3
    assert all("outcome" in info for info in ended)


@pytest.mark.slow
def test_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    envs = make_sb3(NAME, 2, seed=0, map=room(), render_mode="rgb_array")
    envs.reset()
    picture = envs.render()
    assert picture is not None and picture.shape == (2 * 640, 960, 3)
    assert np.array_equal(envs.env_method("render", indices=1)[0], picture[640:])


def test_other_autoreset_modes_are_refused() -> None:
    with pytest.raises(InputError, match="SameStep"):
        NavigationVecEnv(NavigationVectorEnv(2, map=room()))


@pytest.mark.parametrize("odd", [{"seed": "x"}, {"seed": True}, {"autoreset_mode": "NextStep"}])
def test_odd_arguments_are_named(odd: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=f"^{next(iter(odd))} is "):
        make_sb3(NAME, 2, map=room(), **odd)


def test_infos_without_a_value_leave_the_key_out() -> None:
    info = {"a": np.array([1.0, 2.0]), "_a": np.array([True, False]), "b": {"c": np.arange(2)}}
    assert infos_of(info, [0, 1]) == [{"a": 1.0, "b": {"c": 0}}, {"b": {"c": 1}}]


@pytest.mark.slow
@pytest.mark.parametrize("discrete", [False, True])
def test_an_agent_trains(discrete: bool) -> None:
    envs = make_sb3(NAME, 4, seed=0, map=room(), discrete=discrete, **OPTIONS)
    stacked = VecFrameStack(VecNormalize(VecMonitor(envs)), 2)
    agent = PPO("MultiInputPolicy", stacked, n_steps=32, batch_size=32, n_epochs=1, seed=0)
    agent.learn(256)
    assert len(agent.ep_info_buffer or ()) > 0
