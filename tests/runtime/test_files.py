"""Replacing a file or a folder: all or nothing, and the old one until then."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from ambinav.runtime import files
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import holding_interrupts, replacing, sha256


def write(path: Path, text: str, *, folder: bool) -> None:
    with replacing(path) as fresh:
        if folder:
            fresh.mkdir()
            (fresh / "a").write_text(text)
        else:
            fresh.write_text(text)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def content(path: Path, *, folder: bool) -> str:
    return (path / "a" if folder else path).read_text()


@pytest.fixture(params=[True, False], ids=["exchange", "two renames"])
def exchange(request, monkeypatch) -> bool:
    """With and without a file system that swaps two names in one step."""
    if not request.param:
        monkeypatch.setattr(files, "_exchanged", lambda first, second: False)
    return request.param


@pytest.mark.parametrize("folder", [True, False])
def test_new_and_replaced(tmp_path, folder, exchange):
    path = tmp_path / "b" / "out"
    for text in ("one", "two", "three"):
        write(path, text, folder=folder)
        assert content(path, folder=folder) == text
        assert names(path.parent) == ["out"]


@pytest.mark.parametrize("folder", [True, False])
@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_a_failure_while_writing_keeps_the_old_one(tmp_path, folder, error):
    path = tmp_path / "out"
    write(path, "old", folder=folder)
    with pytest.raises(error), replacing(path) as fresh:
        fresh.mkdir()
        raise error
    assert content(path, folder=folder) == "old"
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_a_failure_of_the_last_rename_brings_the_old_one_back(tmp_path, monkeypatch, error):
    path = tmp_path / "out"
    write(path, "old", folder=True)
    monkeypatch.setattr(files, "_exchanged", lambda first, second: False)

    def broken(source: Path, target: Path) -> None:
        assert not path.exists()
        raise error

    monkeypatch.setattr(os, "replace", broken)
    with pytest.raises(error):
        write(path, "new", folder=True)
    assert content(path, folder=True) == "old"
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize("folder", [True, False])
def test_nothing_is_replaced_by_another_kind(tmp_path, folder):
    path = tmp_path / "out"
    write(path, "old", folder=folder)
    with pytest.raises(InputError, match="choose another output"):
        write(path, "new", folder=not folder)
    assert content(path, folder=folder) == "old"
    assert names(tmp_path) == ["out"]


@pytest.mark.parametrize("folder", [True, False])
def test_a_link_stays_and_what_it_points_to_is_replaced(tmp_path, folder):
    write(tmp_path / "real", "old", folder=folder)
    (tmp_path / "out").symlink_to("real")
    write(tmp_path / "out", "new", folder=folder)
    assert (tmp_path / "out").is_symlink()
    assert content(tmp_path / "real", folder=folder) == "new"


@pytest.mark.parametrize("place", ["file/out", "file/b/out", "/proc/out"])
def test_an_impossible_place_is_bad_input(tmp_path, place):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="choose another output"):
        write(tmp_path / place, "new", folder=True)


def test_checksum_of_several_files_is_that_of_their_bytes_in_a_row(tmp_path):
    for name, text in (("a", "ab"), ("b", "c"), ("all", "abc")):
        (tmp_path / name).write_text(text)
    assert sha256(tmp_path / "a", tmp_path / "b") == sha256(tmp_path / "all")
    # Of "abc", in the standard that defines it (FIPS 180).
    assert sha256(tmp_path / "all").startswith("ba7816bf8f01cfea414140de5dae2223")


@pytest.mark.parametrize("twice", [False, True])
def test_an_interrupt_waits_for_the_end_of_the_block_but_the_second_does_not(twice):
    handler = signal.getsignal(signal.SIGINT)
    reached = []
    with pytest.raises(KeyboardInterrupt), holding_interrupts():
        signal.raise_signal(signal.SIGINT)
        reached.append(1)
        if twice:
            signal.raise_signal(signal.SIGINT)
        reached.append(2)
    assert reached == ([1] if twice else [1, 2])
    assert signal.getsignal(signal.SIGINT) is handler


def test_a_second_signal_of_the_other_kind_does_not_wait_either() -> None:
    heard: list[int] = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: heard.append(number))
    try:
        with pytest.raises(KeyboardInterrupt), holding_interrupts():
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGTERM)
            assert heard == [signal.SIGTERM]
    finally:
        signal.signal(signal.SIGTERM, before)
