"""The public `evaluate`: episodes of a registered id, the same as its environment gives."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import pytest

import ambinav_envs
from ambinav.runtime.errors import InputError
from ambinav_envs.evaluation import UNSEEN
from ambinav_envs.leaderboard.evaluated import COUNT
from tests.envs.test_evaluation import Seeker, driven

ARGUMENTS = {"longest": 8.0, "max_steps": 60}


@pytest.mark.slow
def test_episodes_are_those_of_the_environment() -> None:
    """Of unseen buildings: an episode of the same seed has the same return."""
    done = ambinav_envs.evaluate(Seeker(), "ambinav/Hall-v1", 3, seed=4, **ARGUMENTS)
    env = gym.make(
        "ambinav/Hall-v1", buildings=COUNT, first_building=UNSEEN, waypoint=True, **ARGUMENTS
    )
    for k, seed in enumerate(done.seed.tolist()):
        assert driven(env.unwrapped, seed)["reward"] == pytest.approx(done.reward[k], abs=1e-5)


def test_buildings_and_arguments_can_be_chosen() -> None:
    one = ambinav_envs.evaluate(
        Seeker(), "ambinav/Hall-v1", 4, buildings=1, first_building=7, **ARGUMENTS
    )
    assert len(set(one.building.tolist())) == 1
    with pytest.raises(InputError, match="peple"):
        ambinav_envs.evaluate(Seeker(), "ambinav/Hall-v1", 1, peple=3)
    with pytest.raises(InputError, match=r"ambinav/Nowhere-v1"):
        ambinav_envs.evaluate(Seeker(), "ambinav/Nowhere-v1", 1)


@pytest.mark.parametrize("seed", [-1, 1.5, "a", None, True])
def test_a_bad_seed_is_refused(seed: Any) -> None:
    with pytest.raises(InputError, match=r"seed is .*; give a whole number from 0 on"):
        ambinav_envs.evaluate(Seeker(), "ambinav/Hall-v1", 1, seed=seed, **ARGUMENTS)


@pytest.mark.parametrize("controller", ["vfh", None, object()])
def test_what_cannot_drive_is_refused(controller: Any) -> None:
    with pytest.raises(InputError, match=r"controller is .*; give a policy, as load_policy"):
        ambinav_envs.evaluate(controller, "ambinav/Hall-v1", 1)
