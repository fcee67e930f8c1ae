"""The floor of a mesh and the free space of a robot on it, in a room with a table and a shelf."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from ambinav.buildings.mesh.floor import find_floor, floor_environment
from ambinav.casting.mesh.mesh import Mesh
from ambinav.runtime.errors import InputError, InputWarning
from tests.casting.mesh.test_mesh import BOX, corners


def boxes(*parts: tuple[float, float, float, float, float, float]) -> Mesh:
    """Boxes: x, y, z of the lowest corner, and their sizes."""
    vertices = [corners(*part[3:]) + part[:3] for part in parts]
    faces = [np.array(BOX) + 8 * k for k in range(len(parts))]
    return Mesh(np.concatenate(vertices), np.concatenate(faces), name="room")


WALLS = [(0, 0, 0, 6, 0.2, 3), (0, 3.8, 0, 6, 0.2, 3), (0, 0, 0, 0.2, 4, 3), (5.8, 0, 0, 0.2, 4, 3)]
FLOOR = (0, 0, -0.1, 6, 4, 0.1)
TABLE = (2, 1, 0.7, 2, 1, 0.05)
SILL = (1, 3, 0, 1, 0.4, 0.02)


def test_the_floor_is_the_largest_level_surface_near_the_bottom() -> None:
    assert find_floor(boxes(FLOOR, *WALLS, TABLE)) == pytest.approx(0.0, abs=1e-6)
    assert find_floor(boxes((0, 0, -0.3, 6, 4, 0.3))) == pytest.approx(0.0, abs=1e-6)
    raised = boxes(*((*part[:2], part[2] + 4.0, *part[3:]) for part in [FLOOR, *WALLS]))
    assert find_floor(raised) == pytest.approx(4.0, abs=1e-6)


def test_a_robot_drives_under_a_table_that_is_higher_than_itself() -> None:
    mesh = boxes(FLOOR, *WALLS, TABLE, SILL)
    low = floor_environment(mesh, 0.5, 0.2, floor=0.0)
    high = floor_environment(mesh, 1.2, 0.2, floor=0.0)
    assert low.is_free(3.0, 1.5, 0.2) and not high.is_free(3.0, 1.5)
    for env in (low, high):
        assert env.is_free(1.5, 3.2, 0.2)  # over the sill, which is lower than a step
        assert env.is_free(5.0, 3.0, 0.2)
        assert not env.is_free(0.1, 2.0) and not env.is_free(0.3, 2.0, 0.2)
        assert env.bounds == pytest.approx((0.2, 0.2, 5.8, 3.8), abs=0.12)
    assert not floor_environment(mesh, 0.5, 0.2, floor=0.0, step=0.01).is_free(1.5, 3.2)
    assert low.checksum != high.checksum


def test_where_there_is_no_floor_is_a_frontier() -> None:
    half = floor_environment(boxes((0, 0, -0.1, 3, 4, 0.1), *WALLS), 0.5, 0.2)
    assert half.is_free(1.5, 2.0, 0.2) and not half.is_free(4.5, 2.0)
    assert (~half.segments.walls).any()
    whole = floor_environment(boxes((0, 0, -0.1, 3, 4, 0.1), *WALLS), 0.5, 0.2, floor=0.0)
    assert whole.is_free(4.5, 2.0, 0.2)


def test_a_ramp_and_a_threshold() -> None:
    # A step of 0.2 m parts the room, whatever the robot's height.
    mesh = boxes(FLOOR, *WALLS, (3, 0, 0, 3, 4, 0.2))
    env = floor_environment(mesh, 0.5, 0.2, floor=0.0)
    assert env.is_free(1.5, 2.0) and not env.is_free(4.5, 2.0)
    upper = floor_environment(mesh, 0.5, 0.2, floor=0.2)
    assert upper.is_free(4.5, 2.0)


def test_a_part_of_the_floor_that_is_raised_is_said() -> None:
    mesh = boxes(FLOOR, *WALLS, (3, 0, 0, 3, 4, 0.4))
    with pytest.warns(InputWarning, match=r"12 m² in 1 piece is not .* give its height, floor"):
        env = floor_environment(mesh, 0.5, 0.2)
    assert any("up to a metre above the floor" in note for note in env.notes)
    assert not any("up to a metre" in n for n in floor_environment(mesh, 0.5, 0.2, floor=0.0).notes)
    table = floor_environment(boxes(FLOOR, *WALLS, TABLE), 0.5, 0.2)
    assert not any("up to a metre" in note for note in table.notes)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"height": 0.0}, "height is 0.0"),
        ({"height": math.nan}, "height is nan"),
        ({"height": 0.5, "cell": 0.0}, "cell is 0.0"),
        ({"height": 0.5, "floor": 9.0}, "floor is 9.0 and the mesh stands from"),
        ({"height": 0.5, "radius": 3.0}, "and 3 m radius fits nowhere"),
    ],
)
def test_refused(arguments: dict[str, float], text: str) -> None:
    with pytest.raises(InputError, match=text):
        floor_environment(boxes(FLOOR, *WALLS), **{"radius": 0.2, **arguments})


def test_no_floor_is_said() -> None:
    with pytest.raises(InputError, match="no floor is found in it"):
        find_floor(boxes(*WALLS))


def test_recorded_buildings(data_dir: Path) -> None:
    pytest.importorskip("trimesh", reason="trimesh is not installed")
    from ambinav.buildings.mesh.read import read_mesh

    env = floor_environment(read_mesh(data_dir / "mesh3d" / "aws_small_house_visual.ply"), 0.5, 0.2)
    assert 120.0 < env.free.area < 200.0
    with pytest.raises(InputError, match="no floor is found"):
        find_floor(read_mesh(data_dir / "mesh3d" / "turtlebot3_house_collision.ply"))
