"""A map in tiles is the map, whoever makes it, and however often a build is ended."""

from __future__ import annotations

import errno
import itertools
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import pytest
import zarr.storage
from fsspec.implementations.memory import MemoryFileSystem
from typer.testing import CliRunner

import ambinav as an
from ambinav.cli import app
from ambinav.maps import address
from ambinav.maps.address import Address
from ambinav.runtime import cluster, workers
from ambinav.runtime.errors import InputError
from ambinav.tiles import claim
from ambinav.tiles import queue as tile_queue
from ambinav.tiles.build import FOLDER, TiledBuild, check_place, run_plan
from ambinav.tiles.store import TileStore
from tests.tiles.tile_cases import DEMO, assert_identical, content, demo, plan, whole

ROOT = Path(__file__).parents[2]
TILE = 8.0


class Ended(BaseException):
    """Ends a build where it is."""


def ending(share: float) -> Callable[[float], None]:
    """Progress that ends a build when so much of it is done."""

    def report(done: float) -> None:
        if done >= share:
            raise Ended

    return report


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map of the demo in tiles, made by this process in one go."""
    path = tmp_path_factory.mktemp("tiles") / "demo.zarr"
    built(path)
    return path


def built(path: Path | str, **options: Any) -> TiledBuild:
    return run_plan(plan(demo(), TILE), str(path), **{"workers": 0, **options})


@pytest.mark.slow
def test_it_is_the_map_in_one_piece(reference: Path) -> None:
    amap = an.AmbiguityMap.open(reference)
    assert_identical(amap, whole(demo()))
    assert not reference.with_name("demo.zarr.part").exists()


@pytest.mark.sweep
def test_with_headings_and_a_layer_that_costs_read(tmp_path: Path) -> None:
    run_plan(plan(demo(), 9.0, "sonar and laser", 0.6), str(tmp_path / "a.zarr"), workers=0)
    amap = an.AmbiguityMap.open(tmp_path / "a.zarr")
    assert amap.cost_layer == "position"
    assert_identical(amap, whole(demo(), "sonar and laser", 0.6))


@pytest.mark.slow
def test_ended_and_gone_on_with_it_is_the_same(reference: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    for share in (0.1, 0.6):
        with pytest.raises(Ended):
            built(path, progress=ending(share))
        assert not path.exists()
        with pytest.raises(InputError, match="not finished"):
            an.AmbiguityMap.open(tmp_path / "a.zarr.part" / "map")
    done = built(path)
    assert done.kept > done.made > 0
    assert content(path) == content(reference)
    again = built(path)
    assert (again.made, again.kept) == (again.tiles, 0)  # an older map is replaced
    assert [one.name for one in tmp_path.iterdir()] == ["a.zarr"]


@pytest.mark.slow
def test_a_damaged_tile_is_made_again(reference: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.zarr"
    with pytest.raises(Ended):
        built(path, progress=ending(0.6))
    store = tmp_path / "a.zarr.part" / "map"
    flipped = store / "level" / "c" / "0" / "0"
    data = bytearray(flipped.read_bytes())
    data[len(data) // 2] ^= 4
    flipped.write_bytes(data)
    (store / "zone" / "c" / "0" / "1").unlink()
    # Sound for zarr, but not what was written.
    array = zarr.open_array(str(store), path="minor", mode="r+")
    array[0:2, 40:42] = 0.5
    done = built(path)
    assert done.damaged == 3
    assert content(path) == content(reference)


@pytest.mark.slow
def test_other_tiles_are_neither_taken_nor_removed(tmp_path: Path) -> None:
    with pytest.raises(Ended):
        built(tmp_path / "a.zarr", progress=ending(0.3))
    before = content(tmp_path)
    with pytest.raises(InputError, match="tiles are there of another map"):
        run_plan(plan(demo(), TILE + 1), str(tmp_path / "a.zarr"), workers=0)
    assert content(tmp_path) == before


def test_the_second_of_two_builders_is_refused(tmp_path: Path) -> None:
    with (
        FOLDER.hold(tmp_path / "a.zarr.part"),
        pytest.raises(InputError, match="another run is at work here"),
    ):
        built(tmp_path / "a.zarr")


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path) -> None:
    for name in ("a.zarr", "b.zarr.part"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "thesis.tex").touch()
    for name in ("a.zarr", "b.zarr"):
        with pytest.raises(InputError, match=r"not (an ambiguity map|of an earlier)"):
            built(tmp_path / name)


@pytest.mark.slow(kept=("5",))
@pytest.mark.parametrize("room", [5, 200])
def test_a_full_disk_is_said_and_gone_on_from(
    reference: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    calls = itertools.count()
    plain = zarr.storage.LocalStore.set

    async def full(self: Any, key: str, value: Any) -> None:
        if next(calls) > room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        await plain(self, key, value)

    with monkeypatch.context() as patch:
        patch.setattr(zarr.storage.LocalStore, "set", full)
        with pytest.raises(InputError, match=r"No space left on device.*what was made is kept"):
            built(tmp_path / "a.zarr")
    done = built(tmp_path / "a.zarr")
    assert (done.kept > 0) == (room > 5)
    assert content(tmp_path / "a.zarr") == content(reference)


@pytest.mark.slow(minutes=0.2)
def test_workers_write_the_same_bytes(reference: Path, tmp_path: Path) -> None:
    done = built(tmp_path / "a.zarr", workers=2)
    assert done.made == done.tiles >= 16
    assert content(tmp_path / "a.zarr") == content(reference)


@pytest.mark.sweep
def test_killed_workers_are_replaced(reference: Path, tmp_path: Path) -> None:
    rng, killed = np.random.default_rng(), []

    def kill(share: float) -> None:
        if rng.random() < 0.2 and len(killed) < 2:
            child = multiprocessing.active_children()[0]
            killed.append(child.pid)
            os.kill(child.pid or 0, signal.SIGKILL)

    done = built(tmp_path / "a.zarr", workers=2, progress=kill)
    assert done.made == done.tiles
    assert content(tmp_path / "a.zarr") == content(reference)
    assert not multiprocessing.active_children()


@pytest.mark.slow(minutes=0.1)
def test_workers_that_die_again_and_again_end_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Dying(workers._Worker):
        def __init__(self, work: Any) -> None:
            super().__init__(work)
            self.process.kill()

    monkeypatch.setattr(workers, "_Worker", Dying)
    monkeypatch.setattr(tile_queue, "MOST_DEATHS", 2)
    with pytest.raises(RuntimeError, match="worker processes in a row were killed"):
        built(tmp_path / "a.zarr", workers=1)
    assert not multiprocessing.active_children()


def arguments(path: Path) -> list[str]:
    words = ["map", str(DEMO), "-s", "hokuyo-urg-04lx", "--spacing", "0.5", "--tile", "4"]
    return [*words, "--workers", "1", "-o", str(path)]


def begun_as_a_program(path: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "ambinav.cli", *arguments(path)]
    paths = os.pathsep.join(str(ROOT / name) for name in ("", "envs", "planners"))
    return subprocess.Popen(command, env={**os.environ, "PYTHONPATH": paths}, cwd=ROOT)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the command makes if nothing ends it."""
    path = tmp_path_factory.mktemp("program") / "b.zarr"
    assert CliRunner().invoke(app, arguments(path)).exit_code == 0
    return path


@pytest.mark.sweep
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_build_goes_on(undisturbed: Path, tmp_path: Path, number: signal.Signals) -> None:
    records = tmp_path / "a.zarr.part" / "map" / "tiles" / "record" / "c"
    process = begun_as_a_program(tmp_path / "a.zarr")
    try:
        begun = time.monotonic()
        while not records.exists() or len(list(records.rglob("0"))) < 5:
            assert process.poll() is None and time.monotonic() - begun < 120
            time.sleep(0.02)
        process.send_signal(number)
        status = process.wait(60)
    finally:
        process.kill()
        process.wait()
    assert status == {signal.SIGKILL: -9, signal.SIGINT: 130, signal.SIGTERM: 143}[number]
    assert CliRunner().invoke(app, arguments(tmp_path / "a.zarr")).exit_code == 0
    assert content(tmp_path / "a.zarr") == content(undisturbed)


# -- URLs and clusters ---------------------------------------------------------------------------


@contextmanager
def in_memory(name: str) -> Iterator[str]:
    system = fsspec.filesystem("memory")
    try:
        yield f"memory://{name}/a.zarr"
    finally:
        system.rm(f"/{name}", recursive=True)


def fetched(url: str, path: Path) -> dict[str, str]:
    system, root = fsspec.core.url_to_fs(url)
    system.get(root, str(path), recursive=True)
    return content(path)


@pytest.mark.slow
def test_to_a_url_in_place(reference: Path, tmp_path: Path) -> None:
    with in_memory("ambinav-url") as url:
        with pytest.raises(Ended):
            built(url, progress=ending(0.5))
        done = built(url)
        assert done.kept > 0
        assert fetched(url, tmp_path / "got") == content(reference)
        assert_identical(an.AmbiguityMap.open(tmp_path / "got"), an.AmbiguityMap.open(reference))
        with pytest.raises(InputError, match="of another map"):
            run_plan(plan(demo(), TILE + 1), url, workers=0)


@pytest.mark.slow
def test_the_second_of_two_builders_at_a_url_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with in_memory("ambinav-two") as url:
        system, root = fsspec.core.url_to_fs(url)

        def again(share: float) -> None:
            if share < 0.1:
                with pytest.raises(
                    InputError, match=r"another build.*was at work here [0-9] s ago"
                ):
                    built(url)

        built(url, progress=again)
        assert not system.exists(f"{root}{claim.SUFFIX}")
        # Of one that was killed, longer ago than it lets pass without a sign of life.
        system.pipe_file(f"{root}{claim.SUFFIX}", b'{"id": "a", "host": "b", "time": 1.0}')
        assert built(url).made == 0


class NoRights(MemoryFileSystem):  # type: ignore[misc]
    """A bucket into which one may not write."""

    protocol = "norights"

    def pipe_file(self, path: str, value: bytes, *args: Any, **options: Any) -> None:
        raise PermissionError(errno.EACCES, "Access Denied")


def test_a_bucket_without_rights_is_said_before_anything_is_computed() -> None:
    fsspec.register_implementation("norights", NoRights, clobber=True)
    made = plan(demo(), TILE)
    with pytest.raises(InputError, match=r"nothing can be written there.*Access Denied"):
        run_plan(made, "norights://maps/a.zarr", workers=0)
    assert "sample" not in vars(made)
    with pytest.raises(InputError, match=r"nothing can be read or written there.*nosuch"):
        run_plan(made, "nosuch://maps/a.zarr", workers=0)


class Pail(MemoryFileSystem):  # type: ignore[misc]
    """A bucket that would be made with its folders, and whose server may say nothing."""

    protocol = "pail"
    silent = False

    def makedirs(self, path: str, exist_ok: bool = False) -> None:
        raise AssertionError("the bucket would be made")

    def pipe_file(self, path: str, value: bytes, *args: Any, **options: Any) -> None:
        if self.silent:
            time.sleep(5.0)
        super().pipe_file(path, value, *args, **options)


def test_no_bucket_is_made_and_a_silent_server_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    fsspec.register_implementation("pail", Pail, clobber=True)
    monkeypatch.setattr(address, "BUCKETS", {"pail"})
    check_place("pail://maps/a.zarr", None)
    assert address.PATIENCE <= 6.0
    monkeypatch.setattr(address, "PATIENCE", 0.1)
    monkeypatch.setattr(Pail, "silent", True)
    with pytest.raises(InputError, match=r"nobody answers there within 0\.1 s; check the address"):
        check_place("pail://maps/a.zarr", None)


@pytest.mark.slow
def test_a_scheduler_that_does_not_answer_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert cluster.PATIENCE <= 6.0
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:  # it takes calls and says nothing
        scheduler = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(InputError, match=rf"{scheduler}: no scheduler answers"):
            built(tmp_path / "a.zarr", scheduler=scheduler)
    with pytest.raises(InputError, match="no scheduler answers"):
        built(tmp_path / "a.zarr", scheduler="tcp://127.0.0.1:1")
    with pytest.raises(InputError, match="no scheduler answers"):
        built(tmp_path / "a.zarr", scheduler="nonsense")
    assert not list(tmp_path.iterdir())


@pytest.mark.sweep
@pytest.mark.usefixtures("dask_forks")
@pytest.mark.filterwarnings("default")
def test_on_a_cluster_whose_workers_are_killed(reference: Path, tmp_path: Path) -> None:
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as dask:  # type: ignore[no-untyped-call]
        count = itertools.count()

        def kill(share: float) -> None:
            if next(count) == 5:
                os.kill(next(iter(dask.workers.values())).pid, signal.SIGKILL)

        done = built(tmp_path / "a.zarr", scheduler=dask.scheduler_address, progress=kill)
    assert done.made == done.tiles
    assert content(tmp_path / "a.zarr") == content(reference)


@pytest.mark.slow(minutes=0.1)
@pytest.mark.filterwarnings("default")
def test_on_a_cluster_with_no_or_with_other_workers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from distributed import LocalCluster

    monkeypatch.setattr(cluster, "PATIENCE", 2.0)
    options: dict[str, Any] = {"processes": False, "threads_per_worker": 1}
    options |= {"protocol": "tcp://", "dashboard_address": None}
    with LocalCluster(n_workers=0, **options) as dask:  # type: ignore[no-untyped-call]
        with pytest.raises(InputError, match="it has no workers"):
            built(tmp_path / "a.zarr", scheduler=dask.scheduler_address)
        dask.scale(1)
        dask.wait_for_workers(1)
        monkeypatch.setattr("ambinav.tiles.build.computing_digest", lambda: "other")
        with pytest.raises(InputError, match="has other code"):
            built(tmp_path / "a.zarr", scheduler=dask.scheduler_address)


def test_a_store_says_what_it_holds(tmp_path: Path) -> None:
    made = plan(demo(), TILE)
    store = TileStore(Address.of(tmp_path / "a.zarr"), made.cells)
    assert store.key() is None
    (tmp_path / "a.zarr").mkdir()
    (tmp_path / "a.zarr" / "thesis.tex").touch()
    with pytest.raises(InputError, match="not an ambiguity map"):
        store.key()


@pytest.mark.slow
def test_a_window_and_single_layers_are_read_alone(
    reference: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    amap = an.AmbiguityMap.open(reference)
    xmin, ymin, xmax, ymax = bounds = (3.0, 2.0, 14.0, 9.0)
    part = an.AmbiguityMap.open(reference, bounds=bounds)
    assert_identical(
        part, an.AmbiguityMap(amap.dataset.sel(x=slice(xmin, xmax), y=slice(ymin, ymax)))
    )
    with pytest.raises(InputError, match="no cell of the map lies in the bounds"):
        an.AmbiguityMap.open(reference, bounds=(900.0, 0.0, 901.0, 1.0))
    read: set[str] = set()
    plain = zarr.storage.LocalStore.get

    async def noted(self: Any, key: str, *args: Any, **options: Any) -> Any:
        read.add(key.partition("/")[0] if "/c/" in key else "")
        return await plain(self, key, *args, **options)

    monkeypatch.setattr(zarr.storage.LocalStore, "get", noted)
    lazy = an.AmbiguityMap.open(reference, lazy=True)
    service = an.AmbiguityService(lazy, layer="level", weight=5.0)
    cost = service.cost(5.0, 5.0)
    assert "level" in read and not read & {"ambiguity", "major", "minor", "direction"}
    assert cost == an.AmbiguityService(amap, layer="level", weight=5.0).cost(5.0, 5.0)
