"""Policies by what users name them by, and whether they fit an environment."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces
from typer.testing import CliRunner

from ambinav.cli import app
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import sha256
from ambinav_envs.leaderboard.evaluated import environment_for
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.registered import arguments_of_id
from ambinav_envs.spaces import action_space, observation_space
from tests.envs.policies.models import OPTIONS, model, saved
from tests.envs.policies.test_network import observations, same_actions, trained

from ambinav_envs.policies import ModelPolicy, load_policy, save_policy  # isort: skip
from ambinav_envs.policies.card import Card, arguments_of, plain_environment
from ambinav_envs.policies.load import checksum_of
from ambinav_envs.policies.policy import ROWS
from ambinav_envs.sb3 import make_sb3

PLUG = """
import numpy as np


class Straight:
    def act(self, observations, starts):
        return np.zeros((len(starts), 2), dtype=np.float32)


def straight(observation_space, action_space):
    return Straight()


straight.environment = {"waypoint": True}


def empty(observation_space, action_space):
    return object()


def failing(observation_space, action_space):
    raise RuntimeError("no weights")


def listed(observation_space, action_space):
    return Straight()


def unknown(observation_space, action_space):
    return Straight()


listed.environment = ["waypoint"]
unknown.environment = {"wimdow": False}
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved(tmp_path_factory.mktemp("policy") / "small.zip")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "plug.py").write_text(PLUG)
    return tmp_path


def spaces_of(**options: Any) -> tuple[spaces.Dict, spaces.Space[Any]]:
    parameters = NavigationParameters(**options)
    return observation_space(parameters), action_space(parameters)


def test_a_callable(folder: Path) -> None:
    policy = load_policy("plug.py:straight", folder, trust=True)
    assert policy.environment == {"waypoint": True}
    policy.prepare(*spaces_of())
    assert policy.act({}, np.zeros(5, dtype=np.bool_)).shape == (5, 2)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("plug.py:empty", "without act"),
        ("plug.py:failing", r"failed \(RuntimeError: no weights, plug.py line 2\d\)"),
        ("plug.py:gone", "no callable 'gone'"),
        ("plug.py:listed", "plug.py:listed: its environment is a list; give a mapping"),
        ("plug.py:unknown", "has the key 'wimdow', which is unknown; did you mean window"),
        ("none.py:go", "there is no file"),
        ("gone.zip", "there is no such file"),
        ("gone", "neither a file nor a baseline"),
    ],
)
def test_bad_names(name: str, message: str, folder: Path) -> None:
    with pytest.raises(InputError, match=message):
        load_policy(name, folder, trust=True).prepare(*spaces_of())


def test_checksums_of_callables(folder: Path) -> None:
    def of(name: str) -> str:
        policy = load_policy(f"more.py:{name}", folder, trust=True)
        return checksum_of(f"more.py:{name}", policy, folder)

    code = """
import functools

class Maker:
    def __call__(self, observation_space, action_space):
        return None

maker, function = Maker(), lambda observation_space, action_space: None
partial = functools.partial(function)
"""
    (folder / "more.py").write_text(code)
    # An instance stands where its type does; of what is in no file nothing is known again.
    wanted = sha256(folder / "more.py")
    assert of("maker") == of("function") == of("Maker") == wanted
    assert len({of("partial"), of("partial"), wanted}) == 3


def test_more_than_it_wants_is_no_harm(file: Path) -> None:
    actions, rng = [], np.random.default_rng(0)
    richer = spaces_of(window_cells=4, waypoint=True)
    seen = {
        name: rng.uniform(0.0, 1.0, (2, *box.shape)).astype(np.float32)
        for name, box in richer[0].spaces.items()
    }
    for wanted in (spaces_of(window_cells=4), richer):
        policy = load_policy(file)
        policy.prepare(*wanted)
        parts = {name: seen[name] for name in wanted[0].spaces}
        actions.append(policy.act(parts, np.ones(2, dtype=np.bool_)))
    assert "waypoint" in richer[0].spaces and np.array_equal(*actions)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"window": False}, "wants the part 'window', and the environment has goal, remaining"),
        ({"window_cells": 5}, "'window' has 50 numbers and the policy wants 32"),
        ({"window_cells": 4, "scanner": "rplidar-a1"}, "'scan' has 360 numbers and .* wants 60"),
        ({"window_cells": 4, "discrete": True}, "gives 2 numbers .* takes one of 9 actions"),
    ],
)
def test_what_does_not_fit_is_named(options: dict[str, Any], message: str, file: Path) -> None:
    with pytest.raises(InputError, match=message):
        load_policy(file).prepare(*spaces_of(**options))


@pytest.mark.slow
def test_a_policy_of_one_row() -> None:
    envs = make_sb3("ambinav/Navigation-v1", 2, **OPTIONS)
    row = spaces.flatten_space(envs.observation_space)

    class Flat:
        observation_space, action_space = row, envs.action_space

        def predict(self, seen: Any, **_: Any) -> tuple[Any, None]:
            assert seen.shape == (ROWS, *row.shape) and not seen[2:].any()
            self.seen = seen
            return np.zeros((ROWS, 2)), None

    policy = ModelPolicy(Flat())
    policy.prepare(envs.observation_space, envs.action_space)
    seen = envs.reset()
    policy.act(seen, np.ones(2, dtype=np.bool_))
    first = {name: part[0] for name, part in seen.items()}
    assert np.array_equal(policy.model.seen[0], spaces.flatten(envs.observation_space, first))
    with pytest.raises(InputError, match=r"one row of 106 numbers .* make 74"):
        policy.prepare(*spaces_of(window=False))


def test_a_recurrent_policy_keeps_its_state() -> None:
    class Counting:
        observation_space, action_space = spaces_of()

        def predict(self, seen: Any, state: Any, episode_start: Any, **_: Any) -> tuple[Any, Any]:
            state = np.zeros(ROWS) if state is None else state
            state = np.where(episode_start, 0.0, state) + 1.0
            return np.tile(state[:, None], (1, 2)), state

    policy = ModelPolicy(Counting())
    policy.prepare(*spaces_of())
    seen = {name: np.zeros((2, *part.shape)) for name, part in spaces_of()[0].items()}
    for starts in ([True, True], [False, False], [False, True]):
        actions = policy.act(seen, np.array(starts))
    assert actions[:, 0].tolist() == [3.0, 1.0]
    policy.prepare(*spaces_of())
    assert policy.act(seen, np.zeros(2, dtype=np.bool_))[0, 0] == 1.0


def test_loading_leaves_the_random_numbers_alone(file: Path) -> None:
    np.random.seed(5)
    wanted = np.random.random()
    np.random.seed(5)
    load_policy(file)
    assert np.random.random() == wanted


@pytest.mark.slow
def test_a_live_model() -> None:
    envs = make_sb3("ambinav/Navigation-v1", 2, **OPTIONS)
    policy = ModelPolicy(model(envs))
    policy.prepare(envs.observation_space, envs.action_space)
    assert policy.act(envs.reset(), np.ones(2, dtype=np.bool_)).shape == (2, 2)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["PPO", "SAC", "RecurrentPPO"])
def test_a_file_of_model_save(kind: str, tmp_path: Path) -> None:
    made = trained(kind, {}, {"net_arch": [8]})
    made.save(tmp_path / "plain.zip")
    environment = {"id": "ambinav/Navigation-v1", **OPTIONS}
    policy = load_policy(tmp_path / "plain.zip", trust=True, environment=environment)
    assert isinstance(policy, ModelPolicy) and policy.is_code
    assert same_actions(made, policy.model, observations(made.observation_space))
    assert policy.environment["window_cells"] == OPTIONS["window_cells"]
    policy.prepare(*spaces_of(window_cells=4))
    # As a file that needs no trust.
    save_policy(policy.model, tmp_path / "mine.zip", environment=environment)
    again = load_policy(tmp_path / "mine.zip")
    assert isinstance(again, ModelPolicy) and not again.is_code
    assert same_actions(made, again.model, observations(made.observation_space))


def test_an_id_says_what_its_policy_is_judged_in(tmp_path: Path) -> None:
    for name, key, value in (
        ("ambinav/AccurateGoal-v1", "goal_radius", 0.1),
        ("ambinav/Office-NoMap-v1", "ambiguity_seen", False),
        ("ambinav_envs:ambinav/AccurateGoal-v1", "goal_radius", 0.1),
    ):
        made = model(make_sb3(name, 2, buildings=1))
        made.save(tmp_path / "plain.zip")
        save_policy(made, tmp_path / "mine.zip", environment={"id": name})
        loaded = (
            load_policy(tmp_path / "plain.zip", trust=True, environment={"id": name}),
            load_policy(tmp_path / "mine.zip"),
        )
        for policy in loaded:
            judged = environment_for(policy, {})
            assert judged[key] == value
            assert judged["suite"] == arguments_of_id(name)["suite"]
        # In another task it keeps what it sees, and takes the rest from there.
        other = environment_for(loaded[1], {}, "ambinav/Hall-v1")
        assert other.get("ambiguity_seen", True) is (key != "ambiguity_seen")
        assert "goal_radius" not in other


def test_our_module_in_an_id_makes_no_difference() -> None:
    name = "ambinav/Hall-v1"
    plain = plain_environment({"id": name})
    assert plain_environment({"id": f"ambinav_envs:{name}"}) == plain
    assert (plain["id"], plain["suite"]) == (name, "hall")
    assert plain_environment({"id": "mine:mine/Own-v0"})["id"] == "mine:mine/Own-v0"
    earlier = Card("PPO", {"id": f"ambinav_envs:{name}"}, {}, {}, 0, None)
    assert arguments_of(earlier)["suite"] == "hall"


@pytest.mark.slow
def test_a_file_of_model_save_by_command(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AMBINAV_CACHE", str(tmp_path_factory.getbasetemp() / "ambinav-cache"))
    model(make_sb3("ambinav/Navigation-v1", 2, **OPTIONS)).save(tmp_path / "plain.zip")
    saved(tmp_path / "card.zip")
    words = [str(tmp_path / "plain.zip"), "--env", "ambinav/Hall-v1", "-n", "2", "max_steps=3"]
    words += ["window_cells=4", "longest=4", "buildings=1"]
    run = CliRunner().invoke
    done = run(app, ["evaluate", *words, "--trust", "--json"])
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert report["code"] is True and report["environment"]["suite"] == "hall"
    for arguments, message in (
        (words, "add --trust and --env ID"),
        ([words[0], "--trust"], "add --trust and --env ID"),
        ([*words[:2], "ambinav/Gone-v0", *words[3:], "--trust"], "'ambinav/Gone-v0', which is not"),
        ([*words, "--trust", "window=false"], "wants the part 'window'"),
        ([str(tmp_path / "card.zip"), *words[1:]], "leave --env out"),
        (["vfh", *words[1:]], "leave --env out"),
    ):
        done = run(app, ["evaluate", *arguments])
        assert done.exit_code == 2 and message in done.stderr, done.output
        assert done.stderr.count("\n") == 1


def test_a_model_of_another_algorithm(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "plain.zip", "w") as archive:
        archive.writestr("data", json.dumps({"exploration_rate": 0.1}))
    with pytest.raises(InputError, match="of none of PPO, SAC, RecurrentPPO; give module:callable"):
        load_policy(tmp_path / "plain.zip", trust=True, environment={"id": "ambinav/Hall-v1"})
