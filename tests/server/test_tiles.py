"""Pyramids against brute force, tiles against their values, and pyramids kept in a store."""

from __future__ import annotations

import io
import math
import shutil
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import ambinav as an
from ambinav.plotting import style
from ambinav.server.tiles import pyramid, pyramid_store
from ambinav.server.tiles.pyramid import NOT_COUNTED, TILE, Pyramid, build
from ambinav.server.tiles.pyramids import Pyramids
from ambinav.server.tiles.render import LayerStyle
from tests.server.live import Live

Values = NDArray[np.float32]
SHAPE = (130, 261)


@pytest.fixture
def coarse(monkeypatch: pytest.MonkeyPatch) -> int:
    """Tiles so small that small maps have a pyramid."""
    monkeypatch.setattr(pyramid, "TILE", 16)
    return 5


def with_holes(values: NDArray[Any], rng: np.random.Generator) -> Values:
    out = values.astype(np.float32)
    out[rng.random(out.shape) < 0.4] = np.nan
    out[:40, :40] = np.nan
    return out


def blocks(values: Values, k: int) -> list[tuple[int, int, Values]]:
    side = 2**k
    return [
        (r, c, values[r * side : (r + 1) * side, c * side : (c + 1) * side])
        for r in range(math.ceil(values.shape[0] / side))
        for c in range(math.ceil(values.shape[1] / side))
    ]


def known(block: Values) -> Values:
    return block[np.isfinite(block)]


def check(found: tuple[Values, ...], values: Values, wanted: Any, depth: int) -> None:
    assert len(found) == depth
    for k, level in enumerate(found, start=1):
        for r, c, block in blocks(values, k):
            part = known(block)
            if part.size:
                assert abs(level[r, c] - wanted(part)) <= 1e-5
            else:
                assert math.isnan(level[r, c])
        assert level.size == len(blocks(values, k))


@pytest.mark.slow
def test_mean_and_worst_are_those_of_all_cells_of_a_block(coarse: int) -> None:
    rng = np.random.default_rng(1)
    values = with_holes(rng.random(SHAPE), rng)
    made = build(values, "level", lowest_is_worst=False)
    check(made.mean, values, lambda part: part.mean(dtype=np.float64), coarse)
    check(made.worst, values, np.max, coarse)
    check(build(values, "localizability", True).worst, values, np.min, coarse)


@pytest.mark.slow
def test_a_block_is_of_the_zone_of_most_of_its_cells(coarse: int) -> None:
    rng = np.random.default_rng(2)
    values = with_holes(rng.integers(0, 4, SHAPE), rng)

    def commonest(part: Values) -> int:
        counts = np.bincount(part.astype(int), minlength=4)
        return int(np.flatnonzero(counts == counts.max()).max())

    made = build(values, "zone", lowest_is_worst=False)
    check(made.mean, values, commonest, coarse)
    check(made.worst, values, np.max, coarse)


def test_axes_are_averaged_as_axes(coarse: int) -> None:
    values = np.where(np.indices(SHAPE).sum(axis=0) % 2, 0.1, math.pi - 0.1).astype(np.float32)
    mean = build(values, "direction", lowest_is_worst=False).mean[0][:-1, :-1]
    assert np.abs(np.sin(mean)).max() < 1e-6  # between the two, not across them


def test_a_tile_shows_each_cell_in_its_colour(live: Live, corridor: an.AmbiguityMap) -> None:
    answer = live.http.get("/v1/maps/map/layers/zone/tiles/0/0/0.png")
    assert answer.headers["content-type"] == "image/png"
    with Image.open(io.BytesIO(answer.content)) as image:
        assert image.size == (TILE, TILE)
        pixels = np.asarray(image.convert("RGBA"))
    zone = corridor.dataset["zone"].values[::-1]
    counted = corridor.judged.counted[::-1]
    rows, columns = zone.shape
    assert (~counted & (zone < 4)).any()
    zone = np.where(~counted & (zone < 4), NOT_COUNTED, zone)
    for code, colour in enumerate((*style.ZONE_COLOURS, style.UNREACHABLE)):
        wanted = (*bytes.fromhex(colour[1:]), 255)
        np.testing.assert_array_equal((pixels[:rows, :columns] == wanted).all(axis=2), zone == code)
    assert not pixels[rows:, :, 3].any() and not pixels[:, columns:, 3].any()


def test_a_tile_that_is_known_is_not_sent_again(live: Live) -> None:
    path = "/v1/maps/map/layers/zone/tiles/0/0/0.png"
    tag = live.http.get(path).headers["etag"]
    answer = live.http.get(path, headers={"if-none-match": tag})
    assert (answer.status_code, answer.content) == (304, b"")
    for named in (f'"other", {tag}', f"W/{tag}", "*"):
        assert live.http.get(path, headers={"if-none-match": named}).status_code == 304
    assert live.http.get(path, headers={"if-none-match": '"another"'}).status_code == 200


def test_shares_are_drawn_from_0_to_1(live: Live, corridor: an.AmbiguityMap) -> None:
    import matplotlib

    scale = live.get("/v1/maps/map/layers/level")
    assert (scale["min"], scale["max"], scale["levels"], scale["tile"]) == (0.0, 1.0, 1, TILE)
    with Image.open(
        io.BytesIO(live.http.get("/v1/maps/map/layers/level/tiles/0/0/0.png").content)
    ) as image:
        pixels = np.asarray(image.convert("RGBA"))
    values = corridor.dataset["level"].values[::-1]
    there = np.isfinite(values)
    shown = pixels[: values.shape[0], : values.shape[1]]
    np.testing.assert_array_equal(shown[:, :, 3] == 255, there)
    wanted = 255 * matplotlib.colormaps["viridis_r"](values[there].astype(float))
    assert np.abs(shown[there].astype(float) - wanted).max() <= 4.0  # a shade of 255


def test_a_layer_is_drawn_at_a_heading(live: Live, turning: an.AmbiguityMap) -> None:
    path = "/v1/maps/narrow-room/layers/level/tiles/0/0/0.png"
    mean, west = (live.http.get(path, params=query).content for query in ({}, {"theta": math.pi}))
    assert mean != west
    named = live.http.get("/v1/maps/narrow-room/layers/level_mean/tiles/0/0/0.png")
    assert named.content == mean
    assert live.http.get(path, params={"theta": math.pi - math.tau}).content == west


@pytest.mark.parametrize(
    ("path", "status"),
    [
        ("level/tiles/1/0/0.png", 404),
        ("level/tiles/0/1/0.png", 404),
        ("level/tiles/0/-1/0.png", 404),
        ("levl/tiles/0/0/0.png", 404),
        ("..%2Flevel/tiles/0/0/0.png", 404),
        ("level/tiles/a/0/0.png", 422),
        ("level/tiles/0/0/0.png?stat=best", 422),
        ("level/tiles/0/0/99999999999999999999.png", 404),
    ],
)
def test_a_tile_that_is_none_is_a_problem(live: Live, path: str, status: int) -> None:
    answer = live.http.get(f"/v1/maps/map/layers/{path}")
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"


def test_walls_have_tiles_and_no_place_among_the_layers(live: Live) -> None:
    assert live.get("/v1/maps/narrow-room/layers/walls")["legend"][0]["label"] == "wall"
    answer = live.http.get("/v1/maps/narrow-room/layers/walls/tiles/0/0/0.png")
    with Image.open(io.BytesIO(answer.content)) as image:
        assert 0 < (np.asarray(image.convert("RGBA"))[:, :, 3] > 0).sum() < 1000


def test_values_beyond_a_scale_take_its_last_colour() -> None:
    from matplotlib.colors import LogNorm

    palette = np.arange(30, dtype=np.uint8).reshape(10, 3)
    drawn = LayerStyle(LogNorm(1.0, 10.0), palette)
    values = np.array([[np.nan, -1.0, 0.0, 1.0, 10.0, 1e9]], dtype=np.float32)
    assert drawn.indices(values).tolist() == [[0, 1, 1, 1, 10, 10]]


@pytest.fixture
def stored(plan_map: Path, tmp_path: Path) -> Path:
    shutil.copytree(plan_map, tmp_path / "map.zarr")
    return tmp_path / "map.zarr"


def pyramids(path: Path) -> Pyramids:
    return Pyramids(an.AmbiguityMap.open(path), path, pyramid_store.key_of(path))


def same(first: Pyramid, second: Pyramid) -> bool:
    pairs = zip((*first.mean, *first.worst), (*second.mean, *second.worst), strict=True)
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


@pytest.mark.slow
def test_a_kept_pyramid_is_read_again_and_the_map_stays_what_it_is(
    stored: Path, coarse: int
) -> None:
    before = an.AmbiguityMap.open(stored)
    made = pyramids(stored)
    assert made.keep(threading.Event())
    assert sorted(path.name for path in stored.parent.iterdir()) == ["map.zarr"]
    assert an.AmbiguityMap.open(stored).dataset.identical(before.dataset)
    key = pyramid_store.key_of(stored)
    assert key is not None
    for layer in ("level", "zone", pyramid.WALLS):
        mine = made.get(layer)
        read = pyramid_store.load(stored, key, layer, mine.base)
        assert read is not None and len(read.mean) == made.depth > 0 and same(mine, read)


@pytest.mark.slow
def test_a_pyramid_of_another_map_is_not_taken(stored: Path, coarse: int) -> None:
    made = pyramids(stored)
    assert made.keep(threading.Event())
    base = made.get("level").base
    assert pyramid_store.load(stored, "another", "level", base) is None
    # A map that takes the place of this one meanwhile gets no pyramid of this one.
    shutil.rmtree(stored / "pyramid")
    amap = an.AmbiguityMap.open(stored)
    amap.dataset.attrs["title"] = "another"
    amap.save(stored)
    assert not made.keep(threading.Event())
    assert not (stored / "pyramid").exists()
    # An older one makes way.
    assert pyramids(stored).keep(threading.Event())
    assert same(pyramids(stored).get("level"), made.get("level"))


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["chunk", "metadata", "shape"])
def test_a_damaged_pyramid_is_made_again(stored: Path, coarse: int, damage: str) -> None:
    made = pyramids(stored)
    assert made.keep(threading.Event())
    folder = stored / "pyramid" / "level" / "mean" / "1"
    if damage == "chunk":
        for path in folder.rglob("c/**/0"):
            if path.is_file():
                path.write_bytes(b"no zstd")
    elif damage == "metadata":
        (folder / "zarr.json").write_text("{")
    else:
        shutil.rmtree(folder)
        shutil.copytree(folder.parent / "2", folder)
    assert same(pyramids(stored).get("level"), made.get("level"))


def test_nothing_is_kept_where_nothing_can_be_written(
    stored: Path, coarse: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object, **__: object) -> str:
        raise PermissionError(13, "Read-only file system")

    monkeypatch.setattr(pyramid_store.tempfile, "mkdtemp", refused)
    made = pyramids(stored)
    assert not made.keep(threading.Event())
    assert len(made.get("level").mean) == made.depth


def test_keeping_stops_when_it_is_told_to(stored: Path, coarse: int) -> None:
    stop = threading.Event()
    stop.set()
    assert not pyramids(stored).keep(stop)
    assert sorted(path.name for path in stored.parent.iterdir()) == ["map.zarr"]


@pytest.mark.slow
def test_of_two_that_would_keep_a_pyramid_one_does(stored: Path, coarse: int) -> None:
    key = pyramid_store.key_of(stored)
    assert key is not None
    first, second = pyramids(stored), pyramids(stored)
    stop = threading.Event()

    def meanwhile() -> Any:
        assert not second.keep(stop)
        yield from first._all(stop)

    left = stored.parent / ".map.zarr.pyramid.killed"
    left.mkdir()
    assert pyramid_store.keep(stored, key, first.depth, meanwhile())
    assert pyramid_store.is_kept(stored, key)
    assert same(pyramids(stored).get("level"), first.get("level"))
    assert sorted(path.name for path in stored.parent.iterdir()) == ["map.zarr"]


def test_pyramids_may_be_read_while_another_is_made(corridor: an.AmbiguityMap) -> None:
    pyramids = Pyramids(corridor)
    for layer in ("level", "major"):
        pyramids.get(layer)

    class Read(Pyramid):
        @property
        def bytes(self) -> int:
            pyramids.get("level")  # as another thread may do in the middle of the sum
            return 0

    for key, one in list(pyramids._cache.items()):
        pyramids._cache[key] = Read(one.base, one.mean, one.worst)
    pyramids.get("minor")
    assert pyramids.has("minor", None)
