"""The training as a whole: what it writes, that it repeats itself, and that it resumes exactly."""

from __future__ import annotations

import csv
import json
import shutil
import signal
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3 import PPO

from ambinav.runtime.errors import InputError
from ambinav_envs.policies import load_policy, read_card
from ambinav_envs.training.checkpoints import checkpoints, save_checkpoint
from ambinav_envs.training.config import Training
from ambinav_envs.training.config_file import load_training_config, parse_config
from ambinav_envs.training.models import make_model
from ambinav_envs.training.run import Run, TrainingStatus, best_of
from ambinav_envs.training.train import train
from ambinav_envs.training.vec import TrainingEnvs
from tests.envs.training.cases import CORRECTED, RECURRENT, SAC, TINY, tiny


def weights(path: Path) -> dict[str, Any]:
    """The parameters in a policy file or a checkpoint's model."""
    from stable_baselines3.common.save_util import load_from_zip_file

    if path.name != "model.zip":
        policy: Any = load_policy(path)
        state: dict[str, Any] = getattr(policy, "network", policy).model.state_dict()
        return state
    _, params, _ = load_from_zip_file(path, device="cpu", load_data=False)
    return params["policy"]


def same(a: Path, b: Path) -> bool:
    ours, theirs = weights(a), weights(b)
    return ours.keys() == theirs.keys() and all(torch.equal(ours[k], theirs[k]) for k in ours)


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "progress.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def figures(folder: Path) -> list[dict[str, str]]:
    """The table of progress without what a clock tells."""
    return [
        {key: row[key] for key in row if key not in ("seconds", "steps_per_second")}
        for row in rows(folder)
    ]


def interrupted_at(steps: int) -> Any:
    def callback(status: TrainingStatus) -> None:
        if status.steps >= steps:
            raise KeyboardInterrupt

    return callback


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A training from its beginning to its end."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    with pytest.MonkeyPatch.context() as patch:
        cache = tmp_path_factory.getbasetemp() / "ambinav-cache"
        patch.setenv("AMBINAV_CACHE", str(cache))
        train(tiny(), folder, command=["ambinav", "train", "tiny.yaml", "-o", "run here"])
    return folder


def test_writes_all_that_it_says(whole: Path) -> None:
    there = {path.name for path in whole.iterdir()}
    wanted = {"config.yaml", "run.json", "progress.csv", "best.zip", "final.zip", "curve.png"}
    assert wanted | {"report.md", "checkpoints"} <= there
    assert load_training_config(whole / "config.yaml") == tiny()
    record = json.loads((whole / "run.json").read_text())
    assert record["seed"] == 3 and record["buildings"]["hashed"] == 2
    assert record["buildings"]["sha256"] != record["judged_in"]["sha256"]
    (session,) = record["sessions"]
    assert session["command"][-1] == "run here" and "torch" in session["versions"]
    assert [row["steps"] for row in rows(whole)] == ["256", "512"]
    assert all(row["eval_episodes"] == "4" for row in rows(whole))
    assert "ambinav train tiny.yaml -o 'run here'" in (whole / "report.md").read_text()
    assert checkpoints(whole / "checkpoints")[-1].name == "000000000512"


def test_policy_files_are_policies(whole: Path) -> None:
    card = read_card(whole / "final.zip")
    assert (card.algorithm, card.steps, card.seed) == ("PPO", 512, 3)
    assert card.environment["id"] == "ambinav/Hall-v1"
    assert card.notes["evaluation"]["episodes"] == 4
    policy = load_policy(whole / "best.zip")
    assert policy.environment["suite"] == "hall" and "buildings" not in policy.environment
    envs = TrainingEnvs(tiny())
    seen = envs.outer.reset()
    policy.prepare(envs.outer.observation_space, envs.outer.action_space)
    actions = policy.act(seen, np.ones(8, dtype=np.bool_))
    assert actions.shape == (8, 2)
    assert same(whole / "final.zip", whole / "checkpoints" / "000000000512" / "model.zip")
    # Training on with it, and with what a checkpoint holds.
    again = make_model(tiny(), envs.outer)
    again.policy.load_state_dict(policy.model.state_dict())  # type: ignore[attr-defined]
    assert np.array_equal(again.predict(seen, deterministic=True)[0], actions)
    kept = PPO.load(whole / "checkpoints" / "000000000512" / "model.zip", device="cpu")
    final = load_policy(whole / "final.zip")
    final.prepare(envs.outer.observation_space, envs.outer.action_space)
    assert np.array_equal(
        kept.predict(seen, deterministic=True)[0], final.act(seen, np.ones(8, dtype=np.bool_))
    )


@pytest.mark.slow(kept=("sac",))
@pytest.mark.parametrize(
    "other", [{}, SAC, RECURRENT, CORRECTED], ids=["ppo", "sac", "recurrent", "corrected"]
)
def test_resumed_is_as_if_never_interrupted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, other: dict[str, Any]
) -> None:
    # Few steps from one look to the next, so that it is interrupted in the middle.
    monkeypatch.setattr("ambinav_envs.training.models.SAC_ROUND", 256)
    if "algorithm" in other:
        pytest.importorskip("sb3_contrib")
    config = tiny(**other)
    straight, broken = tmp_path / "straight", tmp_path / "broken"
    train(config, straight)
    with pytest.raises(KeyboardInterrupt):
        train(config, broken, callback=interrupted_at(256))
    (kept,) = checkpoints(broken / "checkpoints")
    assert kept.name == "000000000256"
    assert not (broken / "final.zip").exists()
    if config.algorithm == "sac":
        (kept / "replay.pkl").rename(tmp_path / "replay.pkl")
        refused(config, broken, True, r"the checkpoint is damaged.*replay\.pkl")
        (tmp_path / "replay.pkl").rename(kept / "replay.pkl")
    train(config, broken, resume=True)
    assert same(straight / "final.zip", broken / "final.zip")
    assert same(straight / "best.zip", broken / "best.zip")
    assert figures(straight) == figures(broken)
    assert len(json.loads((broken / "run.json").read_text())["sessions"]) == 2


@pytest.mark.sweep
def test_interrupted_before_it_begins(whole: Path, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        train(tiny(), tmp_path / "out", callback=interrupted_at(0))
    train(tiny(), tmp_path / "out", resume=True)
    assert same(whole / "final.zip", tmp_path / "out" / "final.zip")


@pytest.mark.slow
def test_an_interrupt_waits_for_what_torch_writes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """torch makes another error of it, or ends the process."""
    envs = TrainingEnvs(tiny())
    model = make_model(tiny(), envs.outer)
    save, saved = model.save, []

    def interrupted(path: Path) -> None:
        signal.raise_signal(signal.SIGINT)
        save(path)
        saved.append(zipfile.is_zipfile(path))

    monkeypatch.setattr(model, "save", interrupted)
    with pytest.raises(KeyboardInterrupt):
        save_checkpoint(tmp_path / "kept", model, envs, {})
    assert saved == [True] and not list(tmp_path.iterdir())
    envs.close()


@pytest.mark.sweep
def test_same_seed_same_policy_other_seed_another(whole: Path, tmp_path: Path) -> None:
    train(tiny(), tmp_path / "again")
    with (
        zipfile.ZipFile(whole / "final.zip") as ours,
        zipfile.ZipFile(tmp_path / "again" / "final.zip") as theirs,
    ):
        assert ours.namelist() == theirs.namelist()
        assert all(ours.read(name) == theirs.read(name) for name in ours.namelist())
    assert figures(whole) == figures(tmp_path / "again")
    train(tiny(seed=4), tmp_path / "other")
    assert not same(whole / "final.zip", tmp_path / "other" / "final.zip")


@pytest.mark.slow
def test_goes_on_when_it_may_be_longer(tmp_path: Path) -> None:
    out = tmp_path / "out"
    train(tiny(steps=256), out, command=["ambinav", "train", "--steps", "256"])
    before = (out / "final.zip").read_bytes()
    summary = train(
        tiny(steps=512), out, resume=True, command=["ambinav", "--resume", "--steps", "512"]
    )
    # Again: with the limits that it had last, from the beginning.
    assert "`ambinav --steps 512`" in (out / "report.md").read_text()
    assert summary["steps"] == 512 and (out / "final.zip").read_bytes() != before
    report, about = (out / "report.md").read_text(), (out / "run.json").read_text()
    assert " seconds, in 2 goes, with " in report
    # What is finished is no other go.
    assert train(tiny(steps=512), out, resume=True)["steps"] == 512
    assert (out / "run.json").read_text() == about
    assert "in 2 goes, with " in (out / "report.md").read_text()


@pytest.mark.slow
def test_everything_at_once(tmp_path: Path) -> None:
    """Normalised observations, discrete actions, falling rates, a curriculum, a limit of time."""
    config = tiny(
        steps=768,
        minutes=30.0,
        environment=TINY["environment"] | {"discrete": True, "window": True, "window_cells": 8},
        normalize={"observations": True, "reward": False},
        policy={"net_arch": [16], "window": "dense"},
        curriculum=[{"longest": 4.0, "share": 0.5}],
        hyperparameters=TINY["hyperparameters"] | {"learning_rate": {"from": 1e-3, "to": 1e-5}},
    )
    out = tmp_path / "out"
    summary = train(config, out)
    assert [row["longest"] for row in rows(out)] == ["4", "4", "8"]
    assert summary["stage"] == 1
    policy = load_policy(out / "final.zip")
    envs = TrainingEnvs(config)
    policy.prepare(envs.outer.observation_space, envs.outer.action_space)
    envs.outer.reset()
    assert policy.act(envs.normalize.get_original_obs(), np.ones(8, dtype=bool)).shape == (8,)
    assert "8 m" not in (out / "report.md").read_text()


@pytest.mark.slow
def test_a_limit_of_time_ends_it(tmp_path: Path) -> None:
    summary = train(tiny(steps=None, minutes=1e-9), tmp_path / "out")
    assert summary["steps"] == 0 and summary["final"]["episodes"] == 4.0


def refused(config: Training, folder: Path, resume: bool, match: str) -> None:
    with pytest.raises(InputError, match=match):
        train(config, folder, resume=resume)


def test_what_cannot_begin_or_go_on_is_refused(whole: Path, tmp_path: Path) -> None:
    refused(tiny(), whole, False, "add --resume")
    refused(tiny(), tmp_path / "none", True, "leave out --resume")
    assert not (tmp_path / "none").exists()
    refused(tiny(seed=4), whole, True, "seed is 4 and was 3")
    other = tiny(hyperparameters=TINY["hyperparameters"] | {"gamma": 0.9})
    refused(other, whole, True, r"hyperparameters.gamma is 0.9 and was 0.99")
    far = {"first_building": 2, "buildings": 1, "shortest": 100.0, "longest": 120.0}
    judged = tiny(evaluation={"episodes": 2, "environment": far})
    refused(judged, tmp_path / "far", False, r"evaluation\.environment: hall-2: no start and goal")
    assert not (tmp_path / "far" / "config.yaml").exists()
    (tmp_path / "file").write_text("")
    refused(tiny(), tmp_path / "file", False, "this is a file, not a folder")


def test_what_is_finished_is_finished_again_with_the_same_bytes(
    whole: Path, tmp_path: Path
) -> None:
    again = tmp_path / "again"
    shutil.copytree(whole, again)
    train(load_training_config(again / "config.yaml"), again, resume=True)
    for name in ("final.zip", "best.zip", "progress.csv"):
        assert (again / name).read_bytes() == (whole / name).read_bytes(), name


@pytest.mark.slow(kept=("TwinRooms1-v2",))
@pytest.mark.parametrize("name", ["Kidnapped-v1", "UnknownStart-v1", "TwinRooms1-v2"])
def test_tasks_can_be_trained(tmp_path: Path, name: str) -> None:
    environment = {"id": f"ambinav/{name}", "buildings": 1}
    judged = {"episodes": 1, "every": 100_000, "environment": {"buildings": 1}}
    config = parse_config({**TINY, "environment": environment, "evaluation": judged}, "here")
    with pytest.raises(KeyboardInterrupt):
        train(config, tmp_path / "run", callback=interrupted_at(0))
    assert (tmp_path / "run" / "config.yaml").is_file()


@pytest.mark.slow
def test_what_fails_late_leaves_a_checkpoint(tmp_path: Path) -> None:
    def fails(status: TrainingStatus) -> None:
        if status.steps >= 256:
            raise OSError("no space left")

    with pytest.raises(OSError, match="no space left"):
        train(tiny(), tmp_path / "run", callback=fails)
    (last,) = checkpoints(tmp_path / "run" / "checkpoints")
    assert last.name.endswith("256")


def test_the_best_one_is_that_of_the_file(whole: Path, tmp_path: Path) -> None:
    """It may be newer than the checkpoint that a killed training goes on from."""
    card = read_card(whole / "best.zip")
    best = best_of(whole / "best.zip")
    assert best["steps"] == card.steps and best["reward"] == card.notes["evaluation"]["reward"]
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        train(tiny(), out, callback=interrupted_at(0))
    shutil.copy(whole / "best.zip", out)
    run = Run(tiny(), out, True, (), lambda status: None)
    assert run.best == best
    run.envs.close()


@pytest.fixture(scope="module")
def broken(whole: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A training with a checkpoint in its middle and one at its end."""
    out = tmp_path_factory.mktemp("broken") / "out"
    shutil.copytree(whole, out)
    shutil.copytree(out / "checkpoints" / "000000000512", out / "checkpoints" / "000000000256")
    return out


@pytest.mark.parametrize("member", ["model.zip", "memory.pkl", "counters.json"])
def test_a_damaged_checkpoint_is_reported(broken: Path, tmp_path: Path, member: str) -> None:
    out = tmp_path / "out"
    shutil.copytree(broken, out)
    path = out / "checkpoints" / "000000000512" / member
    path.write_bytes(path.read_bytes()[:40])
    refused(tiny(), out, True, "the checkpoint is damaged.*to resume from the one of step 256")
    (out / "checkpoints" / "000000000256" / "memory.pkl").unlink()
    refused(tiny(), out, True, "the checkpoint is damaged.*no other one.*train anew")


def test_what_is_no_damage_is_not_called_so(
    broken: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(*_: Any) -> Any:
        raise InputError("recurrent-ppo needs sb3-contrib.")

    monkeypatch.setattr("ambinav_envs.training.checkpoints.load_model", missing)
    shutil.copytree(broken, tmp_path / "out")
    refused(tiny(), tmp_path / "out", True, "^recurrent-ppo needs sb3-contrib.$")


def test_without_checkpoints_nothing_is_resumed(broken: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(broken, out)
    shutil.rmtree(out / "checkpoints")
    before = (out / "progress.csv").read_bytes()
    refused(tiny(), out, True, "no checkpoint is left to resume from; train anew")
    assert (out / "progress.csv").read_bytes() == before
