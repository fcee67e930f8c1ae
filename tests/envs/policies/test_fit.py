"""Another scanner or robot than a policy was trained with is refused, or named."""

from __future__ import annotations

import json
import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner, Result

pytest.importorskip("stable_baselines3")

from ambinav.cli import app
from ambinav.drive.robot import Robot
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.planar_scanner import default_scanner
from ambinav_envs.policies import ModelPolicy, load_policy
from ambinav_envs.policies.fit import (
    _ROBOT,
    _SENSOR,
    check_fit,
    difference_text,
    differences,
    trained_dt,
)
from tests.envs.policies.models import saved
from tests.studies.compare.conftest import SCENARIO, write

SENSOR = RangeSensor(max_range=4.0, std=0.03, resolution=0.01)


def scanner(
    beams: int = 60, aperture: float = 360.0, mount: tuple[float, float, float] = (0.0, 0.0, 0.0),
    **sensor: Any,
) -> RangeScanner:  # fmt: skip
    """The default scanner, or one that differs."""
    return RangeScanner.planar(replace(SENSOR, **sensor), beams, math.radians(aperture), mount)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A policy file of an untrained model with the default scanner and robot."""
    return saved(tmp_path_factory.mktemp("policy") / "mine.zip")


@pytest.fixture(scope="module")
def policy(file: Path) -> ModelPolicy:
    loaded = load_policy(file)
    assert isinstance(loaded, ModelPolicy)
    return loaded


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"scanner": scanner(beams=32)}, "beams 60, here 32"),
        ({"scanner": scanner(aperture=180.0)}, "aperture 360 degrees, here 180 degrees"),
        ({"scanner": scanner(max_range=12.0)}, "range 4 m, here 12 m"),
        ({"scanner": scanner(min_range=0.1)}, "least range 0 m, here 0.1 m"),
        ({"scanner": scanner(std=0.1)}, "noise 0.03 m, here 0.1 m"),
        ({"scanner": scanner(bias=0.1)}, "bias 0 m, here 0.1 m"),
        ({"scanner": scanner(resolution=0.1)}, "resolution 0.01 m, here 0.1 m"),
        ({"scanner": scanner(aperture=360.0, max_incidence=1.0)}, "incidence any, here 57.3"),
        ({"scanner": scanner(random_share=0.2)}, "share of random readings 0.01, here 0.2"),
        ({"scanner": scanner(lost_share=0.2)}, "share of lost readings 0, here 0.2"),
        (
            {"scanner": scanner(intensity=Intensity(wall=100, reflector=255, std=20))},
            "intensity none, here wall 100",
        ),
        ({"scanner": scanner(mount=(0.1, 0.0, 0.0))}, "mount (0, 0) m, here (0.1, 0) m"),
        ({"scanner": scanner(mount=(0.0, 0.0, 0.05))}, "beams that stand or look otherwise"),
        ({"robot": Robot(radius=0.4)}, "radius 0.22 m, here 0.4 m"),
        ({"robot": Robot(max_speed=1.0)}, "speed 0.5 m/s, here 1 m/s"),
        ({"robot": Robot(max_turn_rate=1.0)}, "turn rate 2 rad/s, here 1 rad/s"),
        ({"robot": Robot(acceleration=1.0)}, "acceleration 2.5 m/s2, here 1 m/s2"),
    ],
)
def test_each_difference_is_named(policy: ModelPolicy, changed: Any, message: str) -> None:
    parameters = NavigationParameters(**changed)
    found = differences(policy, parameters)
    assert list(found) == list(changed)
    assert message in difference_text(found) and len(found[next(iter(found))]) == 1
    with pytest.raises(InputError, match="policy 'mine' was trained with another") as caught:
        check_fit(policy, parameters, False)
    assert str(caught.value).count(". ") == 0 and "--force" in str(caught.value)
    with pytest.warns(InputWarning, match="it drives all the same"):
        assert check_fit(policy, parameters, True) == found


def test_the_time_step_of_the_training_counts(policy: ModelPolicy) -> None:
    found = differences(policy, NavigationParameters(dt=0.1))
    assert difference_text(found) == "another time step (0.2 s, here 0.1 s)"
    with pytest.raises(InputError, match="was trained with another time step"):
        check_fit(policy, NavigationParameters(dt=0.1), False)
    faster = ModelPolicy(policy.model, environment=policy.environment | {"dt": 0.1})
    assert trained_dt(faster) == 0.1
    assert differences(faster, NavigationParameters(dt=0.1)) == {}
    assert trained_dt(ModelPolicy(policy.model)) is None
    odd = ModelPolicy(policy.model, environment=policy.environment | {"dt": "fast"})
    with pytest.raises(InputError, match="dt is 'fast'"):
        trained_dt(odd)


def test_what_is_the_same_fits(policy: ModelPolicy) -> None:
    named = RangeScanner(scanner().parts, "another name", "described", "from a shop")
    for same in (default_scanner(), named, RangeScanner.from_yaml_text(scanner().to_yaml())):
        assert check_fit(policy, NavigationParameters(scanner=same), False) == {}
    # What the policy leaves open fits, too.
    free = ModelPolicy(policy.model)
    assert check_fit(free, NavigationParameters(robot=Robot(radius=1.0)), False) == {}


def test_each_field_of_sensor_and_robot_is_compared() -> None:
    assert set(_ROBOT) == {field.name for field in fields(Robot)}
    names = {field.name for field in fields(RangeSensor)} - {"name", "source", "calibration"}
    assert set(_SENSOR) == names


def test_any_other_beams_are_a_difference() -> None:
    """The dumbest generator: one number of one beam at random."""
    rng = np.random.default_rng(0)
    mounts = np.column_stack([np.zeros((12, 2)), rng.uniform(-3.0, 3.0, 12)])
    own = RangeScanner.from_mounts(SENSOR, mounts)
    policy = ModelPolicy.__new__(ModelPolicy)
    policy.environment = {"scanner": own}
    assert differences(policy, NavigationParameters(scanner=own)) == {}
    for _ in range(50):
        other = mounts.copy()
        other[rng.integers(12), rng.integers(3)] += rng.choice([-1.0, 1.0]) * 10 ** rng.uniform(
            -6, 0
        )
        found = differences(
            policy, NavigationParameters(scanner=RangeScanner.from_mounts(SENSOR, other))
        )
        assert "scanner" in found
    swapped = [0] * 6 + [1] * 6
    far = replace(SENSOR, max_range=8.0)
    one, two = (
        RangeScanner.from_mounts([SENSOR, far], mounts, index) for index in (swapped, swapped[::-1])
    )
    policy.environment = {"scanner": one}
    assert "range" in difference_text(differences(policy, NavigationParameters(scanner=two)))


# -- the three commands ----------------------------------------------------------------------

SHORT = ("-n", "2", "max_steps=3", "longest=4", "--suite", "hall")
HALF = (
    "name: half\nparts:\n- sensor: {max_range: 12, std: 0.03, resolution: 0.01}\n"
    "  planar: {beams: 60, aperture_deg: 180}\n"
)


@pytest.fixture
def folder(
    file: Path,
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
) -> Path:
    monkeypatch.setenv("AMBINAV_CACHE", str(tmp_path_factory.getbasetemp() / "ambinav-cache"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "half.yaml").write_text(HALF)
    (tmp_path / "mine.zip").write_bytes(file.read_bytes())
    return tmp_path


def run(*words: str) -> Result:
    return CliRunner().invoke(app, list(words))


def refused(done: Result) -> bool:
    return (
        done.exit_code == 2
        and "trained with another" in done.stderr
        and "--force" in done.stderr
        and done.stderr.startswith("ambinav: error: ")
        and done.stderr.count("\n") == 1
    )


@pytest.mark.slow
def test_evaluate(folder: Path) -> None:
    for changed, message in (
        ("scanner=half.yaml", "aperture 360 degrees, here 180 degrees; range 4 m, here 12 m"),
        ("robot={radius: 0.4}", "robot (radius 0.22 m, here 0.4 m)"),
    ):
        done = run("evaluate", "mine.zip", *SHORT, changed)
        assert refused(done) and message in done.stderr, done.output
        assert not (folder / "out").exists()
    done = run("evaluate", "mine.zip", *SHORT, "robot={radius: 0.4}", "--force", "-o", "out")
    assert done.exit_code == 0 and "not the robot it was trained with" in done.stdout, done.output
    assert "note: policy 'mine' was trained with another robot" in done.stderr
    evaluation = json.loads((folder / "out" / "evaluation.json").read_text())
    assert evaluation["differs"] == {"robot": ["radius 0.22 m, here 0.4 m"]}
    done = run("evaluate", "mine.zip", *SHORT, "--json")
    assert done.exit_code == 0 and not done.stderr and json.loads(done.stdout)["differs"] == {}


@pytest.mark.sweep
def test_benchmark(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ompl")
    import importlib

    monkeypatch.setattr(importlib.import_module("ambinav.cli.benchmark"), "QUICK_BUILDINGS", 1)
    common = (*SHORT, "--quick", "--planner", "reference:1", "robot={radius: 0.3}", "-o", "out")
    done = run("benchmark", *common, "--policy", "mine.zip")
    assert done.exit_code == 2 and "policy 'mine' was trained with another robot" in done.stderr
    done = run("benchmark", *common, "--policy", "mine.zip", "--json", "--force")
    assert done.exit_code == 0, done.output
    methods = {m["name"]: m for m in json.loads(done.stdout)["methods"]}
    assert methods["mine"]["differs"] == {"robot": ["radius 0.22 m, here 0.3 m"]}
    assert methods["shortest"]["differs"] == {}
    text = (folder / "out" / "report.md").read_text()
    assert "**trained with another robot (radius 0.22 m, here 0.3 m)**" in text


DRIVES = """
from ambinav_envs import load_policy

def drives(observation_space, action_space):
    policy = load_policy("vfh")
    policy.prepare(observation_space, action_space)
    return policy

drives.environment = {**load_policy("vfh").environment, "robot": {"radius": 0.22}}
"""
"""A policy that arrives and was trained with a robot; its file is code."""


@pytest.mark.sweep
def test_compare(folder: Path) -> None:
    (folder / "own.py").write_text(DRIVES)
    own = {"parts": yaml.safe_load(scanner().to_yaml())["parts"]}
    plain = {
        **SCENARIO, "scanner": own, "robot": {"radius": 0.15}, "localizer": "ekf",
        "routes": ["shortest", {"kind": "policy", "policy": "own.py:drives"}],
        "drive": {"runs": 2, "seed": 3},
    }  # fmt: skip
    path = str(write(folder, plain))
    done = run("compare", path, "-o", "out", "-j", "1", "--trust")
    assert refused(done) and "radius 0.22 m, here 0.15 m" in done.stderr, done.output
    assert not (folder / "out").exists()
    done = run("compare", path, "-o", "out", "-j", "1", "--trust", "--force", "--json")
    assert done.exit_code == 0, done.output
    assert "it drives all the same" in done.stderr
    plans = {plan["route"]: plan for plan in json.loads(done.stdout)["plans"]}
    assert plans["own.py:drives"]["differs"] == "another robot (radius 0.22 m, here 0.15 m)"
    for name in ("report.md", "report.html"):
        assert "trained with another robot" in (folder / "out" / name).read_text()
