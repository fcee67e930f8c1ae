"""`build_map` as it is called by default: it opens what was computed, and never fails for it."""

from __future__ import annotations

import ast
import os
import warnings
from pathlib import Path

import numpy as np
import pytest

import ambinav as an
from ambinav.layers.registry import LAYERS, Layer
from ambinav.sensing.scanner import RangeScanner
from ambinav.store.map_store import TAG
from tests.store.scenes import ROOT, laser, python, room, same

BUILD = """
import ambinav as an
from ambinav.map_building import build
from tests.store.scenes import laser, room
calls, compute = [], build._compute
build._compute = lambda *arguments: calls.append(1) or compute(*arguments)
for _ in range(2):
    an.build_map(room(), laser(), 0.25)
print(len(calls))
"""


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's home, where nothing is; whether maps are kept is as in all tests."""
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    return tmp_path / "home"


@pytest.fixture
def kept(home: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where a user's maps are kept who has set nothing."""
    monkeypatch.delenv("AMBINAV_CACHE")
    return home / ".cache" / "ambinav" / "ambinav-maps"


def computed_by_a_child() -> str:
    process = python(BUILD)
    try:
        out, err = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 0, err
    return out.strip()


@pytest.mark.parametrize("options", [{}, {"headings": 4}, {"layers": ("fisher", "gfm")}])
def test_the_second_is_opened(kept, computes, options) -> None:
    first, second = [], []
    built = an.build_map(room(), laser(), 0.25, **options, progress=first.append)
    assert first == sorted(first) and len(first) > 1 and first[-1] == 1.0
    opened = an.build_map(room(), laser(), 0.25, **options, progress=second.append)
    assert len(computes) == 1 and second == [1.0]
    assert same(opened, built) and opened.dataset.identical(built.dataset)
    plain = an.build_map(room(), laser(), 0.25, **options, store=False)
    assert len(computes) == 2 and same(plain, opened)
    assert len(list(kept.glob("*.map"))) == 1


def test_layers_are_maps_of_their_own(kept, computes) -> None:
    """What was computed with a layer is not opened without, nor the reverse."""
    names = [(), ("fisher",), ("gfm", "fisher"), ()]
    found = [an.build_map(room(), laser(), 0.25, layers=layers).layers for layers in names]
    assert len(computes) == 3 and found[0] == found[3]
    assert ["fisher" in layers for layers in found] == [False, True, True, False]
    assert ["gfm" in layers for layers in found] == [False, False, True, False]


def test_a_bar_for_what_is_opened(kept, computes) -> None:
    for _ in range(2):
        an.build_map(room(), laser(), 0.25, progress=True)
    assert len(computes) == 1


def test_who_stops_it_by_its_progress_leaves_nothing(kept, computes) -> None:
    def stop(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        an.build_map(room(), laser(), 0.25, progress=stop)
    assert [path.name for path in kept.iterdir()] == [TAG]
    an.build_map(room(), laser(), 0.25)
    with pytest.raises(KeyboardInterrupt):
        an.build_map(room(), laser(), 0.25, progress=stop)
    assert len(computes) == 2


@pytest.mark.slow
def test_another_process_opens_it(kept) -> None:
    an.build_map(room(), laser(), 0.25)
    assert computed_by_a_child() == "0"
    assert len(list(kept.glob("*.map"))) == 1


@pytest.mark.slow
def test_the_tests_compute_and_keep_nothing(home, computes) -> None:
    """Else tests would compare a map with its copy, and fill the folder of whoever runs them.

    It is switched off as a user does it, for the process and for those that it starts.
    """
    assert os.environ["AMBINAV_CACHE"] == ""
    for _ in range(2):
        an.build_map(room(), laser(), 0.25)
    assert len(computes) == 2 and computed_by_a_child() == "2"
    assert not home.exists()


def test_code_from_elsewhere_is_computed(kept, computes, monkeypatch) -> None:
    def compute(context):
        return {"ones": context.spread(np.ones(len(context.points[0])))}

    class Mine(RangeScanner):
        pass

    layer = Layer(
        name="ones", title="ones", unit="1", worse="high", source="here", compute=compute
    )  # fmt: skip
    monkeypatch.setattr(LAYERS, "_registered", {"ones": layer})
    for _ in range(2):
        assert "ones" in an.build_map(room(), laser(), 0.25, layers="ones").layers
        an.build_map(room(), Mine(laser().parts), 0.25)
    assert len(computes) == 4 and not kept.exists()


@pytest.mark.parametrize("obstacle", ["a file", "/proc", "/dev/full"])
def test_a_home_that_cannot_be_written(kept, computes, monkeypatch, obstacle) -> None:
    if obstacle == "a file":
        kept.parents[2].write_text("in the way")
    else:
        monkeypatch.setenv("HOME", obstacle)
    plain = an.build_map(room(), laser(), 0.25, store=False)
    for _ in range(2):
        with pytest.warns(an.InputWarning, match="the map cannot be kept here") as caught:
            assert same(an.build_map(room(), laser(), 0.25), plain)
        assert len(caught) == 1
    assert len(computes) == 3


def test_a_process_says_it_once(kept, monkeypatch) -> None:
    monkeypatch.setenv("HOME", "/proc")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        for width in (3, 4, 5):
            an.build_map(room(width), laser(), 0.25)
        an.build_map(room(6), laser(), 0.25)
    assert len(caught) == 1


def test_without_a_home(kept, computes, monkeypatch) -> None:
    def nowhere() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", nowhere)
    for _ in range(2):
        an.build_map(room(), laser(), 0.25)
    assert len(computes) == 2


def test_a_folder_that_may_not_be_looked_at(computes, monkeypatch) -> None:
    """Its name is too long for the system, which is not a file in its place."""
    monkeypatch.setenv("AMBINAV_CACHE", "/" + 300 * "a")
    with pytest.warns(an.InputWarning, match="cannot be kept here .*too long"):
        an.build_map(room(), laser(), 0.25)
    assert len(computes) == 1


def calls(folder: str) -> list[tuple[str, ast.Call]]:
    """Calls of `build_map` in a folder's files, each with where it stands."""
    found = []
    for path in sorted((ROOT / folder).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "build_map(" in text else ():
            if isinstance(node, ast.Call):
                name = getattr(node.func, "attr", getattr(node.func, "id", None))
                if name == "build_map":
                    found.append((f"{path.relative_to(ROOT)}:{node.lineno}", node))
    return found


@pytest.mark.parametrize("folder", ["ambinav", "envs", "planners", "benchmarks"])
def test_our_own_callers_say_what_they_want(folder) -> None:
    """A command has its store already; a benchmark measures what is computed."""
    silent = [
        place for place, call in calls(folder) if "store" not in {one.arg for one in call.keywords}
    ]
    assert silent == []
