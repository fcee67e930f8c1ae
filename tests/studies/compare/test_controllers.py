"""Policies that drive step by step, in a comparison."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

pytest.importorskip("gymnasium")

from ambinav.cli import app
from ambinav.runtime.errors import InputError
from ambinav.studies.compare.controllers import driver_of, is_controller
from ambinav.studies.compare.runs import _driver_digest
from ambinav.studies.compare.scenario_file import load_scenario
from tests.studies.compare.conftest import write

POLICY = """
import numpy as np

class ToTheWaypoint:
    def __init__(self, speed):
        self.speed = speed

    def act(self, observations, starts):
        _, cosine, sine = observations["waypoint"].T.astype(float)
        ahead = np.maximum(cosine, 0.0) ** 4
        return np.stack([2.0 * self.speed * ahead - 1.0, np.clip(sine, -1.0, 1.0)], axis=1)

def go(observation_space, action_space):
    assert observation_space["scan"].shape == (24,)
    return ToTheWaypoint(1.0)

def stay(observation_space, action_space):
    return ToTheWaypoint(0.0)

go.environment = stay.environment = {"waypoint": True, "waypoint_distance": 0.5}

def route(environment, scanner, amap, pair):
    return None

class Maker:
    def __call__(self, *arguments):
        return None

anything = Maker()
"""


@pytest.fixture
def folder(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Path:
    monkeypatch.setenv("AMBINAV_CACHE", str(tmp_path_factory.getbasetemp() / "ambinav-cache"))
    (tmp_path / "drives.py").write_text(POLICY)
    return tmp_path


def compare(scenario: Path, out: Path) -> Result:
    words = ["compare", str(scenario), "-o", str(out), "-j", "1", "--json", "--trust"]
    return CliRunner().invoke(app, words)


@pytest.mark.sweep
def test_a_policy_drives_beside_a_route(scenario: dict[str, Any], folder: Path) -> None:
    driver = {"kind": "policy", "policy": "drives.py:go", "name": "go"}
    scenario |= {"routes": ["shortest", driver], "localizer": "ekf"}
    scenario["drive"] = {"runs": 4, "seed": 3}
    scenario["people"] = {"count": 1}
    path = write(folder, scenario)
    done = compare(path, folder / "out")
    assert done.exit_code == 0, done.output
    table = (folder / "out" / "table.csv").read_text()
    assert "there,go,arrived,%,4,100," in table
    # The route that is shown goes from the start to the goal, as driven.
    lines = (folder / "out" / "routes" / "02-there-go.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines if line[:1] in "0123456789-" and line[0] != "#"]
    places = np.array([[float(row[0]), float(row[1])] for row in rows])
    assert np.abs(places[[0, -1]] - [[1, 1], [7, 2]]).max() < 1e-6


@pytest.mark.sweep
def test_reactive_baselines_drive_beside_a_route(scenario: dict[str, Any], folder: Path) -> None:
    drivers = [{"kind": "policy", "policy": name} for name in ("vfh", "dwa-aware")]
    scenario |= {"routes": ["shortest", *drivers], "localizer": "ekf"}
    scenario["drive"] = {"runs": 3, "seed": 3}
    done = compare(write(folder, scenario), folder / "out")
    assert done.exit_code == 0, done.output
    table = (folder / "out" / "table.csv").read_text()
    for name in ("vfh", "dwa-aware"):
        assert f"there,{name},arrived,%,3,100," in table


@pytest.mark.slow
def test_one_that_does_not_get_there_is_refused(scenario: dict[str, Any], folder: Path) -> None:
    scenario["routes"] = ["shortest", {"kind": "policy", "policy": "drives.py:stay"}]
    done = compare(write(folder, scenario), folder / "out")
    assert done.exit_code == 2
    assert "route 'drives.py:stay': policy drives.py:stay does not reach the goal" in done.stderr


@pytest.mark.parametrize(
    ("policy", "message"),
    [("gone.zip", "there is no such file"), ("gone", "neither a file nor a baseline")],
)
def test_bad_names(policy: str, message: str, scenario: dict[str, Any], folder: Path) -> None:
    scenario["routes"] = ["shortest", {"kind": "policy", "policy": policy}]
    done = compare(write(folder, scenario), folder / "out")
    assert done.exit_code == 2 and message in done.stderr and f"route '{policy}'" in done.stderr


def test_another_file_or_goal_is_driven_anew(scenario: dict[str, Any], folder: Path) -> None:
    scenario["routes"] = [{"kind": "policy", "policy": "drives.py:go"}]
    keys = set()
    for goal in ([7, 2], [6, 2]):
        for code in (POLICY, POLICY + "\n# changed\n"):
            (folder / "drives.py").write_text(code)
            scenario["pairs"] = [{"name": "there", "start": [1, 1], "goal": goal}]
            loaded = load_scenario(write(folder, scenario), trust=True)
            part, pair = loaded.scenario.routes[0], loaded.scenario.pairs[0]
            keys.add(_driver_digest(driver_of(loaded, pair, part)))
    assert len(keys) == 4


def test_who_drives_and_who_makes_routes(folder: Path) -> None:
    controllers = {"go": True, "route": False, "anything": False}
    for name, drives in controllers.items():
        assert is_controller(f"drives.py:{name}", folder, trust=True) is drives
    assert is_controller("run/best.zip", folder)
    with pytest.raises(InputError, match="no callable"):
        is_controller("drives.py:gone", folder, trust=True)


@pytest.mark.parametrize("name", ["go", "route", "gone"])
def test_code_runs_only_if_it_is_trusted(name: str, scenario: dict[str, Any], folder: Path) -> None:
    (folder / "drives.py").write_text("open('it-ran', 'w')\n" + POLICY)
    scenario["routes"] = ["shortest", {"kind": "policy", "policy": f"drives.py:{name}"}]
    words = ["compare", str(write(folder, scenario)), "-o", str(folder / "out"), "-j", "1"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2 and "is code that would run with your rights" in done.stderr
    assert "--trust" in done.stderr and done.stderr.count("\n") == 1
    assert not list(folder.rglob("it-ran")) and not (folder / "out").exists()
