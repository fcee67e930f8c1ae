"""A storey of an IFC file in space: against closed forms, its plan, and its triangles."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from ambinav.buildings.ifc.file import read_storey
from ambinav.buildings.ifc.parts import elements_of, meshes, part_role
from ambinav.buildings.load import load_environment
from ambinav.buildings.mesh_prisms import SLICE
from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.plane.fan import scan_plan
from ambinav.casting.space import Scans, SpaceRays
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER, GLASS, WALL
from ambinav.runtime.errors import InputError, InputWarning
from tests.buildings import plan_models
from tests.buildings.plan_models import House

UP, DOWN, NORTH, SOUTH, EAST = (0, 0, 1), (0, 0, -1), (0, 1, 0), (0, -1, 0), (1, 0, 0)
REACH = 30.0


@pytest.fixture(scope="module")
def house(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two storeys of 2.5 m, slabs of 0.3 m below each, walls as in `plan_models`."""
    return plan_models.two_storeys(tmp_path_factory.mktemp("space") / "house.ifc")


@pytest.fixture(scope="module")
def ground(house: Path) -> Environment:
    return load_environment(house, level="Ground", in_space=True)


def meets(env: Environment, origin: tuple[float, float, float], along: Any) -> tuple[float, int]:
    """Range of a ray, and the kind of what it meets."""
    assert env.space is not None
    scans = one_ray(env, origin, along)
    return float(scans[0][0, 0]), int(env.space.surface_kind[scans[1][0, 0]])


def one_ray(env: Environment, origin: tuple[float, float, float], along: Any) -> Scans:
    assert env.space is not None
    u = np.array(along, dtype=float)
    u /= np.linalg.norm(u)
    rays = SpaceRays(np.array([[0.0, 0.0, origin[2]]]), np.arctan2(u[1:2], u[:1]), np.arcsin(u[2:]))
    x, y = np.array([origin[0]]), np.array([origin[1]])
    return env.space.cast_scans(x, y, np.zeros(1), rays, REACH)


@pytest.mark.parametrize(("origin", "along", "distance", "kind"), [
    ((2.0, 2.0, 0.4), UP, 2.3, WALL),  # the slab of the storey above
    ((2.0, 2.0, 0.4), DOWN, 0.4, WALL),  # its own
    ((3.0, 1.5, 1.0), EAST, 7.2, WALL),  # through the door and over the table to the far wall
    ((3.0, 1.5, 0.4), EAST, 4.0, WALL),  # through the door to the table
    ((3.0, 1.5, 2.1), EAST, 1.2, WALL),  # the lintel above the door
    ((7.5, 1.3, 1.5), DOWN, 0.7, WALL),  # the top of the table
    ((7.0, 2.0, 1.0), NORTH, 1.28, GLASS),  # the window's pane
    ((7.0, 2.0, 2.3), NORTH, 1.2, WALL),  # the wall above the window
    ((1.5, 2.0, 1.0), SOUTH, 2.0, FRONTIER),  # the open door to the outside, to the wall's face
    ((1.5, 2.0, 2.2), SOUTH, 1.8, WALL),  # above it
    ((9.5, 2.5, 1.0), DOWN, 1.4, FRONTIER),  # the hole in the slab: 0.4 m below the floor is known
])  # fmt: skip
def test_what_rays_meet(
    ground: Environment,
    origin: tuple[float, float, float],
    along: tuple[int, int, int],
    distance: float,
    kind: int,
) -> None:
    assert meets(ground, origin, along) == (pytest.approx(distance, abs=1e-5), kind)


@pytest.mark.slow
def test_closed_doors_and_clear_glass_and_no_furniture(house: Path) -> None:
    closed = load_environment(house, level="Ground", in_space=True, doors="closed")
    assert meets(closed, (3.0, 1.5, 1.0), EAST) == (pytest.approx(1.28, abs=1e-5), WALL)
    clear = load_environment(house, level="Ground", in_space=True, glass="clear")
    # To the outer face of the wall, behind which nothing is known.
    distance, kind = meets(clear, (7.0, 2.0, 1.0), NORTH)
    assert (distance, kind) == (pytest.approx(1.4, abs=0.006), FRONTIER)
    bare = load_environment(house, level="Ground", in_space=True, furniture=False)
    assert meets(bare, (7.5, 1.3, 1.5), DOWN)[0] == pytest.approx(1.5, abs=1e-5)


def test_the_highest_storey_has_no_ceiling(house: Path) -> None:
    upper = load_environment(house, level="Upper", in_space=True)
    assert upper.floor == 3.0
    assert meets(upper, (2.0, 2.0, 3.4), DOWN) == (pytest.approx(0.4, abs=1e-5), WALL)
    assert meets(upper, (2.0, 2.0, 3.4), UP) == (pytest.approx(2.1, abs=1e-5), FRONTIER)


def test_a_pose_in_a_body_or_beside_the_building_is_nan(ground: Environment) -> None:
    assert np.isnan(one_ray(ground, (7.5, 1.3, 0.5), EAST)[0]).all()  # in the table
    assert np.isnan(one_ray(ground, (1.5, 0.1, 2.3), EAST)[0]).all()  # in the lintel
    assert np.isnan(one_ray(ground, (-2.0, 1.0, 0.5), EAST)[0]).all()


def test_the_plan_is_as_ever(house: Path, ground: Environment) -> None:
    plan = load_environment(house, level="Ground")
    assert plan.free.equals_exact(ground.free, 0.0)
    assert np.array_equal(plan.segments.xy, ground.segments.xy)
    assert plan.checksum == ground.checksum
    assert ground.notes[: len(plan.notes)] == plan.notes
    # The frontiers around it are no walls of the file.
    assert " solids and 0 walls without thickness from -0.4 to 3.4 m" in ground.notes[-1]


def scans_of_both(env: Environment, height: float, count: int) -> tuple[Scans, Scans]:
    """A level laser at poses all over the free floor, in the plan and in space."""
    assert env.space is not None
    rng = np.random.default_rng(5)
    xmin, ymin, xmax, ymax = env.bounds
    x, y = rng.uniform((xmin, ymin), (xmax, ymax), (count, 2)).T
    free = np.asarray(env.is_free(x, y))
    x, y = x[free], y[free]
    theta = rng.uniform(-math.pi, math.pi, len(x))
    angle = np.linspace(-math.pi, math.pi, 90, endpoint=False)
    origin = np.column_stack([np.zeros((90, 2)), np.full(90, height + env.floor)])
    rays = SpaceRays(origin, angle, np.zeros(90))
    flat = scan_plan(env.plan, x, y, theta, origin[:, :2].copy(), angle, REACH)
    return flat, env.space.cast_scans(x, y, theta, rays, REACH)


def agree(env: Environment, height: float, count: int) -> None:
    assert env.space is not None
    flat, space = scans_of_both(env, height, count)
    assert np.array_equal(np.isinf(flat[0]), np.isinf(space[0]))
    met = np.isfinite(flat[0])
    assert np.abs(flat[0][met] - space[0][met]).max() < 1e-4
    kinds = env.segments.kind[flat[1][met]], env.space.surface_kind[space[1][met]]
    assert (kinds[0] == kinds[1]).mean() > 0.999


def test_a_level_scanner_at_the_height_of_the_cut_gets_the_ranges_of_the_plan(
    ground: Environment,
) -> None:
    agree(ground, 0.3, 1000)


def as_mesh(path: Path, level: str | int | None) -> Mesh:
    """The triangles of a storey and of what reaches into it, doors open."""
    plan = read_storey(path, level, height=0.3, doors="open", glass="solid", furniture=True)
    height = plan.next_floor + 0.4 - plan.storey.elevation
    left_out = ("space", "opening", "door", "leaf")
    elements = [
        element
        for element in elements_of(plan.model, plan.storey, height, True)
        if part_role(element) not in left_out
    ]
    vertices, faces, count = [], [], 0
    for _, corners, triangles, _ in meshes(plan.model, elements):
        vertices.append(corners)
        faces.append(triangles + count)
        count += len(corners)
    return Mesh(np.vstack(vertices), np.vstack(faces))


def compared(env: Environment, mesh: Mesh, poses: int, rays: int) -> NDArray[np.float64]:
    """By how much ranges differ, metres, of rays that end on what the file holds."""
    assert env.space is not None
    rng = np.random.default_rng(2)
    xmin, ymin, xmax, ymax = env.bounds
    x, y = rng.uniform((xmin, ymin), (xmax, ymax), (4 * poses, 2)).T
    free = np.flatnonzero(env.is_free(x, y))[:poses]
    theta = rng.uniform(-math.pi, math.pi, len(free))
    height = rng.uniform(0.1, 2.2, rays)
    beams = SpaceRays(
        np.column_stack([np.zeros((rays, 2)), height + env.floor]),
        rng.uniform(-math.pi, math.pi, rays),
        np.arcsin(rng.uniform(-1.0, 1.0, rays)),
    )
    mine = env.space.cast_scans(x[free], y[free], theta, beams, REACH)
    other = mesh.cast_scans(x[free], y[free], theta, beams, REACH)
    known = np.isfinite(mine[0]) & (env.space.surface_kind[mine[1]] != FRONTIER)
    return np.abs(np.minimum(other[0][known], 99.0).astype(float) - mine[0][known])


@pytest.mark.slow
def test_random_rays_against_the_triangles_of_the_house(house: Path, ground: Environment) -> None:
    pytest.importorskip("embreex")
    differ = compared(ground, as_mesh(house, "Ground"), 300, 100)
    assert len(differ) > 20_000
    assert (differ > 1e-4).mean() < 1e-3  # rays that pass an edge by less than Embree resolves


@pytest.mark.sweep
@pytest.mark.parametrize(("name", "level", "share"), [
    ("institute", 1, 0.010), ("duplex", "Level 1", 0.013), ("barcelona_pavilion", None, 0.0005),
])  # fmt: skip
@pytest.mark.filterwarnings("ignore::ambinav.runtime.errors.InputWarning")
def test_real_buildings(name: str, level: str | int | None, share: float, data_dir: Path) -> None:
    """Level rays as in the plan, others as in the mesh but for stairs, rails and curved chairs."""
    pytest.importorskip("embreex")
    path = data_dir / "plans" / f"{name}.ifc"
    env = load_environment(path, level=level, in_space=True)
    agree(env, 0.3, 1000)
    differ = compared(env, as_mesh(path, level), 500, 200)
    assert (differ > 1e-3).mean() < share
    assert (differ > SLICE / 2).mean() < 0.2 * share + 2e-4


def test_a_sloping_roof_is_cut_into_slices_and_a_note_says_so(tmp_path: Path) -> None:
    house = House()
    storey = house.storey("EG", 0.0)
    outer = shapely.box(0, 0, 8, 4) - shapely.box(0.2, 0.2, 7.8, 3.8)
    house.prism("IfcWall", storey, outer, 0.0, 2.5)
    house.prism("IfcSlab", storey, shapely.box(0, 0, 8, 4), -0.2, 0.0)
    roof = house.prism("IfcRoof", storey, shapely.box(0, 0, 8, 4), 2.5, 2.7)
    # Leant to the south: 4 m to the north it is 2 m higher.
    solid = roof.Representation.Representations[0].Items[0]
    solid.ExtrudedDirection = house.model.create_entity("IfcDirection", (0.0, -0.5, 1.0))
    env = load_environment(house.write(tmp_path / "roof.ifc"), in_space=True)
    assert "1 elements have sloping sides" in env.notes[-1]
    # Its underside is level; its sides lean outward to the south.
    assert meets(env, (4.0, 2.0, 0.5), UP) == (pytest.approx(2.0, abs=1e-5), WALL)


def test_a_sloping_sheet_is_warned_of(tmp_path: Path) -> None:
    house = House()
    storey = house.storey("EG", 0.0)
    outer = shapely.box(0, 0, 8, 4) - shapely.box(0.2, 0.2, 7.8, 3.8)
    house.prism("IfcWall", storey, outer, 0.0, 2.5)
    sail = house.prism("IfcBuildingElementProxy", storey, shapely.box(1, 1, 2, 2), 0.0, 1.0)
    model = house.model
    ring = [(1.0, 1.0, 1.5), (3.0, 1.0, 1.5), (3.0, 3.0, 2.5), (1.0, 3.0, 2.5)]
    loop = model.create_entity(
        "IfcPolyLoop", [model.create_entity("IfcCartesianPoint", point) for point in ring]
    )
    face = model.create_entity("IfcFace", [model.create_entity("IfcFaceOuterBound", loop, True)])
    shell = model.create_entity("IfcConnectedFaceSet", [face])
    shown = sail.Representation.Representations[0]
    shown.Items = [model.create_entity("IfcFaceBasedSurfaceModel", [shell])]
    shown.RepresentationType = "SurfaceModel"
    path = house.write(tmp_path / "sail.ifc")
    with pytest.warns(InputWarning, match="1 elements have sloping faces that enclose no body"):
        env = load_environment(path, in_space=True)
    # Level rays meet it within half a slice of where it is.
    distance, _ = meets(env, (2.0, 0.5, 2.0), NORTH)
    assert distance == pytest.approx(1.5, abs=0.5 * SLICE * 2.0)


def test_without_slabs_a_plane_is_the_floor(tmp_path: Path) -> None:
    house = House()
    storey = house.storey("EG", 1.0)
    outer = shapely.box(0, 0, 8, 4) - shapely.box(0.2, 0.2, 7.8, 3.8)
    house.prism("IfcWall", storey, outer, 1.0, 3.5)
    env = load_environment(house.write(tmp_path / "bare.ifc"), in_space=True)
    assert meets(env, (4.0, 2.0, 1.5), DOWN) == (pytest.approx(0.5), WALL)
    assert "a plane at 1 m replaces it" in env.notes[-1]


def test_other_files_are_not_read_in_space(tmp_path: Path) -> None:
    path = tmp_path / "plan.wkt"
    path.write_text("POLYGON ((0 0, 8 0, 8 4, 0 4, 0 0))")
    with pytest.raises(InputError, match="in_space means nothing for a drawn plan"):
        load_environment(path, in_space=True)
