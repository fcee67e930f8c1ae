from __future__ import annotations

import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import ambinav as an
from ambinav_envs.buildings import cache as cache_module
from ambinav_envs.buildings.building import Building
from ambinav_envs.buildings.cache import cache_folder, checksum, map_of
from tests.envs.buildings.scenes import laser, room, two_rooms


def build(environment: an.Environment | None = None, **options: object) -> an.AmbiguityMap:
    given = {"spacing": 0.5, "layers": ("fisher",)} | options
    return map_of(environment or room(3.0, 2.0), laser(), **given)  # type: ignore[arg-type]


def files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.npz"))


def test_a_map_that_was_built_is_read(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    built = build()
    assert len(files(cache)) == 1
    assert not [path for path in cache.rglob("*") if path.name.startswith(".")]
    monkeypatch.setattr(cache_module, "build_map", None)
    read = build()
    assert read.source == str(files(cache)[0])
    assert read.dataset.identical(built.dataset)
    assert "fisher" in read.layers
    np.testing.assert_array_equal(read.segments.xy, built.segments.xy)
    assert read.environment.free.equals(built.environment.free)


def test_other_maps_are_other_files(cache: Path) -> None:
    base = room(3.0, 2.0), laser(), 0.5
    sums = [
        checksum(*base),
        checksum(room(3.0, 2.1), laser(), 0.5),
        checksum(two_rooms(1.0), laser(), 0.5),
        checksum(room(3.0, 2.0), laser(beams=8), 0.5),
        checksum(room(3.0, 2.0), laser(), 0.4),
        checksum(*base, ("fisher",)),
    ]
    assert len(set(sums)) == 6
    assert checksum(*base) == sums[0]


@pytest.mark.parametrize("content", [b"", b"no map", b"PK\x03\x04 cut off"])
def test_damaged_files_are_made_again(cache: Path, content: bytes) -> None:
    built = build()
    path = files(cache)[0]
    whole = path.read_bytes()
    for damaged in (content, whole[: len(whole) // 2], whole[:-100]):
        path.write_bytes(damaged)
        assert build().dataset["level"].equals(built.dataset["level"])
        assert np.load(path)["level"].shape == built.dataset["level"].shape


def test_nothing_is_kept_on_request(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    build(keep=False)
    assert not cache.exists()
    monkeypatch.setenv("AMBINAV_CACHE", "")
    assert cache_folder() is None
    build()
    assert not cache.exists()


def test_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert cache_folder() == tmp_path / "cache"
    monkeypatch.delenv("AMBINAV_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "xdg" / "ambinav"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "ambinav"


def test_a_folder_that_cannot_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("AMBINAV_CACHE", str(tmp_path / "file"))
    with pytest.raises(an.InputError, match=r"AMBINAV_CACHE is .*file', where no map can be kept"):
        build()
    monkeypatch.delenv("AMBINAV_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.warns(an.InputWarning, match=r"no map can be kept in .*set AMBINAV_CACHE"):
        assert "level" in build().layers


PROCESS = """
from tests.envs.buildings.test_cache import build
print(build().dataset["level"].values.tobytes().hex()[:4000])
"""


@pytest.mark.slow
def test_several_processes_build_the_same_map(cache: Path) -> None:
    root = Path(__file__).parents[3]
    started = [
        subprocess.Popen(
            [sys.executable, "-c", PROCESS],
            stdout=subprocess.PIPE,
            text=True,
            cwd=root,
            env={"PYTHONPATH": f"{root}:{root / 'envs'}", "AMBINAV_CACHE": str(cache)},
        )
        for _ in range(2)
    ]
    outputs = [process.communicate(timeout=600)[0] for process in started]
    assert [process.returncode for process in started] == [0, 0]
    assert outputs[0] == outputs[1]
    assert outputs[0].strip() == build().dataset["level"].values.tobytes().hex()[:4000]
    assert len(files(cache)) == 1


def test_a_building(cache: Path) -> None:
    building = Building.of(room(), laser(), 0.3, 0.5, key="mine")
    assert building.key == "mine"
    assert not cache.exists()  # nothing is worked out before it is asked for
    assert building.amap is building.amap
    assert building.amap.spacing == 0.5
    assert {"level", "fisher"} <= set(building.amap.layers)
    assert len(files(cache)) == 1
    assert building.checker.footprint.radius == 0.3
    assert building.lattice.checker is building.checker
    assert Building.of(room(), laser(), 0.3).key == "room"
    for radius, spacing in ((-0.1, 0.2), (np.nan, 0.2), (0.2, 0.0), (0.2, np.inf)):
        with pytest.raises(an.InputError, match="give metres from"):
            Building.of(room(), laser(), radius, spacing)
    assert not stat.S_IMODE(files(cache)[0].stat().st_mode) & stat.S_IXUSR
