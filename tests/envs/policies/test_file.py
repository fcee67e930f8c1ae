"""Policy files: what comes out is what went in, and bad ones are refused in one sentence."""

from __future__ import annotations

import contextlib
import json
import zipfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ambinav.drive.robot import Robot
from ambinav.errors import InputError
from ambinav.provenance import code_digest
from ambinav.sensing.scanner import RangeScanner
from tests.envs.policies.models import NAME, OPTIONS, model, normalized, saved

from stable_baselines3 import PPO  # isort: skip

from ambinav_envs.parameters import default_scanner
from ambinav_envs.policies import load_policy, read_card, save_policy
from ambinav_envs.policies.file import CARD, FORMAT, arguments_of, plain_environment

SEEN: dict[str, Any] = {
    "window": True, "window_cells": 16, "window_spacing": 0.4, "ambiguity_weight": 0.0,
    "waypoint": False, "waypoint_distance": 1.5, "discrete": False, "min_speed": 0.0,
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


def test_stable_baselines_reads_it_whole_and_slim(tmp_path: Path) -> None:
    envs = normalized()
    made = model(envs).learn(8)
    seen = envs.reset()
    sizes = {}
    for slim in (False, True):
        path = tmp_path / f"slim-{slim}.zip"
        save_policy(made, path, environment={}, slim=slim)
        again = PPO.load(path)
        assert np.array_equal(*(m.predict(seen, deterministic=True)[0] for m in (made, again)))
        assert bool(again.policy.optimizer.state_dict()["state"]) is not slim
        sizes[slim] = path.stat().st_size
    assert sizes[True] < 0.7 * sizes[False]


def test_parts_of_an_environment_come_back(tmp_path: Path) -> None:
    scanner = RangeScanner.from_preset("rplidar-a1").thinned(60)
    environment = {
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


def test_what_it_saw_by_default_is_known_of_old_files_too(file: Path, tmp_path: Path) -> None:
    def older(name: str, content: bytes) -> bytes:
        if name != CARD:
            return content
        document = {**json.loads(content), "environment": {"id": NAME, "window_cells": 4}}
        return json.dumps(document).encode()

    for path in (file, rewritten(file, tmp_path / "old.zip", older)):
        assert load_policy(path).seeing == {
            name: value for name, value in (SEEN | {"window_cells": 4}).items() if name != "layer"
        }
    # With the robot that it was trained with, since speeds go by its highest.
    quick = {"robot": {"max_speed": 2.0}, "min_speed": -1.0, "window_spacing": 0.2}
    environment = plain_environment(quick)
    assert (environment["min_speed"], environment["window_spacing"]) == (-1.0, 0.2)


def test_what_is_no_plain_value_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="card cannot be written"):
        save_policy(model(normalized()), tmp_path / "p.zip", environment={"reward": object()})
    assert not list(tmp_path.iterdir())


def broken(file: Path, out: Path) -> Path:
    content = bytearray(file.read_bytes())
    content[len(content) // 3] ^= 0xFF
    out.write_bytes(content)
    return out


def test_a_flipped_byte_anywhere_is_no_crash(file: Path, tmp_path: Path) -> None:
    content = file.read_bytes()
    rng = np.random.default_rng(0)
    for at in rng.integers(0, len(content), 200):
        spoilt = bytearray(content)
        spoilt[at] ^= 0xFF
        (tmp_path / "bad.zip").write_bytes(spoilt)
        with contextlib.suppress(InputError):
            read_card(tmp_path / "bad.zip")


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
    return rewritten(file, out, lambda name, content: None if name == "policy.pth" else content)


def of_another_kind(file: Path, out: Path) -> Path:
    def change(name: str, content: bytes) -> bytes:
        if name != CARD:
            return content
        return json.dumps({**json.loads(content), "algorithm": "A2C"}).encode()

    return rewritten(file, out, change)


def with_bad_moments(file: Path, out: Path) -> Path:
    return rewritten(file, out, lambda name, c: b"?" if name == "normalization.npz" else c)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (broken, "damaged|no policy file|cannot be loaded"),
        (cut, "no policy file"),
        (without_card, "ambinav.json is missing"),
        (of_format(FORMAT - 1), f"not of format {FORMAT}"),
        (of_format(FORMAT + 1), f"not of format {FORMAT}"),
        (without_weights, "cannot be loaded"),
        (of_another_kind, "algorithm is 'A2C'"),
        (with_bad_moments, "normalisation cannot be read"),
    ],
)
def test_bad_files(spoil: Any, message: str, file: Path, tmp_path: Path) -> None:
    path = spoil(file, tmp_path / "bad.zip")
    with pytest.raises(InputError, match=message) as caught:
        load_policy(path)
    assert "bad.zip" in str(caught.value) and str(caught.value).endswith(".")
    assert "\n" not in str(caught.value)
