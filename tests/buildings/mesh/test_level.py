"""A mesh whose floor is tilted is levelled, and strays below the floor change nothing."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from ambinav.buildings.mesh.floor import find_floor, floor_environment
from ambinav.buildings.mesh.level import levelled
from ambinav.buildings.mesh.read import read_mesh
from ambinav.casting.mesh.mesh import Mesh
from tests.buildings.mesh.test_floor import FLOOR, TABLE, WALLS, boxes
from tests.casting.mesh.test_mesh import BOX, corners

trimesh = pytest.importorskip("trimesh", reason="trimesh is not installed")


def tilted(mesh: Mesh, path: Path, degrees: float, axis: tuple[float, float, float]) -> Path:
    """Write a mesh, turned."""
    turn = trimesh.transformations.rotation_matrix(math.radians(degrees), axis)[:3, :3]
    trimesh.Trimesh(mesh.vertices @ turn.T, mesh.faces, process=False).export(path)
    return path


AXES = [(1.0, 0.0, 0.0), (0.6, -0.8, 0.0), (-0.3, 1.0, 0.0)]


@pytest.mark.parametrize("degrees", [0.2, 0.5, 1.0, 3.0, 8.0])
@pytest.mark.parametrize("axis", AXES)
def test_a_tilted_floor_is_levelled(
    tmp_path: Path, degrees: float, axis: tuple[float, float, float]
) -> None:
    mesh = boxes(FLOOR, *WALLS, TABLE)
    level = floor_environment(mesh, 0.5, 0.2)
    found = read_mesh(tilted(mesh, tmp_path / "tilted.ply", degrees, axis), up="z", unit="m")
    (note,) = found.notes
    assert note.endswith(f"its floor was tilted by {degrees:.2f} degrees and is levelled.")
    env = floor_environment(found, 0.5, 0.2)
    # The lattice of cells lies anew: a row of them at two walls is 2.5 % of the room.
    assert env.free.area == pytest.approx(level.free.area, rel=0.04)
    assert any("levelled" in note for note in env.notes)
    steep = np.abs(found.surface_normal[:, 2])
    assert np.isclose(steep, 1.0, atol=1e-9).sum() == np.isclose(
        np.abs(mesh.surface_normal[:, 2]), 1.0
    ).sum()  # fmt: skip


def test_what_is_level_or_a_ramp_stays_bit_for_bit(tmp_path: Path) -> None:
    mesh = boxes(FLOOR, *WALLS, TABLE)
    path = tilted(mesh, tmp_path / "level.ply", 0.0, AXES[0])
    assert levelled(mesh) is mesh and read_mesh(path, up="z", unit="m").notes == ()
    slopes = [corners(6.0, 4.0, 0.1) + np.array([0.0, 6.0 * k, 0.0]) for k in range(4)]
    for k, ramp in enumerate(slopes):  # no two alike, none with half of the area
        ramp[:, 2] += 0.02 * (k + 1) * ramp[:, 0]
    faces = np.concatenate([np.array(BOX) + 8 * k for k in range(4)])
    ramps = Mesh(np.concatenate(slopes), faces)
    assert levelled(ramps) is ramps


def test_strays_below_the_floor_change_nothing() -> None:
    room = [FLOOR, *WALLS, TABLE]
    for deep in (1.0, 4.0, 30.0):
        strays = [(1.0 + k, 1.0, -deep, 0.1, 0.1, 0.001) for k in range(3)]
        assert find_floor(boxes(*room, *strays)) == find_floor(boxes(*room))
    lower_room = [(*part[:2], part[2] - 4.0, *part[3:]) for part in room]
    assert find_floor(boxes(*room, *lower_room)) == pytest.approx(-4.0)


@pytest.mark.slow(kept=("aws_small_house_collision",))
@pytest.mark.parametrize("name", ["aws_small_house_collision", "turtlebot3_house_collision"])
def test_recorded_houses_that_are_tilted(data_dir: Path, tmp_path: Path, name: str) -> None:
    mesh = read_mesh(data_dir / "mesh3d" / f"{name}.ply")
    assert mesh.notes == ()
    floor = 0.0 if name.startswith("turtlebot3") else None  # it has no faces there
    level = floor_environment(mesh, 0.3, 0.2, floor=floor)
    for degrees, axis in itertools.product((0.2, 0.5, 1.0, 3.0), AXES):
        found = read_mesh(tilted(mesh, tmp_path / "tilted.ply", degrees, axis))
        area = floor_environment(found, 0.3, 0.2, floor=floor).free.area
        assert area == pytest.approx(level.free.area, rel=0.01), (degrees, axis)
