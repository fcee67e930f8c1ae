"""Maps on disk: the round trip, and nothing lost when something goes wrong."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.store import FORMAT, FORMAT_ATTR
from ambinav.runtime.errors import InputError
from tests.maps import synthetic


@pytest.mark.slow
@pytest.mark.parametrize("headings", [0, 4])
def test_round_trip_keeps_everything(tmp_path, headings):
    dataset = synthetic.dataset(headings)
    AmbiguityMap(dataset).save(tmp_path / "a.zarr")
    again = AmbiguityMap.open(tmp_path / "a.zarr").dataset
    assert again.identical(dataset)
    assert {n: v.dtype for n, v in again.items()} == {n: v.dtype for n, v in dataset.items()}
    assert again.attrs == dataset.attrs


@pytest.mark.slow
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


@pytest.mark.slow
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


def test_a_store_of_another_program_is_not_replaced(tmp_path):
    amap = AmbiguityMap(synthetic.dataset())
    for name, attrs in (("plain", {}), ("titled", {"title": "temperatures", "scanner": "none"})):
        other = xr.Dataset({"temperature": ("t", np.arange(5.0))}, attrs=attrs)
        other.to_zarr(tmp_path / f"{name}.zarr", zarr_format=3, consolidated=False)
        with pytest.raises(InputError, match=r"not an ambiguity map and is not replaced"):
            amap.save(tmp_path / f"{name}.zarr")
        with xr.open_zarr(tmp_path / f"{name}.zarr", chunks=None, consolidated=False) as kept:
            assert kept.identical(other)


@pytest.mark.slow
def test_older_and_begun_maps_are_replaced(tmp_path):
    amap = AmbiguityMap(synthetic.dataset())
    synthetic.dataset().to_zarr(tmp_path / "old.zarr", zarr_format=3, consolidated=False)
    xr.Dataset().to_zarr(tmp_path / "begun.zarr", zarr_format=3, consolidated=False)
    for name in ("old", "begun"):
        amap.save(tmp_path / f"{name}.zarr")
        assert AmbiguityMap.open(tmp_path / f"{name}.zarr").dataset.identical(amap.dataset)


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


def chunks(path):
    return sorted(item for item in path.glob("*/c/**/*") if item.is_file())


def damaged(path, name, change):
    """The map with one file of it changed."""
    shutil.rmtree(path, ignore_errors=True)
    AmbiguityMap(synthetic.dataset()).save(path)
    change(path / name)
    return path


def flipped(file):
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)


def test_every_chunk_is_there(tmp_path):
    """An empty one too: zarr takes a missing one for the fill value, here NaN or 0."""
    dataset = synthetic.dataset()
    dataset["zone"][:] = 0
    dataset["level"][:] = np.nan
    AmbiguityMap(dataset).save(tmp_path / "a.zarr")
    parts = [
        chunk.relative_to(tmp_path / "a.zarr").parts[0] for chunk in chunks(tmp_path / "a.zarr")
    ]
    assert set(parts) == {str(name) for name in dataset.variables}
    assert AmbiguityMap.open(tmp_path / "a.zarr").dataset.identical(dataset)


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [Path.unlink, flipped, lambda f: f.write_bytes(b""), lambda f: f.write_bytes(b"hello")],
    ids=["missing", "a bit flipped", "empty", "something else"],
)
def test_a_missing_or_damaged_chunk_is_named(tmp_path, change):
    AmbiguityMap(synthetic.dataset()).save(tmp_path / "whole.zarr")
    for chunk in chunks(tmp_path / "whole.zarr")[:: 1 if change is Path.unlink else 4]:
        name = chunk.relative_to(tmp_path / "whole.zarr")
        path = damaged(tmp_path / "a.zarr", name, change)
        with pytest.raises(InputError, match=rf"a\.zarr/{name}: .*; .*make") as caught:
            AmbiguityMap.open(path)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize("version", [FORMAT + 1, 99])
def test_a_map_of_a_newer_format_is_refused(tmp_path, version):
    path = tmp_path / "a.zarr"
    AmbiguityMap(synthetic.dataset()).save(path)
    root = json.loads((path / "zarr.json").read_text())
    root["attributes"] |= {FORMAT_ATTR: version, "ambinav_version": "7.8.9"}
    (path / "zarr.json").write_text(json.dumps(root))
    with pytest.raises(InputError) as caught:
        AmbiguityMap.open(path)
    words = (f"format {version} (of ambinav 7.8.9)", f"up to {FORMAT}", "install a newer ambinav")
    assert all(word in str(caught.value) for word in words)


def test_a_map_of_an_older_format_is_read(tmp_path):
    """Stores without the attribute left empty chunks out."""
    dataset = synthetic.dataset()
    dataset.to_zarr(tmp_path / "a.zarr", zarr_format=3, consolidated=False)
    amap = AmbiguityMap.open(tmp_path / "a.zarr")
    assert amap.dataset.identical(dataset)
    assert FORMAT_ATTR not in amap.dataset.attrs


def test_zones_over_headings_of_an_older_format_are_refused(tmp_path):
    path = tmp_path / "a.zarr"
    AmbiguityMap(synthetic.dataset(headings=4)).save(path)
    AmbiguityMap.open(path)
    root = json.loads((path / "zarr.json").read_text())
    root["attributes"][FORMAT_ATTR] = 2
    (path / "zarr.json").write_text(json.dumps(root))
    with pytest.raises(InputError, match=r"a\.zarr: .* zones .*; make the map again"):
        AmbiguityMap.open(path)


@pytest.mark.parametrize("version", ["new", 0, None, 1.5])
def test_a_format_that_is_none(tmp_path, version):
    path = tmp_path / "a.zarr"
    AmbiguityMap(synthetic.dataset()).save(path)
    root = json.loads((path / "zarr.json").read_text())
    root["attributes"][FORMAT_ATTR] = version
    (path / "zarr.json").write_text(json.dumps(root))
    with pytest.raises(InputError, match="map_format is"):
        AmbiguityMap.open(path)


def test_parameters_must_be_json(tmp_path):
    for parameters in ("{", "[]", 7):
        dataset = synthetic.dataset().assign_attrs(parameters=parameters)
        with pytest.raises(InputError, match=r"attribute parameters is .*, not a JSON object"):
            AmbiguityMap(dataset)


def test_a_building_is_no_map(tmp_path):
    (tmp_path / "office.yaml").write_text("image: office.pgm\nresolution: 0.05\n")
    (tmp_path / "plan.geojson").write_text("{}")
    (tmp_path / "scanner.yaml").write_text("parts: []")
    for name, words in (
        ("office.yaml", "an occupancy map, not an ambiguity map; make one of it with"),
        ("plan.geojson", "a floor plan, not an ambiguity map; make one of it with"),
        ("scanner.yaml", "a scanner, not an ambiguity map; give it with --scanner"),
    ):
        with pytest.raises(InputError, match=words):
            AmbiguityMap.open(tmp_path / name)
