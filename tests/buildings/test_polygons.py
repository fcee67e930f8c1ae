from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from ambinav.buildings.polygons import environment_from_shapes, load_polygons
from ambinav.casting.plane.fan import scan_plan
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER
from ambinav.runtime.errors import InputError, InputWarning


def box(x0: float, y0: float, x1: float, y1: float) -> dict[str, Any]:
    ring = [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]]
    return {"type": "Polygon", "coordinates": [ring]}


def line(*points: tuple[float, float]) -> dict[str, Any]:
    return {"type": "LineString", "coordinates": [list(p) for p in points]}


def feature(geometry: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def collection(*features: Any, **members: Any) -> dict[str, Any]:
    return {"type": "FeatureCollection", "features": list(features), **members}


def load(folder: Path, document: Any, name: str = "plan.geojson") -> Environment:
    path = folder / name
    path.write_text(document if isinstance(document, str) else json.dumps(document))
    return load_polygons(path)


def walls(env: Environment) -> float:
    return float(env.segments.lengths[env.segments.walls].sum())


def frontiers(env: Environment) -> float:
    return float(env.segments.lengths[env.segments.kind == FRONTIER].sum())


def test_room_with_obstacle_and_wall(tmp_path: Path) -> None:
    env = load(
        tmp_path,
        collection(
            feature(box(0, 0, 10, 5), kind="room"),
            feature(box(1, 1, 2, 2), kind="obstacle"),
            feature(line((5, -1), (5, 3)), kind="wall"),
        ),
    )
    assert env.free.area == pytest.approx(49.0)
    # Of the wall, 3 m lie inside.
    assert walls(env) == pytest.approx(30.0 + 4.0 + 3.0)
    assert frontiers(env) == 0.0
    assert env.name == "plan"
    assert len(env.checksum) == 64
    assert env.bounds == (0.0, 0.0, 10.0, 5.0)


@pytest.mark.parametrize(
    "document",
    [
        box(0, 0, 4, 3),
        feature(box(0, 0, 4, 3)),
        collection(feature(box(0, 0, 4, 3))),
        {"type": "GeometryCollection", "geometries": [box(0, 0, 4, 3)]},
        {"type": "MultiPolygon", "coordinates": [box(0, 0, 4, 3)["coordinates"]]},
    ],
)
def test_ways_to_write_one_room(tmp_path: Path, document: Any) -> None:
    env = load(tmp_path, document)
    assert env.free.area == pytest.approx(12.0)
    assert len(env.segments) == 4


def test_polygons_without_a_kind(tmp_path: Path) -> None:
    env = load(
        tmp_path,
        collection(*(feature(b) for b in (box(0, 0, 9, 9), box(20, 0, 21, 1), box(3, 3, 4, 4)))),
    )
    assert env.free.area == pytest.approx(81.0 + 1.0 - 1.0)


def test_holes_are_solid_and_overlapping_rooms_are_one(tmp_path: Path) -> None:
    room = box(0, 0, 10, 10)
    room["coordinates"].append([[4, 4], [6, 4], [6, 6], [4, 6], [4, 4]])
    env = load(tmp_path, collection(feature(room), feature(box(9, 4, 20, 6), kind="room")))
    assert env.free.area == pytest.approx(96.0 + 20.0)
    assert walls(env) == pytest.approx(40.0 - 2.0 + 8.0 + 22.0)


def test_thick_wall_parts_a_room(tmp_path: Path) -> None:
    wall = feature(line((5, 0), (5, 4)), kind="wall", thickness=0.2)
    env = load(tmp_path, collection(feature(box(0, 0, 10, 4)), wall))
    assert env.free.area == pytest.approx(40.0 - 0.8)
    assert len(shapely.get_parts(env.free)) == 2


def test_walls_on_the_boundary_are_not_doubled(tmp_path: Path) -> None:
    env = load(
        tmp_path,
        collection(
            feature(box(0, 0, 10, 4)),
            feature(line((0, 0), (10, 0), (10, 2)), kind="wall"),
            feature(line((2, 2), (6, 2)), kind="wall"),
            feature(line((4, 1), (4, 3)), kind="wall"),
        ),
    )
    assert walls(env) == pytest.approx(28.0 + 4.0 + 2.0)
    # The two that cross are parted there.
    assert len(env.segments) == 4 + 4


def test_without_a_room_the_box_is_free_and_its_edge_a_frontier(tmp_path: Path) -> None:
    parts = [
        feature(line((0, 0), (8, 0))),
        feature(line((0, 6), (8, 6))),
        feature(line((3, 2), (3, 3))),
    ]
    env = load(tmp_path, collection(*parts))
    assert env.free.area == pytest.approx(48.0)
    assert walls(env) == pytest.approx(17.0)
    assert frontiers(env) == pytest.approx(12.0)
    env = load(tmp_path, collection(*parts, bbox=[-1, -1, 9, 7]))
    assert env.free.area == pytest.approx(80.0)
    assert frontiers(env) == pytest.approx(36.0)


def test_opening_turns_a_stretch_into_a_frontier(tmp_path: Path) -> None:
    door = feature(line((4, 0), (5, 0)), kind="opening")
    env = load(tmp_path, collection(feature(box(0, 0, 10, 4)), door))
    assert frontiers(env) == pytest.approx(1.0, abs=1e-9)
    open_ = env.segments.xy[env.segments.kind == FRONTIER]
    np.testing.assert_allclose(np.sort(open_[0, 0::2]), [4.0, 5.0], atol=1e-9)
    assert walls(env) == pytest.approx(27.0)
    with pytest.raises(InputError, match="does not lie on the boundary"):
        load(
            tmp_path,
            collection(feature(box(0, 0, 10, 4)), feature(line((4, 1), (5, 1)), kind="opening")),
        )


def test_scans_see_an_opening_inside_a_longer_wall_and_the_wall_beside_it() -> None:
    room = np.array([[0, 0], [10, 0], [10, 4], [0, 4]])
    pillar = np.array([[7.0, 1.0], [8.0, 1.0], [8.0, 2.0], [7.0, 2.0]])
    env = environment_from_shapes([room], [pillar], openings=[[[4, 0], [5, 0]]])
    x = np.array([0.5, 2.0, 3.9, 4.1, 4.5, 4.9, 5.1, 9.5])
    down = np.array([-math.pi / 2])
    found = scan_plan(env, x, np.full_like(x, 0.5), np.zeros_like(x), np.zeros((1, 2)), down, 9.0)
    kind = env.segments.kind[found[1][:, 0]]
    assert np.allclose(found[0][:, 0], 0.5)
    assert (kind == FRONTIER).tolist() == [False, False, False, True, True, True, False, False]


def test_opening_around_a_corner_on_slanted_walls() -> None:
    turn = np.array([[np.cos(0.4), np.sin(0.4)], [-np.sin(0.4), np.cos(0.4)]])
    room = np.array([[0, 0], [10, 0], [10, 4], [0, 4]]) @ turn
    env = environment_from_shapes([room], openings=[np.array([[9, 0], [10, 0], [10, 1]]) @ turn])
    assert frontiers(env) == pytest.approx(2.0, abs=5e-3)
    assert walls(env) + frontiers(env) == pytest.approx(28.0)


@pytest.mark.parametrize(
    "text",
    [
        "POLYGON ((0 0, 4 0, 4 3, 0 3, 0 0))\nLINESTRING (1 1, 1 2)\n",
        "# a plan\n\nPOLYGON ((0 0, 4 0,\n 4 3, 0 3, 0 0))\n",
        "GEOMETRYCOLLECTION (POLYGON Z ((0 0 1, 4 0 1, 4 3 1, 0 3 1, 0 0 1)))",
    ],
)
def test_wkt(tmp_path: Path, text: str) -> None:
    assert load(tmp_path, text, "plan.wkt").free.area == pytest.approx(12.0)


def test_self_crossing_polygon_is_repaired_and_said_so(tmp_path: Path) -> None:
    tie = {"type": "Polygon", "coordinates": [[[0, 0], [4, 4], [4, 0], [0, 4], [0, 0]]]}
    with pytest.warns(InputWarning, match=r"feature 1 .*Self-intersection.* repaired"):
        env = load(tmp_path, collection(feature(tie)))
    assert env.free.area == pytest.approx(8.0)
    assert any("repaired" in note for note in env.notes)


def test_points_and_reference_systems_are_noted(tmp_path: Path) -> None:
    point = feature({"type": "Point", "coordinates": [1, 1]}, name="charger")
    with pytest.warns(InputWarning) as caught:
        env = load(tmp_path, collection(feature(box(0, 0, 4, 3)), point, crs={"type": "name"}))
    assert len(caught) == len(env.notes) == 2
    assert env.free.area == pytest.approx(12.0)


ROOM = json.dumps(box(0, 0, 4, 3))


@pytest.mark.parametrize(
    ("document", "words"),
    [
        ("", "not valid JSON in line 1"),
        ("{", "not valid JSON"),
        ("[1]", "not GeoJSON"),
        ("{}", "type is None"),
        ('{"type": "Topology"}', "Topology"),
        (collection(), "no polygon"),
        ({"type": "FeatureCollection"}, "features is None"),
        (collection(feature(None)), "feature 1 has no geometry"),
        (collection(7), "feature 1 is 7"),
        (feature({"type": "Point", "coordinates": [0, 0]}), "no polygon"),
        (ROOM.replace("4", "NaN"), "nan"),
        (ROOM.replace("4", "1e999"), "inf"),
        (ROOM.replace("4", "1e20"), "1e\\+20"),
        (ROOM.replace("4", '"4"'), "not a point"),
        (ROOM.replace("4", "true"), "not a point"),
        ({"type": "Polygon", "coordinates": []}, "empty"),
        ({"type": "Polygon", "coordinates": [[]]}, "empty"),
        ({"type": "Polygon", "coordinates": [[[0, 0], [1, 1]]]}, "make no Polygon"),
        ({"type": "Polygon", "coordinates": 3}, "coordinates hold 3"),
        ({"type": "Polygon"}, "coordinates hold None"),
        ({"type": "LineString", "coordinates": [[0, 0]]}, "make no LineString"),
        ({"type": "LineString", "coordinates": [[0, 0], [0, 0]]}, "no length"),
        ({"type": "Polygon", "coordinates": [[[0, 0], [1, 1], [2, 2], [0, 0]]]}, "no area"),
        (line((0, 0), (1, 0)), "no sound area"),
        (feature(box(0, 0, 4, 3), kind="rom"), "did you mean room"),
        (feature(box(0, 0, 4, 3), kind=["room"]), "did you mean"),
        (feature(box(0, 0, 4, 3), kind="wall"), "must be a LineString"),
        (feature(line((0, 0), (1, 0)), kind="room"), "must be a Polygon"),
        (feature(line((0, 0), (1, 0)), thickness=-1), "thickness is -1"),
        (feature(box(0, 0, 4, 3), kind="obstacle"), "no free space"),
        ({**line((0, 0), (1, 1)), "bbox": [0, 0, 1]}, "bbox is"),
        ({**line((0, 0), (1, 1)), "bbox": [1, 1, 0, 0]}, "no sound area"),
    ],
)
def test_bad_geojson(tmp_path: Path, document: Any, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught, warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        load(tmp_path, document)
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)


def test_properties_without_a_value_are_not_given(tmp_path: Path) -> None:
    """As programs of geographic information write a column that a feature has no value of."""
    empty = {"thickness": None, "kind": None, "level": None, "name": None}
    wall = feature(line((2, 0), (2, 1)), kind="wall", thickness=0.2)
    rooms = [feature(box(0, 0, 4, 3), **columns) for columns in ({}, empty)]
    with_columns = load(tmp_path, {"type": "FeatureCollection", "features": [rooms[1], wall]})
    without = load(tmp_path, {"type": "FeatureCollection", "features": [rooms[0], wall]})
    assert np.array_equal(with_columns.segments.xy, without.segments.xy)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "empty"),
        ("# nothing\n", "empty"),
        ("POLYGON ((0 0, 4 0", "line 1 is not WKT"),
        ("POLYGON ((0 0, 4 0, 4 3, 0 0))\nroom", "line 2 is not WKT"),
        ("POLYGON EMPTY", "empty"),
        ("GEOMETRYCOLLECTION EMPTY", "empty"),
        ("POINT (1 2)", "no polygon"),
        ("POLYGON ((0 0, nan 0, 4 3, 0 0))", "nan"),
        ("SRID=4326;POLYGON ((0 0, 4 0, 4 3, 0 0))", "not WKT"),
        ("CIRCULARSTRING (0 0, 1 1, 2 0)", "not WKT"),
    ],
)
def test_bad_wkt(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        load(tmp_path, text, "plan.wkt")


def test_bad_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        load_polygons(tmp_path / "none.geojson")
    with pytest.raises(InputError, match="directory"):
        load_polygons(tmp_path)
    path = tmp_path / "plan.geojson"
    path.write_bytes(b"\xff\xfe{}")
    with pytest.raises(InputError, match="UTF-8"):
        load_polygons(path)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({}, "no room"),
        ({"rooms": [[[0, 0], [1, 1]]]}, "room 1 has the shape"),
        ({"rooms": ["square"]}, "not an array"),
        ({"rooms": [[[0, 0], [1, 0], [1, np.nan]]]}, "nan"),
        ({"rooms": [shapely.LineString([(0, 0), (1, 1)])]}, "must be a Polygon"),
        ({"walls": [shapely.box(0, 0, 1, 1)]}, "must be a LineString"),
        ({"walls": [[[0, 0], [1, 1]]], "bbox": (0, 0, "a", 1)}, "bbox"),
    ],
)
def test_bad_shapes(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        environment_from_shapes(**arguments)


def test_one_shape_is_no_list() -> None:
    with pytest.raises(InputError, match="rooms is a Polygon; give a list of shapes"):
        environment_from_shapes(shapely.box(0.0, 0.0, 3.0, 3.0))  # type: ignore[arg-type]
