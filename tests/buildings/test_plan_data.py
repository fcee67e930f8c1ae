"""Plans of real buildings, against what their files say of themselves."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import ifcopenshell
import ifcopenshell.util.element
import numpy as np
import pytest
import shapely

from ambinav.buildings.ifc.parts import meshes
from ambinav.buildings.ifc.storeys import storey_of, storeys_of
from ambinav.buildings.load import load_environment
from ambinav.buildings.mesh_section import section
from ambinav.geometry.segments import FRONTIER, GLASS
from ambinav.runtime.errors import InputError


@pytest.fixture(scope="module")
def plans(data_dir: Path) -> Iterator[Path]:
    """The folder of plans; each model is read once, and changed by nobody."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ifcopenshell, "open", functools.cache(ifcopenshell.open))
        yield data_dir / "plans"


def of_storey(model: Any, kind: str, storey: Any) -> list[Any]:
    return [one for one in model.by_type(kind) if storey_of(one) == storey]


@pytest.mark.sweep
@pytest.mark.parametrize(("level", "stairs"), [(0, 1.2), (2, 1.4)])
def test_each_space_of_the_institute_is_free_and_of_its_stated_area(
    level: int, stairs: float, plans: Path
) -> None:
    """All of it but what stairs cut out; a door between each two, and none of them too many."""
    path = plans / "institute.ifc"
    model = ifcopenshell.open(str(path))
    storey = storeys_of(model)[level]
    env = load_environment(path, level=level, furniture=False)
    spaces = of_storey(model, "IfcSpace", storey.entity)
    stated, whole = 0.0, []
    for space, vertices, faces, _ in meshes(model, spaces):
        area = section(vertices, faces, storey.elevation + 0.3)[0]
        said = ifcopenshell.util.element.get_psets(space)["BaseQuantities"]["NetFloorArea"]
        stated += said
        assert area.area == pytest.approx(said, abs=1e-6)
        free = shapely.intersection(area, env.free).area
        if free < said - 1e-6:
            assert "Treppe" in space.LongName or "Eingang" in space.LongName
            assert free == pytest.approx(said, abs=stairs)
        whole.append(area)
    walls = of_storey(model, "IfcWall", storey.entity)
    assert len(walls) == {0: 24, 2: 29}[level]
    for _, vertices, faces, _ in meshes(model, walls):
        wall = section(vertices, faces, storey.elevation + 0.3)[0]
        assert shapely.intersection(wall, env.free).area < 1e-6
    # What is free beside the spaces is in the openings of doors, 0.3 m deep and a metre wide.
    beside = env.free.area - shapely.intersection(env.free, shapely.union_all(whole)).area
    doors = of_storey(model, "IfcDoor", storey.entity)
    assert beside == pytest.approx(0.3 * len(doors), abs=0.12 * len(doors) + 1.0)
    assert len(shapely.get_parts(env.free)) == 1
    # Each of them has a door, and behind a closed one is a space of its own.
    closed = load_environment(path, level=level, furniture=False, doors="closed")
    assert len(shapely.get_parts(closed.free)) == len(spaces)


@pytest.mark.slow
def test_the_institute_has_its_storeys_and_corridors(plans: Path) -> None:
    path = plans / "institute.ifc"
    model = ifcopenshell.open(str(path))
    elevations = {one.Name: one.Elevation for one in model.by_type("IfcBuildingStorey")}
    storeys = storeys_of(model)
    assert {one.name: one.elevation for one in storeys} == pytest.approx(elevations)
    assert [one.elevation for one in storeys] == [-3.0, 0.0, 3.0, 6.0, 9.0]
    assert len(model.by_type("IfcWall")) == 119
    with pytest.raises(InputError, match="0: Keller at -3 m, 1: Erdgeschoss at 0 m"):
        load_environment(path)
    env = load_environment(path, level="1. obergeschoss")
    xmin, _, xmax, _ = env.bounds
    # Two corridors of 17.7 x 2.0 m, along y = 8.
    for start, angle in ((xmin + 1.0, 0.0), (xmax - 1.0, np.pi)):
        width = sum(env.cast(start + 3.2 * np.cos(angle), 8.0, a, 99.0) for a in (1.5708, -1.5708))
        assert width == pytest.approx(2.0, abs=1e-3)
    ends = shapely.box(xmin, 7.0, xmin + 17.7, 9.0), shapely.box(xmax - 17.7, 7.0, xmax, 9.0)
    for end in ends:
        assert shapely.intersection(env.free, end).area == pytest.approx(35.4, abs=1e-4)


@pytest.mark.slow(kept=("Level 1",))
@pytest.mark.parametrize("level", ["Level 1", "Level 2"])
def test_the_spaces_of_the_duplex_are_free_but_for_stairs(level: str, plans: Path) -> None:
    path = plans / "duplex.ifc"
    model = ifcopenshell.open(str(path))
    storey = next(one for one in storeys_of(model) if one.name == level)
    env = load_environment(path, level=level, furniture=False)
    for space, vertices, faces, _ in meshes(model, of_storey(model, "IfcSpace", storey.entity)):
        area = section(vertices, faces, storey.elevation + 0.3)[0]
        lost = shapely.difference(area, env.free).area
        assert lost < (0.1 if space.LongName in ("Stair", "Room", "Hallway") else 1e-5)
    assert env.drivable is not None
    assert 4.0 < env.free.area - env.drivable.area < 9.0  # two stairs
    assert (env.segments.kind == GLASS).any()


@pytest.mark.sweep
def test_the_pavilion_has_no_storeys_and_its_drawing_is_the_same(plans: Path) -> None:
    model = load_environment(plans / "barcelona_pavilion.ifc")
    drawing = load_environment(plans / "barcelona_pavilion.dxf")
    assert "storey building at 0 m" in model.notes[0]
    # The podium is 52.0 m long in both.
    for env in (model, drawing):
        xmin, _, xmax, _ = env.bounds
        assert xmax - xmin == pytest.approx(52.0, abs=0.05)
        assert (env.segments.kind == FRONTIER).any()
        assert (env.segments.kind == GLASS).sum() > 20


def test_the_sheet_says_inch_and_is_asked(plans: Path) -> None:
    path = plans / "barcelona_pavilion_sheet.dxf"
    with pytest.raises(InputError, match=r"\$INSUNITS says inch, but then .*--unit"):
        load_environment(path)
