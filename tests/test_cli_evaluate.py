"""`ambinav evaluate` and `ambinav benchmark` as a user meets them."""

from __future__ import annotations

import csv
import importlib
import json
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

pytest.importorskip("gymnasium")

from ambinav.cli import app
from ambinav_envs.navigation import NavigationEnv

ROOT = Path(__file__).parents[1]
DEMO = str(ROOT / "configs" / "demo.geojson")
PLUG = """
import numpy as np


class Spinner:
    def act(self, observations, starts):
        return np.tile(np.float32([-1.0, 0.3]), (len(starts), 1))


def spinner(observation_space, action_space):
    assert "waypoint" in observation_space.spaces
    return Spinner()


spinner.environment = {"waypoint": True, "max_steps": 5}
"""


@pytest.fixture
def runner(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> CliRunner:
    monkeypatch.setenv("AMBINAV_CACHE", str(tmp_path_factory.getbasetemp() / "ambinav-cache"))
    return CliRunner()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "plug.py").write_text(PLUG)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_evaluate(runner: CliRunner, folder: Path) -> None:
    command = [
        "evaluate",
        "plug.py:spinner",
        "--trust",
        "--map",
        DEMO,
        "-n",
        "3",
        "-o",
        "out",
        "people=1",
    ]
    done = runner.invoke(app, [*command, "--json"])
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert report["figures"]["timeout"]["value"] == 100.0
    assert report["code"] is True
    assert report["environment"]["people"] == 1 and report["environment"]["max_steps"] == 5
    assert json.loads((folder / "out" / "evaluation.json").read_text()) == report
    with (folder / "out" / "episodes.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["outcome"] for row in rows] == ["timeout"] * 3
    # The seed makes the episode again.
    _, info = NavigationEnv(map=DEMO, people=1).reset(seed=int(rows[2]["seed"]))
    assert float(rows[2]["shortest"]) == pytest.approx(info["shortest"], rel=1e-5)
    done = runner.invoke(app, command)
    assert "3 episodes in demo" in done.stdout and "exposure per metre" in done.stdout
    assert "normalized score" in done.stdout and "with the true pose: arrived (%)" in done.stdout
    twins = report["twins"]
    assert twins["normalized_by"]["blind"]["method"] == "shortest"
    # Who spins arrives nowhere, by the truth as little as by its estimate.
    assert twins["policy_true_pose"]["figures"]["arrived"]["value"] == 0.0
    difference = twins["policy_true_pose"]["differences"]["arrived"]
    assert difference["value"] == 0.0
    assert difference["low"] < 0.0 < difference["high"]  # three runs show little
    assert twins["blind"]["figures"]["return"] is not None
    alone = runner.invoke(app, [*command, "--json", "--no-twins"])
    assert json.loads(alone.stdout) == report | {"twins": None}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["gone.zip"], "there is no such file"),
        (["gone"], "neither a file nor a baseline"),
        (["plug.py"], "give plug.py:callable"),
        (["plug.py:spinner", "people=many"], "give a whole number, or its fields by name"),
        (["plug.py:spinner", "peple=3"], "did you mean people"),
        (["plug.py:spinner", "people"], "write KEY=VALUE"),
        (["plug.py:spinner", "people=[1"], "cannot be read"),
        (["plug.py:spinner", "people=1", "people=2"], "people is given twice"),
        (["plug.py:spinner", "-n", "0"], "--episodes: 0 is too few"),
        (["plug.py:spinner", "--seed", "-1"], "--seed: -1 is negative"),
        (["plug.py:spinner", "--suite", "ofice"], "office"),
        (["plug.py:spinner", "--suite", "office", "--map", DEMO], "give one of the two"),
        (["plug.py:spinner", "waypoint=false", "--map", DEMO], "failed (AssertionError"),
    ],
)
def test_evaluate_bad_input(
    arguments: list[str], message: str, runner: CliRunner, folder: Path
) -> None:
    done = runner.invoke(app, ["evaluate", *arguments, "--trust"])
    assert done.exit_code == 2, done.output
    assert message in done.stderr and done.stderr.startswith("ambinav: error: ")
    assert done.stderr.count("\n") == 1 and not done.stdout


@pytest.mark.slow
def test_benchmark(runner: CliRunner, folder: Path) -> None:
    pytest.importorskip("ompl")
    # The package's attribute of this name is the command.
    module = importlib.import_module("ambinav.cli.benchmark")
    command = ["benchmark", "-o", "out", "-n", "2", "--quick", "--planner", "reference:1"]
    command += ["--trust", "--policy", "plug.py:spinner", "max_steps=20", "longest=4"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "QUICK_BUILDINGS", 1)
        done = runner.invoke(app, [*command, "--json"])
        assert done.exit_code == 0, done.output
        report = json.loads(done.stdout)
        assert json.loads((folder / "out" / "report.json").read_text()) == report
        methods = [method["name"] for method in report["methods"]]
        assert {"waypoint follower", "shortest", "reference 1", "plug.py:spinner"} <= set(methods)
        again = runner.invoke(app, command)
    assert "procedural, disturbed" in again.stdout and "plug.py:spinner" in again.stdout


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-n", "0"], "--episodes: 0 is too few"),
        (["--planner", "prmstr"], "prmstar"),
        (["--planner", "shortest"], "the method 'shortest', routes of"),
        pytest.param(["--policy", "gone.zip"], "there is no such file", marks=pytest.mark.slow),
        (["--map", "gone.yaml"], "gone.yaml"),
        (["peple=3"], "did you mean people"),
        (["-o", "plug.py"], "this is a file, not a folder"),
    ],
)
def test_benchmark_bad_input(
    arguments: list[str], message: str, runner: CliRunner, folder: Path
) -> None:
    pytest.importorskip("ompl")
    done = runner.invoke(app, ["benchmark", *arguments])
    assert done.exit_code == 2, done.output
    assert message in done.stderr and not done.stdout
    assert [path.name for path in folder.iterdir()] == ["plug.py"]


@pytest.mark.parametrize(
    ("arguments", "missing", "what"),
    [
        (["train", "tiny.yaml", "-o", "out"], "torch", "training"),
        (["evaluate", "plug.py:spinner"], "gymnasium", "evaluating"),
        (["benchmark", "-o", "out"], "gymnasium", "the leaderboard"),
    ],
)
def test_a_missing_package_is_named_the_same_everywhere(
    arguments: list[str],
    missing: str,
    what: str,
    runner: CliRunner,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    module = importlib.import_module("ambinav.runtime.packages")
    find = module.find_spec
    monkeypatch.setattr(module, "find_spec", lambda name: None if name == missing else find(name))
    done = runner.invoke(app, arguments)
    assert done.exit_code == 2, done.output
    wanted = f'ambinav: error: {what} needs {missing}; run: pip install "ambinav[envs]".\n'
    assert done.stderr == wanted and not (folder / "out").exists()


@pytest.mark.slow
def test_a_module_of_the_working_folder(
    runner: CliRunner, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path not in ("", str(folder))])
    (folder / "plug_of_mine.py").write_text(PLUG)
    done = runner.invoke(
        app, ["evaluate", "--trust", "plug_of_mine:spinner", "--map", DEMO, "-n", "1"]
    )
    assert done.exit_code == 0, done.output


@pytest.mark.slow
@pytest.mark.parametrize("given", ["[[0.0, 0.0], [0.0]]", "np.full((len(starts), 2), np.nan)"])
def test_odd_actions_name_the_policy(given: str, runner: CliRunner, folder: Path) -> None:
    (folder / "odd.py").write_text(
        PLUG.replace("np.tile(np.float32([-1.0, 0.3]), (len(starts), 1))", given)
    )
    done = runner.invoke(app, ["evaluate", "--trust", "odd.py:spinner", "--map", DEMO, "-n", "1"])
    assert done.exit_code == 2, done.output
    assert done.stderr.startswith("ambinav: error: policy odd.py:spinner: action")
    assert done.stderr.count("\n") == 1


def test_code_runs_only_if_it_is_trusted(runner: CliRunner, folder: Path) -> None:
    (folder / "plug.py").write_text("open('it-ran', 'w')\n" + PLUG)
    for command in (
        ["evaluate", "plug.py:spinner", "--map", DEMO],
        ["benchmark", "-o", "out", "--policy", "plug.py:spinner", "--map", DEMO],
    ):
        done = runner.invoke(app, command)
        assert done.exit_code == 2, done.output
        assert "'plug.py:spinner' is code" in done.stderr and "add --trust" in done.stderr
        assert done.stderr.count("\n") == 1 and not (folder / "it-ran").exists()
