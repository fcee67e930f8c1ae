"""Wrappers: Gymnasium's own on the single and the batched environment, and stacks of both."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv
from gymnasium.wrappers import FilterObservation, FlattenObservation, FrameStackObservation
from gymnasium.wrappers import vector as many

from ambinav.runtime.errors import InputError
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.vector import NavigationVectorEnv
from ambinav_envs.wrappers import GOAL_ONLY, Filtered, Flat, FrameStack
from tests.envs.cases import equal, room

OPTIONS: dict[str, Any] = {"longest": 8.0, "max_steps": 12, "obstacles": 2}
MODES = ("NextStep", "SameStep")


def batched(mode: str = "NextStep") -> NavigationVectorEnv:
    return NavigationVectorEnv(3, map=room(), autoreset_mode=mode, **OPTIONS)


def single() -> NavigationEnv:
    return NavigationEnv(map=room(), **OPTIONS)


def same(envs: Any, others: Any) -> None:
    """Assert that both tell the same over some episodes."""
    assert envs.observation_space == others.observation_space
    equal(envs.reset(seed=2), others.reset(seed=2))
    for action in np.random.default_rng(1).uniform(-1.0, 1.0, (30, 3, 2)).astype(np.float32):
        got, wanted = envs.step(action), others.step(action)
        equal(got, wanted)
        assert envs.observation_space.contains(got[0])


@pytest.mark.parametrize("mode", MODES)
def test_stacks_are_those_of_single_environments(mode: str) -> None:
    stacks = SyncVectorEnv([lambda: FrameStackObservation(single(), 4)] * 3, autoreset_mode=mode)
    same(FrameStack(batched(mode), 4), stacks)


def test_stacks_begin_anew_where_the_mask_says() -> None:
    envs = FrameStack(batched("Disabled"), 3)
    envs.reset(seed=0)
    for _ in range(3):
        before, *_ = envs.step(np.ones((3, 2), dtype=np.float32))
    mask = np.array([True, False, False])
    after, _ = envs.reset(options={"reset_mask": mask})
    equal({k: v[1:] for k, v in after.items()}, {k: v[1:] for k, v in before.items()})
    assert (after["scan"][0] == after["scan"][0, :1]).all()


def test_what_was_given_out_stays_as_it_is() -> None:
    envs = FrameStack(batched(), 2)
    seen, _ = envs.reset(seed=0)
    kept = {key: part.copy() for key, part in seen.items()}
    envs.step(np.ones((3, 2), dtype=np.float32))
    equal(seen, kept)


def test_a_mask_may_be_a_list() -> None:
    a, b = (FrameStack(batched("Disabled"), 3) for _ in range(2))
    equal(a.reset(seed=0), b.reset(seed=0))
    mask = [True, False, True]
    equal(a.reset(options={"reset_mask": mask}), b.reset(options={"reset_mask": np.array(mask)}))


@pytest.mark.parametrize("mode", MODES)
def test_goal_only(mode: str) -> None:
    alone = SyncVectorEnv([lambda: FilterObservation(single(), GOAL_ONLY)] * 3, autoreset_mode=mode)
    envs = Filtered(batched(mode), GOAL_ONLY)
    assert set(envs.single_observation_space) == set(GOAL_ONLY)
    same(envs, alone)


@pytest.mark.parametrize("mode", MODES)
def test_flat(mode: str) -> None:
    alone = SyncVectorEnv([lambda: FlattenObservation(single())] * 3, autoreset_mode=mode)
    envs = Flat(batched(mode))
    assert envs.single_observation_space.shape == (60 + 3 + 2 + 5 + 512 + 3 + 1,)
    same(envs, alone)


@pytest.mark.slow
def test_gymnasiums_own_give_the_same() -> None:
    same(Filtered(batched(), GOAL_ONLY), many.FilterObservation(batched(), GOAL_ONLY))
    same(Flat(batched()), many.FlattenObservation(batched()))


def test_stacked_then_flat() -> None:
    envs = Flat(FrameStack(Filtered(batched("SameStep")), 3))
    seen, _ = envs.reset(seed=0)
    assert seen.shape == (3, 15) and envs.observation_space.contains(seen)


def test_statistics() -> None:
    envs = many.RecordEpisodeStatistics(FrameStack(batched(), 2))
    envs.reset(seed=0)
    for _ in range(12):
        *_, info = envs.step(np.tile(np.float32([-1.0, 0.5]), (3, 1)))
    assert info["episode"]["l"].tolist() == [12] * 3


def test_bad_input_is_refused() -> None:
    with pytest.raises(InputError, match="frames"):
        FrameStack(batched(), 0)
    with pytest.raises(InputError, match="did you mean goal"):
        Filtered(batched(), ["gaol"])
    with pytest.raises(InputError, match="keys is empty; give some of "):
        Filtered(batched(), ())
    with pytest.raises(InputError, match="the observation is a Box; give"):
        Flat(Flat(batched()))
    with pytest.raises(InputError, match="Dict of Box"):
        FrameStack(gym.make_vec("CartPole-v1", num_envs=2), 2)
