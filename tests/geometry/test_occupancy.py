from __future__ import annotations

import hashlib
import math
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ambinav.buildings.map_server import load_map_server
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from ambinav.runtime.errors import InputError

HEADER = {
    "image": "map.pgm",
    "resolution": "0.05",
    "origin": "[-1.0, 2.0, 0.0]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}
# Top row: black, white, what map_saver writes for unknown. Bottom row: free, black, black.
PIXELS = np.array([[0, 255, 205], [254, 0, 0]], dtype=np.uint8)
STATE = [[FREE, OCCUPIED, OCCUPIED], [OCCUPIED, FREE, UNKNOWN]]


def write_yaml(folder: Path, **changes: str | None) -> Path:
    header = {**HEADER, **changes}
    path = folder / "map.yaml"
    path.write_text("".join(f"{k}: {v}\n" for k, v in header.items() if v is not None))
    return path


def write_map(folder: Path, pixels: np.ndarray = PIXELS, **changes: str | None) -> Path:
    path = write_yaml(folder, **changes)
    Image.fromarray(pixels).save(folder / (changes.get("image") or "map.pgm"))
    return path


def test_rows_start_at_the_smallest_y(tmp_path: Path) -> None:
    grid = load_map_server(write_map(tmp_path))
    assert grid.state.dtype == np.uint8
    assert grid.state.tolist() == STATE
    assert grid.resolution == 0.05
    assert grid.origin == (-1.0, 2.0, 0.0)


def test_checksum_covers_both_files(tmp_path: Path) -> None:
    path = write_map(tmp_path)
    grid = load_map_server(str(path))
    expected = hashlib.sha256(path.read_bytes() + (tmp_path / "map.pgm").read_bytes())
    assert grid.checksum == expected.hexdigest()
    assert (grid.source, grid.image) == (path, tmp_path / "map.pgm")


def test_world_coordinates_turn_with_the_origin() -> None:
    # A quarter turn: columns run along +y, rows along -x.
    grid = OccupancyGrid(np.zeros((2, 3), np.uint8), 0.5, (10.0, 20.0, math.pi / 2))
    x, y = grid.to_world(np.array([0.0, 3.0, 0.5]), np.array([0.0, 2.0, 0.5]))
    np.testing.assert_allclose(x, [10.0, 9.0, 9.75], atol=1e-12)
    np.testing.assert_allclose(y, [20.0, 21.5, 20.25], atol=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        b"P2\n# by hand\n3 2\n255\n0 255 205\n254 0 0\n",
        b"P5\n3 2\n255\n" + PIXELS.tobytes(),
        b"P5 3 2 65535\n" + (PIXELS.astype(">u2") * 257).tobytes(),
    ],
    ids=["P2", "P5", "P5 with 16 bits"],
)
def test_kinds_of_pgm(tmp_path: Path, text: bytes) -> None:
    path = write_yaml(tmp_path)
    (tmp_path / "map.pgm").write_bytes(text)
    assert load_map_server(path).state.tolist() == STATE


@pytest.mark.parametrize("mode", ["L", "LA", "RGB", "RGBA", "P", "I;16"])
def test_kinds_of_png(tmp_path: Path, mode: str) -> None:
    path = write_yaml(tmp_path, image="map.png")
    if mode == "I;16":
        image = Image.fromarray(PIXELS.astype(np.uint16) * 257)
    else:
        image = Image.fromarray(PIXELS).convert(mode)
    image.save(tmp_path / "map.png")
    assert load_map_server(path).state.tolist() == STATE


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("kind", ["LA", "RGBA"])
def test_opaque_pixels_mean_what_they_mean_without_alpha(
    tmp_path: Path, kind: str, mode: str
) -> None:
    """All shades, and one pixel in a corner that is not opaque."""
    shades = np.arange(256, dtype=np.uint8).reshape(16, 16)
    plain = load_map_server(write_map(tmp_path, shades, image="plain.png", mode=mode)).state
    image = Image.fromarray(shades).convert(kind)
    image.save(tmp_path / "map.png")
    path = write_yaml(tmp_path, image="map.png", mode=mode)
    np.testing.assert_array_equal(load_map_server(path).state, plain)
    image.putpixel((0, 0), (200,) * (len(kind) - 1) + (9,))
    image.save(tmp_path / "map.png")
    state = load_map_server(path).state
    np.testing.assert_array_equal(np.delete(state.ravel(), 240), np.delete(plain.ravel(), 240))


@pytest.mark.slow
def test_real_maps_with_an_opaque_alpha_channel(data_dir: Path, tmp_path: Path) -> None:
    for file in sorted((data_dir / "maps").glob("*.yaml")):
        if "tiled" in file.stem:
            continue
        plain = load_map_server(file)
        assert plain.image is not None
        with Image.open(plain.image) as opened:
            opened.convert("RGBA").save(tmp_path / plain.image.name)
        copy = tmp_path / file.name
        copy.write_text(file.read_text())
        np.testing.assert_array_equal(load_map_server(copy).state, plain.state, err_msg=file.stem)


def test_transparent_white_is_less_free_in_trinary(tmp_path: Path) -> None:
    pixels = np.array([[[255, 255, 255, 255], [255, 255, 255, 0]]], dtype=np.uint8)
    # (3 * 255 + 0) / 1020 = 0.75 bright: neither free nor occupied.
    grid = load_map_server(write_map(tmp_path, pixels, image="map.png"))
    assert grid.state.tolist() == [[FREE, UNKNOWN]]


def test_scale_takes_transparency_for_unknown(tmp_path: Path) -> None:
    rgba = [[255, 255], [255, 254], [0, 255], [0, 0], [128, 255]]
    pixels = np.array([[[v, v, v, a] for v, a in rgba]], dtype=np.uint8)
    grid = load_map_server(write_map(tmp_path, pixels, image="map.png", mode="scale"))
    assert grid.state.tolist() == [[FREE, UNKNOWN, OCCUPIED, UNKNOWN, UNKNOWN]]


@pytest.mark.parametrize("negate", ["0", "1"])
def test_raw_values_are_percent(tmp_path: Path, negate: str) -> None:
    pixels = np.array([[0, 19, 20, 65, 66, 100, 101, 255]], dtype=np.uint8)
    grid = load_map_server(write_map(tmp_path, pixels, mode="raw", negate=negate))
    expected = [FREE, FREE, UNKNOWN, UNKNOWN, OCCUPIED, OCCUPIED, UNKNOWN, UNKNOWN]
    assert grid.state.tolist() == [expected]


@pytest.mark.parametrize("negate", ["1", "true"])
def test_negate_makes_black_free(tmp_path: Path, negate: str) -> None:
    grid = load_map_server(write_map(tmp_path, negate=negate))
    assert grid.state[1].tolist() == [FREE, OCCUPIED, OCCUPIED]


def test_thresholds_are_not_reached_by_equality(tmp_path: Path) -> None:
    # 51 / 255 is 0.2 and 204 / 255 is 0.8: the cells at the thresholds are unknown.
    pixels = np.array([[50, 51, 204, 205]], dtype=np.uint8)
    path = write_map(tmp_path, pixels, negate="1", free_thresh="0.2", occupied_thresh="0.8")
    assert load_map_server(path).state.tolist() == [[FREE, UNKNOWN, UNKNOWN, OCCUPIED]]


def test_mode_may_be_left_out_and_numbers_may_be_text(tmp_path: Path) -> None:
    # YAML 1.1 reads 5e-2 as text; yaml-cpp, which map_server uses, reads a number.
    assert load_map_server(write_map(tmp_path, resolution="5e-2")).resolution == 0.05


def test_absolute_image_path(tmp_path: Path) -> None:
    other = tmp_path / "elsewhere"
    other.mkdir()
    Image.fromarray(PIXELS).save(other / "walls.pgm")
    path = write_yaml(tmp_path, image=str(other / "walls.pgm"))
    assert load_map_server(path).state.tolist() == STATE


@pytest.mark.parametrize("key", HEADER)
def test_missing_key_is_named(tmp_path: Path, key: str) -> None:
    with pytest.raises(InputError, match=f"key {key} is missing"):
        load_map_server(write_map(tmp_path, **{key: None, "spare": "1"}))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("image", "[1, 2]"),
        ("image", "''"),
        ("image", "nowhere.pgm"),
        ("image", "."),
        ("image", '"a\\0b"'),
        ("resolution", "0"),
        ("resolution", "-0.05"),
        ("resolution", "5"),  # centimetres
        ("resolution", "50"),  # millimetres
        ("resolution", ".nan"),
        ("resolution", ".inf"),
        ("resolution", "fine"),
        ("resolution", "true"),
        ("resolution", "1" + 400 * "0"),
        ("origin", "0"),
        ("origin", "[0, 0]"),
        ("origin", "[0, 0, north]"),
        ("origin", "[0, 0, .nan]"),
        ("negate", "2"),
        ("negate", "maybe"),
        ("occupied_thresh", "1.5"),
        ("occupied_thresh", ".nan"),
        ("free_thresh", "-0.1"),
        ("free_thresh", "0.65"),
        ("free_thresh", "0.9"),
        ("mode", "ternary"),
        ("mode", "[raw]"),
    ],
)
def test_wrong_value_is_named(tmp_path: Path, key: str, value: str) -> None:
    path = write_map(tmp_path)
    write_yaml(tmp_path, **{key: value})
    with pytest.raises(InputError, match=key) as caught:
        load_map_server(path)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [b"", b"# only a remark\n", b"- a\n- b\n", b"image: [", b"\xff\xfe\x00", b"a: !!int ''"],
)
def test_broken_yaml(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "map.yaml"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"map\.yaml"):
        load_map_server(path)


def test_missing_file_and_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        load_map_server(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="directory"):
        load_map_server(tmp_path)


PNG = b"\x89PNG\r\n\x1a\n"


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"this is no image",
        b"P5\n0 0\n255\n",
        b"P5\n3 2\n255\n\0\0",
        b"P2\n3 2\n255\n0 0 x 0 0 0\n",
        b"P2\n3 2\n255\n0 0\n",
        b"P5\n3 2\n",
        PNG,
        PNG + b"\0\0\0\rIHDR\0\0",
        b"P5\n100000 100000\n255\n\0",
    ],
)
def test_broken_image(tmp_path: Path, content: bytes) -> None:
    path = write_yaml(tmp_path)
    (tmp_path / "map.pgm").write_bytes(content)
    with pytest.raises(InputError, match=r"map\.pgm: the image"):
        load_map_server(path)


def test_truncated_png(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    path = write_map(tmp_path, rng.integers(0, 255, (50, 50), dtype=np.uint8), image="map.png")
    image = tmp_path / "map.png"
    image.write_bytes(image.read_bytes()[:1000])
    with pytest.raises(InputError, match="truncated"):
        load_map_server(path)


def test_map_without_free_cells(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no cell is free"):
        load_map_server(write_map(tmp_path, np.full((4, 4), 205, np.uint8)))
