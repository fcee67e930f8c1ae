"""Policy files of strangers: nothing in them is run, and what is odd is refused in one sentence."""

from __future__ import annotations

import base64
import io
import json
import os
import pickle
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

pytest.importorskip("stable_baselines3")
import torch

from ambinav.cli import app
from ambinav.runtime.errors import InputError
from ambinav_envs.policies import load_policy
from ambinav_envs.policies.card import CARD
from ambinav_envs.policies.file import WEIGHTS
from tests.envs.policies.changed_file import members_of, refusal, with_card, written
from tests.envs.policies.models import NAME, OPTIONS, normalized, saved
from tests.envs.policies.models import model as small_model

MARKER = "it-ran"
_EVENTS: list[str] = []
_watching = False


def _note(event: str, arguments: tuple[Any, ...]) -> None:
    if _watching and event == "pickle.find_class":
        _EVENTS.append(".".join(map(str, arguments)))


# It cannot be removed, and does nothing but while a test watches.
sys.addaudithook(_note)


class Payload:
    """What touches a file when it is unpickled."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        return os.system, (f"touch {self.marker}",)


@pytest.fixture
def evil(tmp_path: Path) -> Iterator[bytes]:
    """A pickle that runs code; it has not been run at the end of the test."""
    content = pickle.dumps(Payload(tmp_path / MARKER))
    pickle.loads(content)
    # It is a real one.
    (tmp_path / MARKER).unlink()
    yield content
    assert not (tmp_path / MARKER).exists()


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return saved(tmp_path_factory.mktemp("policy") / "small.zip")


# -- what would run ----------------------------------------------------------------------------


def test_nothing_is_unpickled(file: Path) -> None:
    global _watching
    load_policy(file)
    _EVENTS.clear()
    _watching = True
    try:
        load_policy(file)
        found = list(_EVENTS)
        pickle.loads(pickle.dumps(Path()))
    finally:
        _watching = False
    assert found == [] and _EVENTS != []


def serialized(evil: bytes) -> dict[str, str]:
    return {":type:": "<class 'dict'>", ":serialized:": base64.b64encode(evil).decode()}


def torch_zip(payload: object) -> bytes:
    """As `torch.save` packs any object."""
    out = io.BytesIO()
    torch.save(payload, out)
    return out.getvalue()


@pytest.mark.parametrize("content", ["raw", "torch"])
def test_pickles_in_the_present_format(
    content: str, file: Path, evil: bytes, tmp_path: Path
) -> None:
    given = evil if content == "raw" else torch_zip({"w": Payload(tmp_path / MARKER)})
    members = members_of(file)
    path = tmp_path / "p.zip"
    for name in (CARD, WEIGHTS):
        assert name in refusal(written(path, members | {name: given}))
    for name in ("data", "policy.pth", "memory.pkl", "__init__.py"):
        assert "has no place in" in refusal(written(path, members | {name: given}))
    path.write_bytes(given)
    refusal(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda card: card["environment"].update(id="os:system"), "names code"),
        (lambda card: card["environment"].update(id=["os"]), "names code"),
        (lambda card: card["network"]["features"].update(kind="os.system"), "kind"),
        (lambda card: card["network"].update(activation="Module"), "activation"),
        (lambda card: card["network"].update(activation="__class__"), "activation"),
        (lambda card: card["network"].update(features_extractor_class="os"), "unknown"),
        (lambda card: card.update(module="os"), "the key 'module', which is unknown"),
        (lambda card: card["environment"].update(scanner={"yaml": "!!python/name:os.system"}), ""),
    ],
)
def test_names_of_code_in_the_card(change: Any, message: str, file: Path, tmp_path: Path) -> None:
    assert message in refusal(with_card(file, tmp_path / "p.zip", change))


def test_models_of_others_need_trust(evil: bytes, tmp_path: Path) -> None:
    model = small_model(normalized())
    path = tmp_path / "plain.zip"
    model.save(path)
    members = members_of(path)
    plain = json.loads(members["data"]) | {"anything": serialized(evil)}
    written(path, members | {"data": json.dumps(plain).encode()})
    for options in ({}, {"environment": {"id": NAME}}):
        with pytest.raises(InputError, match=r"run code when they are loaded.* add --trust"):
            load_policy(path, **options)  # type: ignore[arg-type]
    for command in (
        ["evaluate", str(path), "--env", NAME],
        ["benchmark", "--policy", str(path), "-o", str(tmp_path / "out"), "--suite", "hall"],
    ):
        done = CliRunner().invoke(app, command)
        assert done.exit_code == 2 and "--trust" in done.stderr, done.output
        assert done.stderr.count("\n") == 1
    assert not (tmp_path / MARKER).exists()
    policy = load_policy(path, trust=True, environment={"id": NAME, **OPTIONS})
    assert policy.is_code and (tmp_path / MARKER).exists()
    (tmp_path / MARKER).unlink()


# -- what would take the memory, or lies elsewhere ---------------------------------------------


@pytest.mark.parametrize("name", ["../../up.txt", "/tmp/up.txt", "a/b", "C:\\up.txt", "."])
def test_names_of_other_places(name: str, file: Path, tmp_path: Path) -> None:
    path = written(tmp_path / "p.zip", {**members_of(file), name: b"x"})
    assert "has no place in a policy file" in refusal(path)
    assert [one.name for one in tmp_path.iterdir()] == ["p.zip"]


@pytest.mark.parametrize("name", [CARD, WEIGHTS])
def test_a_member_that_is_there_twice(name: str, file: Path, tmp_path: Path) -> None:
    path = written(tmp_path / "p.zip", members_of(file))
    with zipfile.ZipFile(path, "a") as archive, pytest.warns(UserWarning, match="Duplicate"):
        archive.writestr(name, b"{}")
    assert "is given twice" in refusal(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", [CARD, WEIGHTS])
def test_a_bomb(name: str, file: Path, tmp_path: Path) -> None:
    path = written(tmp_path / "p.zip", members_of(file) | {name: bytes(80 << 20)})
    assert path.stat().st_size < 2 << 20
    assert "bytes, more than" in refusal(path)
    # One that claims to be small.
    content = path.read_bytes()
    lying = content.replace((80 << 20).to_bytes(4, "little"), (100).to_bytes(4, "little"))
    assert lying != content
    path.write_bytes(lying)
    refusal(path)


def test_too_many_members_and_too_many_bytes(file: Path, tmp_path: Path) -> None:
    members = {**members_of(file), **{f"{k:040d}": b"" for k in range(2000)}}
    assert "far more members" in refusal(written(tmp_path / "many.zip", members))
    with (tmp_path / "long.zip").open("wb") as out:
        out.truncate(300 << 20)
    assert "more than 256 MiB" in refusal(tmp_path / "long.zip")


def test_packings_and_ciphers(file: Path, tmp_path: Path) -> None:
    path = tmp_path / "p.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as out:
        for name, content in members_of(file).items():
            out.writestr(name, content)
    assert "packed in an unknown way" in refusal(path)
    content = bytearray(written(path, members_of(file)).read_bytes())
    content[content.rindex(b"PK\x01\x02") + 8] |= 1
    path.write_bytes(content)
    assert "encrypted" in refusal(path)
