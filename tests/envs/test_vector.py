"""Many robots at once: the single environment's numbers bit for bit, whatever happens."""

from __future__ import annotations

import hashlib
import pickle
import subprocess
import sys
from typing import Any

import gymnasium
import numba
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import DictInfoToList, RecordEpisodeStatistics

from ambinav.errors import InputError
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.vector import NavigationVectorEnv
from tests.envs.cases import equal, room

# Short episodes with all that can be in a scene.
OPTIONS: dict[str, Any] = {
    "longest": 8.0, "max_steps": 40, "people": 2, "obstacles": 3, "waypoint": True,
    "odometry_scale": 2.0,
}  # fmt: skip
# Enough for the kernel that uses threads.
COUNT = 20


def actions(count: int, steps: int, seed: int = 0) -> Any:
    return np.random.default_rng(seed).uniform(-1, 1, (steps, count, 2)).astype(np.float32)


def digest(envs: NavigationVectorEnv, steps: int) -> str:
    """All that an episode tells, in one number."""
    total = hashlib.sha256()

    def add(part: Any) -> None:
        if isinstance(part, dict):
            for key in sorted(part):
                total.update(key.encode())
                add(part[key])
        elif part.dtype == object:
            total.update(repr(list(part)).encode())
        else:
            total.update(np.ascontiguousarray(part).tobytes())

    for part in envs.reset(seed=7):
        add(part)
    for action in actions(envs.num_envs, steps):
        for part in envs.step(action):
            add(part)
    return total.hexdigest()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("localizer", ["ekf", "odometry"])
def test_is_the_single_environment_many_times(mode: str, localizer: str) -> None:
    options = OPTIONS | {"map": room(), "localizer": localizer}
    many = NavigationVectorEnv(COUNT, autoreset_mode=mode, **options)
    single = SyncVectorEnv([lambda: NavigationEnv(**options)] * COUNT, autoreset_mode=mode)
    assert many.observation_space == single.observation_space
    assert many.action_space == single.action_space
    assert many.metadata == single.metadata
    equal(many.reset(seed=5), single.reset(seed=5))
    ends = 0
    for action in actions(COUNT, 100):
        got, wanted = many.step(action), single.step(action)
        equal(got, wanted)
        ends += int(got[2].sum() + got[3].sum())
        assert many.observation_space.contains(got[0])
    assert ends > COUNT


def test_particle_filters_are_the_single_environment_too() -> None:
    mcl = {"max_particles": 200, "min_particles": 100}
    options: dict[str, Any] = {"map": room(), "localizer": "mcl", "mcl": mcl, "max_steps": 15}
    many = NavigationVectorEnv(3, **options)
    single = SyncVectorEnv([lambda: NavigationEnv(**options)] * 3)
    equal(many.reset(seed=1), single.reset(seed=1))
    for action in actions(3, 40):
        equal(many.step(action), single.step(action))
    assert many.simulation.state["covariance"].max() > 0.0


def test_neither_number_nor_threads_change_a_bit() -> None:
    few = NavigationVectorEnv(3, map=room(), **OPTIONS)
    many = NavigationVectorEnv(40, map=room(), **OPTIONS)
    chosen = actions(40, 60)
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = digest(NavigationVectorEnv(40, map=room(), **OPTIONS), 60)
        numba.set_num_threads(before)
        assert digest(NavigationVectorEnv(40, map=room(), **OPTIONS), 60) == alone
    finally:
        numba.set_num_threads(before)
    few.reset(seed=7)
    many.reset(seed=7)
    for action in chosen:
        a, b = few.step(action[:3])[0], many.step(action)[0]
        equal(a, {key: value[:3] for key, value in b.items()})


def test_a_fresh_process_gives_the_same() -> None:
    code = (
        "from tests.envs.test_vector import *\n"
        "print(digest(NavigationVectorEnv(4, map=room(), **OPTIONS), 50))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True,
        cwd=__file__.rsplit("/tests/", 1)[0],
    )  # fmt: skip
    assert done.stdout.split()[-1] == digest(NavigationVectorEnv(4, map=room(), **OPTIONS), 50)


@pytest.mark.parametrize("localizer", ["ekf", "mcl"])
def test_pickled_in_the_middle_of_an_episode(localizer: str) -> None:
    envs = NavigationVectorEnv(3, map=room(), **OPTIONS | {"localizer": localizer})
    envs.reset(seed=2)
    for action in actions(3, 10):
        envs.step(action)
    other = pickle.loads(pickle.dumps(envs))
    for action in actions(3, 60, seed=1):
        equal(envs.step(action), other.step(action))


def test_results_are_never_written_again() -> None:
    envs = NavigationVectorEnv(4, map=room(), **OPTIONS)
    first = envs.reset(seed=0)
    kept = pickle.loads(pickle.dumps(first))
    results = [envs.step(action) for action in actions(4, 50)]
    copies = pickle.loads(pickle.dumps(results))
    for action in actions(4, 50, seed=1):
        envs.step(action)
    equal(first, kept)
    equal(results, copies)


def test_a_mask_begins_some_episodes() -> None:
    envs = NavigationVectorEnv(5, map=room(), autoreset_mode=AutoresetMode.DISABLED, **OPTIONS)
    before, _ = envs.reset(seed=0)
    mask = np.array([True, False, False, True, False])
    seen, info = envs.reset(seed=3, options={"reset_mask": mask})
    assert (info["_error"] == mask).all() and (info["error"][~mask] == 0.0).all()
    equal({k: v[~mask] for k, v in seen.items()}, {k: v[~mask] for k, v in before.items()})
    alone = NavigationEnv(map=room(), **OPTIONS)
    equal({k: v[3] for k, v in seen.items()}, alone.reset(seed=6)[0])
    for action in actions(5, 200):
        done = envs.step(action)
        if (done[2] | done[3]).any():
            break
    with pytest.raises(ResetNeeded, match="has ended"):
        envs.step(actions(5, 1)[0])


def test_gymnasium_makes_it_and_its_wrappers_take_it() -> None:
    gymnasium.register(
        "tests/Navigation-v0",
        entry_point="ambinav_envs.navigation:NavigationEnv",
        vector_entry_point="ambinav_envs.vector:NavigationVectorEnv",
    )
    try:
        envs = gymnasium.make_vec("tests/Navigation-v0", num_envs=4, map=room(), **OPTIONS)
        assert isinstance(envs, NavigationVectorEnv)
        listed = DictInfoToList(RecordEpisodeStatistics(envs))
        listed.reset(seed=0)
        lengths = []
        for action in actions(4, 100):
            *_, infos = listed.step(action)
            lengths += [info["episode"]["l"] for info in infos if "episode" in info]
            assert all(("outcome" in info) == ("episode" in info) for info in infos)
        assert lengths and max(lengths) == 40
        alone = gymnasium.make("tests/Navigation-v0", map=room(), max_episode_steps=5)
        alone.reset(seed=0)
        truncations = [alone.step(np.array([-1.0, 0.0]))[3] for _ in range(5)]
        assert truncations == [False] * 4 + [True]
    finally:
        del gymnasium.registry["tests/Navigation-v0"]


def test_bad_input_is_refused() -> None:
    envs = NavigationVectorEnv(2, map=room(), **OPTIONS)
    with pytest.raises(ResetNeeded, match="call reset"):
        envs.step(np.zeros((2, 2)))
    envs.reset(seed=0)
    for wrong, what in (
        (np.zeros(2), "shape"), (np.full((2, 2), np.nan), "finite"), ("left", "numbers"),
        ([[1.0], [1.0, 2.0]], "numbers"), (None, "numbers"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=what):
            envs.step(wrong)
    with pytest.raises(InputError, match="3 seeds"):
        envs.reset(seed=[1, 2, 3])
    with pytest.raises(InputError, match="reset_mask"):
        envs.reset(options={"reset_mask": np.zeros(2, dtype=bool)})
    with pytest.raises(InputError, match="NextStep"):
        NavigationVectorEnv(2, map=room(), autoreset_mode="never")
    with pytest.raises(InputError, match="num_envs"):
        NavigationVectorEnv(0, map=room())
