"""Maps at URLs hold what a folder holds, and what is lacking there is said."""

from __future__ import annotations

import http.server
import json
import socket
import sys
import threading
import time
import uuid
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import pytest
import xarray as xr
from fsspec.implementations.memory import MemoryFileSystem
from fsspec.registry import _registry

from ambinav.maps import address, store
from ambinav.maps.address import Address
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from tests.maps import synthetic


@pytest.fixture
def url() -> Iterator[str]:
    name = f"maps-{uuid.uuid4().hex}"
    yield f"memory://{name}/a.zarr"
    system = fsspec.filesystem("memory")
    if system.exists(f"/{name}"):
        system.rm(f"/{name}", recursive=True)


def files(url: str) -> dict[str, bytes]:
    """Bytes of all files at a URL, by their names."""
    system, root = fsspec.core.url_to_fs(url)
    return {path.removeprefix(f"{root}/"): system.cat_file(path) for path in system.find(root)}


@pytest.mark.slow
@pytest.mark.parametrize("headings", [0, 4])
def test_the_map_at_a_url_is_that_of_a_folder(url: str, tmp_path: Path, headings: int) -> None:
    amap = AmbiguityMap(synthetic.dataset(headings))
    amap.save(url)
    amap.save(tmp_path / "a.zarr")
    assert AmbiguityMap.open(url).dataset.identical(amap.dataset)
    assert AmbiguityMap.open(url).dataset.attrs == amap.dataset.attrs
    folder = {
        str(path.relative_to(tmp_path / "a.zarr")): path.read_bytes()
        for path in (tmp_path / "a.zarr").rglob("*")
        if path.is_file()
    }
    there = files(url)
    chunks = {name for name in folder if "/c" in name}
    assert there.keys() == folder.keys()
    assert all(there[name] == folder[name] for name in chunks)


def test_a_file_url_is_a_folder(tmp_path: Path) -> None:
    amap = AmbiguityMap(synthetic.dataset())
    amap.save(f"file://{tmp_path}/a.zarr")
    assert AmbiguityMap.open(tmp_path / "a.zarr").dataset.identical(amap.dataset)
    assert AmbiguityMap.open(f"file://{tmp_path}/a.zarr").dataset.identical(amap.dataset)
    assert [path.name for path in tmp_path.iterdir()] == ["a.zarr"]


def test_a_window_and_single_layers_are_read_alone(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = AmbiguityMap(synthetic.dataset())
    whole.save(url)
    xmin, ymin, xmax, ymax = whole.bounds
    bounds = (xmin, ymin, (xmin + xmax) / 2, ymax)
    with pytest.raises(InputError, match=r"bounds is .*nan.*; give xmin"):
        AmbiguityMap.open(url, bounds=(xmin, ymin, float("nan"), ymax))
    part = AmbiguityMap.open(url, bounds=bounds)
    assert part.dataset.identical(
        whole.dataset.sel(x=slice(bounds[0], bounds[2]), y=slice(bounds[1], bounds[3]))
    )
    read: set[str] = set()
    plain = MemoryFileSystem.cat_file

    def noted(self: Any, path: str, *args: Any, **options: Any) -> bytes:
        read.add(path.partition("a.zarr/")[2].partition("/")[0])
        return bytes(plain(self, path, *args, **options))

    monkeypatch.setattr(MemoryFileSystem, "cat_file", noted)
    lazy = AmbiguityMap.open(url, lazy=True)
    assert not read & {"level", "ambiguity"}
    assert lazy.sample("level", 10.0, 2.0) == whole.sample("level", 10.0, 2.0)
    assert "level" in read and "ambiguity" not in read


def test_a_newer_map_replaces_an_older_one(url: str) -> None:
    dataset = synthetic.dataset()
    AmbiguityMap(dataset.assign(own=dataset["level"])).save(url)
    newer = dataset.copy(deep=True)
    newer["level"][:] = 0.0
    AmbiguityMap(newer).save(url)
    assert AmbiguityMap.open(url).dataset.identical(newer)
    assert not any(name.startswith("own/") for name in files(url))


@pytest.mark.slow
def test_a_map_is_saved_where_it_is_still_being_read_from(url: str) -> None:
    """At a URL what is there goes first: all of it is in memory before."""
    AmbiguityMap(synthetic.dataset()).save(url)
    lazy = AmbiguityMap.open(url, lazy=True)
    lazy.dataset["own"] = lazy.dataset["level"] + 1.0
    lazy.save(url)
    again = AmbiguityMap.open(url).dataset
    assert again.drop_vars("own").identical(synthetic.dataset())
    assert np.nanmin(again["own"]) >= 1.0


@pytest.mark.slow
@pytest.mark.parametrize("place", ["folder", "url"])
def test_a_map_that_is_replaced_while_it_is_read_is_read_again(
    url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    where = url if place == "url" else str(tmp_path / "a.zarr")
    older, newer = synthetic.dataset(), synthetic.dataset()
    newer["level"][:] = 0.0
    newer.attrs["created"] = "2026-02-02T00:00:00Z"
    AmbiguityMap(older).save(where)
    plain, changes = store._read, [newer, older, newer]

    def replaced(*given: Any) -> xr.Dataset:
        read: xr.Dataset = plain(*given)
        if changes:
            AmbiguityMap(changes.pop()).save(where)
        return read

    monkeypatch.setattr(store, "_read", replaced)
    assert AmbiguityMap.open(where).dataset.identical(newer)
    changes += [newer, older] * 3
    with pytest.raises(InputError, match="was replaced 5 times while it was read"):
        AmbiguityMap.open(where)


@pytest.mark.parametrize("bounds", [(1, 2, 3), (1, 1, "west", 3), 7, None])
def test_bounds_that_are_none_are_named(tmp_path: Path, bounds: Any) -> None:
    path = tmp_path / "a.zarr"
    AmbiguityMap(synthetic.dataset()).save(path)
    if bounds is None:
        assert AmbiguityMap.open(path, bounds=bounds).dataset.sizes["x"] > 1
        return
    with pytest.raises(InputError, match=r"^bounds is .*; give xmin, ymin, xmax and ymax"):
        AmbiguityMap.open(path, bounds=bounds)


def test_only_maps_are_replaced(url: str) -> None:
    fsspec.filesystem("memory").pipe_file(f"{url.removeprefix('memory:/')}/thesis.tex", b"years")
    with pytest.raises(InputError, match="not an ambiguity map and is not replaced"):
        AmbiguityMap(synthetic.dataset()).save(url)
    assert files(url) == {"thesis.tex": b"years"}


def test_a_store_of_another_program_is_not_replaced(url: str) -> None:
    other = xr.Dataset({"temperature": ("t", np.arange(5.0))}, attrs={"title": "temperatures"})
    other.to_zarr(url, zarr_format=3, consolidated=False)
    before = files(url)
    with pytest.raises(InputError, match="not an ambiguity map and is not replaced"):
        AmbiguityMap(synthetic.dataset()).save(url)
    assert files(url) == before


@pytest.mark.slow
def test_a_map_that_was_not_written_to_its_end_is_no_map(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    amap = AmbiguityMap(synthetic.dataset())
    amap.save(url)
    write = xr.Dataset.to_zarr

    def half(self: xr.Dataset, store: Any, **options: Any) -> None:
        options["encoding"] = {}
        write(self[["free"]], store, **options)
        raise OSError("the line is cut")

    with monkeypatch.context() as patch:
        patch.setattr(xr.Dataset, "to_zarr", half)
        with pytest.raises(InputError, match=r"cannot be written \(OSError: the line is cut\)"):
            amap.save(url)
    with pytest.raises(InputError, match=r"this map is not finished.*save it again"):
        AmbiguityMap.open(url)
    amap.save(url)
    assert AmbiguityMap.open(url).dataset.identical(amap.dataset)


def test_tiles_that_are_being_made_are_not_replaced(url: str) -> None:
    amap = AmbiguityMap(synthetic.dataset())
    amap.save(url)
    system, root = fsspec.core.url_to_fs(url)
    metadata = json.loads(system.cat_file(f"{root}/zarr.json"))
    metadata["attributes"]["unfinished"] = "tiles"
    system.pipe_file(f"{root}/zarr.json", json.dumps(metadata).encode())
    with pytest.raises(InputError, match="tiles of a map that is being made are there"):
        amap.save(url)
    with pytest.raises(InputError, match="give the same `ambinav map --tile` command again"):
        AmbiguityMap.open(url)


@pytest.mark.parametrize("lazy", [False, True])
def test_a_missing_or_damaged_chunk_is_named(url: str, lazy: bool) -> None:
    AmbiguityMap(synthetic.dataset()).save(url)
    system, root = fsspec.core.url_to_fs(url)
    chunk = next(name for name in files(url) if name.startswith("level/c"))
    content = system.cat_file(f"{root}/{chunk}")
    system.rm_file(f"{root}/{chunk}")
    with pytest.raises(InputError, match=rf"a\.zarr/{chunk}: this part of the map is missing"):
        AmbiguityMap.open(url, lazy=lazy).sample("level", 10.0, 2.0)
    if not lazy:
        system.pipe_file(f"{root}/{chunk}", content[:-7])
        with pytest.raises(InputError, match=rf"a\.zarr/{chunk}: the map cannot be read"):
            AmbiguityMap.open(url)


def test_nothing_there_is_said(url: str) -> None:
    with pytest.raises(InputError, match=r"there is no ambiguity map, zarr\.json is not there"):
        AmbiguityMap.open(url)


class Guarded(MemoryFileSystem):  # type: ignore[misc]
    """A bucket that is as its name says."""

    protocol = "guarded"

    def cat_file(self, path: str, *args: Any, **options: Any) -> bytes:
        if "silent" in path:
            time.sleep(3.0)
        if "nobucket" in path:
            raise FileNotFoundError("The specified bucket does not exist")
        raise PermissionError(13, "Access Denied")


@pytest.mark.parametrize(
    ("place", "sentence"),
    [
        ("guarded://denied/a.zarr", r"nothing can be read there \(PermissionError: Access Denied"),
        ("guarded://nobucket/a.zarr", r"nothing can be read there .*bucket does not exist"),
        ("guarded://silent/a.zarr", r"nobody answers there within 0\.2 s; check the address"),
        ("nosuch://maps/a.zarr", r"\(ValueError: Protocol not known: nosuch\); check the address"),
    ],
)
def test_what_hinders_is_said_soon(
    place: str, sentence: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    fsspec.register_implementation("guarded", Guarded, clobber=True)
    assert address.PATIENCE <= 6.0
    monkeypatch.setattr(address, "PATIENCE", 0.2)
    begun = time.monotonic()
    with pytest.raises(InputError, match=sentence) as caught:
        AmbiguityMap.open(place)
    assert time.monotonic() - begun < 2.0
    assert str(caught.value).startswith(place) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("place", "module", "package"),
    [
        ("s3://maps/a.zarr", "s3fs", "s3fs"),
        ("gs://maps/a.zarr", "gcsfs", "gcsfs"),
        ("abfs://maps/a.zarr", "adlfs", "adlfs"),
        ("https://example.org/a.zarr", "aiohttp", "aiohttp"),
        ("memory://maps/a.zarr", "fsspec", "fsspec"),
    ],
)
@pytest.mark.parametrize("write", [False, True])
def test_a_package_that_is_lacking_is_named(
    place: str, module: str, package: str, write: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    for name in ("s3fs.core", "gcsfs", "adlfs", "fsspec.implementations.http"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    for protocol in ("s3", "gs", "abfs", "https"):
        monkeypatch.delitem(_registry, protocol, raising=False)
    with pytest.raises(InputError, match=rf'run: pip install "{package}"'):
        if write:
            AmbiguityMap(synthetic.dataset()).save(place)
        else:
            AmbiguityMap.open(place)


def test_addresses_have_names() -> None:
    stems = {
        "s3://maps/office.zarr": "office",
        "https://a.org/x/hall.zarr/?v=1": "hall",
        "a/b.zarr": "b",
    }
    assert {place: Address.of(place).stem for place in stems} == stems


class Quiet(http.server.SimpleHTTPRequestHandler):
    """A server of files that does not print."""

    def log_message(self, *args: Any) -> None:
        """Say nothing."""


def test_over_http(tmp_path: Path) -> None:
    pytest.importorskip("aiohttp")
    amap = AmbiguityMap(synthetic.dataset())
    amap.save(tmp_path / "a.zarr")
    handler = partial(Quiet, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        place = f"http://127.0.0.1:{server.server_port}/a.zarr"
        assert AmbiguityMap.open(place).dataset.identical(amap.dataset)
        level = AmbiguityMap.open(place, lazy=True).sample("level", 10.0, 2.0)
        assert level == amap.sample("level", 10.0, 2.0)
        next((tmp_path / "a.zarr" / "level" / "c").rglob("[0-9]*/[0-9]*")).unlink()
        with pytest.raises(InputError, match="this part of the map is missing"):
            AmbiguityMap.open(place)
        with pytest.raises(InputError, match="nothing can be written there"):
            amap.save(place)
        server.shutdown()
    with socket.create_server(("127.0.0.1", 0)) as silent:
        place = f"http://127.0.0.1:{silent.getsockname()[1]}/a.zarr"
        begun = time.monotonic()
        with pytest.raises(InputError, match="nobody answers there"):
            AmbiguityMap.open(place)
        assert time.monotonic() - begun < 8.0


def test_values_survive(url: str) -> None:
    dataset = synthetic.dataset()
    dataset["level"][0, 0] = np.nan
    AmbiguityMap(dataset).save(url)
    assert np.isnan(AmbiguityMap.open(url).dataset["level"].values[0, 0])
