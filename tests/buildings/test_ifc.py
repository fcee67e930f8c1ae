"""Storeys of IFC buildings, against houses whose rooms are known."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import ifcopenshell
import numpy as np
import pytest
import shapely

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import GLASS, REFLECTOR, WALL
from ambinav.runtime.errors import InputError
from tests.buildings import plan_models
from tests.buildings.plan_models import (
    EAST,
    HOLE,
    INNER_DOOR,
    OUTER_DOOR,
    PANE,
    REVEAL,
    TABLE,
    WEST,
    House,
)

FREE = shapely.union_all([WEST, EAST, INNER_DOOR, OUTER_DOOR]) - TABLE
INSIDE = shapely.box(6.0, 3.2, 8.0, 3.28)
"""What of the window's opening is inside of its pane."""


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return plan_models.two_storeys(tmp_path_factory.mktemp("plans") / "house.ifc")


def differ(a: shapely.Geometry, b: shapely.Geometry) -> float:
    return float(shapely.symmetric_difference(a, b).area)


def frontier(env: Environment) -> float:
    return float(env.segments.lengths[~env.segments.walls].sum())


def test_rooms_doors_and_a_table_are_where_they_are(house: Path) -> None:
    env = load_environment(house, level="Ground")
    assert differ(env.free, shapely.union(FREE, INSIDE)) < 1e-4
    assert frontier(env) == pytest.approx(0.9, abs=1e-4)  # the door to the outside
    corners = {tuple(p) for p in np.round(env.segments.xy.reshape(-1, 2), 5).tolist()}
    assert {(0.2, 0.2), (4.2, 1.0), (4.4, 2.0), (7.0, 1.6), (1.0, 0.0), (6.0, 3.28)} <= corners
    assert env.name == "house Ground"
    # No corner where nothing bends.
    assert len(env.segments) == 24


@pytest.mark.slow
def test_a_storey_by_name_and_by_position_from_the_lowest(house: Path) -> None:
    names = [load_environment(house, level=level).name for level in (0, "1", "upper", "Ground")]
    assert names == ["house Ground", "house Upper", "house Upper", "house Ground"]
    checksums = {load_environment(house, level=level).checksum for level in (0, 1, "Ground")}
    assert len(checksums) == 2


def test_several_storeys_and_none_chosen_are_named_with_their_elevations(house: Path) -> None:
    with pytest.raises(InputError, match=r"0: Ground at 0 m, 1: Upper at 3 m.*--level NAME\.$"):
        load_environment(house)
    with pytest.raises(InputError, match=r"no level 'Uper'; did you mean Upper, of 0: Ground at"):
        load_environment(house, level="Uper")


def test_closed_doors_part_the_rooms(house: Path) -> None:
    env = load_environment(house, level=0, doors="closed")
    assert len(shapely.get_parts(env.free)) == 2
    assert frontier(env) == 0.0
    # A leaf stands in the middle of its wall: 8 cm of the opening are floor on each side.
    assert env.free.area == pytest.approx(WEST.area + EAST.area - TABLE.area + 0.16 + 0.16 + 0.072)


def test_furniture_can_be_left_out(house: Path) -> None:
    bare = load_environment(house, level=0, furniture=False)
    assert shapely.intersection(bare.free, TABLE).area == pytest.approx(TABLE.area)


@pytest.mark.slow
def test_glass_stops_rays_or_only_robots(house: Path) -> None:
    solid = load_environment(house, level=0)
    assert (solid.segments.kind == GLASS).sum() == 1
    assert solid.segments.lengths[solid.segments.glass].sum() == pytest.approx(2.0, abs=1e-4)
    assert not (solid.segments.kind == REFLECTOR).any()
    assert solid.cast(7.0, 3.0, math.pi / 2, 9.0) == pytest.approx(0.28, abs=1e-5)
    clear = load_environment(house, level=0, glass="clear")
    assert differ(clear.free, shapely.union(FREE, REVEAL)) < 1e-4
    assert not clear.segments.glass.any()
    assert clear.cast(7.0, 3.0, math.pi / 2, 9.0) == pytest.approx(0.4, abs=1e-5)
    assert frontier(clear) == pytest.approx(2.9, abs=1e-4)
    assert clear.drivable is not None
    assert shapely.intersection(clear.drivable, PANE).area < 1e-9


def test_rays_cross_a_hole_in_the_floor_and_robots_do_not(house: Path) -> None:
    env = load_environment(house, level=0)
    x, y = HOLE.centroid.x, HOLE.centroid.y
    assert env.is_free(x, y)
    assert not env.is_free(x, y, radius=0.2)
    assert env.drivable is not None
    assert differ(env.drivable, env.free - HOLE) < 1e-3


@pytest.mark.slow
def test_a_height_above_the_table_and_one_in_the_lintel(house: Path) -> None:
    assert load_environment(house, level=0, height=1.0).is_free(7.5, 1.3)
    high = load_environment(house, level=0, height=2.1)  # above the doors, which are 2 m high
    assert len(shapely.get_parts(high.free)) == 2
    with pytest.raises(InputError, match=r"no wall stands 2\.7 m above the floor of 'Upper'"):
        load_environment(house, level=1, height=2.7)


@pytest.mark.slow
@pytest.mark.parametrize("units", [plan_models.MILLIMETRES, plan_models.INCHES])
def test_the_unit_of_the_file_changes_nothing(
    units: dict[str, Any], house: Path, tmp_path: Path
) -> None:
    other = load_environment(
        plan_models.two_storeys(tmp_path / "house.ifc", units=units), level="Upper"
    )
    same = load_environment(house, level="Upper")
    assert differ(other.free, same.free) < 1e-3
    assert len(other.segments) == len(same.segments)


@pytest.mark.slow
def test_a_house_that_is_turned_and_moved(house: Path, tmp_path: Path) -> None:
    path = tmp_path / "house.ifc"
    plan_models.two_storeys(path, angle=0.4, shift=(120.0, -35.0))
    turned = load_environment(path, level=0)
    same = load_environment(house, level=0).transformed(0.4, 120.0, -35.0)
    assert differ(turned.free, same.free) < 1e-3
    assert np.bincount(turned.segments.kind).tolist() == np.bincount(same.segments.kind).tolist()


@pytest.mark.slow
def test_a_building_without_storeys_is_one_level(tmp_path: Path) -> None:
    house = House()
    house.floor(None, 1.5, spaces=False)
    path = house.write(tmp_path / "flat.ifc")
    env = load_environment(path)
    assert env.name == "flat"
    assert "storey building at 1.5 m" in env.notes[0]
    # Without spaces the slab is the floor, beneath the walls too.
    assert differ(env.free, shapely.union_all([FREE, INSIDE])) < 1e-3
    assert load_environment(path, level=0).free.equals(env.free)
    with pytest.raises(InputError, match=r"no level 'EG'"):
        load_environment(path, level="EG")


def test_a_door_of_glass_is_open_too(tmp_path: Path) -> None:
    house = House()
    storey = house.storey("EG", 0.0)
    outer = shapely.box(0, 0, 8, 4) - shapely.box(0.2, 0.2, 7.8, 3.8)
    walls = house.prism("IfcWall", storey, outer, 0.0, 2.5)
    house.door(walls, storey, shapely.box(3.0, 0.0, 4.0, 0.2), 0.0, clear=0.9)
    path = house.write(tmp_path / "hall.ifc")
    passage = load_environment(path)
    assert not passage.segments.glass.any()
    assert frontier(passage) == pytest.approx(1.0, abs=1e-4)
    shut = load_environment(path, doors="closed")
    assert shut.segments.lengths[shut.segments.glass].tolist() == pytest.approx([1.0], abs=1e-4)
    assert frontier(shut) == 0.0


def test_gaps_of_millimetres_between_walls_are_closed(tmp_path: Path) -> None:
    house = House()
    storey = house.storey("EG", 0.0)
    for box in (
        (0.0, 0.0, 5.0, 0.2),
        (0.0, 0.204, 0.2, 4.0),  # 4 mm short of the corner
        (4.8, 0.15, 5.0, 4.0),  # overlaps
        (0.0, 3.8, 5.0, 4.0),
    ):
        house.prism("IfcWall", storey, shapely.box(*box), 0.0, 2.5)
    env = load_environment(house.write(tmp_path / "room.ifc"))
    assert differ(env.free, shapely.box(0.2, 0.2, 4.8, 3.8)) < 1e-3
    assert frontier(env) == 0.0
    assert (env.segments.kind == WALL).sum() == 4


def test_a_wall_of_the_storey_below_that_reaches_up_counts(tmp_path: Path) -> None:
    house = House()
    low, high = house.storey("EG", 0.0), house.storey("OG", 3.0)
    outer = shapely.box(0, 0, 8, 4) - shapely.box(0.3, 0.3, 7.7, 3.7)
    house.prism("IfcWall", low, outer, 0.0, 6.0)
    house.prism("IfcSpace", high, shapely.box(0.3, 0.3, 7.7, 3.7), 3.0, 5.5)
    house.prism("IfcFurnishingElement", low, shapely.box(1, 1, 2, 2), 0.0, 1.0)
    env = load_environment(house.write(tmp_path / "tall.ifc"), level="OG")
    assert differ(env.free, shapely.box(0.3, 0.3, 7.7, 3.7)) < 1e-4


def test_storeys_of_the_same_name_are_told_apart(tmp_path: Path) -> None:
    house = House()
    for low in (0.0, 3.0):
        house.floor(house.storey("Level", low), low)
    path = house.write(tmp_path / "twins.ifc")
    with pytest.raises(InputError, match=r"0: Level at 0 m at 0 m, 1: Level at 3 m"):
        load_environment(path)
    assert load_environment(path, level=1).name == "twins Level at 3 m"


EMPTY = (
    "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
    "FILE_SCHEMA(('{schema}'));\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;\n"
)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "the file is empty"),
        ("PK\x03\x04", "this is not an IFC file"),
        (EMPTY.format(schema="IFC4"), "there is no IfcWall in it"),
        (EMPTY.format(schema="AP214"), r"this is not an IFC file \(Unsupported schema: AP214\)"),
        (EMPTY.format(schema="IFC4")[:60], "this IFC file is cut off"),
    ],
)
def test_what_is_no_building_is_refused_in_one_sentence(
    content: str, said: str, tmp_path: Path
) -> None:
    path = tmp_path / "bad.ifc"
    path.write_text(content)
    with pytest.raises(InputError, match=said) as refused:
        load_environment(path)
    assert "bad.ifc" in str(refused.value)
    assert str(refused.value).count(". ") == 0


def test_a_damaged_file_is_refused_in_one_sentence(house: Path, tmp_path: Path) -> None:
    path = tmp_path / "bad.ifc"
    text = house.read_text()
    # A storey whose elevation is a text, and one whose name is a number.
    line = next(one for one in text.splitlines() if "IFCBUILDINGSTOREY(" in one)
    path.write_text(text.replace(line, line.replace("'Ground'", "7.")))
    with pytest.raises(InputError, match=r"bad\.ifc: ") as refused:
        load_environment(path)
    assert str(refused.value).count(". ") == 0


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.999])
def test_a_file_that_is_cut_off_is_refused(share: float, house: Path, tmp_path: Path) -> None:
    """At the end of a line too, where what is left is sound."""
    content = house.read_bytes()
    end = int(share * len(content))
    for kept in (content[:end], content[: content.rfind(b";\n", 0, end) + 2]):
        path = tmp_path / "cut.ifc"
        path.write_bytes(kept)
        with pytest.raises(InputError, match=r"cut\.ifc: this IFC file is cut off \(END-ISO"):
            load_environment(path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="No such file"):
        load_environment(tmp_path / "none.ifc")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"doors": "ajar"}, "doors is 'ajar'; it must be open or closed"),
        ({"glass": "thick"}, "glass is 'thick'"),
        ({"height": 0.0}, "height is 0; give metres"),
        ({"height": math.nan}, "height is nan"),
        ({"unit": "mm"}, "unit means nothing for a building model"),
        ({"tolerance": 0.1}, "tolerance means nothing for a building model"),
    ],
)
def test_options_of_no_use_are_refused(options: dict[str, Any], said: str, house: Path) -> None:
    with pytest.raises(InputError, match=said):
        load_environment(house, level=0, **options)


@pytest.mark.parametrize(
    ("prefix", "text"), [("KILO", r"stand on 1\.\d+e\+04 x"), ("MILLI", r"up to 0\.00\d+ m high")]
)
def test_a_file_in_another_unit_than_it_names(
    house: Path, tmp_path: Path, prefix: str, text: str
) -> None:
    """As some programs write them: millimetres, which are said to be metres, or the reverse."""
    model = ifcopenshell.open(str(house))
    (unit,) = [u for u in model.by_type("IfcSIUnit") if u.UnitType == "LENGTHUNIT"]
    unit.Prefix = prefix
    model.write(str(tmp_path / "other.ifc"))
    with pytest.raises(InputError, match=f"IfcUnitAssignment.*{text}"):
        load_environment(tmp_path / "other.ifc", level="Ground")
