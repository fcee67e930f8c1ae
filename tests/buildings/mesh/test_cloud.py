"""Point clouds: every format gives the same voxels, rays end where the surfaces are."""

from __future__ import annotations

import importlib.util
import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ambinav.buildings.mesh import cloud, cloud_tables
from ambinav.buildings.mesh.cloud import is_cloud, read_cloud
from ambinav.buildings.mesh.cloud_scans import las_points
from ambinav.buildings.mesh.floor import find_floor, floor_environment
from ambinav.buildings.mesh.octomap import read_octomap
from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.space import SpaceRays
from ambinav.runtime.errors import InputError
from tests.buildings.mesh.cloud_files import (
    GRAIN,
    WRITERS,
    Points,
    faces_of,
    pcd_head,
    room,
    write_ascii_ply,
    write_las,
    write_pcd,
    write_ply,
    write_xyz,
)
from tests.geometry.furnished import furnished


@pytest.fixture(scope="module")
def points() -> Points:
    """Off the borders of voxels, which scans of an E57 turn by rounding."""
    return room(300) + GRAIN / 2.0


@pytest.fixture(scope="module")
def voxels(points: Points) -> set[tuple[int, ...]]:
    return set(map(tuple, np.floor(points / 0.0625).astype(int).tolist()))


def same(one: Mesh, other: Mesh) -> bool:
    return np.array_equal(one.vertices, other.vertices) and np.array_equal(one.faces, other.faces)


@pytest.mark.slow
@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same_mesh(
    name: str, points: Points, voxels: set[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (cloud_tables, importlib.import_module("ambinav.buildings.mesh.cloud_scans")):
        monkeypatch.setattr(module, "AT_ONCE", 1000)
    monkeypatch.setattr(cloud_tables, "_LINES_AT_ONCE", 700)
    suffix, write = WRITERS[name]
    path = tmp_path / f"room.{suffix}"
    write(path, points)
    assert is_cloud(path)
    mesh = read_cloud(path, voxel=0.0625)
    write_xyz(tmp_path / "other.xyz", points[::-1])
    assert same(mesh, read_cloud(tmp_path / "other.xyz", voxel=0.0625))
    assert f"{len(points)} points in {len(voxels)} voxels of 0.0625 m" in mesh.notes[-1]
    assert mesh.bounds[0] == pytest.approx((0.0, 0.0, 0.0))


def test_voxels_are_those_that_hold_points(tmp_path: Path) -> None:
    rows = np.array([(0.01, 0.02, 0.03), (0.01, 0.9, 0.9), (0.02, 0.9, 0.9), (-0.01, 0.02, 0.03)])
    write_xyz(tmp_path / "few.xyz", rows)
    mesh = read_cloud(tmp_path / "few.xyz", voxel=0.1)
    # Two beside each other, and one alone.
    assert (len(mesh.faces), mesh.open_edges) == (20 + 12, 0)
    assert mesh.bounds == pytest.approx(np.array([(-0.1, 0.0, 0.0), (0.1, 1.0, 1.0)]))
    kept = read_cloud(tmp_path / "few.xyz", voxel=0.1, points=2, unit="m")
    assert kept.bounds == pytest.approx(np.array([(0.0, 0.9, 0.9), (0.1, 1.0, 1.0)]))
    assert "2 voxels with fewer than 2 points left out" in kept.notes[-1]


@pytest.mark.slow
def test_ranges_are_those_of_the_prisms(tmp_path: Path) -> None:
    pytest.importorskip("embreex", reason="embreex is not installed")
    edge, prisms = 0.05, furnished()[0].space
    assert prisms is not None
    write_ply(tmp_path / "room.ply", room(20_000))
    mesh = read_cloud(tmp_path / "room.ply", voxel=edge)
    rng = np.random.default_rng(2)
    x, y, theta = rng.uniform((0.3, 0.3, -3.0), (5.7, 0.9, 3.0), (60, 3)).T
    rays = SpaceRays.layers(np.radians(np.arange(-60.0, 61.0, 10.0)), np.linspace(-3, 3, 61), 1.0)
    true, _, oblique = prisms.cast_scans(x, y, theta, rays, 12.0)
    ours, _, _ = mesh.cast_scans(x, y, theta, rays, 12.0)
    # No ray gets through a surface; some end on the voxels of a corner that they pass.
    assert (ours <= true + 1e-4).all()
    near = (true - ours) * np.cos(oblique) <= edge * math.sqrt(3.0) + 1e-4
    assert near[oblique < math.radians(75.0)].mean() > 0.985
    assert np.median(true - ours) < edge * math.sqrt(3.0)


@pytest.mark.parametrize(
    ("height", "noise"),
    [
        (0.0, 0.01),
        (0.024, 0.0),
        pytest.param(0.012, 0.0, marks=pytest.mark.slow),
        pytest.param(0.04, 0.01, marks=pytest.mark.slow),
        *(
            pytest.param(height, noise, marks=pytest.mark.sweep)
            for height, noise in ((0.0, 0.0), (0.012, 0.01), (0.024, 0.01), (0.04, 0.0))
        ),
    ],
)  # fmt: skip
def test_the_floor_is_found_wherever_it_lies_among_the_voxels(
    height: float, noise: float, tmp_path: Path
) -> None:
    rng = np.random.default_rng(3)
    some = room(1500)
    some = some + rng.normal(0.0, noise, some.shape) if noise else some
    # Not quite level.
    some[:, 2] += height + 0.004 * some[:, 0]
    write_ply(tmp_path / "room.ply", some)
    mesh = read_cloud(tmp_path / "room.ply")
    assert find_floor(mesh) == pytest.approx(height + 0.04, abs=0.05)
    env = floor_environment(mesh, 0.5, 0.2)
    # Under the table, but not in the cupboard.
    assert 20.0 < env.free.area < 23.5
    assert env.is_free(3.0, 1.5, 0.2) and not env.is_free(5.0, 3.1)
    assert any("points in" in note for note in env.notes)


@pytest.mark.slow
def test_coordinates_of_a_country_are_moved_to_the_origin(tmp_path: Path) -> None:
    few, there = room(300) + GRAIN / 2.0, np.array((412_345.25, 5_678_900.5, 512.0))
    far = few + there
    write_las(tmp_path / "far.las", far)
    mesh = read_cloud(tmp_path / "far.las", voxel=0.0625)
    assert "moved by (-412345, -5678900, 0) m to the origin" in mesh.notes[-1]
    write_xyz(tmp_path / "near.xyz", few)
    near = read_cloud(tmp_path / "near.xyz", voxel=0.0625)
    assert np.array_equal(mesh.vertices, near.vertices + there % (1.0, 1.0, 1e9))
    assert np.array_equal(mesh.faces, near.faces)


@pytest.mark.slow
def test_units_and_axes_are_asked_about_and_not_guessed(tmp_path: Path) -> None:
    few = room(300)
    write_xyz(tmp_path / "mm.xyz", few * 1000.0)
    with pytest.raises(InputError, match=r"more than a building has; say with --unit"):
        read_cloud(tmp_path / "mm.xyz")
    write_xyz(tmp_path / "m.xyz", few)
    metres = read_cloud(tmp_path / "m.xyz", voxel=0.0625)
    assert same(read_cloud(tmp_path / "mm.xyz", voxel=0.0625, unit="mm"), metres)
    write_xyz(tmp_path / "high.xyz", few * (1, 1, 1000))
    with pytest.raises(InputError, match=r"more than a building"):
        read_cloud(tmp_path / "high.xyz")
    write_xyz(tmp_path / "toy.xyz", few / 100.0)
    with pytest.raises(InputError, match="no robot drives in it"):
        read_cloud(tmp_path / "toy.xyz", voxel=0.005)
    write_xyz(tmp_path / "side.xyz", few[:, [0, 2, 1]])
    with pytest.raises(InputError, match="y may be up in it"):
        read_cloud(tmp_path / "side.xyz")
    assert np.ptp(read_cloud(tmp_path / "side.xyz", up="y").bounds, axis=0)[2] < 2.7


@pytest.mark.slow
def test_a_cloud_with_y_up_is_the_one_that_was_turned(points: Points, tmp_path: Path) -> None:
    """Cell by cell: x stays, and what was y points against z."""
    write_xyz(tmp_path / "z.xyz", points)
    write_xyz(tmp_path / "y.xyz", np.column_stack([points[:, 0], points[:, 2], -points[:, 1]]))
    upright, turned = (
        read_cloud(tmp_path / f"{up}.xyz", voxel=0.0625, up=up).vertices for up in "zy"
    )
    assert np.array_equal(np.unique(turned, axis=0), np.unique(upright, axis=0))


@pytest.mark.slow
def test_feet_and_degrees_of_a_las_file(tmp_path: Path) -> None:
    laspy = pytest.importorskip("laspy", reason="laspy is not installed")
    for extended, text, wanted in (
        (False, 'PROJCS["x",UNIT["US survey foot",0.3048]]', "in feet; say with --unit"),
        (True, 'PROJCS["x",UNIT["US survey foot",0.3048]]', "in feet; say with --unit"),
        (False, 'GEOGCS["WGS 84",UNIT["degree",0.01745]]', "longitude and latitude in degrees"),
    ):
        header = laspy.LasHeader(point_format=6, version="1.4")
        record = laspy.vlrs.known.WktCoordinateSystemVlr(text)
        if extended:
            header.evlrs = laspy.vlrs.vlrlist.VLRList([record])
        else:
            header.vlrs.append(record)
        found = laspy.LasData(header)
        found.x, found.y, found.z = room(300).T / 0.3048
        found.write(str(tmp_path / "feet.las"))
        with pytest.raises(InputError, match=wanted):
            read_cloud(tmp_path / "feet.las")
        if "foot" in text:
            assert np.ptp(read_cloud(tmp_path / "feet.las", unit="ft").bounds, axis=0)[0] < 6.2


@pytest.mark.parametrize("name", WRITERS)
def test_cut_off_files_are_refused(name: str, points: Points, tmp_path: Path) -> None:
    suffix, write = WRITERS[name]
    path = tmp_path / f"room.{suffix}"
    write(path, points)
    whole = path.read_bytes()
    for share in (0.6, 0.02):
        path.write_bytes(whole[: int(share * len(whole))])
        if suffix in ("txt", "XYZ"):
            # Nothing says how many lines there were.
            path.write_bytes(path.read_bytes() + b"\n1.0\n")
        with pytest.raises(InputError) as caught:
            read_cloud(path)
        assert str(path) in str(caught.value)


@pytest.mark.parametrize(("name", "content", "text"), [
    ("empty.xyz", b"", "no point in it"),
    ("words.txt", b"a letter to my aunt\nwith two lines\n", "no point in it"),
    ("words.xyz", b"1 2 3\n1 two 3\n1 2 3\n", "after 1 points a line is not x, y and z, '1 two 3'"),
    ("comma.xyz", b"0,1;0,2;0,3\n", "after 0 points .* give numbers with decimal points"),
    ("flat.xyz", b"1 2\n3 4\n", "there is no point in it"),
    ("binary.xyz", bytes(range(128, 256)) * 9, "not a text of numbers"),
    ("odd.xyz", b"nan 1 2\ninf 1 2\n1 nan nan\n", "no point in it|none of its"),
    ("infinite.xyz", b"1 inf 2\n-inf 1 2\n1 nan nan\n", "none of its 3 points is finite|not x, y"),
    ("text.las", b"1 2 3\n4 5 6\n", "cannot be read as LAS"),
    ("text.laz", b"1 2 3\n4 5 6\n", "cannot be read as LAZ"),
    ("text.e57", b"1 2 3\n4 5 6\n", "cannot be read as E57"),
    ("text.pcd", b"1 2 3\n4 5 6\n", "no header of a PCD file"),
    ("text.ply", b"1 2 3\n4 5 6\n", "no header of a PLY file"),
    ("none.ply", b"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\n"
     b"property float z\nend_header\n", "it has no points"),
    ("less.ply", b"ply\nformat ascii 1.0\nelement vertex -5\nend_header\n", "vertex is '-5'"),
    ("less.pcd", pcd_head(np.zeros((1, 3)), "ascii").replace(b"POINTS 1", b"POINTS -5"),
     "POINTS is '-5'"),
    ("two.pcd", pcd_head(np.zeros((1, 3)), "ascii").replace(b"FIELDS x", b"FIELDS q"), "no x, y"),
    ("kind.pcd", pcd_head(np.zeros((1, 3)), "zip"), "DATA is 'zip'"),
    ("points.step", b"1 2 3\n", r"\.step names no format of points"),
])  # fmt: skip
def test_refused_files(name: str, content: bytes, text: str, tmp_path: Path) -> None:
    needed = {".las": "laspy", ".laz": "laspy", ".e57": "pye57"}.get(Path(name).suffix)
    if needed:
        pytest.importorskip(needed, reason=f"{needed} is not installed")
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InputError, match=text) as caught:
        read_cloud(path)
    assert str(path) in str(caught.value)


def test_refused_arguments(tmp_path: Path) -> None:
    path = tmp_path / "few.xyz"
    write_xyz(path, room(100))
    for fields, text in (
        ({"voxel": 0.0}, "voxel is 0.0"), ({"voxel": math.nan}, "voxel is nan"),
        ({"voxel": 1e-7}, "voxels apart, more than can be counted"),
        ({"points": 0}, "points is 0"), ({"points": 10**6}, "no voxel holds 1000000 of its"),
        ({"unit": "inch"}, "unit is 'inch'"), ({"up": "w"}, "up is 'w'"),
    ):  # fmt: skip
        with pytest.raises(InputError, match=text):
            read_cloud(path, **fields)
    with pytest.raises(InputError, match="no such file"):
        read_cloud(tmp_path / "none.xyz")


def test_more_voxels_than_memory_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cloud, "MOST_VOXELS", 100)
    write_xyz(tmp_path / "few.xyz", room(100))
    with pytest.raises(InputError, match="give larger ones with voxel"):
        read_cloud(tmp_path / "few.xyz")


def test_points_that_are_not_finite_are_left_out_and_counted(tmp_path: Path) -> None:
    some = room(300)
    some[::7] = np.nan
    write_pcd(tmp_path / "holes.pcd", some)
    assert (
        f"{len(some[::7])} points that are not finite left out"
        in (read_cloud(tmp_path / "holes.pcd").notes[-1])
    )


def test_no_points_in_a_las_file_and_faces_in_a_ply(tmp_path: Path) -> None:
    write_ascii_ply(tmp_path / "mesh.ply", room(100))
    path = tmp_path / "mesh.ply"
    path.write_text(path.read_text().replace("face 0", "face 1") + "3 0 1 2\n")
    assert not is_cloud(path)
    with pytest.raises(InputError, match="it has faces; read it as a mesh"):
        read_cloud(path)
    laspy = pytest.importorskip("laspy", reason="laspy is not installed")
    laspy.LasData(laspy.LasHeader(point_format=3, version="1.2")).write(str(tmp_path / "none.las"))
    with pytest.raises(InputError, match="it has no points"):
        read_cloud(tmp_path / "none.las")


@pytest.mark.parametrize("suffix", ["las", "laz"])
@pytest.mark.parametrize("version", ["1.2", "1.4"])
def test_a_header_with_more_records_than_the_file_can_hold(
    tmp_path: Path, version: str, suffix: str
) -> None:
    """Its reader would make them all, or end the interpreter."""
    laspy = pytest.importorskip("laspy", reason="laspy is not installed")
    found = laspy.LasData(laspy.LasHeader(point_format=3, version=version))
    found.x, found.y, found.z = np.random.default_rng(0).uniform(0.0, 9.0, (3, 200))
    path = tmp_path / f"room.{suffix}"
    found.write(str(path))
    assert len(np.concatenate([*las_points(path, [], None)])) == 200
    whole = path.read_bytes()
    damaged = [(100, "<I", 2**31)]  # records
    if version == "1.4":
        damaged.append((243, "<I", 2**31))  # extended ones
    if suffix == "laz":
        points = int.from_bytes(whole[96:100], "little")
        table = int.from_bytes(whole[points : points + 8], "little")
        damaged += [(table + 4, "<I", 2**32 - 1), (points, "<q", 2**60)]  # chunks, their table
    for at, kind, value in damaged:
        content = bytearray(whole)
        struct.pack_into(kind, content, at, value)
        path.write_bytes(content)
        with pytest.raises(InputError, match="its header is damaged or it is cut off"):
            list(las_points(path, [], None))


def test_points_that_an_e57_calls_invalid_and_spheres(tmp_path: Path) -> None:
    pye57 = pytest.importorskip("pye57", reason="pye57 is not installed")
    some = room(300)
    bad = np.zeros(len(some), dtype=np.int8)
    bad[::3] = 2
    data = {f"cartesian{a}": some[:, k].copy() for k, a in enumerate("XYZ")}
    with pye57.E57(str(tmp_path / "room.e57"), mode="w") as file:
        file.write_scan_raw({**data, "cartesianInvalidState": bad})
    assert f"{int((bad == 0).sum())} points in" in read_cloud(tmp_path / "room.e57").notes[-1]
    scans = importlib.import_module("ambinav.buildings.mesh.cloud_scans")
    flat = np.hypot(some[:, 0], some[:, 1])
    sphere = np.stack([np.hypot(flat, some[:, 2]), np.arctan2(some[:, 1], some[:, 0]),
                       np.arctan2(some[:, 2], flat)], axis=1)  # fmt: skip
    assert np.allclose(scans._cartesian(sphere), some, atol=1e-12)


@pytest.mark.parametrize(("suffix", "package"), [("laz", "laspy"), ("las", "lazrs"),
                                                 ("e57", "pye57")])  # fmt: skip
def test_a_missing_package_is_named(
    suffix: str, package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"room.{suffix}"
    path.touch()
    found = importlib.util.find_spec
    monkeypatch.setattr(
        "ambinav.runtime.packages.find_spec",
        lambda name: None if name == package else found("json"),
    )
    with pytest.raises(InputError, match=rf'needs {package}; run: pip install "ambinav\[clouds\]"'):
        read_cloud(path)


@pytest.mark.sweep
def test_voxels_of_a_recorded_building_are_those_of_its_octomap(data_dir: Path) -> None:
    folder = data_dir / "mesh3d"
    centres = read_cloud(folder / "geb079_occupied_voxels.ply", voxel=0.08)
    octree = read_octomap(folder / "geb079.bt")
    assert np.array_equal(centres.vertices, octree.vertices)
    # In another order.
    faces = [np.unique(mesh.faces, axis=0) for mesh in (centres, octree)]
    assert np.array_equal(*faces) and len(centres.faces) == len(octree.faces)
    floors = [floor_environment(mesh, 0.5, 0.2) for mesh in (centres, octree)]
    assert floors[0].floor == floors[1].floor
    assert floors[0].free.area == pytest.approx(floors[1].free.area)
    assert floors[0].free.area > 80.0


POINTS = [(x, y, z) for x in (0.0, 1.0, 2.0) for y in (0.0, 1.0) for z in (0.0, 2.0)]


@pytest.mark.parametrize(
    "start", ["", "\ufeff", "# x,y,z\n", "Östlich Nördlich Höhe\n", "(x y z)\n", "12\n"]
)
def test_empty_lines_and_comments_are_no_points(tmp_path: Path, start: str) -> None:
    plain, odd = tmp_path / "plain.xyz", tmp_path / "odd.xyz"
    plain.write_text("\n".join(f"{x},{y},{z}" for x, y, z in POINTS))
    odd.write_text(start + "\n# here\n\n".join(f"{x},{y},{z}" for x, y, z in POINTS))
    spaced = tmp_path / "spaced.xyz"
    spaced.write_text("\n".join(f"{x} {y} {z} # a, b" for x, y, z in POINTS))
    assert np.array_equal(read_cloud(plain, up="z").vertices, read_cloud(spaced, up="z").vertices)
    assert np.array_equal(read_cloud(plain, up="z").vertices, read_cloud(odd, up="z").vertices)


def test_a_pcd_with_an_empty_line_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "room.pcd"
    head = (
        "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH %d\nHEIGHT 1\n"
        "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS %d\nDATA ascii\n"
    )
    rows = "\n\n".join(f"{x} {y} {z}" for x, y, z in POINTS)
    path.write_text(head % (len(POINTS), len(POINTS)) + rows)
    assert f"{len(POINTS)} points" in read_cloud(path, up="z").notes[-1]


@pytest.mark.parametrize("cameras", [0, 2])
def test_vertices_of_a_text_ply_may_follow_other_elements(tmp_path: Path, cameras: int) -> None:
    path, plain = tmp_path / "camera.ply", tmp_path / "plain.xyz"
    rows = "\n".join(f"{x} {y} {z}" for x, y, z in POINTS)
    path.write_text(
        f"ply\nformat ascii 1.0\nelement camera {cameras}\nproperty list uchar int seen\n"
        f"element vertex {len(POINTS)}\nproperty float x\nproperty float y\nproperty float z\n"
        "end_header\n" + "2 5 6\n" * cameras + rows
    )
    plain.write_text(rows)
    assert same(read_cloud(path, up="z"), read_cloud(plain, up="z"))
    path.write_text(path.read_text().removesuffix("2.0") + "2.")
    assert len(read_cloud(path, up="z").vertices)
    path.write_text(path.read_text().removesuffix(" 2."))
    with pytest.raises(InputError, match="cut off: there are 11 points of 12"):
        read_cloud(path, up="z")


def test_a_field_of_a_pcd_may_hold_nothing(tmp_path: Path) -> None:
    path, plain = tmp_path / "room.pcd", tmp_path / "plain.xyz"
    plain.write_text("\n".join(f"{x} {y} {z}" for x, y, z in POINTS))
    head = (
        "VERSION .7\nFIELDS x y z label\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 0\n"
        f"WIDTH {len(POINTS)}\nHEIGHT 1\nDATA binary\n"
    )
    path.write_bytes(head.encode() + np.array(POINTS, dtype="<f4").tobytes())
    assert same(read_cloud(path, up="z"), read_cloud(plain, up="z"))


@pytest.mark.sweep
@pytest.mark.parametrize(("degrees", "axis"), [(0.5, (0.6, -0.8)), (3.0, (1.0, 0.0))])
def test_a_tilted_cloud_is_levelled(
    tmp_path: Path, degrees: float, axis: tuple[float, float]
) -> None:
    """Of a hall of 20 by 14 m; tilted by half a degree, most of its floor was lost."""
    rng = np.random.default_rng(2)
    hall = np.concatenate(
        [faces_of((0, 0, 0), (20, 14, 3), 500, rng), faces_of((4, 4, 0), (6, 9, 1), 500, rng)]
    )
    areas = []
    for tilt in (0.0, math.radians(degrees)):
        skew = np.array([[0.0, 0.0, axis[1]], [0.0, 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
        turn = np.eye(3) + math.sin(tilt) * skew + (1.0 - math.cos(tilt)) * skew @ skew
        path = tmp_path / f"{tilt:.3f}.ply"
        write_ply(path, hall @ turn.T + (300.0, -200.0, 5.0))
        found = read_cloud(path, voxel=0.1)
        assert any("levelled" in note for note in found.notes) == (tilt > 0.0)
        areas.append(floor_environment(found, 0.5, 0.2).free.area)
    assert areas[1] == pytest.approx(areas[0], rel=0.02)
