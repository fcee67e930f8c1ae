"""Localizers that are programs: the same estimates as within, and what goes wrong with them."""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ambinav.buildings.load import load_environment
from ambinav.drive.drive import drive_route
from ambinav.drive.localizer_spec import ChosenLocalizer, LocalizerContext, chosen_localizer
from ambinav.drive.localizers import DeadReckoning
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.odometries import ODOMETRIES
from ambinav.drive.robot import Robot
from ambinav.forecasting.ensemble import ensemble
from ambinav.runtime.errors import InputError
from tests.drive.cases import laser, route_through
from tests.geometry.scenes import room

NOISE = OdometryNoise()
SCANNER = laser(4.0, 8)
DEAD_RECKONING = """
import json, math, sys

def answer(**values):
    print(json.dumps(values), flush=True)

setting = json.loads(sys.stdin.readline())
open(LOG, "w").write(json.dumps(setting))
answer()
for line in sys.stdin:
    message = json.loads(line)
    if "start" in message:
        poses, before = message["start"], None
        answer()
        continue
    now = message["odometry"]
    for pose, a, b in zip(poses, before or now, now):
        turn = pose[2] - a[2]
        dx, dy = b[0] - a[0], b[1] - a[1]
        pose[0] += math.cos(turn) * dx - math.sin(turn) * dy
        pose[1] += math.sin(turn) * dx + math.cos(turn) * dy
        pose[2] = (pose[2] + b[2] - a[2] + math.pi) % (2 * math.pi) - math.pi
    before = now
    seen = [[r for r in ranges if r is not None and r <= 4.0] for ranges in message["ranges"]]
    answer(pose=poses, covariance=[[[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.01]]] * len(poses),
           used=[bool(ranges) for ranges in seen])
"""


def chosen(folder: Path, text: str, **more: Any) -> ChosenLocalizer:
    """Return the localizer that a program's text is."""
    script = folder / "filter.py"
    script.write_text(text.replace("LOG", repr(str(folder / "log.json"))))
    plain = {"type": "program", "command": [sys.executable, str(script)], **more}
    return chosen_localizer(plain, NOISE, Robot(), 10.0)


def context(runs: int = 2) -> LocalizerContext:
    return LocalizerContext(room(6.0, 4.0), SCANNER, NOISE, runs, np.random.default_rng(1))


def test_is_as_the_same_localizer_within(tmp_path: Path) -> None:
    environment = room(6.0, 4.0)
    route = route_through([(1.0, 1.0), (4.0, 1.2), (4.5, 3.0)])
    drives = [
        drive_route(
            environment, SCANNER, Robot(radius=0.2), route, localizer,
            np.random.default_rng(3), 3, noise=NOISE,
        )
        for localizer in (chosen(tmp_path, DEAD_RECKONING), DeadReckoning(NOISE, 3))
    ]  # fmt: skip
    assert drives[0].estimate.shape == drives[1].estimate.shape
    np.testing.assert_allclose(drives[0].estimate, drives[1].estimate, atol=1e-9, equal_nan=True)
    np.testing.assert_allclose(drives[0].truth, drives[1].truth, atol=1e-9, equal_nan=True)


def test_what_it_is_told(tmp_path: Path) -> None:
    localizer = chosen(tmp_path, DEAD_RECKONING).make(context())
    setting = json.loads((tmp_path / "log.json").read_text())
    assert setting["runs"] == 2
    assert np.shape(setting["beams"]) == (8, 3)
    assert setting["range_max"] == [4.0] * 8
    assert setting["odometry"]["alpha1"] == NOISE.modelled.alpha1
    mapped = load_environment(setting["map"])
    assert mapped.free.area == pytest.approx(24.0, rel=0.05)
    assert localizer is not None
    localizer.start(np.zeros((2, 3)), np.eye(3))
    ranges = np.full((2, 8), np.inf, dtype=np.float32)
    ranges[1, 0], ranges[1, 1] = np.nan, -np.inf
    assert localizer.update(np.zeros((2, 3)), ranges).tolist() == [False, True]
    folder = Path(setting["map"]).parent
    del localizer
    assert not folder.exists()


# Answers with a covariance of the given rows.
VARIES = (
    "import json, sys\n"
    "for line in sys.stdin:\n"
    "    print(json.dumps({'pose': 2 * [3 * [0]], 'covariance': 2 * [%s]}), flush=True)"
)
SAYS = 'import json, sys\nfor line in sys.stdin:\n    print(json.dumps({"pose": 1}), flush=True)'


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import sys; sys.exit('no such sensor')", "ended with status 1: no such sensor"),
        ("print('ready', flush=True); input()", "answered ready; let it print one JSON object"),
        ("import time; time.sleep(60)", r"did not answer in 0\.5 s; give it more"),
        (SAYS, "answered no pose of 2 x 3 finite numbers"),
        (VARIES % "[[1, 0, 0], [0, -1, 0], [0, 0, 1]]", "has a variance below zero"),
        (VARIES % "[[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]", "that is not symmetric"),
        ("import os, time; os.close(1); time.sleep(9)", "closed its output"),
    ],
)
def test_what_goes_wrong_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        localizer = chosen(tmp_path, text, seconds=0.5 if "sleep(60)" in text else 30).make(
            context()
        )
        assert localizer is not None
        localizer.start(np.zeros((2, 3)), np.eye(3))
        localizer.update(np.zeros((2, 3)), np.zeros((2, 8), dtype=np.float32))
    assert "filter.py" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_a_program_that_does_not_read_blocks_nobody(tmp_path: Path) -> None:
    text = "import time\nfor _ in range(2): input(); print('{}', flush=True)\ntime.sleep(60)"
    localizer = chosen(tmp_path, text, seconds=0.5).make(context(runs=4000))
    assert localizer is not None
    localizer.start(np.zeros((4000, 3)), np.eye(3))
    began = time.monotonic()
    with pytest.raises(InputError, match="did not answer"):
        localizer.update(np.zeros((4000, 3)), np.ones((4000, 8), dtype=np.float32))
    assert time.monotonic() - began < 30.0


def test_no_process_is_left(tmp_path: Path) -> None:
    text = "import os\n" + DEAD_RECKONING.replace("json.dumps(setting)", "str(os.getpid())")
    localizer = chosen(tmp_path, text).make(context())
    number = int((tmp_path / "log.json").read_text())
    os.kill(number, 0)
    del localizer
    with pytest.raises(ProcessLookupError):
        os.kill(number, 0)


@pytest.mark.parametrize("command", ["filter.py", [], [1], None])
def test_bad_command(command: Any) -> None:
    with pytest.raises(InputError, match=r"command is .*; give a list of words"):
        chosen_localizer({"type": "program", "command": command}, NOISE, Robot(), 10.0)


def test_missing_program() -> None:
    plain = {"type": "program", "command": ["no-such-filter"]}
    localizer = chosen_localizer(plain, NOISE, Robot(), 10.0)
    with pytest.raises(InputError, match=r"`no-such-filter` cannot be started \(No such file"):
        localizer.make(context())


def test_its_file_is_part_of_its_identity(tmp_path: Path) -> None:
    first = chosen(tmp_path, DEAD_RECKONING).identity
    assert chosen(tmp_path, DEAD_RECKONING).identity == first
    assert chosen(tmp_path, DEAD_RECKONING + "\n").identity != first


@pytest.mark.slow
def test_filter_of_another_project(monkeypatch: pytest.MonkeyPatch) -> None:
    """The example knows where it is where dead reckoning does not."""
    noise, script = ODOMETRIES["poor"], "examples/outside_localizer/pfilter_localizer.py"
    monkeypatch.chdir(Path(__file__).parents[2])
    filtered = {"type": "program", "command": [sys.executable, script]}
    route = route_through([(1.0, 1.0), (7.0, 1.2), (7.0, 5.0), (2.0, 5.0)])
    environment, lost = room(8.0, 6.0), {}
    for plain in (filtered, "odometry"):
        localizer = chosen_localizer(plain, noise, Robot(), 10.0)
        runs = ensemble(
            environment, laser(4.0, 60), route, localizer, np.random.default_rng(2), 8, noise=noise
        )
        lost[localizer.spec.name] = int(runs.lost.sum())
    assert lost["program"] == 0
    assert lost["odometry"] >= 4
