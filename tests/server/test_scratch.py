"""Folders of servers: one's own, and what killed servers left."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest

from ambinav.server.jobs.scratch import LOCK, PREFIX, ScratchFolder, remove_left


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def left(folder: Path, name: str) -> Path:
    """What a killed server leaves: a folder with files, and a lock that nobody holds."""
    path = folder / f"{PREFIX}{name}"
    path.mkdir()
    (path / "upload.yaml").write_text("image: a.png")
    path.with_name(path.name + LOCK).touch()
    return path


def test_only_what_nobody_holds_is_removed(temporary: Path) -> None:
    mine, killed = ScratchFolder(), left(temporary, "killed")
    foreign = temporary / f"{PREFIX}foreign"
    foreign.mkdir()  # without a lock it is nobody's to judge
    remove_left()
    assert mine.path.is_dir() and foreign.is_dir() and not killed.exists()
    mine.close()
    assert sorted(temporary.iterdir()) == [foreign]
    mine.close()


def test_no_link_is_followed(temporary: Path) -> None:
    home = temporary / "home"
    home.mkdir()
    (home / "thesis.tex").touch()
    link = temporary / f"{PREFIX}link"
    link.symlink_to(home)
    link.with_name(link.name + LOCK).touch()
    lock = temporary / f"{PREFIX}other{LOCK}"
    lock.symlink_to(home / "thesis.tex")
    remove_left()
    assert [path.name for path in home.iterdir()] == ["thesis.tex"] and lock.is_symlink()


def test_what_cannot_be_removed_yet_is_left_to_the_next_start(
    temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed = left(temporary, "killed")
    with monkeypatch.context() as patched:
        patched.setattr("ambinav.server.jobs.scratch.shutil.rmtree", lambda *_, **__: None)
        remove_left()
    assert killed.is_dir()
    remove_left()
    assert not list(temporary.iterdir())


def test_a_folder_that_nobody_closes_goes_with_its_server(temporary: Path) -> None:
    folder = ScratchFolder()
    path = folder.path
    assert path.is_dir()
    del folder
    assert not path.exists() and not list(temporary.iterdir())
