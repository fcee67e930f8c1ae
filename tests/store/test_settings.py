"""Where maps are kept, and how much room they may take."""

from __future__ import annotations

from pathlib import Path

import pytest

import ambinav as an
from ambinav.store.map_store import MapStore
from ambinav.store.settings import LIMIT, cache_folder, parse_size, size_limit, size_text
from tests.store.scenes import build


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AMBINAV_CACHE", str(tmp_path / "cache"))


def test_the_folder(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("AMBINAV_CACHE", str(tmp_path / "mine"))
    assert cache_folder() == tmp_path / "mine"
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("AMBINAV_CACHE", "~/mine")
    assert cache_folder() == tmp_path / "mine"
    monkeypatch.setenv("AMBINAV_CACHE", "")
    assert cache_folder() is None and MapStore.of_user().folder is None
    monkeypatch.delenv("AMBINAV_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "xdg" / "ambinav"
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder() == tmp_path / ".cache" / "ambinav"
    assert MapStore.of_user().folder == tmp_path / ".cache" / "ambinav" / "ambinav-maps"

    def nowhere() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", nowhere)
    assert MapStore.of_user().folder is None


def test_a_file_in_place_of_the_folder_is_said_before_the_work(tmp_path, monkeypatch) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("AMBINAV_CACHE", str(tmp_path / "file"))
    with pytest.raises(an.InputError, match=r"AMBINAV_CACHE is .*file', where no map can be kept"):
        build(True)


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("0", 0),
        ("17B", 17),
        ("2000000", 2_000_000),
        ("2G", 2_000_000_000),
        ("500 MB", 500_000_000),
        ("1.5 kB", 1500),
    ],
)
def test_sizes(text, size, monkeypatch) -> None:
    assert parse_size(text, "here") == size
    monkeypatch.setenv("AMBINAV_CACHE_LIMIT", text)
    assert size_limit() == size == MapStore.of_user().limit
    monkeypatch.setenv("AMBINAV_CACHE_LIMIT", "")
    assert size_limit() == LIMIT
    assert parse_size(size_text(size), "here") == size


@pytest.mark.parametrize("text", ["5", "0.5"])
def test_a_small_number_needs_its_unit(text) -> None:
    with pytest.raises(
        an.InputError, match=rf"--limit: '{text}' has no unit; give e\.g\. {text} GB"
    ):
        parse_size(text, "--limit")


@pytest.mark.parametrize("text", ["-1", "1 XB", "much", "1e9", "nan", "inf", "1,5 GB", "9" * 400])
def test_no_sizes(text, monkeypatch) -> None:
    monkeypatch.setenv("AMBINAV_CACHE_LIMIT", text)
    with pytest.raises(an.InputError, match=r"AMBINAV_CACHE_LIMIT: .* is not a size; give e\.g\."):
        MapStore.of_user()
