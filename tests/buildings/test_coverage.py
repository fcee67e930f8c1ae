"""Coverage of inputs: broken ones are said to be, and sound ones are not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.coverage import Coverage
from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from ambinav.runtime.errors import InputWarning
from tests import recorded

FLOOR = shapely.box(0, 0, 20, 10)


def line(x0: float, y0: float, x1: float, y1: float) -> shapely.LineString:
    return shapely.LineString([(x0, y0), (x1, y1)])


def test_what_is_small_is_not_worth_a_word() -> None:
    found = Coverage("a.dxf", left_out=[(0.9, 3, "why"), (1.5, 1, "how"), (9.9, 2, "when")])
    assert found.notes(FLOOR) == [
        "a.dxf: 1.5 m² in 1 piece is not taken for floor: how.",
        "a.dxf: 9.9 m² in 2 pieces are not taken for floor: when.",
    ]


def test_much_is_warned_about_unless_it_is_expected() -> None:
    with pytest.warns(InputWarning, match="12 m² in 2 pieces are not taken for floor: why"):
        Coverage("a", left_out=[(12.0, 2, "why")]).notes(FLOOR)
    assert Coverage("a", left_out=[(12.0, 2, "why")], expected=("why",)).notes(FLOOR)


def test_a_door_needs_floor_on_both_sides_but_for_outdoors() -> None:
    walls = [shapely.box(0, 10, 20, 10.2)]
    within, entrance = line(5, 5, 6, 5), line(0, 4, 0, 5)
    assert Coverage("a", doors=[within, entrance], walls=walls).notes(FLOOR) == []
    # Behind it is a space between walls.
    lost = line(5, 10.1, 6, 10.1)
    walls.append(shapely.box(0, 14, 20, 14.2))
    with pytest.warns(InputWarning, match="of walls there is no floor"):
        note, _ = Coverage("a", doors=[within, lost], walls=walls).notes(FLOOR)
    assert "1 of 2 doors open onto nothing that is taken for floor, the first at (5.50, 10." in note


def test_rooms_by_their_outline_or_a_point() -> None:
    rooms = [
        ("Office", shapely.box(1, 1, 4, 4)),
        ("Store", shapely.box(30, 1, 34, 4)),
        ("Hall", shapely.Point(20.5, 5)),
        ("Yard", shapely.Point(25, 5)),
    ]
    with pytest.warns(InputWarning, match="no floor is found in 2 of 4 named rooms: Store, Yard"):
        Coverage("a", rooms=rooms).notes(FLOOR)


def test_walls_without_floor_beside_them() -> None:
    near, far = shapely.box(0, 10, 20, 10.2), line(0, 40, 20, 40)
    assert Coverage("a", walls=[near]).notes(FLOOR) == []
    with pytest.warns(InputWarning, match=r"along 20 of 40\.2 m of walls there is no floor"):
        Coverage("a", walls=[near, far]).notes(FLOOR)


def drawn(folder: Path, *features: tuple[Any, dict[str, Any]]) -> Environment:
    document = {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature",
                "geometry": json.loads(shapely.to_geojson(geometry)),
                "properties": properties,
            }
            for geometry, properties in features
        ],
    }
    path = folder / "plan.geojson"
    path.write_text(json.dumps(document))
    return load_environment(path)


def test_rooms_in_an_outline_that_is_a_room_itself(tmp_path: Path) -> None:
    rooms = [(shapely.box(x, 1, x + 8, 9), {}) for x in (1, 11)]
    with pytest.warns(InputWarning, match="128 m² in 2 pieces are not .* say it of rooms"):
        drawn(tmp_path, (FLOOR, {}), *rooms)


def test_a_named_room_that_an_obstacle_fills_and_walls_outside(tmp_path: Path) -> None:
    room, store = shapely.box(0, 0, 8, 8), shapely.box(10, 0, 12, 2)
    with pytest.warns(InputWarning, match="no floor is found in 1 of 2 named rooms: Store"):
        drawn(
            tmp_path,
            (room, {"kind": "room", "name": "Hall"}),
            (store, {"kind": "room", "name": "Store"}),
            (shapely.buffer(store, 0.1), {"kind": "obstacle"}),
        )
    with pytest.warns(InputWarning, match="1 of 2 walls and obstacles lie outside of its rooms"):
        env = drawn(
            tmp_path,
            (room, {"kind": "room"}),
            (line(2, 2, 2, 5), {"kind": "wall"}),
            (line(12, 2, 12, 5), {"kind": "wall"}),
        )
    assert "change nothing" in env.notes[0]


def test_a_corridor_of_a_map_that_gap_closes_is_said() -> None:
    state = np.full((60, 400), OCCUPIED, dtype=np.uint8)
    state[10:50, 10:50] = state[10:50, 350:390] = FREE
    state[29:31, 50:350] = FREE
    grid = OccupancyGrid(state, 0.1)
    assert environment_from_grid(grid, gap=0.1).notes == ()
    with pytest.warns(InputWarning, match="6 m² in 1 piece is not .* no wider than 0.2 m, which"):
        environment_from_grid(grid, gap=0.2)
    dots = np.full((60, 400), OCCUPIED, dtype=np.uint8)
    dots[10:50, 10:50] = FREE
    dots[5:55:10, 60:390:10] = FREE
    (note,) = environment_from_grid(OccupancyGrid(dots, 0.1), gap=0.0).notes
    assert "1.65 m² in 165 pieces are not taken for floor: each is smaller than 0.25 m²" in note


SAID = {
    "barcelona_pavilion_sheet.dxf": ["5 parts of it do not touch"],
    "duplex.ifc Roof": ["no floor is found in 1 of 1 named rooms: Roof"],
}
"""What is warned about, of all files of the data folder: a sheet, and a roof that is no storey."""
OPTIONS: dict[str, list[dict[str, Any]]] = {
    "barcelona_pavilion_sheet.dxf": [{"unit": "m"}],
    "institute.ifc": [{"level": k} for k in range(5)],
    "duplex.ifc": [{"level": k} for k in ("T/FDN", "Level 1", "Level 2", "Roof")],
}
FOLDERS = ("maps", "maps_from_logs", "maps_research_only", "planner_maps")
FILES = [*((folder, "yaml") for folder in FOLDERS), ("plans", "dxf"), ("plans", "ifc")]


@pytest.mark.slow(kept=("maps-yaml",))
@pytest.mark.parametrize(("folder", "suffix"), FILES)
def test_of_all_files_only_broken_ones_are_warned_about(
    folder: str, suffix: str, data_dir: Path
) -> None:
    paths = sorted((data_dir / folder).glob(f"*.{suffix}"))
    assert paths
    for path in paths:
        if path.stem == "stata_tiled_2x9_huge":
            continue
        for options in OPTIONS.get(path.name, [{}]):
            level = options.get("level")
            name = f"{path.name} {level}" if isinstance(level, str) else path.name
            env, texts = recorded.read(path, **options)
            expected = SAID.get(name, [])
            assert len(texts) == len(expected), texts
            for text, part in zip(texts, expected, strict=True):
                assert part in text and text in env.notes
