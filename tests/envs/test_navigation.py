"""The single environment as Gymnasium and Stable-Baselines3 want it, and what it refuses."""

from __future__ import annotations

import math
import pickle
from typing import Any

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

from ambinav.runtime.errors import InputError
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.rewards import PRESETS, REWARD_TERMS, TERMS, weights_of
from ambinav_envs.spaces import ACTIONS
from tests.envs.cases import equal, room

SCENES: list[dict[str, Any]] = [
    {},
    {"discrete": True, "window": False},
    {"people": 3, "obstacles": 4, "waypoint": True, "min_speed": -0.2},
    {"localizer": "perfect", "reward": "error"},
]


@pytest.mark.parametrize("scene", SCENES)
def test_checkers_have_nothing_to_say(scene: dict[str, Any]) -> None:
    stable_baselines = pytest.importorskip("stable_baselines3.common.env_checker")
    check_env(NavigationEnv(map=room(), **scene), skip_render_check=True)
    stable_baselines.check_env(NavigationEnv(map=room(), **scene))


def test_same_seed_same_episode_and_the_next_one_too() -> None:
    a, b = NavigationEnv(map=room(), people=2), NavigationEnv(map=room(), people=2)
    rng = np.random.default_rng(0)
    for seed in (4, None, None):
        equal(a.reset(seed=seed), b.reset(seed=seed))
        for _ in range(10):
            action = rng.uniform(-1.0, 1.0, 2)
            equal(a.step(action), b.step(action))
    first = a.reset(seed=4)
    a.reset()
    equal(a.reset(seed=4), first)


def test_layers_that_no_map_has_by_itself_are_made() -> None:
    env = NavigationEnv(map=room(), layer="position")
    seen, _ = env.reset(seed=0)
    amap = env.simulation.sites[0].building.amap  # type: ignore[union-attr]
    assert "position" in amap.layers
    level, _ = NavigationEnv(map=room()).reset(seed=0)
    assert not np.array_equal(seen["window"], level["window"])


def test_streams_are_apart() -> None:
    # What one part draws changes nothing for the others.
    plain, full = NavigationEnv(map=room()), NavigationEnv(map=room(), people=3, obstacles=2)
    far = {"start": (1.0, 1.0, 0.0), "goal": (4.0, 1.0)}
    _, a = plain.reset(seed=1, options=far)
    _, b = full.reset(seed=1, options=far)
    for _ in range(10):
        *_, a = plain.step(np.array([-1.0, 0.3]))
        *_, b = full.step(np.array([-1.0, 0.3]))
    assert np.array_equal(a["true_pose"], b["true_pose"])
    assert np.array_equal(a["odometry"], b["odometry"])


def test_discrete_actions_are_continuous_ones() -> None:
    one, other = (NavigationEnv(map=room(), discrete=d) for d in (False, True))
    equal(one.reset(seed=0), other.reset(seed=0))
    for k, (speed, turn) in enumerate(ACTIONS):
        equal(one.step(np.array([2.0 * speed - 1.0, turn])), other.step(k))
    assert other.action_space.n == 9


def test_actions_beyond_the_limits_are_cut_off() -> None:
    one, other = NavigationEnv(map=room()), NavigationEnv(map=room())
    equal(one.reset(seed=0), other.reset(seed=0))
    equal(one.step(np.array([1.0, -1.0])), other.step(np.array([5.0, -1e9])))


def test_options_place_the_robot() -> None:
    env = NavigationEnv(map=room())
    seen, info = env.reset(seed=0, options={"start": (2.0, 3.0, 0.5), "goal": (2.0, 8.0)})
    assert np.allclose(info["true_pose"], (2.0, 3.0, 0.5))
    assert seen["goal"][0] == pytest.approx(0.5, abs=0.05)
    angle = math.atan2(seen["goal"][2], seen["goal"][1])
    assert angle == pytest.approx(math.pi / 2 - 0.5, abs=0.1)
    building = env.simulation.sites[0]
    assert building is not None
    env.reset(options={"building": building.building.key})
    # Arrays and NumPy's numbers are as good.
    ends = {"start": np.array((2.0, 3.0, 0.5)), "goal": np.array((2.0, 8.0))}
    equal(env.reset(seed=0, options=ends | {"building": np.int64(0)}), (seen, info))


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"begin": (0, 0, 0)}, "did you mean|choose from"),
        ({"start": (5.5, 6.0, 0.0)}, "start"),
        ({"start": (1.0, 1.0)}, "start"),
        ({"start": (5.0 + 1j, 6.0, 0.0)}, "start is .*give 3 numbers"),
        ({"goal": (math.nan, 1.0)}, "goal"),
        ({"goal": (40.0, 1.0)}, "outside"),
        ({"building": 17}, "building"),
        ("start", "options is 'start'; give a mapping"),
    ],
)
def test_bad_options_are_refused(options: Any, what: str) -> None:
    env = NavigationEnv(map=room())
    env.reset(seed=0)
    with pytest.raises(InputError, match=what):
        env.reset(seed=0, options=options)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(2))


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"rewards": "shortest"}, "did you mean reward"),
        ({"reward": "ambigious"}, "did you mean ambiguity"),
        ({"reward": {"progres": 1.0}}, "did you mean progress"),
        ({"reward": {"progress": math.nan}}, "progress"),
        ({"localizer": "kalman"}, "localizer"),
        ({"scanner": "hokuyo"}, "hokuyo"),
        ({"scanner": 3}, "scanner"),
        ({"robot": {"radius": -1.0}}, "radius"),
        ({"robot": {"size": 1.0}}, "size"),
        ({"odometry": {"alpha9": 1.0}}, "did you mean"),
        ({"people": -1}, "people"),
        ({"people": True}, "people"),
        ({"obstacles": -1}, "obstacles"),
        ({"obstacle_sizes": (0.8, 0.3)}, "obstacle_sizes"),
        ({"dt": 0.0}, "dt"),
        ({"min_speed": 0.1}, "min_speed"),
        ({"window": 1}, "window"),
        ({"window_cells": 0}, "window_cells"),
        ({"gamma": 1.5}, "gamma"),
        ({"shortest": 5.0, "longest": 4.0}, "longest"),
        ({"start_std": (0.1, 0.1)}, "start_std"),
        ({"start_std": (0.1, 0.0, 0.1)}, "start_std"),
        ({"start_std": np.array(0.1)}, "start_std is 0.1; give 3 numbers"),
        ({"start_std": [[0.1], [0.1, 0.1], 0.1]}, "start_std"),
        ({"success_radius": 0.1}, "success_radius"),
        ({"layer": "zone"}, "zone"),
        ({"layer": "levle"}, "^layer 'levle' is unknown; did you mean level"),
        ({"suite": "hall"}, "^suite is 'hall', .* and map is given too; give one of the two"),
        ({"buildings": 0}, "buildings is 0"),
        ({"first_building": 1}, "first_building 1"),
        ({"first_building": 0.5}, "first_building 0.5"),
        ({"scanner": np.ones((50, 50))}, "scanner is of the type ndarray"),
        ({"mcl": {"max_particles": 0}}, "^mcl: max_particles is 0"),
        ({"mcl": {"max_particle": 9}}, "^mcl: the key 'max_particle' is unknown; did you mean"),
        ({"localizer": "mcl", "mcl": {"laser_min_range": 99.0}}, "^mcl: laser_min_range is 99"),
        ({"window_cells": 257}, "window_cells is 257; give a whole number from 1 to 256"),
        ({"obstacles": 1001}, "obstacles is 1001; give a whole number from 0 to 1000"),
        ({"people": 1001}, "people are 1001; give at most 1000"),
        (
            {"max_steps": 10**9 + 1},
            "max_steps is 1000000001; give a whole number from 1 to 1000000000",
        ),
        ({"iterations": 10**30}, "iterations is 10*; give a whole number from 1 to 1000"),
        ({"max_episode_steps": 0}, "max_steps"),
        ({"robot": {"radius": 7.0}}, "room"),
        ({"shortest": 100.0, "longest": 200.0}, "100"),
    ],
)
def test_bad_arguments_are_refused(options: dict[str, Any], what: str) -> None:
    with pytest.raises(InputError, match=what) as caught:
        NavigationEnv(map=room(), **options).reset(seed=0)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "what"),
    [
        ({"map": "hall"}, "map is 'hall', which is a suite; give suite='hall'"),
        ({"map": "nowhere"}, "nowhere: the suffix"),
        ({"map": 3}, "map is of the type int"),
        ({"suite": "hal"}, "there is no suite 'hal'; did you mean hall"),
        ({"suite": "a/hall"}, "no suite 'a/hall'"),
        ({"suite": "hall.yaml"}, "suite is 'hall.yaml', which is a file's name; give it as map"),
        ({"suite": room()}, "suite is of the type Environment; give a suite's name, or map"),
    ],
)
def test_a_suite_is_a_name_and_a_map_a_file(options: dict[str, Any], what: str) -> None:
    with pytest.raises(InputError, match=what):
        NavigationEnv(**options)


@pytest.mark.parametrize("seed", [1.5, -1, True, "1", [1]])
def test_bad_seeds_are_refused(seed: Any) -> None:
    env = NavigationEnv(map=room())
    with pytest.raises(InputError, match=r"seed is .*; give a whole number from 0 on\.$"):
        env.reset(seed=seed)


def test_bad_actions_are_refused() -> None:
    env = NavigationEnv(map=room())
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(2))
    env.reset(seed=0)
    for wrong in (np.zeros(3), np.zeros((1, 2)), 1.0, [math.nan, 0.0], [math.inf, 0.0], "go", None):
        with pytest.raises(InputError, match="action"):
            env.step(wrong)
    env = NavigationEnv(map=room(), discrete=True)
    env.reset(seed=0)
    for number in (9, -1, 0.5, [1]):
        with pytest.raises(InputError, match="action"):
            env.step(number)


def test_weights_by_name() -> None:
    assert REWARD_TERMS.names() == TERMS
    assert all(set(preset) <= set(TERMS) for preset in PRESETS.values())
    assert tuple(weights_of({"time": 2}).values()) == (0.0,) * 4 + (2.0,) + (0.0,) * 5
    assert weights_of("shortest")["ambiguity"] == 0.0 < weights_of("ambiguity")["ambiguity"]


def test_parameters_from_plain_values() -> None:
    p = NavigationParameters.of(
        {"scanner": "rplidar-a1", "robot": {"radius": 0.3}, "people": {"count": 2, "speed": 0.5}}
    )
    assert p.scanner.beams > 0 and p.robot.radius == 0.3 and p.people.speed == 0.5
    numbers = NavigationParameters(
        people=np.int64(2), obstacles=np.int32(3), window=np.bool_(False),
        start_std=np.array([0.1, 0.1, 0.05]), obstacle_sizes=np.array([0.2, 0.4]),
    )  # fmt: skip
    plain = NavigationParameters(
        people=2, obstacles=3, window=False, start_std=(0.1, 0.1, 0.05), obstacle_sizes=(0.2, 0.4)
    )  # type: ignore[arg-type]
    assert repr(numbers) == repr(plain)
    assert pickle.loads(pickle.dumps(p)) == p
