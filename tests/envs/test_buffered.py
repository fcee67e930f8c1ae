"""Steps into the caller's arrays are those of the vector environment."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from ambinav.runtime.errors import InputError
from ambinav_envs import BufferedEnv, Flat

ROBOTS = 5


def robots(**arguments: Any) -> gym.vector.VectorEnv[Any, Any, Any]:
    arguments = {"autoreset_mode": "SameStep", "buildings": 1, "max_steps": 12, **arguments}
    return gym.make_vec("ambinav/Hall-v1", ROBOTS, **arguments)


@pytest.mark.parametrize("halves", [False, True])
@pytest.mark.parametrize("discrete", [False, True])
def test_buffered_steps_are_those_of_the_vector_environment(halves: bool, discrete: bool) -> None:
    plain, buffered = Flat(robots(discrete=discrete)), BufferedEnv(robots(discrete=discrete))
    assert buffered.single_observation_space == plain.single_observation_space
    assert buffered.single_action_space == plain.single_action_space
    arrays = [buffered.observations, buffered.rewards, buffered.terminals, buffered.truncations]
    seen, _ = plain.reset(seed=3)
    first, infos = buffered.reset(seed=3)
    np.testing.assert_array_equal(first, seen)
    assert infos == []
    plain.action_space.seed(1)
    ended = 0
    for _ in range(40):
        actions = plain.action_space.sample()
        seen, rewards, terminated, truncated, info = plain.step(actions)
        if halves:
            buffered.send(actions)
            # The caller may use its array again at once.
            actions[:] = 0
            result = buffered.recv()
        else:
            result = buffered.step(actions)
        assert all(array is mine for array, mine in zip(result[:4], arrays, strict=True))
        np.testing.assert_array_equal(result[0], seen)
        np.testing.assert_array_equal(result[1], rewards.astype(np.float32))
        np.testing.assert_array_equal(result[2], terminated)
        np.testing.assert_array_equal(result[3], truncated)
        done = terminated | truncated
        assert len(result[4]) == done.any()
        if done.any():
            success = info["final_info"]["is_success"][done].mean()
            assert result[4] == [{"episodes": done.sum(), "is_success": success}]
            ended += int(done.sum())
    assert ended >= 3 * ROBOTS
    buffered.close()


def test_the_caller_can_give_the_arrays() -> None:
    size = BufferedEnv(robots()).single_observation_space.shape[0]
    # Columns of a larger array, as in memory that several environments share.
    shared = np.full((2 * ROBOTS, size), np.nan, np.float32)
    given = {
        "observations": shared[ROBOTS:],
        "rewards": np.full(ROBOTS, np.nan, np.float32),
        "terminals": np.ones(ROBOTS, np.bool_),
        "truncations": np.ones(ROBOTS, np.bool_),
    }
    buffered = BufferedEnv(robots(), given)
    seen, _ = buffered.reset(seed=1)
    assert np.shares_memory(seen, shared)
    assert np.isfinite(shared[ROBOTS:]).all()
    assert np.isnan(shared[:ROBOTS]).all()
    assert not given["rewards"].any()
    assert not given["terminals"].any()


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("rewards", np.zeros(ROBOTS), "buffers: rewards is float64 of the shape (5,); give"),
        ("terminals", np.zeros(1, np.bool_), "buffers: terminals is bool of the shape (1,); give"),
        ("observations", None, "buffers: observations is None; give an array of float32"),
    ],
)
def test_arrays_of_another_kind_are_refused(name: str, value: Any, expected: str) -> None:
    fitting = BufferedEnv(robots())
    arrays = {key: getattr(fitting, key) for key in ("observations", "rewards")}
    arrays |= {key: getattr(fitting, key) for key in ("terminals", "truncations")}
    with pytest.raises(InputError) as refused:
        BufferedEnv(robots(), {**arrays, name: value})
    assert expected in str(refused.value)


def test_read_only_arrays_and_other_modes_are_refused() -> None:
    fitting = BufferedEnv(robots())
    names = ("observations", "rewards", "terminals", "truncations")
    arrays = {name: getattr(fitting, name) for name in names}
    arrays["rewards"].flags.writeable = False
    with pytest.raises(InputError, match=r"rewards is float32 of the shape .*, read-only; give"):
        BufferedEnv(robots(), arrays)
    with pytest.raises(InputError, match="autoreset_mode is 'NextStep'; give"):
        BufferedEnv(robots(autoreset_mode="NextStep"))


def test_halves_of_a_step_come_in_turn() -> None:
    buffered = BufferedEnv(robots())
    with pytest.raises(ResetNeeded, match="call send first"):
        buffered.recv()
    buffered.reset(seed=1)
    actions = np.zeros((ROBOTS, 2), np.float32)
    buffered.send(actions)
    for call in (lambda: buffered.send(actions), lambda: buffered.step(actions), buffered.reset):
        with pytest.raises(InputError, match="call recv first"):
            call()
    buffered.recv()
    buffered.send(np.full((ROBOTS, 2), np.nan))
    with pytest.raises(InputError):
        buffered.recv()
    # The environment goes on.
    buffered.step(actions)
    buffered.close()
