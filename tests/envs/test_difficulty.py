"""A world unlike map and models: each option against what is worked out apart, and the levels."""

from __future__ import annotations

import copy
import math
import pickle
import re
import warnings
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, settings
from hypothesis import strategies as st

import ambinav_envs
from ambinav.drive.clutter import with_obstacles
from ambinav.drive.world import unicycle
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from ambinav_envs.difficulty import LEVELS
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.policy import SEEING
from ambinav_envs.registration import IDS
from ambinav_envs.simulation.layout import ARRIVED, RUNNING
from ambinav_envs.vector import NavigationVectorEnv
from tests.envs.cases import equal, room
from tests.envs.test_tasks import polygon

gym.register_envs(ambinav_envs)
DOCS = Path(__file__).parents[2] / "docs" / "environments.md"
STAND = np.array([-1.0, 0.0], dtype=np.float32)
AHEAD = np.array([1.0, 0.0], dtype=np.float32)
# A laser without noise, so that readings are ranges.
EXACT = RangeScanner.planar(
    RangeSensor(max_range=20.0, std=1e-9, resolution=1e-5, random_share=0.0), 40, 2.0 * math.pi
)
OFF: dict[str, Any] = {
    "walls_std": 0.0, "furniture_std": 0.0, "pose_latency": 0.0, "scan_time": 0.0, "gain_std": 0.0,
    "actuation_std": 0.0, "difficulty": 0,
}  # fmt: skip


def weaving(k: int) -> np.ndarray:
    return np.array([1.0, 0.3 * math.sin(0.4 * k)], dtype=np.float32)


@pytest.mark.slow
def test_options_of_zero_are_none() -> None:
    crowded: dict[str, Any] = {"suite": "office", "buildings": 2, "people": 2, "obstacles": 3}
    for source in ({"map": room()}, crowded):
        env = NavigationEnv(**source)
        plain = NavigationEnv(**source, **OFF)
        equal(env.reset(seed=3), plain.reset(seed=3))
        for k in range(12):
            equal(env.step(weaving(k)), plain.step(weaving(k)))


@pytest.mark.parametrize(("late", "steps"), [(0.1, 1), (0.3, 3), (0.74, 7)])
def test_a_late_pose_is_the_estimate_of_so_many_steps_ago(late: float, steps: int) -> None:
    env = NavigationEnv(map=room(), pose_latency=late, dt=0.1)
    now = NavigationEnv(map=room(), dt=0.1)
    seen, info = env.reset(seed=1)
    prompt = [now.reset(seed=1)[0]]
    equal(seen, prompt[0])
    estimates, goal = [info["estimate"]], env.simulation.state["goal"][0]
    for k in range(25):
        seen, _, done, _, info = env.step(weaving(k))
        prompt.append(now.step(weaving(k))[0])
        estimates.append(info["estimate"])
        x, y, theta = estimates[max(len(estimates) - 1 - steps, 0)]
        away = goal - (x, y)
        bearing = math.atan2(away[1], away[0]) - theta
        wanted = math.hypot(*away) / 10.0, math.cos(bearing), math.sin(bearing)
        np.testing.assert_allclose(seen["goal"], wanted, atol=1e-6)
        # All that is seen from a pose is what who sees it at once saw then; scan and speed are new.
        for part in ("goal", "uncertainty", "window", "waypoint"):
            equal(seen[part], prompt[max(len(prompt) - 1 - steps, 0)][part])
        for part in ("scan", "velocity", "remaining"):
            equal(seen[part], prompt[-1][part])
        assert not done


def test_a_late_pose_lets_the_robot_stop_late() -> None:
    ends = []
    for late in (0.0, 0.4):
        env = NavigationEnv(
            map=room(), localizer="odometry", odometry_scale=0.0, pose_latency=late,
            start_std=(1e-9, 1e-9, 1e-9), dt=0.1,
        )  # fmt: skip
        env.reset(seed=0, options={"start": (1.0, 1.0, 0.0), "goal": (4.0, 1.0)})
        while env.simulation.state["outcome"][0] == RUNNING:
            env.step(AHEAD)
        assert env.simulation.state["outcome"][0] == ARRIVED
        ends.append(int(env.simulation.state["steps"][0]))
    assert ends[1] == ends[0] + 4


def test_who_knows_the_truth_knows_it_at_once() -> None:
    one, other = (
        NavigationEnv(map=room(), localizer="perfect", pose_latency=late) for late in (0.0, 0.5)
    )
    equal(one.reset(seed=2), other.reset(seed=2))
    for k in range(8):
        equal(one.step(weaving(k)), other.step(weaving(k)))


@pytest.mark.parametrize("localizer", ["ekf", "mcl"])
def test_a_late_pose_is_kept_when_a_batch_is_pickled(localizer: str) -> None:
    envs = NavigationVectorEnv(3, map=room(), pose_latency=0.3, localizer=localizer, window=False)
    envs.reset(seed=0)
    for k in range(5):
        envs.step(np.tile(weaving(k), (3, 1)))
    copied = pickle.loads(pickle.dumps(envs))
    for k in range(5):
        equal(envs.step(np.tile(weaving(k), (3, 1))), copied.step(np.tile(weaving(k), (3, 1))))


@pytest.mark.slow
@pytest.mark.parametrize("crowded", [False, True])
def test_beams_of_a_scan_are_taken_from_where_the_robot_was_then(crowded: bool) -> None:
    duration = 0.08
    env = NavigationEnv(
        map=room(), scanner=EXACT, scan_time=duration, localizer="perfect", window=False, dt=0.1,
        obstacles=4 if crowded else 0,
    )  # fmt: skip
    _, info = env.reset(seed=4, options={"start": (9.0, 6.0, 0.5), "goal": (12.0, 6.0)})
    world, moved = room(), 0.0
    if crowded:
        boxes = env.simulation.boxes[0, : env.simulation.state["boxes"][0]]
        assert len(boxes) > 1
        world = with_obstacles(world, [polygon(box) for box in boxes])
    angle = env.simulation.parameters.scanner.mounts[:, 2]
    for k in range(30):
        before = info["true_pose"]
        action = np.array([-1.0 if k < 15 else 0.2, 0.5])
        _, _, _, _, info = env.step(action)
        speed, rate = env.simulation.state["ground"][0]
        for i, reading in enumerate(env.simulation.readings[0]):
            share = (i + 1) / len(angle)
            # From where it was when the step began, along the arc of the step.
            t = env.simulation.parameters.dt - duration * (1.0 - share)
            x, y, theta = unicycle(*before, speed, rate, t)
            if k < 15:
                assert theta == pytest.approx(
                    info["true_pose"][2] - rate * duration * (1.0 - share), abs=1e-9
                )
            wanted = world.cast(x, y, theta + angle[i], 20.0)
            assert reading == pytest.approx(wanted, abs=1e-5)
            instant = world.cast(*info["true_pose"][:2], info["true_pose"][2] + angle[i], 20.0)
            moved = max(moved, abs(float(wanted) - float(instant)))
    assert moved > 0.3


def test_a_scan_of_who_stands_is_not_skewed() -> None:
    readings = []
    for duration in (0.0, 0.3):
        env = NavigationEnv(map=room(), scan_time=duration, window=False, people=2, obstacles=3)
        env.reset(seed=1)
        env.step(STAND)
        readings.append(env.simulation.readings[0].copy())
    np.testing.assert_allclose(*readings, atol=1e-9)


def driven(**options: Any) -> np.ndarray:
    """Speeds and turn rates of 400 robots in 5 steps at half of both, shape (5, 400, 2)."""
    envs = NavigationVectorEnv(
        400, map=room(), localizer="odometry", window=False, robot={"max_speed": 0.5},
        odometry_scale=0.0, **options,
    )  # fmt: skip
    envs.reset(seed=0, options={"start": (2.0, 2.0, 0.3), "goal": (12.0, 10.0)})
    found = []
    for _ in range(8):
        before = envs.simulation.state[["truth", "odometry"]].copy()
        envs.step(np.tile(np.float32([0.0, 0.1]), (400, 1)))
        state = envs.simulation.state
        found.append(state["speeds"].copy())
        # Odometry without errors measures what the wheels do.
        told = np.hypot(*(state["odometry"] - before["odometry"])[:, :2].T)
        gone = np.hypot(*(state["truth"] - before["truth"])[:, :2].T)
        np.testing.assert_allclose(told, gone, atol=1e-12)
    return np.array(found)[3:]


@pytest.mark.slow
def test_wheels_err_by_a_share_in_each_step() -> None:
    commanded = np.array([0.25, 0.2])
    assert np.allclose(driven(), commanded)
    share = driven(actuation_std=0.1) / commanded
    assert share.mean(axis=(0, 1)) == pytest.approx([1.0, 1.0], abs=0.01)
    assert share.std(axis=(0, 1)) == pytest.approx([0.1, 0.1], rel=0.07)
    # Steps, speed and turn rate know nothing of each other.
    mixed = np.corrcoef(share.transpose(0, 2, 1).reshape(10, -1))
    assert np.abs(mixed - np.eye(10)).max() < 0.2


@pytest.mark.slow
def test_wheels_err_by_the_same_share_all_the_episode() -> None:
    share = driven(gain_std=0.1) / np.array([0.25, 0.2])
    assert np.allclose(share, share[0])
    assert share[0].mean(axis=0) == pytest.approx([1.0, 1.0], abs=0.02)
    assert share[0].std(axis=0) == pytest.approx([0.1, 0.1], rel=0.12)
    both = driven(gain_std=0.06, actuation_std=0.08) / np.array([0.25, 0.2])
    assert both.std(axis=(0, 1)) == pytest.approx([0.1, 0.1], rel=0.1)


def test_who_is_told_to_stand_stands() -> None:
    env = NavigationEnv(map=room(), gain_std=0.5, actuation_std=0.5)
    _, info = env.reset(seed=0)
    for _ in range(5):
        assert np.array_equal(env.step(STAND)[4]["true_pose"], info["true_pose"])


@settings(max_examples=12, deadline=None)
@given(
    difficulty=st.integers(0, 3), explicit=st.sets(st.sampled_from(sorted(LEVELS[3])), max_size=4)
)
def test_what_is_given_wins_over_the_level(difficulty: int, explicit: set[str]) -> None:
    plain = NavigationParameters()
    chosen = {name: getattr(plain, name) for name in explicit}
    for made in (
        NavigationParameters(difficulty=difficulty, **chosen),
        NavigationParameters.of({**chosen, "difficulty": difficulty}),
    ):
        level = NavigationParameters.of(dict(LEVELS[difficulty]))
        for item in fields(made):
            if item.name not in ("difficulty", "scanner"):
                wanted = getattr(plain if item.name in explicit else level, item.name)
                assert getattr(made, item.name) == wanted, item.name
        assert made.difficulty == difficulty
        for same in (copy.copy(made), pickle.loads(pickle.dumps(made)), replace(made, dt=0.2)):
            assert all(
                getattr(same, item.name) == getattr(made, item.name)
                for item in fields(made)
                if item.name != "scanner"
            )
    assert replace(NavigationParameters(difficulty=3), obstacles=0).obstacles == 0


def test_levels_rise() -> None:
    assert LEVELS[0] == {}
    plain = NavigationParameters()
    for name in LEVELS[3]:
        rising = [level.get(name, getattr(plain, name)) for level in LEVELS]
        rising[0] = getattr(rising[0], "count", rising[0])
        assert rising == sorted(rising) and rising[3] > rising[2] > rising[0], name


def test_the_table_in_the_docs_is_that_of_the_code() -> None:
    section = DOCS.read_text().partition("## Difficulty")[2].partition("\n\n- ")[0]
    rows = re.findall(r"^\| `(\w+)` \|((?: [\d.]+ \|){4})", section, re.M)
    found = {name: [float(cell) for cell in cells.split("|")[:-1]] for name, cells in rows}
    plain = NavigationParameters()
    wanted = {}
    for name in LEVELS[3]:
        default = getattr(plain, name)
        default = getattr(default, "count", default)
        wanted[name] = [float(level.get(name, default)) for level in LEVELS]
    assert found == wanted


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"difficulty": 4}, "difficulty is 4; give a whole number from 0 to 3"),
        ({"difficulty": 1.5}, "difficulty"),
        ({"dificulty": 1}, "did you mean difficulty"),
        ({"walls_std": 0.3}, "walls_std"),
        ({"furniture_std": -1.0}, "furniture_std"),
        ({"pose_latency": 201.0}, "pose_latency is 201.0; give at most 200 seconds"),
        ({"scan_time": 2.0}, "scan_time"),
        ({"gain_std": -0.1}, "gain_std"),
        ({"actuation_std": math.nan}, "actuation_std"),
    ],
)
def test_what_makes_no_sense_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        NavigationParameters.of(options)


@pytest.mark.slow
@pytest.mark.parametrize("localizer", ["ekf", "mcl"])
def test_a_robot_of_a_batch_is_the_single_one_bit_for_bit(localizer: str) -> None:
    options: dict[str, Any] = {
        "suite": "office", "buildings": 2, "difficulty": 3, "localizer": localizer,
        "window": False, "autoreset_mode": "Disabled", "obstacles": 1,
    }  # fmt: skip
    if localizer == "mcl":
        options["mcl"] = {"min_particles": 100, "max_particles": 100}
    envs = NavigationVectorEnv(4, **options)
    del options["autoreset_mode"]
    alone = [NavigationEnv(**options) for _ in range(4)]
    many, _ = envs.reset(seed=5)
    for i, env in enumerate(alone):
        equal(env.reset(seed=5 + i)[0], {name: part[i] for name, part in many.items()})
    for k in range(20):
        action = np.float32([-0.4, 0.8])
        many, reward, terminated, truncated, _ = envs.step(np.tile(action, (4, 1)))
        for i, env in enumerate(alone):
            seen, own, *_ = env.step(action)
            equal(seen, {name: part[i] for name, part in many.items()})
            assert own == reward[i]
        if (terminated | truncated).any():
            break
        if k == 10:
            envs, alone = pickle.loads(pickle.dumps((envs, alone)))
    assert k > 10


@pytest.mark.parametrize("difficulty", range(4))
@pytest.mark.parametrize("name", ["Office-v1", "Kidnapped-NoMap-v1", "Procedural-TruePose-v1"])
def test_checkers_have_nothing_to_say_at_any_level(name: str, difficulty: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make(f"ambinav/{name}", difficulty=difficulty, buildings=1, max_steps=20)
        check_env(env.unwrapped, skip_render_check=True)
    parameters = env.unwrapped.simulation.parameters  # type: ignore[attr-defined]
    assert parameters.difficulty == difficulty
    assert parameters.obstacles == LEVELS[difficulty].get("obstacles", 0)


@pytest.mark.slow
def test_every_id_and_twin_has_levels() -> None:
    assert not set(LEVELS[3]) & set(SEEING)
    for name, own in IDS.items():
        env, plain = gym.make(name, difficulty=2), gym.make(name)
        assert env.observation_space == plain.observation_space
        p = env.unwrapped.simulation.parameters  # type: ignore[attr-defined]
        for key, value in LEVELS[2].items():
            wanted = own.get(key, value)
            assert getattr(getattr(p, key), "count", getattr(p, key)) == wanted, (name, key)
    many = gym.make_vec("ambinav/Office-NoMap-v1", num_envs=2, difficulty=3, obstacles=1)
    p = many.unwrapped.simulation.parameters  # type: ignore[attr-defined]
    assert (p.difficulty, p.obstacles, p.people.count) == (3, 1, 3)


def test_training_files_and_cards_keep_the_level(tmp_path: Path) -> None:
    pytest.importorskip("torch")
    from ambinav_envs.policies import read_card, save_policy
    from ambinav_envs.policies.card import arguments_of
    from ambinav_envs.scenario import source_of
    from ambinav_envs.training.config_file import parse_config
    from tests.envs.policies.models import model, normalized

    settings = {"id": "ambinav/Office-v1", "buildings": 10, "difficulty": 2}
    config = parse_config({"minutes": 2, "environment": settings}, "here")
    for arguments in (config.arguments, config.judged):
        assert source_of(arguments)[1].walls_std == LEVELS[2]["walls_std"]
    path = tmp_path / "p.zip"
    save_policy(model(normalized(window_cells=16)), path, environment=settings)
    kept = arguments_of(read_card(path))
    assert kept["difficulty"] == 2 and not set(kept) & set(LEVELS[2])
