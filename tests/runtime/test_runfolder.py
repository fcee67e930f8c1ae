"""Output folders: nothing else is lost, one run at a time, left-overs go."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ambinav.runtime.errors import InputError
from ambinav.runtime.runfolder import LOCK, WORK, RunFolder

REPLACED = RunFolder("audit", ("report.json", "floor-*.png"), proof="report.json", format="audit")
KEPT = RunFolder("comparison", ("report.json", WORK))


def test_what_is_not_of_an_earlier_run_is_named(tmp_path: Path) -> None:
    assert KEPT.check(tmp_path / "new") == tmp_path / "new" and not (tmp_path / "new").exists()
    assert REPLACED.check(tmp_path) == tmp_path
    (tmp_path / "thesis.tex").write_text("years of work")
    message = r"thesis\.tex, which is not of an earlier audit; choose a new folder\.$"
    with pytest.raises(InputError, match=message):
        REPLACED.check(tmp_path)
    with pytest.raises(InputError, match=r"thesis\.tex: this is a file, not a folder"):
        KEPT.check(tmp_path / "thesis.tex")


def test_what_is_replaced_whole_must_prove_what_it_is(tmp_path: Path) -> None:
    (tmp_path / "floor-plan.png").write_bytes(b"")
    with pytest.raises(InputError, match=r"floor-plan\.png, which is not of an earlier audit"):
        REPLACED.check(tmp_path)
    for content in ("{", '{"format": "map/1"}', "[]"):
        (tmp_path / "report.json").write_text(content)
        with pytest.raises(InputError):
            REPLACED.check(tmp_path)
    (tmp_path / "report.json").write_text(json.dumps({"format": "audit/1"}))
    REPLACED.check(tmp_path)


def test_one_run_at_a_time_and_left_overs_go(tmp_path: Path) -> None:
    (tmp_path / WORK).mkdir()
    lost = tmp_path / ".report.json.abc", tmp_path / WORK / ".map.zarr.abc"
    other = tmp_path / ".git", tmp_path / ".notes.d"
    for folder in (*lost, *other):
        folder.mkdir()
    with pytest.raises(InputError, match=r"\.git, which is not"):
        KEPT.check(tmp_path)
    with KEPT.hold(tmp_path):
        assert not any(folder.exists() for folder in lost)
        assert all(folder.exists() for folder in other)
        assert (tmp_path / WORK / LOCK).is_file()
        with (
            pytest.raises(InputError, match="work: another run is at work here"),
            KEPT.hold(tmp_path),
        ):
            pass
    with KEPT.hold(tmp_path):
        pass
