"""Policy files with one thing changed, and what they are refused with."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from safetensors.numpy import load, save

from ambinav.runtime.errors import InputError
from ambinav_envs.policies import load_policy
from ambinav_envs.policies.card import CARD
from ambinav_envs.policies.file import WEIGHTS


def members_of(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def written(path: Path, members: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for name, content in members.items():
            out.writestr(name, content)
    return path


def refusal(path: Path) -> str:
    """The one sentence that a file is refused with."""
    with pytest.raises(InputError) as caught:
        load_policy(path)
    text = str(caught.value)
    assert str(path) in text and "\n" not in text and text.endswith("."), text
    assert len(text) < 700
    return text


def with_card(file: Path, out: Path, change: Callable[[dict[str, Any]], Any]) -> Path:
    members = members_of(file)
    plain = json.loads(members[CARD])
    change(plain)
    return written(out, members | {CARD: json.dumps(plain).encode()})


def with_tensors(file: Path, out: Path, change: Callable[[dict[str, Any]], Any]) -> Path:
    members = members_of(file)
    tensors = load(members[WEIGHTS])
    change(tensors)
    return written(out, with_weights(members, save(tensors)))


def with_weights(members: dict[str, bytes], weights: bytes) -> dict[str, bytes]:
    """Other weights, with a card that names them."""
    card = json.loads(members[CARD]) | {"weights_sha256": hashlib.sha256(weights).hexdigest()}
    return members | {WEIGHTS: weights, CARD: json.dumps(card).encode()}
