"""Reflectors: walls like any other for rays and robots, told apart by their kind alone."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.export.occupancy import occupancy, raster_of
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER, REFLECTOR, WALL, Segments
from ambinav.plotting.maps import plot_zones

ROOM = shapely.box(0, 0, 10, 4)
TAG = [(4.0, 0.0), (4.5, 0.0)]
PANEL = [(7.0, 1.0), (7.0, 2.0)]
POST = shapely.Point(2, 2).buffer(0.1)


def reflecting() -> Environment:
    """A room with a tag on its wall, a panel within it and a post."""
    return an.environment_from_shapes([ROOM], reflectors=[TAG, PANEL, POST])


def plain(environment: Environment) -> Environment:
    """The same segments, none of which reflects."""
    segments = environment.segments
    kind = np.where(segments.kind == REFLECTOR, WALL, segments.kind).astype(np.uint8)
    return Environment(Segments(segments.xy, kind), environment.free)


def test_a_tag_a_panel_and_a_post() -> None:
    """Each is as long as it is drawn, and walls without them are as long as the rest."""
    env = reflecting()
    assert env.segments.walls.all()
    lengths = env.segments.lengths
    bright = lengths[env.segments.reflectors]
    assert math.isclose(bright.sum(), 0.5 + 1.0 + POST.length, abs_tol=1e-9)
    assert math.isclose(lengths.sum(), 28.0 + 1.0 + POST.length, abs_tol=1e-9)
    # What rays meet: the tag, the wall beside it, the panel from both sides, the post.
    _, segment = env.cast_hits(
        [4.25, 4.6, 6.0, 8.0, 1.0], [1, 1, 1.5, 1.5, 2],
        [-math.pi / 2, -math.pi / 2, 0, math.pi, 0], 9.0,
    )  # fmt: skip
    assert env.segments.kind[segment].tolist() == [REFLECTOR, WALL, REFLECTOR, REFLECTOR, REFLECTOR]


def test_a_reflector_is_a_wall() -> None:
    """Rays, clearances, what is free, collision: the same bits as with plain walls."""
    env, other = reflecting(), plain(reflecting())
    rng = np.random.default_rng(5)
    x, y, angle = rng.uniform(0, 10, 500), rng.uniform(0, 4, 500), rng.uniform(-4, 4, 500)
    assert np.array_equal(env.cast(x, y, angle, 20.0), other.cast(x, y, angle, 20.0))
    assert np.array_equal(env.clearance(x, y), other.clearance(x, y))
    assert np.array_equal(env.is_free(x, y, 0.2), other.is_free(x, y, 0.2))
    assert np.array_equal(env.collision.is_free(x, y), other.collision.is_free(x, y))
    # And a tag flat on the wall moves no range beyond rounding.
    tagged = an.environment_from_shapes([ROOM], reflectors=[TAG])
    bare = an.environment_from_shapes([ROOM])
    assert np.allclose(tagged.cast(x, y, angle, 20.0), bare.cast(x, y, angle, 20.0), atol=1e-9)


@pytest.mark.slow
def test_a_map_keeps_reflectors(tmp_path: Path) -> None:
    """A map is the same to the bit, stores their kind, and gives them back."""
    env = reflecting()
    scanner = an.RangeScanner.planar(
        sensor=an.RangeSensor(max_range=5.0, std=0.03, resolution=0.01),
        beams=24,
        aperture=2 * math.pi,
    )
    maps = [an.build_map(e, scanner, spacing=0.25) for e in (env, plain(env))]
    for name in ("level", "major", "minor", "direction"):
        assert np.array_equal(*(m.dataset[name].values for m in maps), equal_nan=True)
    maps[0].save(tmp_path / "room.zarr")
    back = an.AmbiguityMap.open(tmp_path / "room.zarr").environment
    # What other programs read knows it as a wall, as does the picture of a map.
    cells = [occupancy(m.environment, raster_of(m.environment, 0.1, 0.25)) for m in maps]
    assert np.array_equal(*cells)
    labels = [[text.get_text() for text in plot_zones(m).get_legend().get_texts()] for m in maps]
    assert "reflector" in labels[0]
    assert "reflector" not in labels[1]
    assert np.array_equal(back.segments.kind, env.segments.kind)
    assert np.array_equal(back.segments.xy, env.segments.xy)


def feature(shape: dict[str, Any], **properties: object) -> dict[str, Any]:
    """A feature of GeoJSON."""
    return {"type": "Feature", "properties": properties, "geometry": shape}


def load(folder: Path, *features: dict[str, Any]) -> Environment:
    """The environment of a GeoJSON file with a room and features."""
    room = feature(shapely.geometry.mapping(ROOM), kind="room")
    path = folder / "plan.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [room, *features]}))
    return an.load_environment(path)


def test_geojson(tmp_path: Path) -> None:
    """The kind reflector, of lines with and without thickness and of polygons."""
    line = {"type": "LineString", "coordinates": [[3, 2], [5, 2]]}
    assert load(tmp_path, feature(line, kind="reflector")).segments.reflectors.sum() == 1
    thick = load(tmp_path, feature(line, kind="reflector", thickness=0.1)).segments
    assert math.isclose(thick.lengths[thick.reflectors].sum(), 4.2, abs_tol=1e-9)
    post = load(tmp_path, feature(shapely.geometry.mapping(POST), kind="reflector"))
    assert math.isclose(post.free.area, 40.0 - POST.area, abs_tol=1e-9)
    assert math.isclose(
        post.segments.lengths[post.segments.reflectors].sum(), POST.length, abs_tol=1e-9
    )
    with pytest.raises(an.InputError, match=r"did you mean reflector"):
        load(tmp_path, feature(line, kind="reflective"))


def test_reflectors_that_no_ray_meets_are_refused() -> None:
    """A tag within the wall, or behind it, would do nothing: a sentence says so."""
    for shape in ([(4.0, -0.05), (4.5, -0.05)], shapely.box(11, 0, 12, 1)):
        with pytest.raises(an.InputError, match=r"reflector at .* borders no free space"):
            an.environment_from_shapes([ROOM], reflectors=[shape])
    with pytest.raises(an.InputError, match=r"reflector 1 has no length"):
        an.environment_from_shapes([ROOM], reflectors=[[(1, 1), (1, 1)]])


def test_a_reflector_on_a_frontier_closes_it() -> None:
    """As a wall on it does."""
    env = an.environment_from_shapes([ROOM], openings=[[(0, 0), (10, 0)]], reflectors=[TAG])
    kinds = env.segments.kind[np.isclose(env.segments.xy[:, [1, 3]], 0.0).all(axis=1)]
    assert sorted(kinds.tolist()) == [FRONTIER, FRONTIER, REFLECTOR]


def test_corners_turned_and_cut_reflectors() -> None:
    """A tag round a corner in a turned room, and one that an obstacle halves."""
    env = an.environment_from_shapes(
        [ROOM], [shapely.box(4.25, 0, 5, 1)], reflectors=[TAG, [(0, 1), (0, 0), (1, 0)]]
    )
    lengths = env.segments.lengths[env.segments.reflectors]
    assert math.isclose(lengths.sum(), 0.25 + 2.0, abs_tol=1e-9)
    turned = env.transformed(0.7, 3.0, -2.0)
    assert np.array_equal(turned.segments.kind, env.segments.kind)
