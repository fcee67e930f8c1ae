"""Whatever a file holds, the answer is an environment or an InputError, nothing else."""

from __future__ import annotations

import json
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st
from PIL import Image

from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.map_server import load_map_server
from ambinav.buildings.polygons import load_polygons
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError, InputWarning

SETTINGS = settings(max_examples=40, deadline=None)

scalar = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
junk = st.recursive(
    scalar,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=8,
)
HEADER = {
    "image": "map.pgm",
    "resolution": 0.5,
    "origin": [0, 0, 0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.25,
    "mode": "trinary",
}


def settled(name: str, content: bytes, image: bytes = b"") -> Environment | None:
    """The environment in a file of this name and content, with floor; None if it is refused."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        path = Path(folder) / name
        path.write_bytes(content)
        (Path(folder) / "map.pgm").write_bytes(image)
        try:
            if path.suffix == ".yaml":
                env = environment_from_grid(load_map_server(path))
            else:
                env = load_polygons(path)
        except InputError as error:
            assert str(error)
            assert "\n" not in str(error)
            return None
    assert env.free.is_valid
    assert env.free.area > 0.0
    return env


def pgm(pixels: np.ndarray) -> bytes:
    return b"P5 %d %d 255\n" % pixels.shape[::-1] + pixels.tobytes()


ROOM = pgm(np.pad(np.full((6, 6), 254, np.uint8), 1))


@pytest.mark.slow
@SETTINGS
@given(st.dictionaries(st.sampled_from(sorted(HEADER)), junk, max_size=3))
@example({"origin": [1e308, 1e308, 1e308]})
@example({"resolution": 1e-320})
@example({"resolution": 1e308})
@example({"mode": "raw"})
def test_yaml_values(changes: dict[str, Any]) -> None:
    settled("map.yaml", yaml.safe_dump({**HEADER, **changes}).encode(), ROOM)


@pytest.mark.sweep
@SETTINGS
@given(st.binary(max_size=60) | st.text(max_size=60).map(str.encode))
@example(b"&a [*a]")
@example(b"? {}\n: 1")
@example(b"!!timestamp x")
@example(b"[" * 5000)
@example(b"resolution: 1\nresolution: 2")
def test_yaml_junk(content: bytes) -> None:
    assert settled("map.yaml", content) is None


@pytest.mark.slow
@SETTINGS
@given(st.sampled_from([b"", b"P2", b"P5", b"P5 4 4 255\n", b"P6 1 1 255\n", b"BM"]), st.binary())
def test_image_junk(start: bytes, rest: bytes) -> None:
    settled("map.yaml", yaml.safe_dump(HEADER).encode(), start + rest)


@pytest.mark.slow
@SETTINGS
@given(st.data())
def test_damaged_png(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as folder:
        Image.fromarray(np.pad(np.full((6, 6), 254, np.uint8), 1)).save(Path(folder) / "a.png")
        content = bytearray((Path(folder) / "a.png").read_bytes())
    where = data.draw(st.integers(0, len(content) - 1))
    content[where] = data.draw(st.integers(0, 255))
    settled(
        "map.yaml", yaml.safe_dump(HEADER).encode(), bytes(content[: data.draw(st.integers(0, 99))])
    )
    settled("map.yaml", yaml.safe_dump(HEADER).encode(), bytes(content))


number = st.integers(-3, 3) | st.floats(-5, 5, width=16) | st.floats()
points = st.lists(st.lists(number, min_size=2, max_size=3), max_size=6)
ring = points.map(lambda p: [*p, p[0]] if p else p)
geometry = st.recursive(
    st.builds(lambda p: {"type": "LineString", "coordinates": p}, points)
    | st.builds(lambda r: {"type": "Polygon", "coordinates": r}, st.lists(ring, max_size=2))
    | st.builds(lambda r: {"type": "MultiPolygon", "coordinates": [r]}, st.lists(ring, max_size=2))
    | st.builds(
        lambda t, c: {"type": t, "coordinates": c}, st.sampled_from(["Point", "Arc"]), junk
    ),
    lambda inner: st.builds(
        lambda g: {"type": "GeometryCollection", "geometries": g}, st.lists(inner, max_size=3)
    ),
    max_leaves=4,
)
kind = st.sampled_from(["room", "obstacle", "wall", "opening", None]) | junk
feature = st.builds(
    lambda g, k, t: {"type": "Feature", "geometry": g, "properties": {"kind": k, "thickness": t}},
    geometry,
    kind,
    st.sampled_from([0.0, 0.1]) | junk,
)


@pytest.mark.slow
@SETTINGS
@given(st.lists(feature | junk, max_size=4), st.none() | junk | st.just([0, 0, 4, 4]))
def test_geojson_features(features: list[Any], bbox: Any) -> None:
    document = {"type": "FeatureCollection", "features": features, "bbox": bbox}
    settled("plan.geojson", json.dumps(document).encode())


@pytest.mark.slow
@SETTINGS
@given(
    st.lists(st.tuples(geometry, st.sampled_from(["room", "obstacle", "wall", None])), max_size=5)
)
def test_geojson_shapes(shapes: list[tuple[Any, str | None]]) -> None:
    features = [
        {"type": "Feature", "geometry": g, "properties": {"kind": k} if k else None}
        for g, k in shapes
    ]
    settled(
        "plan.geojson", json.dumps({"type": "FeatureCollection", "features": features}).encode()
    )


@pytest.mark.slow
@SETTINGS
@given(junk | geometry)
@example({"type": "Feature", "geometry": {"type": "Feature"}})
@example({"type": [], "coordinates": []})
def test_geojson_junk(document: Any) -> None:
    settled("plan.geojson", json.dumps(document).encode())


@SETTINGS
@given(st.binary(max_size=60))
@example(b"[" * 100_000)
@example(b'{"type":' * 5000)
@example(
    b'{"type": "Polygon", "coordinates": [[[0, 0], [1' + b"0" * 400 + b", 0], [1, 1], [0, 0]]]}"
)
def test_geojson_bytes(content: bytes) -> None:
    assert settled("plan.geojson", content) is None


@pytest.mark.slow
@SETTINGS
@given(
    st.sampled_from(["", "POLYGON ", "LINESTRING Z ", "MULTIPOLYGON ", "GEOMETRYCOLLECTION "]),
    st.text("(),0123 .e-\nnaifEMPTY\0", max_size=50) | st.text(max_size=20),
)
def test_wkt(start: str, rest: str) -> None:
    settled("plan.wkt", (start + rest).encode("utf-8", "surrogatepass"))
