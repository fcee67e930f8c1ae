"""Maps on disk: the round trip, and nothing lost when something goes wrong."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from ambinav.errors import InputError
from ambinav.maps.ambiguity_map import AmbiguityMap
from tests.maps import synthetic


@pytest.mark.parametrize("headings", [0, 4])
def test_round_trip_keeps_everything(tmp_path, headings):
    dataset = synthetic.dataset(headings)
    AmbiguityMap(dataset).save(tmp_path / "a.zarr")
    again = AmbiguityMap.open(tmp_path / "a.zarr").dataset
    assert again.identical(dataset)
    assert {n: v.dtype for n, v in again.items()} == {n: v.dtype for n, v in dataset.items()}
    assert again.attrs == dataset.attrs


def test_saving_an_opened_map_again(tmp_path):
    AmbiguityMap(synthetic.dataset()).save(tmp_path / "a.zarr")
    AmbiguityMap.open(str(tmp_path / "a.zarr")).save(tmp_path / "b.zarr")
    assert AmbiguityMap.open(tmp_path / "b.zarr").dataset.identical(synthetic.dataset())


def test_plain_xarray_reads_it_too(tmp_path):
    AmbiguityMap(synthetic.dataset()).save(tmp_path / "a.zarr")
    with xr.open_zarr(tmp_path / "a.zarr", chunks=None, consolidated=True) as dataset:
        assert "level" in dataset


def test_a_failed_save_leaves_the_old_map(tmp_path, monkeypatch):
    path = tmp_path / "a.zarr"
    AmbiguityMap(synthetic.dataset()).save(path)
    newer = synthetic.dataset()
    newer["level"][:] = 0.0
    write = xr.Dataset.to_zarr

    def half(self, store, **options):
        write(self[["free"]], store, mode="w", consolidated=True, zarr_format=3)
        raise KeyboardInterrupt

    monkeypatch.setattr(xr.Dataset, "to_zarr", half)
    with pytest.raises(KeyboardInterrupt):
        AmbiguityMap(newer).save(path)
    assert [item.name for item in tmp_path.iterdir()] == ["a.zarr"]
    assert AmbiguityMap.open(path).dataset.identical(synthetic.dataset())


def test_an_open_map_outlives_its_file(tmp_path):
    path = tmp_path / "a.zarr"
    AmbiguityMap(synthetic.dataset()).save(path)
    amap = AmbiguityMap.open(path)
    newer = synthetic.dataset()
    newer["level"][:] = 0.0
    AmbiguityMap(newer).save(path)
    assert amap.sample("level", 10.0, 2.0) == pytest.approx(0.5)
    assert AmbiguityMap.open(path).sample("level", 10.0, 2.0) == 0.0


def test_only_maps_are_replaced(tmp_path):
    amap = AmbiguityMap(synthetic.dataset())
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.tex").write_text("years of work")
    (tmp_path / "file").write_text("text")
    for name in ("thesis", "file"):
        with pytest.raises(InputError, match="not replaced"):
            amap.save(tmp_path / name)
    assert (tmp_path / "thesis" / "chapter.tex").read_text() == "years of work"
    (tmp_path / "empty").mkdir()
    amap.save(tmp_path / "empty")
    assert AmbiguityMap.open(tmp_path / "empty").dataset.identical(amap.dataset)


def test_open_names_what_is_missing(tmp_path):
    with pytest.raises(InputError, match="no such map"):
        AmbiguityMap.open(tmp_path / "none.zarr")
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match=r"lacks zarr\.json"):
        AmbiguityMap.open(tmp_path / "folder")
    synthetic.dataset().drop_vars("level").to_zarr(
        tmp_path / "part.zarr", zarr_format=3, consolidated=False
    )
    with pytest.raises(InputError, match=r"part\.zarr: not an ambiguity map, it lacks level"):
        AmbiguityMap.open(tmp_path / "part.zarr")


def test_damaged_stores_are_the_users_input(tmp_path):
    path = tmp_path / "a.zarr"
    AmbiguityMap(synthetic.dataset()).save(path)
    chunk = next(item for item in (path / "level" / "c").rglob("*") if item.is_file())
    chunk.write_bytes(chunk.read_bytes()[: chunk.stat().st_size // 2])
    with pytest.raises(InputError, match="cannot be read"):
        AmbiguityMap.open(path)
    (path / "zarr.json").write_text("{")
    with pytest.raises(InputError, match="cannot be read"):
        AmbiguityMap.open(path)


def test_large_maps_are_stored_in_tiles(tmp_path):
    dataset = synthetic.dataset()
    wide = dataset.pad(x=(0, 1200), constant_values=0).assign_coords(
        x=dataset["x"].values[0] + 0.1 * np.arange(dataset.sizes["x"] + 1200)
    )
    AmbiguityMap(wide).save(tmp_path / "a.zarr")
    chunks = [item for item in (tmp_path / "a.zarr" / "level" / "c").rglob("*") if item.is_file()]
    assert len(chunks) == 2
    assert AmbiguityMap.open(tmp_path / "a.zarr").dataset["level"].equals(wide["level"])
