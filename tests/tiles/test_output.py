"""Tiles and what is at their output: links, stores of other programs, other callers, clusters."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import fsspec
import numpy as np
import pytest
import xarray as xr

import ambinav as an
from ambinav.runtime import cluster
from ambinav.runtime.errors import InputError
from ambinav.tiles.build import TiledBuild, run_plan
from tests.geometry import scenes
from tests.tiles.tile_cases import assert_identical, plan, whole

ROOM = scenes.room(4.0, 3.0)


class Ended(BaseException):
    """Ends a build where it is."""


def built(path: Path | str, env: an.Environment = ROOM, **options: Any) -> TiledBuild:
    return run_plan(plan(env, 2.0), str(path), **{"workers": 0, **options})


@pytest.mark.slow
def test_tiles_are_made_beside_the_target_of_a_link(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    link, target = tmp_path / "a.zarr", tmp_path / "disk" / "real.zarr"
    link.symlink_to(target)

    def end(share: float) -> None:
        raise Ended

    with pytest.raises(Ended):
        built(link, progress=end)
    assert [path.name for path in target.parent.iterdir()] == ["real.zarr.part"]
    built(link)
    assert link.is_symlink() and [path.name for path in target.parent.iterdir()] == ["real.zarr"]
    assert_identical(an.AmbiguityMap.open(link), whole(ROOM))


@pytest.mark.parametrize("attrs", [{}, {"title": "temperatures"}])
def test_a_store_of_another_program_is_not_replaced(attrs: dict[str, str]) -> None:
    url, system = "memory://ambinav-other/mine.zarr", fsspec.filesystem("memory")
    other = xr.Dataset({"temperature": ("t", np.arange(5.0))}, attrs=attrs)
    try:
        other.to_zarr(url, zarr_format=3, consolidated=False)
        with pytest.raises(InputError, match="not an ambiguity map and is not replaced"):
            built(url)
        assert xr.open_zarr(url, chunks=None, consolidated=False).identical(other)
    finally:
        system.rm("/ambinav-other", recursive=True)


@pytest.mark.slow
def test_a_begun_template_is_written_again_and_a_plain_map_is_not() -> None:
    url, system = "memory://ambinav-begun/a.zarr", fsspec.filesystem("memory")
    try:
        xr.Dataset().to_zarr(url, zarr_format=3, consolidated=False)
        assert built(url).made > 0
        system.rm("/ambinav-begun", recursive=True)
        whole(ROOM).save(url)
        with pytest.raises(InputError, match="a map is there that was not made in tiles"):
            built(url)
    finally:
        system.rm("/ambinav-begun", recursive=True)


@pytest.mark.slow
def test_a_repeated_build_has_the_names_that_are_given_now() -> None:
    url, system = "memory://ambinav-names/a.zarr", fsspec.filesystem("memory")
    renamed = copy.copy(ROOM)
    renamed.name, renamed.source = "hall", Path("hall.geojson")
    try:
        built(url)
        assert built(url, renamed).made == 0
        assert_identical(an.AmbiguityMap.open(url), whole(renamed))
    finally:
        system.rm("/ambinav-names", recursive=True)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["CommClosedError", "TimeoutError"])
def test_a_lost_cluster_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    comm = pytest.importorskip("distributed.comm")
    error = {"CommClosedError": comm.CommClosedError, "TimeoutError": TimeoutError}[kind]

    def lost(*_: object) -> None:
        raise error("in <TCP (closed)>: Stream is closed")

    monkeypatch.setattr(cluster, "threads_of", lambda *_: 1)
    monkeypatch.setattr(cluster, "_await_workers", lost)
    monkeypatch.setattr("distributed.Client", MagicMock())
    with pytest.raises(InputError, match="--scheduler tcp://a:1: it was lost; what is finished"):
        built(tmp_path / "a.zarr", scheduler="tcp://a:1")
