"""`ambinav train` as a user meets it: exit status, what is said, what is left on disk."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

pytest.importorskip("stable_baselines3")

from ambinav.cli import app
from tests.envs.training.cases import TINY

ROOT = Path(__file__).parents[1]


@pytest.fixture
def folder(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """A working folder with a configuration."""
    monkeypatch.setenv("AMBINAV_CACHE", str(tmp_path_factory.getbasetemp() / "ambinav-cache"))
    (tmp_path / "tiny.yaml").write_text(yaml.safe_dump(TINY))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def runner() -> CliRunner:
    return CliRunner()


@pytest.mark.slow
def test_trains_and_tells(runner: CliRunner, folder: Path) -> None:
    result = runner.invoke(app, ["train", "tiny.yaml", "-o", "out", "--steps", "256"])
    assert result.exit_code == 0, result.output
    assert "256 steps in" in result.stdout and "policy: out/final.zip" in result.stdout
    assert "256 steps: arrived" in result.stderr
    assert (folder / "out" / "report.md").is_file()


@pytest.mark.slow
def test_json_is_one_line_and_nothing_else(runner: CliRunner, folder: Path) -> None:
    result = runner.invoke(app, ["train", "tiny.yaml", "-o", "out", "--json", "--seed", "9"])
    assert result.exit_code == 0, result.output
    assert result.stdout.count("\n") == 1 and not result.stderr
    summary = json.loads(result.stdout)
    assert summary["steps"] == 512 and summary["final"]["episodes"] == 4
    assert yaml.safe_load((folder / "out" / "config.yaml").read_text())["seed"] == 9


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["none.yaml", "-o", "out"], "none.yaml: the file cannot be read"),
        (["bad.yaml", "-o", "out"], "bad.yaml: the key 'stepz' is unknown; did you mean steps"),
        (["tiny.yaml", "-o", "tiny.yaml"], "this is a file, not a folder"),
        (["tiny.yaml", "-o", "tiny.yaml/out"], "is a file, not a folder"),
        (["tiny.yaml", "-o", "out", "--resume"], "no training is there to be resumed"),
        (["tiny.yaml", "-o", "out", "--steps", "0"], "--steps: 0 is not above zero"),
        (["tiny.yaml", "-o", "out", "--minutes", "-1"], "--minutes: -1 is not above zero"),
        (["tiny.yaml", "-o", "out", "--seed", "-1"], "--seed: -1 is negative"),
        (["tiny.yaml", "-o", "out", "--steps", "9", "--minutes", "9"], "give one of the two"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(
    runner: CliRunner, folder: Path, given: list[str], message: str
) -> None:
    (folder / "bad.yaml").write_text("stepz: 3\nenvironment: {id: ambinav/Hall-v1}\n")
    result = runner.invoke(app, ["train", *given])
    assert result.exit_code == 2, result.output
    assert message in result.stderr and result.stderr.count("\n") == 1
    assert not (folder / "out").exists()


@pytest.mark.slow
def test_a_training_is_not_trained_over(runner: CliRunner, folder: Path) -> None:
    call = ["train", "tiny.yaml", "-o", "out", "--steps", "256"]
    assert runner.invoke(app, call).exit_code == 0
    again = runner.invoke(app, call)
    assert again.exit_code == 2 and "add --resume" in again.stderr
    longer = runner.invoke(app, ["train", "tiny.yaml", "-o", "out", "--resume", "--json"])
    assert longer.exit_code == 0 and json.loads(longer.stdout)["steps"] == 512
    other = runner.invoke(app, ["train", "tiny.yaml", "-o", "out", "--resume", "--seed", "5"])
    assert other.exit_code == 2 and "seed is 5 and was 3" in other.stderr


@pytest.mark.sweep
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_training_can_be_resumed(
    folder: Path, number: signal.Signals, status: int
) -> None:
    paths = os.pathsep.join(str(ROOT / name) for name in ("", "envs", "planners"))
    command = [sys.executable, "-m", "ambinav.cli", "train", "tiny.yaml", "-o", "out"]
    progress = folder / "out" / "progress.csv"
    deadline = time.monotonic() + 300.0
    with subprocess.Popen(
        [*command, "--steps", "100000000"],
        env={**os.environ, "PYTHONPATH": paths},
        stderr=subprocess.PIPE,
        text=True,
    ) as running:
        try:
            while not progress.is_file() or progress.read_text().count("\n") < 3:
                assert running.poll() is None and time.monotonic() < deadline
                time.sleep(0.05)
            running.send_signal(number)
            _, stderr = running.communicate(timeout=120)
        finally:
            running.kill()
    assert running.returncode == status, stderr
    assert "--resume continues" in stderr and "Traceback" not in stderr
    (kept,) = (folder / "out" / "checkpoints").iterdir()
    steps = int(kept.name) + 256
    done = CliRunner().invoke(
        app, ["train", "tiny.yaml", "-o", "out", "--resume", "--json", "--steps", str(steps)]
    )
    assert done.exit_code == 0 and json.loads(done.stdout)["steps"] == steps, done.output
