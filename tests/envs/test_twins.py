"""Twins of the ids: what differs from the id itself, and that nothing else does."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import ambinav_envs
from ambinav.runtime.errors import InputError
from ambinav_envs.leaderboard.evaluated import environment_for
from ambinav_envs.policies import load_policy
from ambinav_envs.policies.file import plain_environment
from ambinav_envs.registration import IDS
from ambinav_envs.twins import TWINS, twins_of
from ambinav_envs.vector import NavigationVectorEnv
from tests.envs.cases import equal, room

gym.register_envs(ambinav_envs)
# Odometry and a start so bad that the estimate is far off in the middle of the room.
HARD: dict[str, Any] = {
    "odometry_scale": 4.0, "start_std": (0.3, 0.3, 0.1), "people": 2, "obstacles": 2,
    "max_steps": 60, "reward": {"progress": 1.0, "ambiguity": 1.0, "error": 1.0, "lost": 1.0},
}  # fmt: skip
PLAIN = [name for name in IDS if name.count("-") == 1]


def rollout(steps: int = 40, **options: Any) -> list[tuple[Any, ...]]:
    """What eight robots in one room see and earn under the same drawn actions."""
    envs = NavigationVectorEnv(8, map=room(), **HARD | options)
    envs.action_space.seed(1)
    return [envs.reset(seed=3), *(envs.step(envs.action_space.sample()) for _ in range(steps))]


def test_every_id_has_both() -> None:
    beliefs = [name for name in IDS if "-Belief-" in name]
    assert len(IDS) == len(PLAIN) * (1 + len(TWINS)) + len(beliefs)
    assert {IDS[name]["belief"] for name in beliefs} == {True}
    for name in PLAIN:
        stem, version = name.rsplit("-", 1)
        assert IDS[f"{stem}-TruePose-{version}"] == IDS[name] | {"localizer": "perfect"}
        assert IDS[f"{stem}-NoMap-{version}"] == IDS[name] | {"ambiguity_seen": False}
    assert twins_of({"a/B-v3": {"suite": "hall"}}).keys() == {"a/B-TruePose-v3", "a/B-NoMap-v3"}


@pytest.mark.parametrize("kind", TWINS)
def test_a_policy_of_an_id_fits_its_twins(kind: str) -> None:
    one, twin = gym.make("ambinav/Hall-v1"), gym.make(f"ambinav/Hall-{kind}-v1")
    assert one.observation_space == twin.observation_space
    assert one.action_space == twin.action_space


def test_with_the_true_pose_nothing_errs() -> None:
    by_estimate, by_truth = rollout(), rollout(**TWINS["TruePose"])
    # The same episodes: walls, boxes, people and noise of the readings at the start.
    equal(by_estimate[0][0]["scan"], by_truth[0][0]["scan"])
    equal(by_estimate[0][1]["true_pose"], by_truth[0][1]["true_pose"])
    assert max(float(info["error"].max()) for *_, info in by_estimate) > 0.5
    for seen, *_, info in by_truth:
        assert np.array_equal(info["estimate"], info["true_pose"])
        assert not info["error"].any() and not info["lost"].any()
        assert not seen["uncertainty"].any()
        assert not info["terms"]["error"].any() and not info["terms"]["lost"].any()


def test_the_goal_is_seen_and_reached_by_the_true_pose() -> None:
    envs = NavigationVectorEnv(8, map=room(), **HARD | TWINS["TruePose"])
    seen, info = envs.reset(seed=3)
    goals = envs.simulation.state["goal"]
    away = np.linalg.norm(goals - info["true_pose"][:, :2], axis=1)
    assert np.allclose(10.0 * seen["goal"][:, 0], away, atol=1e-5)


def test_without_the_map_the_first_half_of_the_window_alone_differs() -> None:
    differ = False
    for one, twin in zip(rollout(), rollout(**TWINS["NoMap"]), strict=True):
        window, bare = one[0].pop("window"), twin[0].pop("window")
        # Everything else to the last bit: the other parts, rewards, ends and info.
        equal(one, twin)
        free = bare[:, 256:]
        assert np.array_equal(free, window[:, 256:])
        assert np.array_equal(bare[:, :256], 1.0 - free)
        differ |= not np.array_equal(bare, window)
    assert differ


def test_without_the_map_another_layer_changes_nothing_that_is_seen() -> None:
    seen = {
        (layer, shown): [
            one[0] for one in rollout(10, layer=layer, ambiguity_seen=shown, waypoint=True)
        ]
        for layer in ("level", "fisher")
        for shown in (True, False)
    }
    equal(seen["level", False], seen["fisher", False])
    assert not np.array_equal(seen["level", True][0]["window"], seen["fisher", True][0]["window"])


def test_a_waypoint_by_the_map_is_refused_without_it() -> None:
    with pytest.raises(InputError, match="ambiguity_weight is 5, by which the waypoint") as caught:
        gym.make("ambinav/Hall-NoMap-v1", ambiguity_weight=5)
    assert "\n" not in str(caught.value)
    gym.make("ambinav/Hall-NoMap-v1")
    # The term `progress` alone follows that route then, and no part of the observation.
    gym.make("ambinav/Hall-NoMap-v1", waypoint=False, ambiguity_weight=5)
    with pytest.raises(InputError, match="ambiguity_seen"):
        gym.make("ambinav/Hall-v1", ambiguity_seen="no")


def test_a_task_hides_the_map_from_policies_that_saw_it() -> None:
    """In evaluations, on leaderboards and in data sets; one trained without it stays without."""
    sighted = load_policy("vfh")
    sighted.environment = {**sighted.environment, "ambiguity_seen": True}
    blind = load_policy("vfh")
    blind.environment = {**blind.environment, "ambiguity_seen": False}
    for name, seen in (("ambinav/Office-NoMap-v1", False), ("ambinav/Office-v1", True)):
        for policy, wanted in ((sighted, seen), (blind, False)):
            given = environment_for(policy, {}, name)
            assert given.get("ambiguity_seen", True) is wanted
            env = gym.make(name, buildings=1, **policy.seeing)
            assert env.unwrapped.simulation.parameters.ambiguity_seen is wanted
    given = environment_for(sighted, {"ambiguity_seen": True}, "ambinav/Office-NoMap-v1")
    assert given["ambiguity_seen"] is True


def test_a_policy_file_says_that_its_policy_saw_no_map() -> None:
    for name, shown in (("ambinav/Hall-NoMap-v1", False), ("ambinav/Hall-v1", True)):
        assert plain_environment({"id": name})["ambiguity_seen"] is shown
    assert plain_environment({"id": "ambinav/Hall-NoMap-v1", "ambiguity_seen": True})[
        "ambiguity_seen"
    ]
