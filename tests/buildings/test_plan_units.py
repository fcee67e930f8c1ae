"""Plans in degrees are refused, and what is no building in metres is asked about."""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError, InputWarning

# Metres along a degree of latitude; of longitude times the cosine of the latitude.
DEGREE = 111_320.0


def plan(*features: tuple[Any, dict[str, Any]], **members: Any) -> dict[str, Any]:
    made = [
        {"type": "Feature", "geometry": shapely.geometry.mapping(shape), "properties": properties}
        for shape, properties in features
    ]
    return {"type": "FeatureCollection", "features": made, **members}


def load(folder: Path, document: Any, **options: Any) -> Environment:
    path = folder / "plan.geojson"
    path.write_text(json.dumps(document))
    return load_environment(path, **options)


OFFICE = [
    (shapely.box(0, 0, 20, 12), {"kind": "room"}),
    (shapely.box(5, 5, 6, 7), {"kind": "obstacle"}),
    (shapely.LineString([(10, 0), (10, 5)]), {"kind": "wall", "thickness": 0.2}),
    (shapely.LineString([(0, 3), (0, 4)]), {"kind": "opening"}),
]


def placed(change: Any, thickness: float = 1.0) -> list[tuple[Any, dict[str, Any]]]:
    """The office with its points changed."""
    return [
        (
            shapely.transform(shape, change),
            {k: v * thickness if k == "thickness" else v for k, v in properties.items()},
        )
        for shape, properties in OFFICE
    ]


def in_degrees(lat: float, lon: float) -> Any:
    along = np.array([1 / (DEGREE * math.cos(math.radians(lat))), 1 / DEGREE])
    return lambda points: np.array([lon, lat]) + points * along


@given(
    lat=st.floats(-80, 80), lon=st.floats(-180, 179.9), size=st.sampled_from([0.2, 1.0, 40.0]),
    swapped=st.booleans(),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_degrees_are_refused_wherever_the_building_stands(
    tmp_path_factory: pytest.TempPathFactory, lat: float, lon: float, size: float, swapped: bool
) -> None:
    turn = in_degrees(lat, lon)

    def change(points: np.ndarray) -> np.ndarray:
        place = turn(points * size)
        return place[:, ::-1] if swapped else place

    folder = tmp_path_factory.mktemp("degrees")
    with pytest.raises(InputError, match=r"look like longitude and latitude in degrees; give"):
        load(folder, plan(*placed(change)))


@pytest.mark.slow
@given(
    width=st.floats(0.6, 900), height=st.floats(0.6, 900), x=st.floats(-170, 170),
    y=st.floats(-80, 80),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_no_room_is_taken_for_degrees(
    tmp_path_factory: pytest.TempPathFactory, width: float, height: float, x: float, y: float
) -> None:
    room = shapely.box(x, y, x + width, y + height)
    env = load(tmp_path_factory.mktemp("room"), plan((room, {})))
    assert env.free.area == pytest.approx(room.area, rel=1e-6)


@pytest.mark.parametrize(
    "crs",
    [
        {"type": "name", "properties": {"name": "EPSG:4326"}},
        {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::4326"}},
        {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}},
        {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC::CRS84"}},
        {"type": "name", "properties": {"name": "http://www.opengis.net/def/crs/EPSG/0/4258"}},
        {"type": "EPSG", "properties": {"code": 4326}},
        "EPSG:4326",
        "WGS 84",
    ],
)
def test_reference_systems_in_degrees_are_refused(tmp_path: Path, crs: Any) -> None:
    # By the name alone, whatever the numbers are, and whatever unit is said.
    for unit in (None, "m"):
        with pytest.raises(InputError, match="is longitude and latitude in degrees; project"):
            load(tmp_path, plan(*OFFICE, crs=crs), unit=unit)


@pytest.mark.parametrize(
    ("name", "words"),
    [("urn:ogc:def:crs:EPSG::25832", "count as metres"), ("EPSG:3857", "web Mercator stretches")],
)
def test_projected_reference_systems_are_noted(tmp_path: Path, name: str, words: str) -> None:
    far = placed(lambda p: p + np.array([691_000.0, 5_335_000.0]))
    crs = {"type": "name", "properties": {"name": name}}
    with pytest.warns(InputWarning, match=words):
        env = load(tmp_path, plan(*far, crs=crs))
    assert env.free.area == pytest.approx(20 * 12 - 2 - 1)
    assert any(name in note for note in env.notes)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(tmp_path, plan(*OFFICE, crs=None))


@pytest.mark.parametrize(("unit", "metres"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001)])
def test_a_plan_is_the_same_in_any_unit(tmp_path: Path, unit: str, metres: float) -> None:
    scaled = load(tmp_path, plan(*placed(lambda p: p / metres, 1 / metres)), unit=unit)
    plain = load(tmp_path, plan(*OFFICE))
    assert scaled.free.symmetric_difference(plain.free).area < 1e-9
    assert np.allclose(np.sort(scaled.segments.lengths), np.sort(plain.segments.lengths))
    assert (scaled.checksum == plain.checksum) == (unit == "m")
    text = shapely.box(0, 0, 4 / metres, 3 / metres).wkt
    (tmp_path / "plan.wkt").write_text(text)
    assert load_environment(tmp_path / "plan.wkt", unit=unit).free.area == pytest.approx(12)


@pytest.mark.parametrize(
    ("metres", "words"),
    [
        (0.001, r"20000 by 12000 m in all, more than a building has; say with --unit what its"),
        (0.01, r"2000 by 1200 m in all, more than a building"),
    ],
)
def test_large_numbers_are_asked_about(tmp_path: Path, metres: float, words: str) -> None:
    with pytest.raises(InputError, match=words):
        load(tmp_path, plan(*placed(lambda p: p / metres, 1 / metres)))
    (tmp_path / "plan.wkt").write_text(shapely.box(0, 0, 4000, 3000).wkt)
    with pytest.raises(InputError, match="--unit"):
        load_environment(tmp_path / "plan.wkt")


def test_a_small_flat_in_centimetres_is_asked_about(tmp_path: Path) -> None:
    room = (shapely.box(0, 0, 800, 600), {"kind": "room"})
    wall = (shapely.LineString([(400, 0), (400, 300)]), {"kind": "wall", "thickness": 12})
    door = (shapely.LineString([(0, 100), (0, 180)]), {"kind": "opening"})
    with pytest.raises(InputError, match="thickness 12 m, more than any has; say with --unit"):
        load(tmp_path, plan(room, wall))
    with pytest.raises(InputError, match="narrowest opening is 80 m wide"):
        load(tmp_path, plan(room, door))
    assert load(tmp_path, plan(room, wall, door), unit="cm").free.area == pytest.approx(
        48 - 0.12 * 3
    )


def test_what_is_said_is_believed(tmp_path: Path) -> None:
    campus = shapely.box(0, 0, 2000, 1500)
    assert load(tmp_path, plan((campus, {})), unit="m").free.area == pytest.approx(3e6)
    maze = shapely.box(0, 0, 0.3, 0.2)
    with pytest.raises(InputError, match="say with --unit that they are"):
        load(tmp_path, plan((maze, {})))
    assert load(tmp_path, plan((maze, {})), unit="m").free.area == pytest.approx(0.06)
    with pytest.raises(InputError, match="unit is 'inch'; it must be m, cm, mm"):
        load(tmp_path, plan(*OFFICE), unit="inch")


def test_a_box_without_a_room_counts(tmp_path: Path) -> None:
    wall = (shapely.LineString([(0, 0), (30, 0)]), {"kind": "wall"})
    with pytest.raises(InputError, match="4000 by 3000 m"):
        load(tmp_path, plan(wall, bbox=[0, 0, 4000, 3000]))
    env = load(tmp_path, plan(wall, bbox=[0, 0, 4000, 3000]), unit="mm")
    assert env.free.area == pytest.approx(12.0)


def test_units_and_levels_are_not_for_occupancy_maps(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text("image: map.pgm")
    for option in ({"unit": "m"}, {"level": "EG"}):
        with pytest.raises(InputError, match=r"means nothing for an occupancy map \(\.yaml\)"):
            load_environment(tmp_path / "map.yaml", **option)


def test_the_shipped_plan_is_not_asked_about() -> None:
    demo = Path(__file__).parents[2] / "configs" / "demo.geojson"
    assert load_environment(demo).free.area > 100
