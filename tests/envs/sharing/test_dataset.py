"""Minari data sets: read by Minari, the same episodes as evaluations, and driven again."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from typer.testing import CliRunner

from ambinav.cli import app
from ambinav.runtime.errors import InputError
from ambinav_envs.evaluation import episode_seeds, evaluate_in
from ambinav_envs.leaderboard import dataset as module
from ambinav_envs.leaderboard.dataset import dataset_id, record_datasets
from ambinav_envs.leaderboard.methods import Method, follower_method, planner_methods, policy_method
from ambinav_envs.policies import load_policy
from ambinav_envs.policies.policy import Policy
from ambinav_envs.scenario import scenario
from ambinav_envs.simulation.layout import OUTCOMES

HALL, NAVIGATION = "ambinav/Hall-v1", "ambinav/Navigation-v1"
SMALL: dict[str, Any] = {"buildings": 1, "longest": 6.0, "max_steps": 120, "window": False}


def run(*arguments: str) -> Any:
    return CliRunner().invoke(app, ["dataset", *arguments])


def test_names_are_those_of_minari() -> None:
    minari = pytest.importorskip("minari.dataset.minari_dataset")
    names = {
        dataset_id(HALL, "reference 5"): "ambinav/hall/reference-5-v0",
        dataset_id("ambinav/Hall-TruePose-v1", "mine.py:Go"): "ambinav/hall-truepose/mine-py-go-v0",
    }
    for got, wanted in names.items():
        assert got == wanted
        namespace, name, version = minari.parse_dataset_id(got)
        assert version == 0 and f"{namespace}/{name}-v0" == wanted


@pytest.mark.slow
def test_a_policy_is_configured_for_the_environment() -> None:
    """Its actions are those of an evaluation, also of another robot and where it declares."""
    pytest.importorskip("minari")
    pytest.importorskip("h5py")
    method = policy_method("vfh")
    for more in ({"robot": {"max_speed": 1.0}}, {"declare": ["arrived"]}):
        arguments = {**method.seeing, **SMALL, **more}
        driver = module._Driver(method, gym.make(HALL, **arguments))
        (number,) = episode_seeds(3, 0, 1)
        buffer, _ = driver.drive(0, int(number))
        count = arguments.pop("buildings")
        source, parameters = scenario("hall", None, count, 0, None, arguments)
        policy = load_policy("vfh")
        policy.configure(parameters)
        wanted = evaluate_in(policy, source, parameters, 1, 3, chunk=1)
        assert sum(buffer.rewards) == pytest.approx(float(wanted.reward[0]))


def test_code_is_recorded_where_it_is_trusted(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("import nothing_there\n")
    given = ["-o", str(tmp_path / "sets"), "--policy", f"{tmp_path}/mine.py:Go"]
    assert "add --trust" in run(*given).stderr
    assert "cannot be imported" in run(*given, "--trust").stderr


@pytest.mark.slow
def test_what_is_recorded_can_be_driven_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    minari = pytest.importorskip("minari")
    pytest.importorskip("h5py")
    methods = [follower_method(0.0), planner_methods(["reference:5"])[-1]]
    shares: list[float] = []
    made = record_datasets(methods, HALL, SMALL, 3, 7, tmp_path / "sets", shares.append)
    assert shares == sorted(shares) and shares[-1] == 1.0
    assert module._ROOT not in os.environ
    monkeypatch.setenv(module._ROOT, str(tmp_path / "sets"))
    assert set(minari.list_local_datasets()) == {one.id for one in made}
    for method, one in zip(methods, made, strict=True):
        stored = minari.load_dataset(one.id)
        assert (stored.total_episodes, stored.total_steps) == (3, one.steps)
        env = stored.recover_environment()
        source, parameters = scenario(
            "hall", None, 1, 0, None,
            {key: value for key, value in {**method.seeing, **SMALL}.items() if key != "buildings"},
        )  # fmt: skip
        wanted = evaluate_in(method.make(parameters), source, parameters, 3, 7, chunk=1)
        ends = list(stored.storage.get_episode_metadata(range(3)))
        for k, episode in enumerate(stored.iterate_episodes()):
            seen, _ = env.reset(seed=ends[k]["seed"])
            observations, rewards = [seen], []
            for action in episode.actions:
                seen, reward, over, cut, info = env.step(action)
                observations.append(seen)
                rewards.append(reward)
            assert over or cut
            for name, recorded in episode.observations.items():
                assert np.array_equal(recorded, [seen[name] for seen in observations])
            assert np.array_equal(episode.rewards, rewards)
            assert bool(episode.terminations[-1]) is over and not episode.terminations[:-1].any()
            assert np.array_equal(episode.infos["true_pose"][-1], info["true_pose"])
            assert len(episode.infos["cost"]) == len(episode.actions) + 1
            # Kept actions are float32, and those of planners were float64 before.
            assert ends[k]["seed"] == wanted.seed[k]
            assert ends[k]["outcome"] == OUTCOMES[wanted.outcome[k]] == info["outcome"]
            assert ends[k]["travelled"] == pytest.approx(wanted.travelled[k], rel=1e-3)
        env.close()


def test_a_failure_leaves_nothing(tmp_path: Path) -> None:
    pytest.importorskip("minari")

    class Broken(Policy):
        def prepare(self, observation_space: Any, action_space: Any) -> None:
            pass

        def act(self, observations: Any, starts: Any) -> Any:
            raise RuntimeError("broken")

    broken = Method("broken", "policy", "", {}, {}, lambda parameters: Broken("broken", {}))
    with pytest.raises(RuntimeError, match="broken"):
        record_datasets([broken], HALL, SMALL, 1, 0, tmp_path / "sets")
    assert list(tmp_path.iterdir()) == [] and module._ROOT not in os.environ
    with pytest.raises(InputError, match="two data sets are called"):
        record_datasets([broken, broken], HALL, SMALL, 1, 0, tmp_path / "sets")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-n", "0"], "--episodes: 0 is too few"),
        (["--seed", "-1"], "--seed: -1 is negative"),
        (
            ["--planner", "reference", "--env", "ambinav/Hal-v0"],
            "the id is 'ambinav/Hal-v0'; did you mean ambinav/Hall-v1",
        ),
        (["--planner", "referense"], "reference"),
        (["--policy", "gone"], "neither a file nor a baseline"),
        (["--planner", "reference", "peple=2"], "did you mean people"),
        (["--planner", "reference", "discrete=true", "buildings=1"], "discrete"),
        (["--planner", "reference", "map=gone.yaml"], "give one of the two"),
        (["--planner", "reference", "--env", NAVIGATION, "map=gone.yaml"], "gone.yaml"),
    ],
)
def test_bad_input(arguments: list[str], message: str, tmp_path: Path) -> None:
    pytest.importorskip("minari")
    pytest.importorskip("ompl")
    done = run(*arguments, "-o", str(tmp_path / "sets"))
    assert done.exit_code == 2, done.output
    assert message in done.stderr and done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_what_is_there_stays(tmp_path: Path) -> None:
    pytest.importorskip("minari")
    (tmp_path / "mine.txt").write_text("keep")
    done = run("-o", str(tmp_path), "--planner", "reference")
    assert done.exit_code == 2 and "it is there already" in done.stderr
    assert (tmp_path / "mine.txt").read_text() == "keep"


def test_without_minari_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import ambinav.runtime.packages as packages

    there = packages.find_spec
    monkeypatch.setattr(
        packages, "find_spec", lambda name: None if name == "minari" else there(name)
    )
    done = run("-o", str(tmp_path / "sets"))
    assert done.exit_code == 2 and 'pip install "ambinav[minari]"' in done.stderr
    monkeypatch.setattr(packages, "find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"ambinav\[minari\]"):
        record_datasets([], HALL, {}, 1, 0, tmp_path / "sets")


@pytest.mark.slow
def test_one_command(tmp_path: Path) -> None:
    pytest.importorskip("minari")
    given = [f"{key}={json.dumps(value)}" for key, value in SMALL.items()]
    done = run(
        "-o", str(tmp_path / "sets"), "-n", "1", "--planner", "reference:5", "--json", *given
    )
    assert done.exit_code == 0, done.output
    made = json.loads(done.stdout)
    assert [one["id"] for one in made] == [
        "ambinav/hall/shortest-v0", "ambinav/hall/reference-5-v0",
    ]  # fmt: skip
    assert all(one["episodes"] == 1 and one["steps"] > 5 for one in made)


@pytest.mark.parametrize("weight", ["x", np.nan, -1.0, 101.0])
def test_a_bad_weight_of_a_follower_is_refused(weight: Any) -> None:
    with pytest.raises(InputError, match="ambiguity_weight is "):
        follower_method(weight)
