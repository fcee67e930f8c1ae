"""Every registered id: checkers, seeds, pickles, specs, vectors; a warning is an error."""

from __future__ import annotations

import json
import pickle
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.env_match import check_environments_match

import ambinav_envs
from ambinav.runtime.errors import InputError
from ambinav_envs.buildings.suites import SUITES
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.registration import IDS, register_envs
from ambinav_envs.tasks import SUITES_WITH_IDS
from ambinav_envs.vector import NavigationVectorEnv
from tests.envs.cases import equal

gym.register_envs(ambinav_envs)
# One building of each, so that its map is made once.
FEW: dict[str, Any] = {"buildings": 1, "max_steps": 30}
KEPT = (
    "ambinav/Procedural-v1", "ambinav/Kidnapped-NoMap-v1", "ambinav/Loop-TruePose-v1",
    "ambinav/TwinRooms5-v3",
)  # fmt: skip
# Suites, and twins of an id, differ by one argument: offices stand for the others. Of the twin
# rooms the last have whatever the others have.
OTHERS = ("Hall", "Corridor", "Warehouse", "Loop", "Procedural", "TwinRooms")
EVERY = [
    pytest.param(name, marks=pytest.mark.slow if name in KEPT else pytest.mark.sweep)
    if "Office" not in name and (name.count("-") > 1 or any(suite in name for suite in OTHERS))
    else name
    for name in IDS
]


@pytest.fixture(autouse=True)
def strict(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def make(name: str, **options: Any) -> Any:
    return gym.make(name, **FEW | options)


def test_every_suite_has_an_id() -> None:
    # But for the one that is there to train in beside others, the leaderboard's, and tasks'.
    others = ("cluttered", "standard", "twin-rooms-seen", "twin-rooms", "triple-rooms")
    assert set(SUITES.names()) == {*SUITES_WITH_IDS, *others}
    assert set(IDS) <= set(gym.registry)
    # A limit of the id's would hold whatever `max_steps` says.
    assert all(gym.spec(name).max_episode_steps is None for name in IDS)


@pytest.mark.parametrize("steps", [7, 1000])
def test_the_limit_is_in_the_spec(steps: int) -> None:
    env = gym.make("ambinav/Hall-v1", longest=4.0, buildings=1, max_steps=steps)
    assert env.spec is not None and env.spec.max_episode_steps == steps
    aware = gym.wrappers.TimeAwareObservation(env, flatten=False, normalize_time=True)
    assert aware.max_timesteps == steps
    again = gym.make(env.spec)
    assert again.spec == env.spec
    many = gym.make_vec("ambinav/Hall-v1", num_envs=2, buildings=1, max_steps=steps)
    assert many.spec is not None and many.spec.max_episode_steps == steps
    assert gym.make("ambinav/Hall-v1").spec.max_episode_steps == 300  # type: ignore[union-attr]
    if steps > 10:
        return
    for each in (aware, gym.wrappers.TimeAwareObservation(again, flatten=False)):
        each.reset(seed=0)
        for k in range(steps):
            seen, _, ended, truncated, info = each.step(np.float32([-1.0, 0.0]))
            assert not ended and truncated is (k == steps - 1)
        assert info["outcome"] == "timeout" and seen["time"] in (1.0, steps)
    # Gymnasium's own limit can only be the shorter one, and is in the spec too.
    short = gym.make("ambinav/Hall-v1", buildings=1, max_episode_steps=5)
    assert short.spec is not None and short.spec.max_episode_steps == 5


def test_only_where_no_suite_is_named_are_buildings_new_in_every_episode() -> None:
    held = {name: gym.make(name).unwrapped.simulation.source.count for name in IDS}
    new = {name for name in IDS if name.startswith("ambinav/Navigation-")}
    assert {name for name, count in held.items() if count is None} == new
    assert gym.make("ambinav/Hall-v1", buildings=None).unwrapped.simulation.source.count is None


def test_registering_again_changes_nothing() -> None:
    before = {name: gym.registry[name] for name in IDS}
    register_envs()
    assert all(gym.registry[name] is spec for name, spec in before.items())


@pytest.mark.slow
def test_registering_is_cheap_and_an_id_can_name_the_module() -> None:
    code = (
        "import sys, ambinav_envs, gymnasium as gym\n"
        "assert not {'numba', 'matplotlib', 'torch', 'pygame'} & set(sys.modules)\n"
        "print(gym.spec('ambinav/Hall-v1').kwargs)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "{'suite': 'hall', 'buildings': 64}"
    assert isinstance(gym.make("ambinav_envs:ambinav/Hall-v1").unwrapped, NavigationEnv)


@pytest.mark.parametrize("name", EVERY)
def test_checkers_have_nothing_to_say(name: str) -> None:
    stable_baselines = pytest.importorskip("stable_baselines3.common.env_checker")
    check_env(make(name).unwrapped, skip_render_check=True)
    stable_baselines.check_env(make(name))


@pytest.mark.slow
def test_all_render_modes_pass_the_checker() -> None:
    check_env(make("ambinav/Office-v1").unwrapped)


@pytest.mark.parametrize("name", EVERY)
def test_same_seed_same_episodes(name: str) -> None:
    one, other = make(name), make(name)
    check_environments_match(one, other, num_steps=40, seed=3)
    one.reset(seed=1)
    copy = pickle.loads(pickle.dumps(one))
    size = (5, *one.action_space.shape)
    for action in np.random.default_rng(0).uniform(-1.0, 1.0, size).astype(np.float32):
        result = one.step(action)
        equal(result, copy.step(action))
        if result[2]:
            break


@pytest.mark.parametrize("name", EVERY)
def test_spec_to_json_and_back(name: str) -> None:
    env = make(name, reward="shortest", odometry_scale=2.0)
    text = env.spec.to_json()
    assert json.loads(text)["id"] == name
    spec = gym.envs.registration.EnvSpec.from_json(text)
    assert spec.kwargs == env.spec.kwargs
    equal(gym.make(spec).reset(seed=0), env.reset(seed=0))


@pytest.mark.slow
@pytest.mark.parametrize("name", EVERY)
def test_made_as_a_vector(name: str) -> None:
    many = gym.make_vec(name, num_envs=3, vectorization_mode="vector_entry_point", **FEW)
    assert isinstance(many.unwrapped, NavigationVectorEnv)
    assert gym.envs.registration.EnvSpec.from_json(many.spec.to_json()).id == name
    loose = gym.make_vec(name, num_envs=3, vectorization_mode="sync", **FEW)
    equal(many.reset(seed=0), loose.reset(seed=0))
    action = np.zeros(many.action_space.shape, dtype=np.float32)
    equal(many.step(action), loose.step(action))
    many.close()
    for mode in gym.vector.AutoresetMode:
        other = gym.make_vec(name, 2, "vector_entry_point", autoreset_mode=mode.value, **FEW)
        assert other.metadata["autoreset_mode"] is mode


def test_discrete_actions_are_an_argument() -> None:
    env = make("ambinav/Office-v1", discrete=True)
    check_env(env.unwrapped, skip_render_check=True)
    assert env.action_space == gym.spaces.Discrete(9)


@pytest.mark.slow
def test_a_map_is_an_argument() -> None:
    demo = Path(__file__).parents[2] / "configs" / "demo.geojson"
    env = gym.make("ambinav/Navigation-v1", map=str(demo), max_steps=3)
    env.reset(seed=0)
    assert env.unwrapped.simulation.source.name == "demo"
    assert [env.step(np.zeros(2, dtype=np.float32))[3] for _ in range(3)][-1]


def test_what_cannot_be_made_is_refused() -> None:
    with pytest.raises(gym.error.NameNotFound, match="Office"):
        gym.make("ambinav/Ofice-v1")
    with pytest.raises(gym.error.VersionNotFound):
        gym.make("ambinav/Office-v7")
    with pytest.raises(InputError, match="give one of the two"):
        make("ambinav/Office-v1", map="configs/demo.geojson")
    with pytest.raises(InputError, match="did you mean"):
        gym.make("ambinav/Navigation-v1", suite="ofice")


def test_the_docstring_has_the_usual_headings() -> None:
    text = NavigationEnv.__doc__ or ""
    places = [
        text.index(f"## {heading}\n")
        for heading in (
            "Description", "Action Space", "Observation Space", "Rewards", "Starting State",
            "Episode End", "Arguments", "Version History",
        )
    ]  # fmt: skip
    assert places == sorted(places)


def test_importing_without_gymnasium_says_what_to_install() -> None:
    code = "import sys; sys.modules['gymnasium'] = None; import ambinav_envs"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    last = done.stderr.strip().splitlines()[-1]
    assert done.returncode and last == (
        "ImportError: ambinav_envs needs the package gymnasium, which is not installed; run "
        '`pip install "ambinav[envs]"`.'
    )
