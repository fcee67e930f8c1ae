"""Model cards: the hub's keys, the figures of the evaluation, and what is refused."""

from __future__ import annotations

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

pytest.importorskip("gymnasium")

from ambinav.cli import app
from ambinav.runtime.files import sha256
from ambinav_envs.leaderboard.figures import FIGURES
from ambinav_envs.leaderboard.model_card import model_card, read_judged
from ambinav_envs.policies import Card, read_card
from tests.envs.policies.models import saved

NAME = "small"
REWARDS = (1.5, -2.0, 7.25)


def evaluated(folder: Path, name: str = NAME, **environment: Any) -> Path:
    """What `ambinav evaluate` writes, as far as it is read."""
    figure = {"value": 66.67, "low": 10.0, "high": 100.0, "count": 3}
    keys = [one.key for one in FIGURES]
    record = {
        "policy": name,
        "environment": {"suite": "hall", "buildings": 2, **environment},
        "episodes": len(REWARDS),
        "seed": 0,
        "figures": dict.fromkeys(keys, figure) | {"seconds": None},
    }
    folder.mkdir(exist_ok=True)
    (folder / "evaluation.json").write_text(json.dumps(record))
    with (folder / "episodes.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["episode", "outcome", "reward"])
        writer.writerows((k, "arrived", reward) for k, reward in enumerate(REWARDS))
    return folder


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved(tmp_path_factory.mktemp("policy") / f"{NAME}.zip")


@pytest.fixture
def card(file: Path) -> Card:
    """The card as if it had been trained in the id of a suite."""
    own = read_card(file)
    return replace(own, environment=own.environment | {"id": "ambinav/Procedural-v1"})


def front_of(text: str) -> dict[str, Any]:
    assert text.startswith("---\n")
    found: dict[str, Any] = yaml.safe_load(text.split("---\n")[1])
    return found


def test_the_front_matter_is_that_of_stable_baselines(card: Card, tmp_path: Path) -> None:
    text = model_card(NAME, card, read_judged(evaluated(tmp_path), Path(NAME)))
    front = front_of(text)
    assert front["library_name"] == "stable-baselines3"
    tags = {"ambinav/Procedural-v1", "deep-reinforcement-learning", "reinforcement-learning"}
    assert tags < set(front["tags"])
    (model,) = front["model-index"]
    (result,) = model["results"]
    assert model["name"] == "PPO" and result["dataset"]["type"] == "ambinav/Hall-v1"
    mean = result["metrics"][0]
    spread = f"{np.mean(REWARDS):.2f} +/- {np.std(REWARDS):.2f}"
    assert mean == {
        "type": "mean_reward",
        "value": spread,
        "name": "mean_reward",
        "verified": False,
    }
    arrived = next(one for one in result["metrics"] if one["type"] == "arrived_percent")
    assert arrived["value"] == 66.7
    assert "| arrived (%) | 66.7 [10.0, 100.0] |" in text and "time (s)" not in text


def test_the_hub_reads_it(card: Card, tmp_path: Path) -> None:
    hub = pytest.importorskip("huggingface_hub")
    read = hub.ModelCard(model_card(NAME, card, read_judged(evaluated(tmp_path), Path(NAME))))
    assert read.data.library_name == "stable-baselines3"
    found = {one.metric_type: one.metric_value for one in read.data.eval_results}
    assert found["arrived_percent"] == 66.7 and "+/-" in found["mean_reward"]
    assert {one.dataset_type for one in read.data.eval_results} == {"ambinav/Hall-v1"}
    assert {one.task_type for one in read.data.eval_results} == {"reinforcement-learning"}


@pytest.mark.parametrize(
    ("environment", "judged"),
    [
        ({"suite": "procedural"}, ("ambinav/Procedural-v1", "ambinav/Procedural-v1")),
        ({"suite": None}, ("ambinav/Procedural-v1", "ambinav/Procedural-v1")),
        ({"map": 'maps/it\'s "mine".yaml'}, None),
    ],
)
def test_where_it_was_judged(
    environment: dict[str, Any], judged: tuple[str, str] | None, card: Card, tmp_path: Path
) -> None:
    text = model_card(NAME, card, read_judged(evaluated(tmp_path, **environment), Path(NAME)))
    dataset = front_of(text)["model-index"][0]["results"][0]["dataset"]
    wanted = judged or ('ambinav/Navigation-v1, map it\'s "mine".yaml', "ambinav/Navigation-v1")
    assert (dataset["name"], dataset["type"]) == wanted


def run(*arguments: str) -> Any:
    return CliRunner().invoke(app, ["card", *arguments])


def test_the_folder_is_whole(file: Path, tmp_path: Path) -> None:
    evaluation = evaluated(tmp_path / "evaluation")
    done = run(str(file), str(evaluation), "-o", str(tmp_path / "hub"), "--json")
    assert done.exit_code == 0, done.output
    hub = tmp_path / "hub"
    assert json.loads(done.stdout) == {"readme": str(hub / "README.md")}
    assert sorted(path.name for path in hub.iterdir()) == [
        "README.md", "results.json", f"{NAME}.zip",
    ]  # fmt: skip
    assert (hub / f"{NAME}.zip").read_bytes() == file.read_bytes()
    results = json.loads((hub / "results.json").read_text())
    assert results["mean_reward"] == pytest.approx(2.25) and results["n_eval_episodes"] == 3
    # Of the policy in its own folder, again: the same, and the policy stays as it is.
    before = (hub / "README.md").read_text()
    assert run(str(hub / f"{NAME}.zip"), str(evaluation), "-o", str(hub)).exit_code == 0
    assert (hub / "README.md").read_text() == before


def test_an_evaluation_of_another_file_of_that_name_is_refused(file: Path, tmp_path: Path) -> None:
    evaluation = evaluated(tmp_path / "evaluation")
    record = json.loads((evaluation / "evaluation.json").read_text())
    for checksum, refused in ((sha256(file), False), ("0" * 64, True), (None, False)):
        changed = record | {"sha256": checksum}
        (evaluation / "evaluation.json").write_text(json.dumps(changed))
        done = run(str(file), str(evaluation), "-o", str(tmp_path / "hub"))
        assert done.exit_code == (2 if refused else 0)
        assert ("an evaluation of another file" in done.stderr) is refused


def test_bad_input(file: Path, tmp_path: Path) -> None:
    good = evaluated(tmp_path / "good")
    other = evaluated(tmp_path / "other", "another")
    short = evaluated(tmp_path / "short")
    rows = (short / "episodes.csv").read_text().splitlines()
    (short / "episodes.csv").write_text("\n".join(rows[:-1]))
    torn = evaluated(tmp_path / "torn")
    (torn / "evaluation.json").write_text("{")
    bare = evaluated(tmp_path / "bare")
    (bare / "episodes.csv").unlink()
    shutil.copy(good / "evaluation.json", tmp_path / "no.zip")
    cases = (
        (
            str(file),
            tmp_path / "gone",
            "gone/evaluation.json: there is no such file; run: ambinav eval",
        ),
        (str(file), bare, "bare/episodes.csv: there is no such file"),
        (str(file), other, "this is an evaluation of another, not of small"),
        (str(file), short, "are not of one evaluation"),
        (str(file), torn, "the evaluation is damaged"),
        ("vfh", good, "vfh: there is no such file; give a policy's .zip file"),
        (str(tmp_path / "gone.zip"), good, "there is no such file"),
        (str(tmp_path / "no.zip"), good, "no.zip"),
    )
    for policy, evaluation, message in cases:
        done = run(policy, str(evaluation), "-o", str(tmp_path / "out"))
        assert done.exit_code == 2, done.output
        assert message in done.stderr and done.stderr.count("\n") == 1
        assert not (tmp_path / "out").exists()
