"""Occupancy grids and masks, read by our reader and by the rules of nav2's map_io written anew."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

import ambinav as an
from ambinav.buildings.map_server import load_map_server
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, UNKNOWN
from ambinav.maps.judged_floor import JUDGED
from ambinav.maps.zones import CORRIDOR, OPEN

Write = Callable[..., tuple[Path, ...]]


def map_io(path: Path) -> tuple[np.ndarray, float, list[float]]:
    """What map_server publishes: int8 (height, width), row 0 at the origin; bytes read by hand."""
    header = yaml.safe_load(path.read_text())
    raw = (path.parent / header["image"]).read_bytes()
    magic, width, height, most = raw.split(maxsplit=4)[:4]
    assert (magic, most) == (b"P5", b"255")
    rows, columns = int(height), int(width)
    # Pixels may look like blanks, so that the image is told by its length.
    image = np.frombuffer(raw[-rows * columns :], dtype=np.uint8).reshape(rows, columns)
    shade = image / 255.0
    occupied = shade if header["negate"] else 1.0 - shade
    out = np.full(image.shape, -1, dtype=np.int8)
    if header["mode"] == "raw":
        out[image <= 100] = image[image <= 100]
    else:
        assert header["mode"] == "trinary"
        out[occupied > header["occupied_thresh"]] = 100
        out[occupied < header["free_thresh"]] = 0
    return out[::-1], header["resolution"], header["origin"]


def at(path: Path, x: float, y: float) -> int:
    """The value of the published grid at a place."""
    grid, resolution, origin = map_io(path)
    assert origin[2] == 0.0
    row, column = int((y - origin[1]) // resolution), int((x - origin[0]) // resolution)
    return int(grid[row, column])


def test_places_of_the_building(write: Write) -> None:
    path = write("map-server", "house.yaml", resolution=0.05)[0]
    for x, y in [(0.5, 0.5), (2.0, 1.5), (7.0, 1.2), (17.5, 5.5), (17.5, -1.5), (12.2, 0.8)]:
        assert at(path, x, y) == 0, (x, y)
    # The thin wall, the rim of the pillar, the corner of the room, the corridor's wall.
    # They lie on lines of the lattice: either neighbour may be the wall's cell, or both.
    for x, y in [(1.0, 0.8), (12.0, 0.2), (3.0, 0.5), (7.0, 1.0), (18.0, 3.0)]:
        around = [at(path, x + dx, y + dy) for dx in (-0.01, 0.01) for dy in (-0.01, 0.01)]
        assert 100 in around, (x, y)
    # Within the pillar, beyond the walls and the opening.
    for x, y in [(12.25, 0.25), (7.0, 3.5), (-0.04, 1.5)]:
        assert at(path, x, y) == -1, (x, y)


def test_our_reader_sees_the_same(write: Write) -> None:
    path = write("map-server", "house.yaml", resolution=0.05)[0]
    grid = load_map_server(path)
    published, resolution, origin = map_io(path)
    codes = np.select([published == 0, published == 100], [FREE, OCCUPIED], UNKNOWN)
    np.testing.assert_array_equal(grid.state, codes)
    assert (grid.resolution, list(grid.origin)) == (resolution, origin)
    again = an.load_environment(path)
    assert again.free.area == pytest.approx(6.0 + 12.0 + 3.0 + 56.0, rel=0.05)


def test_a_map_from_a_grid_gives_the_cells_of_that_grid(tmp_path: Path, write: Write) -> None:
    rows = ["##########", "#........#", "#..##....#", "#........#", "##########"]
    state = np.array([[100 if c == "#" else 0 for c in row] for row in rows[::-1]], dtype=np.uint8)
    image = np.kron(np.where(state == 100, 0, 254)[::-1], np.ones((10, 10))).astype(np.uint8)
    from PIL import Image

    Image.fromarray(image).save(tmp_path / "in.pgm")
    (tmp_path / "in.yaml").write_text(
        "image: in.pgm\nresolution: 0.05\norigin: [-1.5, 2.25, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    scanner = an.RangeScanner.planar(
        sensor=an.RangeSensor(max_range=2.0, std=0.02, resolution=0.01), beams=16, aperture=6.283
    )
    amap = an.build_map(an.load_environment(tmp_path / "in.yaml"), scanner, spacing=0.2)
    out = write("map-server", "out.yaml", of=amap)[0]
    before, after = load_map_server(tmp_path / "in.yaml"), load_map_server(out)
    assert after.origin == before.origin
    assert after.state.shape == before.state.shape
    assert not ((after.state == FREE) & (before.state == OCCUPIED)).any()
    # Where a robot may be keeps off the walls by a cell here and there (Environment.drivable).
    assert ((after.state == FREE) == (before.state == FREE)).mean() > 0.96


def test_a_plain_room_keeps_its_free_cells_and_its_walls(tmp_path: Path, write: Write) -> None:
    """No occupied cell lies in the fitted floor of such a room, which so is all drivable."""
    from PIL import Image

    image = np.zeros((60, 80), dtype=np.uint8)
    image[2:-2, 2:-2] = 254
    Image.fromarray(image).save(tmp_path / "in.pgm")
    (tmp_path / "in.yaml").write_text(
        "image: in.pgm\nresolution: 0.05\norigin: [500.0, -700.0, 0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    scanner = an.RangeScanner.planar(
        sensor=an.RangeSensor(max_range=2.0, std=0.02, resolution=0.01), beams=16, aperture=6.283
    )
    environment = an.load_environment(tmp_path / "in.yaml")
    assert environment.drivable is None
    amap = an.build_map(environment, scanner, spacing=0.2)
    grid, resolution, origin = map_io(write("map-server", "out.yaml", of=amap)[0])
    before = np.where(image[::-1] == 254, 0, 100)
    assert (resolution, origin) == (0.05, [500.0, -700.0, 0.0])
    np.testing.assert_array_equal(grid == 0, before == 0)
    assert (grid == before).sum() >= grid.size - 4  # the outermost corners are far from any wall


@pytest.mark.parametrize(
    ("kind", "plugin", "code"),
    [
        ("nav2-keepout", "nav2_costmap_2d::KeepoutFilter", 0),
        ("nav2-preference", "nav2_costmap_2d::KeepoutFilter", 0),
        ("nav2-speed", "nav2_costmap_2d::SpeedFilter", 1),
        ("nav2-binary", "nav2_costmap_2d::BinaryFilter", 3),
    ],
)
def test_masks_and_their_parameters(
    write: Write, amap: an.AmbiguityMap, kind: str, plugin: str, code: int
) -> None:
    mask, image, params, _ = write(kind, "mask.yaml")
    assert (image.name, params.name) == ("mask.pgm", "mask_params.yaml")
    nodes = yaml.safe_load(params.read_text())
    server, info, manager, costmap = nodes.values()
    inner = next(iter(costmap.values()))["ros__parameters"]
    (name,) = inner["filters"]
    assert inner[name]["plugin"] == plugin
    info, server = info["ros__parameters"], server["ros__parameters"]
    assert info["type"] == code
    assert info["mask_topic"] == server["topic_name"]
    assert info["filter_info_topic"] == inner[name]["filter_info_topic"]
    assert server["yaml_filename"] == mask.name
    assert manager["ros__parameters"]["node_names"] == list(nodes)[:2]
    # Cell by cell by its place in the world, against the map read there.
    grid, resolution, origin = map_io(mask)
    rows, columns = np.indices(grid.shape)
    x = origin[0] + (columns + 0.5) * resolution
    y = origin[1] + (rows + 0.5) * resolution
    judged = amap.sample("judged", x, y) == JUDGED
    level = np.where(judged, amap.sample("level", x, y), 0.0)
    zone = np.where(judged, amap.sample("zone", x, y), np.nan)
    limit = info["base"] + info["multiplier"] * grid
    if kind == "nav2-keepout":
        np.testing.assert_array_equal(grid == 100, zone == OPEN)
    elif kind == "nav2-binary":
        np.testing.assert_array_equal(limit > inner[name]["flip_threshold"], zone >= CORRIDOR)
    elif kind == "nav2-preference":
        np.testing.assert_allclose(grid, 90.0 * level, atol=0.501)
        # Of keepout_filter.cpp: 0 to 100 become 0 to 254, and 253 is inscribed.
        assert int(grid.max()) * 254 / 100 < 253
    else:
        np.testing.assert_allclose(limit, 100.0 - 70.0 * level, atol=0.501)


def test_speed_in_metres_a_second(write: Write, amap: an.AmbiguityMap) -> None:
    mask, _, params, _ = write("nav2-speed", "m.yaml", max_speed=0.5, slowest=0.0)
    info = yaml.safe_load(params.read_text())["speed_costmap_filter_info_server"]["ros__parameters"]
    assert info["type"] == 2
    grid, *_ = map_io(mask)
    limit = info["base"] + info["multiplier"] * grid
    assert limit.max() == 0.5
    # 0 would be no limit at all.
    assert 0.0 < limit.min() < 0.1


def test_a_threshold_of_a_layer(write: Write, amap: an.AmbiguityMap) -> None:
    mask = write("nav2-keepout", "m.yaml", layer="major_radius", threshold=0.4)[0]
    reached = (amap.dataset["major_radius"].values >= 0.4) & amap.judged.counted
    assert (map_io(mask)[0] == 100).sum() == reached.sum()


def test_headings(write: Write, headed_map: an.AmbiguityMap) -> None:
    """A laser that looks ahead: a mask by the mean, and one for a heading."""
    mean = map_io(write("nav2-preference", "mean.yaml", of=headed_map)[0])[0]
    north = map_io(write("nav2-preference", "north.yaml", of=headed_map, heading=90.0)[0])[0]
    level = headed_map.dataset["level_mean"].values
    np.testing.assert_allclose(mean, np.nan_to_num(90.0 * level), atol=0.501)
    assert (mean != north).any()
