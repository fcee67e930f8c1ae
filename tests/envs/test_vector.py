"""Many robots at once: the single environment's numbers bit for bit, whatever happens."""

from __future__ import annotations

import hashlib
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers.vector import DictInfoToList, RecordEpisodeStatistics

from ambinav.runtime import threads
from ambinav.runtime.errors import InputError
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.simulation.simulation import SHARED
from ambinav_envs.spaces import continuous
from ambinav_envs.vector import MANY, NavigationVectorEnv
from tests.envs.cases import equal, room

# Short episodes with all that can be in a scene.
OPTIONS: dict[str, Any] = {
    "longest": 8.0, "max_steps": 40, "people": 2, "obstacles": 3, "waypoint": True,
    "ambiguity_weight": 2.0, "odometry_scale": 2.0,
}  # fmt: skip
# The fewest that threads share, and one more.
COUNT = SHARED + 1
AT_THE_WALL = {"building": 0, "start": (14.5, 6.0, 0.0), "goal": (13.0, 1.0)}
ROOT = Path(__file__).parents[2]


@pytest.fixture
def two_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """As many threads as it takes to share work, on machines with one core too."""
    monkeypatch.setattr("numba.get_num_threads", lambda: 2)
    threads._pools.clear()


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


@pytest.mark.slow(kept=("ekf-NextStep",))
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("localizer", ["ekf", "odometry"])
def test_is_the_single_environment_many_times(mode: str, localizer: str, two_threads: None) -> None:
    options = OPTIONS | {"map": room(), "localizer": localizer, "max_steps": 20}
    many = NavigationVectorEnv(COUNT, autoreset_mode=mode, **options)
    single = SyncVectorEnv([lambda: NavigationEnv(**options)] * COUNT, autoreset_mode=mode)
    assert many.observation_space == single.observation_space
    assert many.action_space == single.action_space
    assert many.metadata == single.metadata
    equal(many.reset(seed=5), single.reset(seed=5))
    ends = 0
    for action in actions(COUNT, 44):
        got, wanted = many.step(action), single.step(action)
        equal(got, wanted)
        ends += int(got[2].sum() + got[3].sum())
        assert many.observation_space.contains(got[0])
    assert ends > COUNT
    assert 2 in threads._pools


@pytest.mark.parametrize("mode", ["NextStep", AutoresetMode.SAME_STEP])
def test_make_vec_takes_the_autoreset_mode(mode: AutoresetMode | str) -> None:
    name, options = "ambinav/Navigation-v1", {"map": room(), "max_steps": 5}
    many = gymnasium.make_vec(name, 3, "vector_entry_point", autoreset_mode=mode, **options)
    single = gymnasium.make_vec(name, 3, "sync", vector_kwargs={"autoreset_mode": mode}, **options)
    for envs in (many, single):
        assert envs.metadata["autoreset_mode"] is envs.autoreset_mode is AutoresetMode(mode)
    equal(many.reset(seed=5), single.reset(seed=5))
    ends = 0
    for action in actions(3, 12):
        got = many.step(action)
        equal(got, single.step(action))
        ended = got[2] | got[3]
        ends += int(ended.sum())
        final = ended.any() and many.autoreset_mode is AutoresetMode.SAME_STEP
        assert ("final_obs" in got[4]) == ("final_info" in got[4]) == final
    assert ends >= 6


def test_particle_filters_are_the_single_environment_too() -> None:
    mcl = {"max_particles": 200, "min_particles": 100}
    options: dict[str, Any] = {"map": room(), "localizer": "mcl", "mcl": mcl, "max_steps": 15}
    many = NavigationVectorEnv(3, **options)
    single = SyncVectorEnv([lambda: NavigationEnv(**options)] * 3)
    equal(many.reset(seed=1), single.reset(seed=1))
    for action in actions(3, 40):
        equal(many.step(action), single.step(action))
    assert many.simulation.state["covariance"].max() > 0.0


@pytest.mark.slow
def test_neither_number_nor_threads_change_a_bit(monkeypatch: pytest.MonkeyPatch) -> None:
    few = NavigationVectorEnv(3, map=room(), **OPTIONS)
    many = NavigationVectorEnv(40, map=room(), **OPTIONS)
    chosen = actions(40, 60)
    digests = []
    for number in (1, 2):
        monkeypatch.setattr("numba.get_num_threads", lambda number=number: number)
        digests.append(digest(NavigationVectorEnv(40, map=room(), **OPTIONS), 60))
    assert digests[0] == digests[1]
    few.reset(seed=7)
    many.reset(seed=7)
    for action in chosen:
        a, b = few.step(action[:3])[0], many.step(action)[0]
        equal(a, {key: value[:3] for key, value in b.items()})


@pytest.mark.sweep
def test_a_fresh_process_gives_the_same() -> None:
    code = (
        "from tests.envs.test_vector import *\n"
        "print(digest(NavigationVectorEnv(4, map=room(), **OPTIONS), 50))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout.split()[-1] == digest(NavigationVectorEnv(4, map=room(), **OPTIONS), 50)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere forks are not the default")
def test_many_robots_in_new_buildings_warn_of_what_that_takes(
    recwarn: pytest.WarningsRecorder,
) -> None:
    with pytest.warns(UserWarning, match="give a number of them, such as buildings=64"):
        gymnasium.make_vec("ambinav/Navigation-v1", MANY, "vector_entry_point")
    for name, count, options in (
        ("ambinav/Navigation-v1", MANY - 1, {}),
        ("ambinav/Navigation-v1", MANY, {"buildings": 4}),
        ("ambinav/Office-v1", MANY, {}),
    ):
        gymnasium.make_vec(name, count, "vector_entry_point", **options)
    assert not recwarn.list


@pytest.mark.slow
def test_forked_processes_make_buildings_and_drive() -> None:
    envs = gymnasium.make_vec(
        "ambinav/Navigation-v1",
        num_envs=2,
        vectorization_mode="async",
        map=room(),
        **OPTIONS,
        vector_kwargs={"context": "fork"},
    )
    try:
        seen, _ = envs.reset(seed=4)
        many = NavigationVectorEnv(2, map=room(), **OPTIONS)
        equal(seen, many.reset(seed=4)[0])
        action = actions(2, 1)[0]
        equal(envs.step(action)[0], many.step(action)[0])
    finally:
        envs.close()


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
    assert all(part.flags.c_contiguous for seen, *_ in results for part in seen.values())


def test_a_mask_begins_some_episodes() -> None:
    envs = NavigationVectorEnv(5, map=room(), autoreset_mode=AutoresetMode.DISABLED, **OPTIONS)
    before, _ = envs.reset(seed=0)
    mask = np.array([True, False, False, True, False])
    seen, info = envs.reset(seed=3, options={"reset_mask": mask})
    assert (info["_error"] == mask).all() and (info["error"][~mask] == 0.0).all()
    equal({k: v[~mask] for k, v in seen.items()}, {k: v[~mask] for k, v in before.items()})
    alone = NavigationEnv(map=room(), **OPTIONS)
    equal({k: v[3] for k, v in seen.items()}, alone.reset(seed=6)[0])
    assert envs.np_random_seed == (3, 1, 2, 6, 4)  # the others' random numbers go on
    for action in actions(5, 200):
        done = envs.step(action)
        if (done[2] | done[3]).any():
            break
    with pytest.raises(ResetNeeded, match="has ended"):
        envs.step(actions(5, 1)[0])


def test_gymnasium_makes_it_and_its_wrappers_take_it() -> None:
    gymnasium.register(
        "tests/Navigation-v1",
        entry_point="ambinav_envs.navigation:NavigationEnv",
        vector_entry_point="ambinav_envs.vector:NavigationVectorEnv",
    )
    try:
        envs = gymnasium.make_vec("tests/Navigation-v1", num_envs=4, map=room(), **OPTIONS)
        assert isinstance(envs, NavigationVectorEnv)
        listed = DictInfoToList(RecordEpisodeStatistics(envs))
        listed.reset(seed=0)
        lengths = []
        for action in actions(4, 100):
            *_, infos = listed.step(action)
            lengths += [info["episode"]["l"] for info in infos if "episode" in info]
            assert all(("outcome" in info) == ("episode" in info) for info in infos)
        assert lengths and max(lengths) == 40
        # Gymnasium keeps `max_episode_steps` to itself and knows of no outcome.
        for limit, outcome in (("max_steps", "timeout"), ("max_episode_steps", None)):
            alone = gymnasium.make("tests/Navigation-v1", map=room(), **{limit: 5})
            alone.reset(seed=0)
            steps = [alone.step(np.array([-1.0, 0.0])) for _ in range(5)]
            assert [step[3] for step in steps] == [False] * 4 + [True]
            assert steps[-1][4].get("outcome") == outcome
        few = gymnasium.make_vec("tests/Navigation-v1", map=room(), max_episode_steps=5)
        assert few.unwrapped.simulation.parameters.max_steps == 5
    finally:
        del gymnasium.registry["tests/Navigation-v1"]


def test_a_refused_reset_begins_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    envs, other = (NavigationVectorEnv(3, map=room(), **OPTIONS) for _ in range(2))
    envs.reset(seed=0)
    other.reset(seed=0)
    source, before = envs.simulation.source, envs.simulation.state.tobytes()
    at, calls = source.at, []

    def fails_at_the_second(share: float) -> Any:
        calls.append(share)
        if len(calls) == 2:
            raise InputError("no room.")
        return at(share)

    monkeypatch.setattr(source, "at", fails_at_the_second)
    with pytest.raises(InputError, match="no room"):
        envs.reset()
    assert envs.simulation.state.tobytes() == before
    with pytest.raises(ResetNeeded, match="robot 0 has no episode"):
        envs.step(np.zeros((3, 2)))
    # The random numbers of all have gone on by one episode.
    other.reset()
    equal(envs.reset(), other.reset())


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_next_episode_that_is_refused(mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    envs = NavigationVectorEnv(2, map=room(), autoreset_mode=mode, **OPTIONS)
    start, mask = AT_THE_WALL, np.array([True, False])
    envs.reset(seed=0)
    envs.reset(options=start | {"reset_mask": mask})

    def fails(share: float) -> Any:
        raise InputError("no room.")

    monkeypatch.setattr(envs.simulation.source, "at", fails)
    with pytest.raises(InputError, match="no room"):
        for _ in range(20):
            envs.step(np.array([[1.0, 0.0], [-1.0, 0.0]]))
    with pytest.raises(ResetNeeded, match="robot 0 has no episode"):
        envs.step(np.zeros((2, 2)))
    # The other one goes on.
    steps = envs.simulation.state["steps"][1]
    envs.reset(options=start | {"reset_mask": mask})
    envs.step(np.zeros((2, 2)))
    assert envs.simulation.state["steps"][1] == steps + 1


def test_where_people_have_no_room_nobody_drives() -> None:
    # One person has room in the middle of the right half alone, if no robot is there.
    envs = NavigationVectorEnv(2, map=room(), people={"count": 1, "radius": 3.9})
    ends = {"goal": (13.0, 1.0), "start": (1.0, 1.0, 0.0)}
    envs.reset(seed=0, options=ends)
    envs.step(np.zeros((2, 2)))
    with pytest.raises(InputError, match="no room for 1 "):
        envs.reset(options=ends | {"start": (10.5, 6.0, 0.0)})
    with pytest.raises(ResetNeeded):
        envs.step(np.zeros((2, 2)))


def test_actions_in_any_order_of_memory() -> None:
    envs, others = (NavigationVectorEnv(3, map=room(), **OPTIONS) for _ in range(2))
    equal(envs.reset(seed=0), others.reset(seed=0))
    for action in actions(3, 3):
        for other in (np.asfortranarray(action.astype(np.float64)), action.astype(">f4")):
            # Any other would have the kernel compiled again.
            assert continuous(other, 3, envs.simulation.parameters).flags.c_contiguous
            equal(envs.step(other), others.step(action))


def test_seeds_may_be_numpys() -> None:
    envs, others = (NavigationVectorEnv(3, map=room(), **OPTIONS) for _ in range(2))
    wanted = envs.reset(seed=[4, 5, 6])
    for seeds in ([np.int64(4), 5, np.uint8(6)], np.arange(4, 7), np.int64(4), (4, 5, 6)):
        equal(others.reset(seed=seeds), wanted)
    assert others.np_random_seed == (4, 5, 6)


@pytest.mark.parametrize("discrete", [False, True])
def test_an_action_that_is_ignored_may_be_anything(discrete: bool) -> None:
    envs = NavigationVectorEnv(2, map=room(), discrete=discrete)
    start, mask = AT_THE_WALL, np.array([True, False])
    envs.reset(seed=0)
    envs.reset(options=start | {"reset_mask": mask})
    ahead, wrong = (7, 9) if discrete else ((1.0, 0.0), (np.nan, 0.0))
    still = 1 if discrete else (-1.0, 0.0)
    ended = False
    while not ended:
        with pytest.raises(InputError, match=r"action of robot 0 is .*; give"):
            envs.step(np.array([wrong, still]))
        ended = bool(envs.step(np.array([ahead, still]))[2][0])
    with pytest.raises(InputError, match=r"action of robot 1 is .*; give"):
        envs.step(np.array([wrong, wrong]))
    envs.step(np.array([wrong, still]))
    assert envs.simulation.state["steps"].tolist()[0] == 0


def test_bad_input_is_refused() -> None:
    envs = NavigationVectorEnv(2, map=room(), **OPTIONS)
    with pytest.raises(ResetNeeded, match="call reset"):
        envs.step(np.zeros((2, 2)))
    envs.reset(seed=0)
    for wrong, what in (
        (np.zeros(2), "shape"), (np.full((2, 2), np.nan), "finite"), ("left", "numbers"),
        ([[1.0], [1.0, 2.0]], "numbers"), (None, "numbers"), (np.full((2, 2), "x" * 99), "numbers"),
        (np.ones((500, 2)), "shape"), ([["a" * 99] * 99, 3], "numbers"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=what) as caught:
            envs.step(wrong)
        assert len(str(caught.value)) < 200 and "\n" not in str(caught.value)
    for seed, what in (
        ([1, 2, 3], "3 seeds"), (1.5, "seed is 1.5"), ([1, 1.5], r"seed\[1\] is 1.5"),
        ("12", "seed is '12'"), (-1, "seed is -1"), (np.array(1.5), "seed is 1.5"),
        ([[1], [2, 3]], r"seed\[0\]"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=what):
            envs.reset(seed=seed)  # type: ignore[arg-type]
    for mask in (np.zeros(2, dtype=bool), [[True], [True, False]], [1, 0], "yes", [True]):
        with pytest.raises(InputError, match="reset_mask"):
            envs.reset(seed=3, options={"reset_mask": mask})
    # Nothing of it has started random numbers anew.
    assert envs.np_random_seed == (0, 1)
    with pytest.raises(InputError, match="NextStep"):
        NavigationVectorEnv(2, map=room(), autoreset_mode="never")
    with pytest.raises(InputError, match="num_envs"):
        NavigationVectorEnv(0, map=room())


def test_options_are_a_mapping() -> None:
    with pytest.raises(InputError, match="options is 5; give a mapping"):
        NavigationVectorEnv(2, map=room()).reset(options=5)  # type: ignore[arg-type]
