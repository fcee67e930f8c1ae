"""The frozen benchmark: its score, its submissions, and that no change goes unnoticed."""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

pytest.importorskip("gymnasium")

from ambinav.cli import app
from ambinav.runtime.errors import InputError, InputWarning
from ambinav_envs.evaluation import UNSEEN, Episodes
from ambinav_envs.leaderboard.frozen import FrozenBenchmark, seeds_of
from ambinav_envs.leaderboard.submission import (
    Entry,
    entries_for,
    make_record,
    read_submission,
    verify,
)
from ambinav_envs.leaderboard.submission_checks import first_difference, scores_of
from ambinav_envs.simulation.layout import OUTCOMES
from ambinav_envs.tasks import HARD_TASKS, VARIANTS
from tests.envs.sharing.submissions import HARD, PLAIN, SECRET, copied, ignore, small, written


def test_the_score_of_an_episode() -> None:
    ended = ["arrived", "arrived", "arrived", "missed", "collided", "lost", "timeout"]
    count = len(ended)
    columns: dict[str, Any] = dict.fromkeys(Episodes.__dataclass_fields__, np.zeros(count))
    columns["outcome"] = np.array([OUTCOMES.index(name) for name in ended])
    columns["shortest"] = np.full(count, 5.0)
    columns["seconds"] = np.array([20.0, 10.0, 8.0, 20.0, 20.0, 20.0, 60.0])
    # 5 m at 0.5 m/s take 10 s.
    assert Episodes(**columns).sct(0.5).tolist() == [0.5, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]


def test_the_score_of_tasks() -> None:
    quarters = [0.0, 0.25, 0.5, 0.75] * 3
    spread = [[f"hall-{k // 4}", k, "arrived", 1.0, s] for k, s in enumerate(quarters)]
    same = [[f"loop-{k}", k, "collided" if k else "arrived", 1.0, 0.5] for k in range(3)]
    scores = scores_of({"spread": spread, "same": same})
    assert scores["score"]["value"] == 0.4375 == (0.375 + 0.5) / 2
    own = scores["tasks"]
    assert (own["same"]["low"], own["same"]["value"], own["same"]["high"]) == (0.5, 0.5, 0.5)
    assert own["same"]["collided"] == 2 and own["spread"]["arrived"] == 12
    # Of 12 even draws from the quarters: mean 0.375, deviation sqrt(5) / 8 / sqrt(12) = 0.081.
    half = 1.96 * np.sqrt(5.0) / 8.0 / np.sqrt(12.0)
    assert own["spread"]["low"] == pytest.approx(0.375 - half, abs=0.025)
    assert own["spread"]["high"] == pytest.approx(0.375 + half, abs=0.025)
    assert scores["score"]["high"] == pytest.approx(0.4375 + half / 2, abs=0.0125)


@pytest.mark.slow
def test_the_shipped_definition_holds() -> None:
    frozen = FrozenBenchmark.read()
    venues = list(frozen.venues(None))
    assert [task for _, task, _ in venues] == [*(spec.name for spec in HARD_TASKS), PLAIN]
    assert frozen.first >= VARIANTS and frozen.first + 30 <= UNSEEN
    assert {venue.count for _, _, venue in venues} == {30}


@pytest.mark.slow
def test_the_recorded_maps_are_the_frozen_ones(
    data_dir: Path, frozen: FrozenBenchmark, tmp_path: Path
) -> None:
    names = [venue.name for part, _, venue in frozen.venues(data_dir) if part == "recorded"]
    assert names == ["nav2_depot", "freiburg-079", "stata_hallways_5cm"] * 2
    with pytest.raises(InputError, match=r"nav2_depot.yaml is missing; put the map there"):
        list(frozen.venues(tmp_path))
    name = "maps/nav2_depot.yaml"
    (tmp_path / "maps").mkdir()
    text = (
        (data_dir / name)
        .read_text()
        .replace("nav2_depot.png", str(data_dir / "maps/nav2_depot.png"))
    )
    (tmp_path / name).write_text(text.replace("resolution: 0.05", "resolution: 0.06"))
    with pytest.raises(InputError, match=r"nav2_depot.yaml is not the frozen one"):
        list(frozen.venues(tmp_path))


@pytest.mark.parametrize(
    ("part", "name"), [("buildings", "hall-1001"), ("tasks", "ambinav/AccurateGoal-v1")]
)
def test_other_buildings_and_tasks_are_noticed(
    part: str, name: str, frozen: FrozenBenchmark, tmp_path: Path
) -> None:
    plain: dict[str, dict[str, Any]] = {
        "buildings": dict(frozen.buildings),
        "tasks": dict(frozen.tasks),
    }
    if part == "buildings":
        plain[part]["hall"] = [frozen.buildings["hall"][0], "0" * 64]
    else:
        plain[part][name] = "0" * 64
    other = small(tmp_path, **plain)
    with pytest.raises(InputError, match=f"{name} is not the frozen one"):
        make_record(other, entries_for(other, ["vfh"], False), ignore)


@pytest.mark.slow
def test_a_submission_is_verified(
    record: dict[str, Any], frozen: FrozenBenchmark, tmp_path: Path
) -> None:
    path = written(record, tmp_path / "mine.json", sealed=False)
    assert verify(path, frozen, ignore) == (record, None)
    (network, baseline) = record["policies"]
    assert (network["name"], network["tasks"], network["complete"]) == ("mine", [PLAIN], True)
    assert (baseline["name"], baseline["kind"], baseline["file"]) == ("vfh", "reactive", None)
    assert [len(rows) for rows in record["drawn"]["episodes"].values()] == [4, 4]
    # Whoever has its seeds changed, and all else made to fit, is found by driving.
    changed = copied(record)
    changed["drawn"]["episodes"][HARD][2][2:] = ["arrived", 12.0, 0.75]
    _, difference = verify(written(changed, tmp_path / "changed.json"), frozen, ignore)
    assert difference is not None and "arrived after 12 s with score 0.75 in the file" in difference
    assert difference.startswith(f"{HARD}, hall-1001, seed ")
    assert difference.endswith("here (seconds, score differ).")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda record: record["policies"][1].update(sha256="0" * 64),
            f"policy 'vfh': sha256 is {'0' * 64} in the file, but ",
        ),
        (
            lambda record: record["drawn"]["tasks"][HARD].update(low=0.5),
            f"drawn, {HARD}: low is 0.5 in the file, but ",
        ),
        (
            lambda record: record["drawn"]["score"].update(value=0.5),
            "drawn: value of the score is 0.5 in the file, but ",
        ),
        (
            lambda record: record["drawn"]["episodes"][PLAIN][0].__setitem__(3, 7.0),
            r"\(seconds differ\)\.$",
        ),
    ],
)
def test_differences_are_named(
    change: Callable[[dict[str, Any]], None], message: str, record: dict[str, Any]
) -> None:
    changed = copied(record)
    change(changed)
    assert first_difference(record, copied(record)) is None
    assert re.search(message, str(first_difference(changed, record)))


def test_the_kept_submission_holds() -> None:
    path = Path(__file__).parents[3] / "benchmarks/results/benchmark-v1-vfh-aware.json"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        record = read_submission(path, FrozenBenchmark.read())
    assert len(record["drawn"]["episodes"]) == 6


@pytest.mark.slow
def test_the_hidden_seed(
    record: dict[str, Any], frozen: FrozenBenchmark, submission_folder: Path
) -> None:
    secret = submission_folder / "secret.json"
    path = written(record, submission_folder / "public.json", sealed=False)
    hidden = make_record(frozen, entries_for(frozen, [str(path)], False), ignore, secret=secret)
    assert hidden["policies"] == record["policies"] and hidden["seeds"] == "hidden"
    # No episode is published, by whose exact score start and goal could be found.
    assert hidden["drawn"]["episodes"] is None
    assert hidden["drawn"]["tasks"] != record["drawn"]["tasks"]
    text = json.dumps(hidden)
    seeds = seeds_of(int("5" * 64, 16), HARD, "hall-1000", 2)
    assert "5" * 64 not in text and not any(str(seed) in text for seed in seeds)
    # They are too many to be tried one by one.
    assert min(seeds_of(int("5" * 64, 16), HARD, "hall-1000", 50)) > 2**40
    again = written(hidden, submission_folder / "hidden.json", sealed=False)
    assert verify(again, frozen, ignore, secret=secret)[1] is None
    with pytest.raises(InputError, match="it was made with --secret; give it too"):
        verify(again, frozen, ignore)
    other = submission_folder / "other.json"
    other.write_text(SECRET.replace("5", "6"))
    with pytest.raises(InputError, match="is committed to"):
        make_record(frozen, entries_for(frozen, ["vfh"], False), ignore, secret=other)
    attack = Entry.of(list(frozen.tasks), f"{submission_folder}/attacks.py:stands", trust=True)
    with pytest.raises(InputError, match="is code, which could read the hidden seed"):
        make_record(frozen, [attack], ignore, secret=secret)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["declares", "stands", "rams", "acts_randomly"])
def test_who_does_not_navigate_scores_nothing(
    name: str, frozen: FrozenBenchmark, submission_folder: Path
) -> None:
    few = replace(frozen, tasks={HARD: frozen.tasks[HARD]}, episodes=4)
    source = f"{submission_folder}/attacks.py:{name}"
    record = make_record(few, entries_for(few, [source], True), ignore)
    assert record["drawn"]["score"]["value"] == 0.0
    assert record["policies"][0]["complete"] is False
    path = written(record, submission_folder / f"{name}.json", sealed=False)
    with pytest.raises(InputError, match="is not part of the submission; give it with --policy"):
        verify(path, few, ignore)
    if name == "declares":
        assert record["drawn"]["tasks"][HARD]["missed"] == 8
        assert verify(path, few, ignore, [source], trust=True)[1] is None


@pytest.mark.parametrize(
    ("policies", "message"),
    [
        ([], "a task has two policies or none"),
        (["vfh", "dwa"], "a task has two policies or none"),
        ([f"{HARD}=vfh"], "a task has two policies or none"),
        ([f"{HARD}=vfh", f"{HARD}=dwa", "vfh"], "a task has two policies or none"),
        ([f"{HARD}=vhf", "vfh"], "did you mean vfh"),
        (
            ["ambinav/AcurateGoal-v1=vfh", "vfh"],
            "'ambinav/AcurateGoal-v1' is no task of the benchmark; did you mean ambinav/Accu",
        ),
        (["Procedural-v1=vfh", "vfh"], f"is no task of the benchmark; did you mean {PLAIN}"),
        (["gone.json"], "gone.json: it cannot be read"),
    ],
)
def test_policies_are_refused(policies: list[str], message: str, frozen: FrozenBenchmark) -> None:
    with pytest.raises(InputError, match=message):
        entries_for(frozen, policies, False)


@pytest.mark.slow
def test_the_command(
    record: dict[str, Any], frozen: FrozenBenchmark, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(FrozenBenchmark, "read", lambda: frozen)
    run = CliRunner().invoke
    path = tmp_path / "quick.json"
    done = run(app, ["benchmark", "--submit", str(path), "--policy", "vfh", "--quick", "--json"])
    assert done.exit_code == 0, done.output
    trial = json.loads(path.read_text())
    assert trial["quick"] and json.loads(done.stdout)["drawn"]["score"] == trial["drawn"]["score"]
    done = run(app, ["benchmark", "--rerun", str(path)])
    assert done.exit_code == 2 and "it is a quick trial" in done.stderr
    changed = copied(record)
    changed["drawn"]["episodes"][PLAIN][0][3] += 0.2
    written(changed, path)
    done = run(app, ["benchmark", "--rerun", str(path)])
    assert done.exit_code == 3 and f"differs: {PLAIN}, procedural-1000, seed" in done.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--submit", "a.json", "--policy", "vfh", "--seed", "1"], "--submit: the episodes of the"),
        (["--submit", "a.json", "--policy", "vfh", "people=3"], "--submit: the episodes of the"),
        (["--rerun", "a.json", "-o", "out"], "--rerun: the episodes of the benchmark are fixed"),
        (["--rerun", "a.json", "--quick"], "--quick cannot verify a submission"),
        (["--rerun", "a.json", "--submit", "b.json"], "--submit and --rerun are both given"),
        (["--secret", "a.json"], "--secret is for --submit, --rerun; leave it out"),
        (["--submit", "a.txt", "--policy", "vfh"], "ends in '.txt'"),
        (["--submit", "a.json"], "a task has two policies or none"),
        (["--rerun", "a.json"], "a.json: it cannot be read"),
    ],
)
def test_the_command_refuses(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["benchmark", *arguments])
    assert done.exit_code == 2 and message in done.stderr, done.output
    assert done.stderr.count("\n") == 1 and not list(tmp_path.iterdir())
