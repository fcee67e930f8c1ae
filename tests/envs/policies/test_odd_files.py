"""Policy files that do not fit together: each is refused in one sentence."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.numpy import load, save

pytest.importorskip("stable_baselines3")

from ambinav.runtime.errors import InputError
from ambinav_envs.policies import load_policy, read_card
from ambinav_envs.policies.card import CARD
from ambinav_envs.policies.file import WEIGHTS
from tests.envs.policies.changed_file import (
    members_of,
    refusal,
    with_card,
    with_tensors,
    with_weights,
    written,
)
from tests.envs.policies.models import saved


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved(tmp_path_factory.mktemp("policy") / "small.zip")


LOG_STD = "policy.log_std"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.pop(LOG_STD), "'log_std' is missing"),
        (lambda t: t.update({"policy.more": np.zeros(2, np.float32)}), "'more' has no place in"),
        (lambda t: t.update({"more": np.zeros(2, np.float32)}), "'more' has no place in"),
        (
            lambda t: t.update({LOG_STD: np.zeros(3, np.float32)}),
            "the shape (3,), and the network (2,)",
        ),
        (lambda t: t.update({LOG_STD: np.zeros((), np.float32)}), "the shape ()"),
        (lambda t: t.update({LOG_STD: np.zeros(2)}), "is float64, not float32"),
        (lambda t: t.update({LOG_STD: np.zeros(2, np.float16)}), "is float16, not float32"),
        (lambda t: t.update({LOG_STD: np.full(2, np.nan, np.float32)}), "not finite"),
        (lambda t: t.update({LOG_STD: np.full(2, np.inf, np.float32)}), "not finite"),
        (lambda t: t.pop("normalization.mean.goal"), "do not match"),
        (lambda t: t.update({"normalization.mean.goal": np.zeros(4)}), "of the shape (4,)"),
        (lambda t: t.update({"normalization.mean.goal": np.full(3, np.nan)}), "numbers that are"),
        (lambda t: t.update({"normalization.var.goal": np.full(3, -1.0)}), "numbers that are"),
        (lambda t: t.update({"normalization.mean.gaol": np.zeros(3)}), "no place for"),
    ],
)
def test_odd_tensors(change: Any, message: str, file: Path, tmp_path: Path) -> None:
    assert message in refusal(with_tensors(file, tmp_path / "p.zip", change))


def test_weights_that_somebody_changed(file: Path, tmp_path: Path) -> None:
    members = members_of(file)
    tensors = load(members[WEIGHTS])
    tensors[LOG_STD] += np.float32(0.5)
    path = written(tmp_path / "p.zip", members | {WEIGHTS: save(tensors)})
    assert "was changed since the policy was saved" in refusal(path)


def odd_header(file: Path, out: Path, kind: str) -> Path:
    """Weights whose header lies."""
    members = members_of(file)
    content = members[WEIGHTS]
    size = int.from_bytes(content[:8], "little")
    header = json.loads(content[8 : 8 + size])
    if kind == "far":
        header[LOG_STD]["data_offsets"] = [0, 1 << 40]
    if kind == "overlapping":
        header[LOG_STD]["data_offsets"] = [0, 8]
    if kind == "shape":
        header[LOG_STD]["shape"] = [1 << 62, 4]
    if kind == "type":
        header[LOG_STD]["dtype"] = "O"
    if kind == "bfloat16":
        header[LOG_STD] |= {"dtype": "BF16", "shape": [4]}
    text = json.dumps(header).encode()
    if kind == "twice":
        text = text[:-1] + b"," + text[1:]
    start = (1 << 60) if kind == "long" else len(text)
    changed = start.to_bytes(8, "little") + text + content[8 + size :]
    return written(out, with_weights(members, changed[: -9 if kind == "cut" else None]))


@pytest.mark.parametrize(
    "kind", ["far", "overlapping", "shape", "type", "bfloat16", "long", "cut", "nothing"]
)
def test_headers_that_lie(kind: str, file: Path, tmp_path: Path) -> None:
    path = odd_header(file, tmp_path / "p.zip", kind)
    if kind == "nothing":
        load_policy(path)
        return
    assert "cannot be read" in refusal(path) or "not float32" in refusal(path)


WIDE = (
    "parts: [{sensor: {max_range: 4, std: 0.03, resolution: 0.01}, "
    "planar: {beams: 1000000000, aperture_deg: 360}}]"
)


def update(*keys: str, to: Any) -> Callable[[dict[str, Any]], None]:
    def change(card: dict[str, Any]) -> None:
        inner = card
        for key in keys[:-1]:
            inner = inner[key]
        inner[keys[-1]] = to

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (update("network", "net_arch", to=[1 << 16] * 4), "weights or so, more than"),
        (
            update("network", "net_arch", to={"vf": [8], "qf": [1 << 16] * 4}),
            "more than 16,777,216",
        ),
        (update("action", to={"count": 1 << 20}), "more than 16,777,216"),
        (update("network", "net_arch", to=[10**30]), "net_arch"),
        (update("network", "net_arch", to=[8] * 100), "net_arch"),
        (update("network", "net_arch", to=[9]), "has the shape"),
        (update("network", "net_arch", to="8"), "net_arch"),
        (update("network", "use_sde", to=1), "use_sde"),
        (update("network", "squash_output", to=True), "does not go with"),
        (update("network", to=[]), "network must be a mapping"),
        (update("network", to={}), "network"),
        (update("observation", "parts", "goal", "size", to=4), "limits for 4 numbers"),
        (update("observation", "parts", "scan", "size", to=61), "of the shape (60,), not"),
        (update("observation", "parts", "scan", "size", to=1 << 40), "more than 1,048,576"),
        (update("observation", "parts", "scan", "size", to=-1), "has the size"),
        (update("observation", "parts", "scan", "low", to="x"), "not a number"),
        (update("observation", "parts", "scan", "low", to=2.0), "low limit above"),
        (update("observation", "parts", to={}), "not a row of numbers"),
        (update("observation", "parts", "a.b", to={"size": 1, "low": 0, "high": 1}), "go with"),
        (update("observation", to={"count": 1 << 20}), "observations are rows"),
        (update("action", to={"size": 3, "low": -1, "high": 1}), "has the shape"),
        (update("action", to={"count": 9}), "log_std"),
        (update("action", to=None), "action must be a mapping"),
        (update("algorithm", to="SAC"), "weights"),
        (update("algorithm", to=["PPO"]), "algorithm is"),
        (update("steps", to="many"), "steps is 'many'"),
        (update("seed", to=True), "seed is 'True'"),
        (update("normalization", to=None), "that the card does not name"),
        (update("normalization", to={"clip": -1.0, "epsilon": 1e-8}), "give clip and epsilon"),
        (update("environment", "window_cells", to="many"), "window_cells"),
        (update("environment", "window_cells", to=1 << 20), "window_cells is 1048576"),
        (update("environment", "scanner", to={"yaml": WIDE}), "scanner has 1,000,000,000 beams"),
        (update("environment", to=3), "environment must be"),
        (update("format", to=[3]), "not of format"),
    ],
)
def test_odd_cards(change: Any, message: str, file: Path, tmp_path: Path) -> None:
    assert message in refusal(with_card(file, tmp_path / "p.zip", change))


@pytest.mark.parametrize("text", [b"[" * 100_000, b'{"format": 4, "steps": ' + b"9" * 10_000 + b"}",
    b'{"format": 4, "steps": NaN}', b"\xff\xfe", b"", b"null"])  # fmt: skip
def test_cards_that_are_no_json(text: bytes, file: Path, tmp_path: Path) -> None:
    path = written(tmp_path / "p.zip", members_of(file) | {CARD: text})
    assert CARD in refusal(path)
    with pytest.raises(InputError):
        read_card(path)


def test_any_cut_is_refused(file: Path, tmp_path: Path) -> None:
    content = file.read_bytes()
    path = tmp_path / "p.zip"
    for at in np.random.default_rng(0).integers(0, len(content), 40):
        path.write_bytes(content[: int(at)])
        refusal(path)
