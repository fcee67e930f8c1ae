"""The file of a kept map: all of it comes back, and no bit of it can change unnoticed."""

from __future__ import annotations

import hashlib
import io
import json

import numpy as np
import pytest
import xarray as xr
from numcodecs import Zstd

from ambinav.store import entry
from tests.maps import synthetic

KEY = "0123456789abcdef" * 2


def small() -> xr.Dataset:
    """Arrays of all kinds: without dimension, empty, NaN, not in the order of C."""
    rng = np.random.default_rng(3)
    return xr.Dataset(
        {
            "level": (("y", "x"), rng.random((3, 4), dtype=np.float32), {"units": "1", "worse": 1}),
            "turned": (("x", "y"), np.asfortranarray(rng.random((4, 3)))),
            "zone": (("y", "x"), np.arange(12, dtype=np.uint8).reshape(3, 4)),
            "free": (("y", "x"), rng.random((3, 4)) > 0.5),
            "nothing": (("none",), np.empty(0, dtype=np.float32)),
            "number": ((), np.float64(np.nan)),
        },
        {"x": ("x", np.arange(4.0), {"units": "m"}), "y": ("y", np.arange(3.0))},
        {"environment": "Höhle", "notes": ["a", None, 1.5]},
    )


def packed(dataset: xr.Dataset) -> bytes:
    return b"".join(entry.pack(dataset, KEY))


def opened(content: bytes) -> xr.Dataset:
    return entry.unpack(content, entry.check_whole(content, KEY))


@pytest.mark.parametrize("piece", [1 << 28, 7])
@pytest.mark.parametrize("dataset", [small(), synthetic.dataset(), synthetic.dataset(4)])
def test_all_comes_back(dataset: xr.Dataset, piece: int, monkeypatch: pytest.MonkeyPatch) -> None:
    if piece == 7:
        dataset = dataset.isel({name: slice(6) for name in ("x", "y") if name in dataset.dims})
        monkeypatch.setattr(entry, "_PIECE", piece)
    again = opened(packed(dataset))
    assert again.identical(dataset)
    assert list(again.data_vars) == list(dataset.data_vars) and again.attrs == dataset.attrs
    for name, one in dataset.variables.items():
        assert again[name].dtype == one.dtype
        assert again[name].values.tobytes() == one.values.tobytes()
        assert name in dataset.coords or again[name].values.flags.writeable


def test_the_layout_is_as_described() -> None:
    """Read apart, by what the module says of it."""
    content = packed(small())
    line, _, body = content.partition(b"\n")
    name, version, checksum = line.split()
    assert (name, version) == (b"ambinav-map", b"1")
    assert hashlib.sha256(b"ambinav-map 1\n" + body).hexdigest() == checksum.decode()
    length = int.from_bytes(body[:8], "big")
    about = json.loads(body[8 : 8 + length])
    assert about["key"] == KEY and about["coords"] == ["x", "y"]
    rest = body[8 + length :]
    for variable, _, _, dtype, shape, lengths in about["variables"]:
        values = np.empty(0, dtype)
        for size in lengths:
            values = np.frombuffer(Zstd().decode(rest[:size]), dtype)
            rest = rest[size:]
        np.testing.assert_array_equal(values.reshape(shape), small()[variable].values)
    assert rest == b""


def test_what_is_shown_of_it_needs_not_all_of_it() -> None:
    content = packed(synthetic.dataset(4))
    about = entry.read_about(io.BytesIO(content[: len(content) // 2]))
    assert about.key == KEY and about.is_current
    sizes = synthetic.dataset(4).sizes
    assert entry.cells(about) == sizes["x"] * sizes["y"] * 4


def test_no_bit_changes_unnoticed() -> None:
    content = packed(small())
    rng = np.random.default_rng(5)
    for place in range(len(content)):
        changed = bytearray(content)
        changed[place] ^= 1 << int(rng.integers(8))
        with pytest.raises((entry.DamagedError, entry.NewerFormatError)):
            opened(bytes(changed))


def test_nothing_is_missing_unnoticed() -> None:
    content = packed(small())
    for end in range(len(content)):
        with pytest.raises(entry.DamagedError):
            opened(content[:end])
        with pytest.raises(entry.DamagedError):
            opened(content[:end] + content[end + 1 :])
    with pytest.raises(entry.DamagedError):
        opened(content + b"\0")


def test_another_map_under_this_name() -> None:
    with pytest.raises(entry.DamagedError, match="another map"):
        entry.check_whole(packed(small()), "f" * 32)


@pytest.mark.parametrize("name", [b'"environment_source"', b'"versions"', rb"\"spacing\""])
def test_a_header_without_what_is_shown_is_damaged(name: bytes) -> None:
    content = packed(synthetic.dataset())
    assert content.count(name) == 1
    changed = content.replace(name, name.replace(b"s", b"r"))
    with pytest.raises(entry.DamagedError, match="its beginning cannot be read"):
        entry.read_about(io.BytesIO(changed))


def test_the_beginning_of_a_damaged_file_does_no_harm() -> None:
    content = packed(synthetic.dataset())
    rng = np.random.default_rng(6)
    for _ in range(300):
        changed = bytearray(content)
        for place in rng.integers(0, 300, size=3):
            changed[place] = int(rng.integers(256))
        with pytest.raises((entry.DamagedError, entry.NewerFormatError)):
            entry.read_about(io.BytesIO(bytes(changed)))
            raise entry.DamagedError  # what is shown may be wrong, but nothing else is raised


@pytest.mark.parametrize("version", [entry.FORMAT + 1, 999])
def test_a_newer_format(version: int) -> None:
    content = packed(small()).replace(b"ambinav-map 1 ", f"ambinav-map {version} ".encode(), 1)
    for read in (lambda: opened(content), lambda: entry.read_about(io.BytesIO(content))):
        with pytest.raises(entry.NewerFormatError, match=str(version)):
            read()


def test_compression_is_worth_it() -> None:
    dataset = synthetic.dataset(4)
    raw = sum(one.nbytes for one in dataset.variables.values())
    assert len(packed(dataset)) < 0.5 * raw
