"""Plans in DXF, against drawings whose rooms are known."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
import shapely

from ambinav.buildings.dxf.layers import role_by_name
from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER, GLASS
from ambinav.runtime.errors import InputError

ROOM = shapely.box(0.2, 0.2, 6.2, 4.2)
OUTER = shapely.box(0.0, 0.0, 6.4, 4.4)
DOOR = shapely.box(2.0, 0.0, 3.0, 0.2)
"""An opening in the wall, its leaf open inwards."""
Draw = Callable[[Any], None]


def rectangle(space: Any, shape: shapely.Polygon, layer: str, scale: float = 1.0) -> None:
    points = [(scale * x, scale * y) for x, y in shape.exterior.coords[:-1]]
    space.add_lwpolyline(points, close=True, dxfattribs={"layer": layer})


def lines(space: Any, layer: str, *ends: tuple[float, float, float, float]) -> None:
    for x0, y0, x1, y1 in ends:
        space.add_line((x0, y0), (x1, y1), dxfattribs={"layer": layer})


def room(space: Any, scale: float = 1.0) -> None:
    """One room with a door, a column and a table; walls as two lines, closed at the door."""
    s = scale
    faces = [
        (0.2, 0.2, 0.2, 4.2), (0.2, 4.2, 6.2, 4.2), (6.2, 4.2, 6.2, 0.2),
        (0.2, 0.2, 2.0, 0.2), (3.0, 0.2, 6.2, 0.2), (2.0, 0.0, 2.0, 0.2), (3.0, 0.0, 3.0, 0.2),
        (0.0, 0.0, 0.0, 4.4), (0.0, 4.4, 6.4, 4.4), (6.4, 4.4, 6.4, 0.0),
        (0.0, 0.0, 2.0, 0.0), (3.0, 0.0, 6.4, 0.0),
    ]  # fmt: skip
    lines(space, "Walls", *((s * a, s * b, s * c, s * d) for a, b, c, d in faces))
    space.add_arc((2 * s, 0.2 * s), s, 0, 90, dxfattribs={"layer": "Doors"})
    lines(space, "Doors", (2 * s, 0.2 * s, 2 * s, 1.2 * s))
    rectangle(space, shapely.box(4.0, 2.0, 4.3, 2.3), "Columns", s)
    rectangle(space, shapely.box(1.0, 3.0, 2.0, 3.6), "Furniture", s)
    space.add_text("Office", dxfattribs={"layer": "Texts"})


COLUMN, TABLE = shapely.box(4.0, 2.0, 4.3, 2.3), shapely.box(1.0, 3.0, 2.0, 3.6)
FREE = shapely.union(ROOM, DOOR) - COLUMN - TABLE


def written(path: Path, draw: Draw, insunits: int = 6) -> Path:
    document = ezdxf.new("R2010", setup=True)
    document.header["$INSUNITS"] = insunits
    draw(document.modelspace())
    document.saveas(path)
    return path


def loaded(folder: Path, draw: Draw, insunits: int = 6, **options: Any) -> Environment:
    return load_environment(written(folder / "plan.dxf", draw, insunits), **options)


def differ(a: shapely.Geometry, b: shapely.Geometry) -> float:
    return float(shapely.symmetric_difference(a, b).area)


def test_walls_of_two_lines_a_door_a_column_and_a_table(tmp_path: Path) -> None:
    env = loaded(tmp_path, room)
    assert differ(env.free, FREE) < 1e-5
    assert len(env.segments) == 4 + 4 + 8
    assert env.segments.lengths[env.segments.kind == FRONTIER].tolist() == pytest.approx([1.0])
    assert env.map_std == 0.02  # a drawing
    assert any("TEXT" in note for note in env.notes)


@pytest.mark.slow
def test_a_closed_door_is_a_wall_where_it_shuts(tmp_path: Path) -> None:
    env = loaded(tmp_path, room, doors="closed")
    assert (env.segments.kind != FRONTIER).all()
    assert env.cast(2.5, 1.0, -math.pi / 2, 9.0) == pytest.approx(0.78, abs=1e-6)


def test_two_leaves_of_a_door_meet_and_leaves_are_drawn_open(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        for shape in (OUTER, ROOM):
            rectangle(space, shape, "Walls")
        for x0, x1 in ((0.2, 2.2), (4.2, 6.2)):
            rectangle(space, shapely.box(x0, 2.0, x1, 2.1), "Walls")
        for hinge, start, end in ((2.2, 0, 90), (4.2, 90, 180)):
            space.add_arc((hinge, 2.1), 1.0, start, end, dxfattribs={"layer": "Doors"})
            rectangle(space, shapely.box(hinge - 0.02, 2.1, hinge + 0.02, 3.1), "Doors")

    env = loaded(tmp_path, draw, doors="closed")
    assert len(shapely.get_parts(env.free)) == 2
    assert env.cast(3.0, 3.0, -math.pi / 2, 9.0) == pytest.approx(0.88, abs=1e-6)
    assert len(shapely.get_parts(loaded(tmp_path, draw).free)) == 1


def test_furniture_can_be_left_out(tmp_path: Path) -> None:
    env = loaded(tmp_path, room, furniture=False)
    assert differ(env.free, shapely.union(FREE, TABLE)) < 1e-5


@pytest.mark.parametrize(
    ("insunits", "per_metre"), [(4, 1e3), (5, 1e2), (1, 1 / 0.0254), (2, 1 / 0.3048)]
)
def test_the_unit_of_the_file_changes_nothing(
    insunits: int, per_metre: float, tmp_path: Path
) -> None:
    env = loaded(tmp_path, lambda space: room(space, per_metre), insunits)
    assert differ(env.free, FREE) < 1e-4
    assert len(env.segments) == 16


@pytest.mark.parametrize(
    ("insunits", "per_metre", "said"),
    [
        (0, 1.0, r"\$INSUNITS says no unit .* 6\.4 by 4\.4 in all, its doors 1 wide; say with"),
        (3, 1.0, r"\$INSUNITS says no unit"),  # miles
        (1, 1.0, r"says inch, but then its walls are 0\.163 by 0\.112 m in all and its doors 0"),
        (6, 1e3, r"says metre, but then its walls are 6\.4e\+03 by"),
        (4, 1.0, r"says millimetre, but then"),
        (5, 1e3, r"its walls are 64 by 44 m in all and its doors 10 m wide"),
    ],
)
def test_a_unit_that_is_unclear_is_asked_and_not_guessed(
    insunits: int, per_metre: float, said: str, tmp_path: Path
) -> None:
    path = written(tmp_path / "plan.dxf", lambda space: room(space, per_metre), insunits)
    with pytest.raises(InputError, match=said):
        load_environment(path)
    unit = "m" if per_metre == 1.0 else "mm"
    assert differ(load_environment(path, unit=unit).free, FREE) < 1e-4


def test_blocks_in_blocks_scaled_turned_and_mirrored(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        inner = space.doc.blocks.new("table")
        # On layer 0: it belongs to the layer of what inserts it.
        rectangle(inner, shapely.box(0, 0, 1.0, 0.5), "0")
        outer = space.doc.blocks.new("tables")
        outer.add_blockref(
            "table", (1.0, 0.0), {"xscale": 2.0, "yscale": 2.0, "layer": "Furniture"}
        )
        rectangle(space, OUTER, "Walls")
        rectangle(space, ROOM, "Walls")
        space.add_blockref("tables", (6.0, 1.0), {"xscale": -1.0, "rotation": 0.0})
        space.add_blockref("tables", (1.0, 1.5), {"rotation": 90.0})

    env = loaded(tmp_path, draw)
    # 2 x 1 m, once mirrored from x = 6 - 1 to 6 - 3, once turned to x = 1 - 1 .. 1.
    mirrored, turned = shapely.box(3.0, 1.0, 5.0, 2.0), shapely.box(0.0, 2.5, 1.0, 4.5)
    assert differ(env.free, ROOM - mirrored - turned) < 1e-5


def test_a_grid_of_blocks(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        block = space.doc.blocks.new("post")
        rectangle(block, shapely.box(0, 0, 0.1, 0.1), "0")
        rectangle(space, OUTER, "Walls")
        rectangle(space, ROOM, "Walls")
        space.add_blockref(
            "post",
            (1.0, 1.0),
            {
                "row_count": 2, "column_count": 3, "row_spacing": 1, "column_spacing": 2,
                "layer": "Columns",
            },
        )  # fmt: skip

    env = loaded(tmp_path, draw)
    assert len(env.free.interiors) == 6
    assert ROOM.area - env.free.area == pytest.approx(0.06)


def test_bulges_arcs_and_splines_are_chords_within_a_millimetre(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        # A round hall of radius 5 and a wall of 0.3 m, as polylines of two half circles.
        for radius in (5.0, 5.3):
            space.add_lwpolyline(
                [(radius, 0, 1.0), (-radius, 0, 1.0)],
                format="xyb",
                close=True,
                dxfattribs={"layer": "A-WALL"},
            )
        space.add_circle((1, 1), 0.4, dxfattribs={"layer": "S-COLS"})
        space.add_ellipse((-2, 0), (1, 0), 0.5, dxfattribs={"layer": "S-COLS"})

    env = loaded(tmp_path, draw)
    away = np.hypot(*shapely.get_coordinates(env.free.exterior).T)
    assert np.abs(away - 5.0).max() < 1e-6
    middles = env.segments.xy[:, :2] / 2 + env.segments.xy[:, 2:] / 2
    hall = middles[np.hypot(*middles.T) > 4.0]
    assert np.hypot(*hall.T).min() > 5.0 - 1.01e-3
    exact = math.pi * (25.0 - 0.16 - 0.5)
    assert env.free.area == pytest.approx(exact, rel=2e-3)


def test_a_drawing_seen_from_below_is_mirrored(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        for shape in (OUTER, ROOM):
            points = [(-x, y) for x, y in shape.exterior.coords[:-1]]
            space.add_lwpolyline(
                points, close=True, dxfattribs={"layer": "Walls", "extrusion": (0, 0, -1)}
            )

    assert differ(loaded(tmp_path, draw).free, ROOM) < 1e-5


def test_lines_that_miss_each_other_by_millimetres_meet(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        rectangle(space, OUTER, "Walls")
        lines(
            space, "Walls",
            (0.2, 0.2, 6.2, 0.2), (6.2, 0.204, 6.2, 4.2), (6.196, 4.2, 0.2, 4.2),
            (0.2, 4.206, 0.2, 0.2),  # goes on for 6 mm
        )  # fmt: skip

    env = loaded(tmp_path, draw)
    assert differ(env.free, ROOM) < 1e-4
    assert len(env.segments) == 4


def test_walls_of_two_open_lines_are_closed_and_single_lines_are_thin(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        rectangle(space, OUTER, "Walls")
        rectangle(space, ROOM, "Walls")
        lines(space, "Walls", (2.0, 0.2, 2.0, 2.0), (2.1, 0.2, 2.1, 2.0))  # no end drawn
        lines(space, "Walls", (4.0, 0.2, 4.0, 3.0))

    env = loaded(tmp_path, draw)
    assert differ(env.free, ROOM - shapely.box(2.0, 0.2, 2.1, 2.0)) < 1e-5
    assert sorted(env.thin_walls.reshape(2, 2).tolist()) == [[4.0, 0.2], [4.0, 3.0]]


def glazed(space: Any) -> None:
    """A wall with a window of two lines, which end at the walls."""
    lines(
        space, "Walls",
        (0.2, 0.2, 0.2, 4.2), (0.2, 4.2, 6.2, 4.2), (6.2, 4.2, 6.2, 0.2),
        (0.0, 0.0, 0.0, 4.4), (0.0, 4.4, 6.4, 4.4), (6.4, 4.4, 6.4, 0.0),
        (0.2, 0.2, 2.0, 0.2), (0.0, 0.0, 2.0, 0.0), (2.0, 0.0, 2.0, 0.2),
        (5.0, 0.2, 6.2, 0.2), (5.0, 0.0, 6.4, 0.0), (5.0, 0.0, 5.0, 0.2),
    )  # fmt: skip
    lines(space, "Fenster", (2.0, 0.08, 5.0, 0.08), (2.0, 0.12, 5.0, 0.12))


def test_glass_stops_rays_or_only_robots(tmp_path: Path) -> None:
    solid = loaded(tmp_path, glazed)
    assert solid.segments.lengths[solid.segments.kind == GLASS].tolist() == pytest.approx([3.0])
    assert solid.cast(3.0, 1.0, -math.pi / 2, 9.0) == pytest.approx(0.88, abs=1e-6)
    clear = loaded(tmp_path, glazed, glass="clear")
    assert not clear.segments.glass.any()
    assert clear.is_free(3.0, 0.1)
    assert clear.drivable is not None
    assert not clear.drivable.intersects(shapely.box(2.5, 0.085, 4.5, 0.115))


def test_robots_pass_neither_clear_glass_nor_walls_without_thickness(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        glazed(space)
        lines(space, "Walls", (4.0, 0.3, 4.0, 3.0))

    env = loaded(tmp_path, draw, glass="clear")
    assert len(env.thin_walls) == 1
    assert env.is_free(4.1, 1.0, radius=0.09)
    assert not env.is_free(4.1, 1.0, radius=0.11)
    assert not env.is_free(3.0, 0.3, radius=0.2)


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("Walls", "walls"),
        ("A-WALL-FULL", "walls"),
        ("Außenwände", "walls"),
        ("01_Mauerwerk", "walls"),
        ("MUROS", "walls"),
        ("paredes", "walls"),
        ("Columns", "columns"),
        ("Stützen", "columns"),
        ("Crystal", "glass"),
        ("A-GLAZ", "glass"),
        ("Fenster", "glass"),
        ("Doors", "doors"),
        ("A-DOOR", "doors"),
        ("Türen", "doors"),
        ("Puertas", "doors"),
        ("I-FURN", "furniture"),
        ("Möbel", "furniture"),
        ("Flooring", "floor"),
        ("Wall-Hatch", "ignore"),
        ("Wand massiv", "walls"),
        ("DG-Dachgeschoss-Wand", "walls"),
        ("Fireproof walls", "walls"),
        ("A-WALL-DIMS", "ignore"),
        ("Roof", "ignore"),
        ("Projection", None),
        ("Cancel", None),
        ("Tower", None),
        ("Murmur", None),
        ("EG_MUR", "walls"),
        ("Protocol", None),
    ],
)
def test_what_the_names_of_layers_say(name: str, role: str | None) -> None:
    assert role_by_name(name) == role


def test_layers_are_taken_as_the_user_says(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        rectangle(space, OUTER, "S1")
        rectangle(space, ROOM, "S1")
        rectangle(space, TABLE, "S2")
        rectangle(space, COLUMN, "S3")

    path = written(tmp_path / "plan.dxf", draw)
    with pytest.raises(InputError, match=r"none of its layers \(S1, S2, S3\) holds .*--cad-layer"):
        load_environment(path)
    env = load_environment(path, layers={"s1": "walls", "S3": "columns"})
    assert differ(env.free, ROOM - COLUMN) < 1e-5
    assert any("layers S2 are left out" in note for note in env.notes)
    with pytest.raises(InputError, match="layers: S1 is 'wall'; it must be walls, columns"):
        load_environment(path, layers={"S1": "wall"})
    with pytest.raises(InputError, match="nothing is drawn on a layer 'S9'; it has S1, S2, S3"):
        load_environment(path, layers={"S9": "walls"})


def test_a_drawing_on_one_layer_is_walls_and_hidden_layers_are_not_read(tmp_path: Path) -> None:
    def draw(space: Any) -> None:
        rectangle(space, OUTER, "0")
        rectangle(space, ROOM, "0")
        space.doc.layers.add("Old").off()
        rectangle(space, TABLE, "Old")

    env = loaded(tmp_path, draw)
    assert differ(env.free, ROOM) < 1e-5
    assert any("1 LWPOLYLINE on hidden layers" in note for note in env.notes)


@pytest.mark.parametrize("hidden", ["invisible", "frozen", "off"])
def test_a_block_that_is_hidden_is_not_read(tmp_path: Path, hidden: str) -> None:
    """But on a layer that is merely off, the parts of a block on other layers are seen."""

    def draw(space: Any) -> None:
        rectangle(space, ROOM, "A-WALL")
        rectangle(space.doc.blocks.new("pillar"), COLUMN, "A-COLS")
        reference = space.add_blockref("pillar", (0, 0), dxfattribs={"layer": "Old"})
        reference.dxf.invisible = int(hidden == "invisible")
        layer = space.doc.layers.add("Old")
        {"frozen": layer.freeze, "off": layer.off}.get(hidden, layer.on)()

    env = loaded(tmp_path, draw)
    assert differ(env.free, ROOM - COLUMN if hidden == "off" else ROOM) < 1e-5
    assert any("1 INSERT on hidden" in note for note in env.notes) == (hidden != "off")
