"""Meshes from files: what trimesh writes is read, and what is unclear is asked."""

from __future__ import annotations

import math
import re
import struct
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ambinav.buildings.mesh.cloud import is_cloud, read_cloud
from ambinav.buildings.mesh.floor import floor_environment
from ambinav.buildings.mesh.frame import storey_height
from ambinav.buildings.mesh.octomap import read_octomap
from ambinav.buildings.mesh.read import read_mesh
from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.prisms import Prisms
from ambinav.casting.space import SpaceRays
from ambinav.runtime.errors import InputError, InputWarning

trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")


def house(scale: float = 1.0) -> Any:
    """A hollow box of 12 x 8 x 3 m on z = 0, as two meshes: without lid, and the lid."""
    box = trimesh.creation.box(extents=(12.0, 8.0, 3.0))
    box.apply_translation((2.0, 1.0, 1.5))
    box.apply_scale(scale)
    return box


def saved(mesh: Any, path: Path) -> Path:
    mesh.export(path)
    return path


@pytest.mark.parametrize("suffix", ["ply", "stl", "obj", "PLY"])
def test_formats(tmp_path: Path, suffix: str) -> None:
    mesh = read_mesh(saved(house(), tmp_path / f"house.{suffix.lower()}").rename(
        tmp_path / f"house.{suffix}"
    ))  # fmt: skip
    assert mesh.bounds == pytest.approx(np.array([(-4, -3, 0), (8, 5, 3)]))
    assert (len(mesh.faces), mesh.open_edges, mesh.name) == (12, 0, "house")


def test_glb_has_y_up_and_parts_with_places_of_their_own(tmp_path: Path) -> None:
    lying = house()
    lying.apply_transform([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    scene = trimesh.Scene()
    scene.add_geometry(lying)
    moved = np.eye(4)
    moved[0, 3] = 20.0
    scene.add_geometry(lying, transform=moved)
    mesh = read_mesh(saved(scene, tmp_path / "two.glb"))
    assert len(mesh.faces) == 24
    # As the program drew it that wrote it with y up.
    assert mesh.bounds == pytest.approx(np.array([(-4, -3, 0), (28, 5, 3)]))
    # A rotation, no mirror image: faces still look outward.
    assert float(np.linalg.det(mesh.triangles - (0.0, 0.0, -100.0)).sum()) > 0.0


@pytest.mark.parametrize(("unit", "scale"), [("mm", 1000.0), ("cm", 100.0)])
def test_millimetres_are_asked_about_and_not_guessed(
    tmp_path: Path, unit: str, scale: float
) -> None:
    path = saved(house(scale), tmp_path / "house.stl")
    with pytest.raises(InputError, match=r"more than a building has; say with --unit"):
        read_mesh(path)
    assert read_mesh(path, unit=unit).bounds == pytest.approx(np.array([(-4, -3, 0), (8, 5, 3)]))


def test_feet_that_are_taken_for_metres_are_warned_about(tmp_path: Path) -> None:
    path = saved(house(3.2808), tmp_path / "house.ply")
    with pytest.warns(
        InputWarning, match=r"storey is 9\.75 m high, 3 m if its numbers are ft; say"
    ):
        mesh = read_mesh(path)
    assert any("storey is 9.75 m high" in note for note in mesh.notes)
    assert read_mesh(path, unit="m").notes == ()
    feet = read_mesh(path, unit="ft")
    assert feet.notes == () and feet.bounds[1, 2] == pytest.approx(3.0, abs=1e-3)


def test_a_tower_has_storeys_as_houses_have(tmp_path: Path) -> None:
    """The height of all of it says nothing; that to the next floor does."""
    storeys = []
    for k in range(8):
        storey = house()
        storey.apply_translation((0.0, 0.0, 3.2 * k))
        storeys.append(storey)
    tower = trimesh.util.concatenate(storeys)
    assert storey_height(read_mesh(saved(tower, tmp_path / "tower.ply"))) < 3.3
    tower.apply_scale(3.2808)
    with pytest.warns(InputWarning, match="if its numbers are ft"):
        read_mesh(saved(tower, tmp_path / "tower.ply"))


UNITS = {"ft": 3.2808, "in": 39.37, "mm": 1000.0}


@pytest.mark.slow(kept=("ft",))
@pytest.mark.parametrize("unit", ["m", *UNITS])
def test_recorded_buildings_in_other_units_are_asked_about(
    unit: str, tmp_path: Path, data_dir: Path
) -> None:
    """All meshes, clouds and OctoMaps: in metres nothing is said, in other units it is asked."""
    paths = sorted((data_dir / "mesh3d").iterdir())
    assert len(paths) == 6
    scale = UNITS.get(unit, 1.0)
    for path in paths:
        scaled = tmp_path / path.name
        if path.suffix == ".bt":
            res = re.search(rb"\nres (\S+)", path.read_bytes())
            assert res is not None
            edge = f"\nres {float(res[1]) * scale}".encode()
            scaled.write_bytes(path.read_bytes().replace(res[0], edge, 1))
            read: Callable[..., Mesh] = read_octomap
        else:
            loaded = trimesh.load(path, process=False)
            loaded.apply_scale(scale)
            loaded.export(scaled)
            read = partial(read_cloud, voxel=0.08 * scale) if is_cloud(path) else read_mesh
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", InputWarning)
            try:
                read(scaled)
                asked = [str(one.message) for one in caught if one.category is InputWarning]
            except InputError as refused:
                asked = [str(refused)]
        assert len(asked) == (unit != "m"), asked
        assert all("say with --unit whether its numbers are" in text for text in asked)


def test_a_mesh_as_small_as_a_toy_is_asked_about(tmp_path: Path) -> None:
    path = saved(house(0.001), tmp_path / "house.obj")
    with pytest.raises(InputError, match="no robot drives in it"):
        read_mesh(path)
    with pytest.raises(InputError, match="unit is 'inch'"):
        read_mesh(path, unit="inch")


def test_a_mesh_on_its_side_is_asked_about(tmp_path: Path) -> None:
    mesh = house()
    mesh.apply_transform([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    path = saved(mesh, tmp_path / "house.ply")
    with pytest.raises(InputError, match="y may be up in it"):
        read_mesh(path)
    assert np.ptp(read_mesh(path, up="y").bounds, axis=0)[2] == pytest.approx(3.0)
    assert np.ptp(read_mesh(path, up="z", unit="m").bounds, axis=0)[1] == pytest.approx(3.0)
    with pytest.raises(InputError, match="up is 'w'"):
        read_mesh(path, up="w")


def test_refused_files(tmp_path: Path) -> None:
    points = trimesh.PointCloud(np.random.default_rng(1).uniform(0, 5, (40, 3)))
    broken = tmp_path / "broken.ply"
    broken.write_text("ply\nformat ascii 1.0\nelement vertex nine\n")
    odd = house()
    odd.vertices[3, 1] = np.nan
    for path, text in (
        (saved(points, tmp_path / "points.ply"), "40 points and no triangles"),
        (broken, "no header of a PLY file"),
        (saved(odd, tmp_path / "odd.ply"), "a vertex is not finite"),
        (tmp_path / "none.ply", "no such file"),
        (tmp_path / "house.step", r"\.step names no format of meshes"),
    ):
        with pytest.raises(InputError, match=text) as caught:
            read_mesh(path)
        assert str(path) in str(caught.value)


# An L of 36 m2, whose corner points inwards, and walls.
BENT = [(8, 3), (4, 3), (4, 6), (0, 6), (0, 0), (8, 0)]
SIDES = [[i, (i + 1) % 6, 6 + (i + 1) % 6, 6 + i] for i in range(6)]


def polygons(path: Path, outline: Any, floors: list[list[int]]) -> Path:
    """An OBJ or an ASCII PLY of a room."""
    points = [(x, y, z) for z in (0, 2.5) for x, y in outline]
    faces = [*floors, *SIDES]
    if path.suffix == ".obj":
        lines = [f"v {x} {y} {z}" for x, y, z in points]
        lines += ["f " + " ".join(str(k + 1) for k in face) for face in faces]
    else:
        head = (
            f"ply\nformat ascii 1.0\nelement vertex {len(points)}\nproperty float x\n"
            f"property float y\nproperty float z\nelement face {len(faces)}\n"
            "property list uchar int vertex_indices\nend_header"
        )
        lines = [head, *(f"{x} {y} {z}" for x, y, z in points)]
        lines += [" ".join(map(str, (len(face), *face))) for face in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("suffix", [".obj", ".ply"])
def test_polygons_are_read_where_a_fan_of_triangles_is_the_same(
    suffix: str, tmp_path: Path
) -> None:
    """A polygon that is not convex would put floor outside of the walls."""
    with pytest.raises(InputError, match="1 of its faces are not convex"):
        read_mesh(polygons(tmp_path / f"bent{suffix}", BENT, [[0, 1, 2, 3, 4, 5]]))
    cut = [[0, 1, 4, 5], [1, 2, 3, 4]]
    mesh = read_mesh(polygons(tmp_path / f"cut{suffix}", BENT, cut), up="z", unit="m")
    assert len(mesh.faces) == 2 * (len(cut) + len(SIDES))
    around = [(4 * math.cos(k * math.pi / 3), 4 * math.sin(k * math.pi / 3)) for k in range(6)]
    hexagon = polygons(tmp_path / f"hexagon{suffix}", around, [[0, 1, 2, 3, 4, 5]])
    assert len(read_mesh(hexagon, up="z", unit="m").faces) == 4 + 2 * len(SIDES)


def test_faces_of_several_sizes_in_a_binary_ply(tmp_path: Path) -> None:
    points = np.array([(0, 0, 0), (4, 0, 0), (4, 3, 0), (0, 3, 0)], dtype="<f4")
    header = (
        "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\n"
        "property float y\nproperty float z\nelement face 2\n"
        "property list uchar int vertex_indices\nend_header\n"
    )
    faces = struct.pack("<B4iB3i", 4, 0, 1, 2, 3, 3, 0, 1, 2)
    path = tmp_path / "room.ply"
    path.write_bytes(header.encode() + points.tobytes() + faces)
    with pytest.raises(InputError, match="export it again with triangles only"):
        read_mesh(path)


def test_files_that_would_be_misread_are_refused(tmp_path: Path) -> None:
    path = polygons(tmp_path / "room.ply", BENT, [])
    lines = path.read_text().splitlines()
    for kept, text in ((-2, "of face it has 4 of 6"), (-10, "of vertex it has 8 of 12")):
        path.write_text("\n".join(lines[:kept]))
        with pytest.raises(InputError, match=f"cut off: {text}; copy it again"):
            read_mesh(path)
    obj = polygons(tmp_path / "room.obj", BENT, [])
    whole = obj.read_text()
    for face, index in (
        ("-1 -2 -3", "-1"),
        ("1 2/2 -10//3", "-10"),
        ("1 0 2", "0"),
        ("2/1 1 0", "0"),
    ):
        obj.write_text(f"{whole}f {face}\nf 10 1/0 2\n")
        with pytest.raises(
            InputError, match=f"line 19 has the vertex {index}, counted from the end"
        ):
            read_mesh(obj)
    obj.write_text(whole.replace("v 4 6 2.5", "v 4 6"))
    with pytest.raises(InputError, match=r"line 9 is not a valid vertex \(4 6\)"):
        read_mesh(obj)


@pytest.mark.parametrize("name", ["aws_small_house_collision", "turtlebot3_house_visual"])
def test_recorded_buildings(data_dir: Path, name: str) -> None:
    mesh = read_mesh(data_dir / "mesh3d" / f"{name}.ply")
    assert 2.0 < np.ptp(mesh.bounds, axis=0)[2] < 4.0
    assert mesh.open_edges > 0


@pytest.mark.slow
def test_the_planar_slice_of_a_recorded_building_returns_what_the_mesh_does(data_dir: Path) -> None:
    pytest.importorskip("embreex", reason="embreex is not installed")
    z, reach = 0.31, 12.0
    mesh = read_mesh(data_dir / "mesh3d" / "aws_small_house_visual.ply")
    env = floor_environment(mesh, 0.5, 0.2)
    # Each triangle that the plane cuts leaves a segment, as a wall of 2 cm in height.
    cut = mesh.triangles
    above = cut[..., 2] > z
    cut, above = cut[above.any(axis=1) & ~above.all(axis=1)], above[above.any(1) & ~above.all(1)]
    ends = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        share = (z - cut[:, a, 2]) / np.where(above[:, a] == above[:, b], 1.0, np.diff(
            cut[:, [a, b], 2], axis=1)[:, 0])  # fmt: skip
        point = cut[:, a, :2] + share[:, None] * (cut[:, b, :2] - cut[:, a, :2])
        ends.append(np.where((above[:, a] != above[:, b])[:, None], point, np.nan))
    two = np.stack(ends, axis=1)
    two = two[~np.isnan(two[..., 0])].reshape(-1, 4)
    slice_ = Prisms(two, np.tile((z - 0.01, z + 0.01), (len(two), 1)))
    rng = np.random.default_rng(1)
    x, y = rng.uniform(env.bounds[:2], env.bounds[2:], (400, 2)).T
    x, y = x[env.is_free(x, y, 0.2)], y[env.is_free(x, y, 0.2)]
    rays = SpaceRays.layers(np.zeros(1), rng.uniform(-3, 3, 180), z)
    ours, _, _ = slice_.cast_scans(x, y, np.zeros(len(x)), rays, reach)
    theirs, _, _ = mesh.cast_scans(x, y, np.zeros(len(x)), rays, reach)
    gap = np.abs(np.minimum(ours, reach) - np.minimum(theirs, reach))
    assert len(x) > 100
    # Where a ray grazes the outline of a chair, float32 finds what is behind it.
    assert (gap > 1e-4).mean() < 1e-3
    assert np.median(gap) < 1e-6
