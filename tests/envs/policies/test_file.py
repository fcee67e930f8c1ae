"""Policy files: what comes out is what went in, and bad ones are refused in one sentence."""

from __future__ import annotations

import contextlib
import json
import zipfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from ambinav.drive.robot import Robot
from ambinav.runtime.errors import InputError
from ambinav.runtime.provenance import code_digest
from ambinav.sensing.scanner import RangeScanner
from ambinav_envs.leaderboard.evaluated import environment_for
from ambinav_envs.planar_scanner import default_scanner
from ambinav_envs.policies import load_policy, read_card, save_policy
from ambinav_envs.policies.card import CARD, FORMAT, arguments_of, plain_environment
from ambinav_envs.policies.file import WEIGHTS, read_policy_file
from ambinav_envs.policies.policy import RULES, SEEING
from tests.envs.policies.models import NAME, OPTIONS, model, normalized, saved

SEEN: dict[str, Any] = {
    "window": True, "window_cells": 16, "window_spacing": 0.4, "ambiguity_weight": 0.0,
    "waypoint": True, "waypoint_distance": 1.5, "ambiguity_seen": True, "discrete": False,
    "declare": [], "belief": False, "min_speed": 0.0,
    "layer": "level",
}  # fmt: skip
"""What a policy sees by default."""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved(tmp_path_factory.mktemp("policy") / "small.zip")


def rewritten(file: Path, out: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """A copy of a zip file with other members; None leaves one out."""
    with zipfile.ZipFile(file) as source, zipfile.ZipFile(out, "w") as copy:
        for name in source.namelist():
            content = change(name, source.read(name))
            if content is not None:
                copy.writestr(name, content)
    return out


@pytest.mark.slow
def test_acts_as_the_model_does(tmp_path: Path) -> None:
    envs = normalized()
    made = model(envs)
    path = tmp_path / "p.zip"
    save_policy(made, path, environment={**OPTIONS, "id": NAME}, normalization=envs)
    policy = load_policy(path)
    policy.prepare(envs.venv.observation_space, envs.action_space)
    seen = envs.get_original_obs()
    wanted, _ = made.predict(envs.normalize_obs(seen), deterministic=True)
    got = policy.act(seen, np.ones(2, dtype=np.bool_))
    assert np.array_equal(got, wanted)


def test_the_card(file: Path) -> None:
    card = read_card(file)
    assert card.algorithm == "PPO" and card.seed == 3 and card.steps == 0
    # Scanner and robot are written out, by default too: defaults and presets may change.
    used = {"scanner": {"yaml": default_scanner().to_yaml()}, "robot": asdict(Robot())}
    assert card.environment == {**SEEN, **used, **OPTIONS, "id": NAME}
    assert card.code == code_digest()
    assert card.observation["parts"]["scan"] == {"size": 60, "low": 0.0, "high": 1.0}
    assert card.action == {"size": 2, "low": -1.0, "high": 1.0}
    assert card.notes == {"note": "a test"} and "torch" in card.versions


def test_parts_of_an_environment_come_back(tmp_path: Path) -> None:
    scanner = RangeScanner.from_preset("rplidar-a1").thinned(60)
    environment = {
        "window_cells": OPTIONS["window_cells"],
        "robot": Robot(radius=0.3),
        "scanner": scanner,
        "buildings": 7,
        "first_building": 1,
    }
    path = tmp_path / "p.zip"
    save_policy(model(normalized()), path, environment=environment)
    arguments = arguments_of(read_card(path))
    assert set(arguments) == {"robot", "scanner", *SEEN}
    assert Robot(**arguments["robot"]) == Robot(radius=0.3)
    assert arguments["scanner"].to_yaml() == scanner.to_yaml()


def test_what_a_card_leaves_out_is_as_by_default(file: Path, tmp_path: Path) -> None:
    def shorter(name: str, content: bytes) -> bytes:
        if name != CARD:
            return content
        document = {**json.loads(content), "environment": {"id": NAME, "window_cells": 4}}
        return json.dumps(document).encode()

    shown = [name for name in SEEING if name not in (*RULES, "ambiguity_seen")]
    now = {name: value for name, value in (SEEN | OPTIONS).items() if name in shown}
    assert load_policy(file).seeing == now
    assert load_policy(rewritten(file, tmp_path / "short.zip", shorter)).seeing == now
    # With the robot that it was trained with, since speeds go by its highest.
    quick = {"robot": {"max_speed": 2.0}, "min_speed": -1.0, "window_spacing": 0.2}
    environment = plain_environment(quick)
    assert (environment["min_speed"], environment["window_spacing"]) == (-1.0, 0.2)


def test_a_policy_brings_no_rules_into_a_task(file: Path) -> None:
    """One that declares nothing must not be judged by its estimate where others have to declare."""
    policy = load_policy(file)
    task = environment_for(policy, {}, "ambinav/AccurateGoal-v1")
    assert task["declare"] == ["arrived"] and task["window_cells"] == OPTIONS["window_cells"]
    env = gym.make(**{**task, "buildings": 1, "first_building": 0})
    with pytest.raises(InputError, match="gives 2 numbers and the environment takes 3"):
        policy.prepare(env.observation_space, env.action_space)


def test_an_id_that_nobody_knows_is_not_taken_for_another(file: Path, tmp_path: Path) -> None:
    """Else a policy would be judged in other buildings than those of its training."""
    wrong = {**OPTIONS, "id": "ambinav/Hal-v1"}
    with pytest.raises(InputError, match="the id is 'ambinav/Hal-v1'; did you mean ambinav/Hall"):
        save_policy(model(normalized()), tmp_path / "p.zip", environment=wrong)
    assert not list(tmp_path.iterdir())

    def gone(name: str, content: bytes) -> bytes:
        if name != CARD:
            return content
        document = json.loads(content)
        document["environment"]["id"] = "ambinav/Gone-v1"
        return json.dumps(document).encode()

    policy = load_policy(rewritten(file, tmp_path / "gone.zip", gone))
    with pytest.raises(InputError, match="was trained in 'ambinav/Gone-v1', which is not known"):
        environment_for(policy, {})
    assert environment_for(policy, {"suite": "hall"})["suite"] == "hall"
    assert environment_for(policy, {}, "ambinav/Hall-v1")["id"] == "ambinav/Hall-v1"


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"map": object()}, "card cannot be written"),
        ({"foo": 3}, "environment has the key 'foo'"),
        ({"windows": True}, "did you mean window"),
        ({"people": -3}, "people"),
        ({"window": False}, "the environment has .*; make it with"),
        ({"window_cells": 16}, "'window' has 512 numbers and the policy wants 32; make it with"),
        ({"discrete": True}, "gives 2 numbers and the environment takes one of"),
    ],
)
def test_an_environment_that_the_model_cannot_come_from(
    tmp_path: Path, wrong: dict[str, Any], message: str
) -> None:
    made = model(normalized())
    for own in ({"id": NAME}, {}):
        with pytest.raises(InputError, match=message):
            save_policy(made, tmp_path / "p.zip", environment={**OPTIONS, **own, **wrong})
    assert not list(tmp_path.iterdir())


def broken(file: Path, out: Path) -> Path:
    content = bytearray(file.read_bytes())
    content[len(content) // 3] ^= 0xFF
    out.write_bytes(content)
    return out


def test_a_flipped_byte_anywhere_is_refused_or_changes_nothing(file: Path, tmp_path: Path) -> None:
    """It changes nothing where nobody reads, as in the dates of the members."""
    content, whole = file.read_bytes(), read_policy_file(file)
    rng = np.random.default_rng(0)
    for at in rng.integers(0, len(content), 200):
        spoilt = bytearray(content)
        spoilt[at] ^= 0xFF
        (tmp_path / "bad.zip").write_bytes(spoilt)
        with contextlib.suppress(InputError):
            read = read_policy_file(tmp_path / "bad.zip")
            assert read.card == whole.card
            assert all(
                np.array_equal(read.weights[name], whole.weights[name]) for name in whole.weights
            )


def cut(file: Path, out: Path) -> Path:
    out.write_bytes(file.read_bytes()[:2000])
    return out


def without_card(file: Path, out: Path) -> Path:
    return rewritten(file, out, lambda name, content: None if name == CARD else content)


def of_format(number: int) -> Callable[[Path, Path], Path]:
    def change(name: str, content: bytes) -> bytes:
        if name != CARD:
            return content
        return json.dumps({**json.loads(content), "format": number}).encode()

    return lambda file, out: rewritten(file, out, change)


def without_weights(file: Path, out: Path) -> Path:
    return rewritten(file, out, lambda name, content: None if name == WEIGHTS else content)


def of_another_kind(file: Path, out: Path) -> Path:
    def change(name: str, content: bytes) -> bytes:
        if name != CARD:
            return content
        return json.dumps({**json.loads(content), "algorithm": "A2C"}).encode()

    return rewritten(file, out, change)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (broken, "damaged|cannot be read"),
        (cut, "not a policy file"),
        (without_card, "ambinav.json is missing"),
        (of_format(FORMAT - 1), f"not of format {FORMAT}"),
        (of_format(FORMAT + 1), f"not of format {FORMAT}"),
        (without_weights, f"{WEIGHTS} is missing"),
        (of_another_kind, "algorithm is 'A2C'"),
    ],
)
def test_bad_files(spoil: Any, message: str, file: Path, tmp_path: Path) -> None:
    path = spoil(file, tmp_path / "bad.zip")
    with pytest.raises(InputError, match=message) as caught:
        load_policy(path)
    assert "bad.zip" in str(caught.value) and str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)


def test_the_same_policy_is_the_same_file(tmp_path: Path) -> None:
    envs = normalized()
    made = model(envs)
    for name in ("a.zip", "b.zip"):
        save_policy(made, tmp_path / name, environment=OPTIONS, normalization=envs)
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.zip") as archive:
        assert archive.namelist() == [CARD, WEIGHTS]
