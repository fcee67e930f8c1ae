"""The environment: what is free, bounds, turning and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import DRAWING_STD, MAPPING_STD, Environment
from ambinav.geometry.segments import Segments
from ambinav.runtime.errors import InputError
from tests.geometry import scenes

DEMO = Path(__file__).parents[2] / "configs" / "demo.geojson"


@pytest.fixture(scope="module")
def hall() -> Environment:
    return scenes.scene(1)


def test_free_is_a_plain_bool_or_an_array(hall: Environment) -> None:
    env = scenes.room(4.0, 3.0)
    assert env.is_free(1.0, 1.0) is True
    assert env.is_free(-1.0, 1.0) is False
    assert env.is_free(1.0, 1.0, 0.5) is True
    answer = env.is_free([[1.0], [9.0]], [1.0, 2.0, 3.5])
    assert np.asarray(answer).tolist() == [[True, True, False], [False, False, False]]


def test_not_a_number_is_not_free() -> None:
    env = scenes.room(4.0, 3.0)
    assert env.is_free(math.nan, 1.0) is False
    assert env.is_free(1.0, math.inf) is False
    assert env.is_free([1.0, math.nan], 1.0, 0.2).tolist() == [True, False]


@pytest.mark.parametrize("radius", [0.0, 0.1, 0.35, 1.2])
def test_a_disc_is_free_where_shapely_says_so(hall: Environment, radius: float) -> None:
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-1, 51, (2, 5000))
    points = shapely.points(x, y)
    lines = shapely.multilinestrings(shapely.linestrings(hall.segments.xy.reshape(-1, 2, 2)))
    away = shapely.distance(points, lines)
    expected = shapely.contains(hall.free, points) & (away >= radius)
    clear = np.abs(away - radius) > 1e-5
    assert (np.asarray(hall.is_free(x, y, radius)) == expected)[clear].all()


def test_a_disc_touching_a_wall_is_free() -> None:
    env = scenes.room(4.0, 3.0)
    assert env.is_free(0.5, 1.0, 0.5) is True
    assert env.is_free(0.4999, 1.0, 0.5) is False


def test_bounds_take_in_segments_and_free_space() -> None:
    box = shapely.box(0, 0, 5, 3)
    xy = np.vstack([scenes.rings(box), [[-1.0, 0, 7, 0]]])
    assert Environment(Segments(xy, np.zeros(5)), box).bounds == (-1.0, 0.0, 7.0, 3.0)


def test_walls_are_as_sure_as_the_map() -> None:
    box = shapely.box(0, 0, 5, 3)
    walls = Segments(scenes.rings(box), np.zeros(4))
    assert Environment(walls, box).map_std == DRAWING_STD
    for cell in (0.025, 0.05, 0.1):
        assert Environment(walls, box, resolution=cell).map_std == MAPPING_STD


def test_turning_changes_nothing_that_a_robot_sees(hall: Environment) -> None:
    angle, dx, dy = 0.7, 3.0, -5.0
    turned = hall.transformed(angle, dx, dy)
    assert (turned.name, turned.notes) == (hall.name, hall.notes)
    assert turned.free.area == pytest.approx(hall.free.area)
    xy = scenes.points_inside(hall, 500, seed=4)
    c, s = math.cos(angle), math.sin(angle)
    x, y = c * xy[:, 0] - s * xy[:, 1] + dx, s * xy[:, 0] + c * xy[:, 1] + dy
    look = np.random.default_rng(1).uniform(-3, 3, len(xy))
    assert np.asarray(turned.is_free(x, y)).all()
    assert np.asarray(turned.clearance(x, y)) == pytest.approx(np.asarray(hall.clearance(*xy.T)))
    assert np.asarray(turned.cast(x, y, look + angle, 90.0)) == pytest.approx(
        np.asarray(hall.cast(*xy.T, look, 90.0)), abs=1e-6
    )


def test_no_free_space_or_nothing_around_it_is_refused() -> None:
    wall = Segments(np.array([[0.0, 0, 5, 0]]), np.zeros(1))
    with pytest.raises(InputError, match="no free space"):
        Environment(wall, shapely.Polygon())
    with pytest.raises(InputError, match="nothing bounds"):
        Environment(Segments(np.empty((0, 4)), np.empty(0)), shapely.box(0, 0, 1, 1))


def test_what_is_wrong_is_said_with_the_file() -> None:
    with pytest.raises(InputError, match=r"office\.yaml: there is no free space"):
        Environment(
            Segments(np.array([[0.0, 0, 5, 0]]), np.zeros(1)),
            shapely.Polygon(),
            source=Path("office.yaml"),
        )


def test_unknown_suffix_and_options_that_do_not_fit(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.stl names no known format"):
        load_environment(tmp_path / "house.stl")
    with pytest.raises(InputError, match="buildings are read from files of this machine"):
        load_environment("s3://maps/house.yaml")
    with pytest.raises(InputError, match="tolerance means nothing for a drawn plan"):
        load_environment(DEMO, tolerance=0.1)


def test_the_demo_tells_its_size_in_its_repr() -> None:
    env = load_environment(DEMO)
    assert env.name in repr(env) and f"{len(env.segments)} segments" in repr(env)


ROOM = np.array([[0.0, 0, 8, 0], [8, 0, 8, 4], [8, 4, 0, 4], [0, 4, 0, 0]])
HALL = shapely.box(0, 0, 8, 4)


def bounded_by(xy: np.ndarray, free: shapely.Geometry = HALL) -> Environment:
    return Environment(Segments(xy, np.zeros(len(xy))), free, name="hall")


def test_a_border_without_a_segment_is_refused_with_the_place() -> None:
    with pytest.raises(InputError, match=r"hall: no segment .* for 4 m around \(8, 2\); "):
        bounded_by(ROOM[[0, 2, 3]])
    # 1.5 m are open in the lower wall; 0.3 m in the upper one are no longer the worst.
    open_walls = np.array(
        [[0, 0, 3, 0], [4.5, 0, 8, 0], [8, 0, 8, 4], [8, 4, 5, 4], [4.7, 4, 0, 4], [0, 4, 0, 0.0]]
    )
    with pytest.raises(InputError, match=r"for 1.5 m around \(3.75, 0\)"):
        bounded_by(open_walls)
    # Around a corner: two sides are one stretch, its middle 2 m from the corner.
    with pytest.raises(InputError, match=r"for 12 m around \(6, 4\)"):
        bounded_by(ROOM[[0, 3]])
    # A pillar that nothing stands on, and a segment that only crosses the border.
    pillar = HALL - shapely.box(2, 2, 3, 3)
    with pytest.raises(InputError, match="for 4 m around"):
        bounded_by(ROOM, pillar)
    with pytest.raises(InputError, match=r"for 4 m around \(8, 2\)"):
        bounded_by(np.vstack([ROOM[[0, 2, 3]], [[7.0, 2.0, 9.0, 2.0]]]))
    # What an intersection leaves over is no border.
    bounded_by(ROOM, shapely.GeometryCollection([HALL, shapely.LineString([(9, 0), (9, 4)])]))
    # A centimetre beside the border is not on it.
    with pytest.raises(InputError, match=r"for 4 m around \(8, 2\)"):
        bounded_by(np.vstack([ROOM[[0, 2, 3]], [[7.99, 0.0, 7.99, 4.0]]]))


@pytest.mark.parametrize("seed", range(5))
def test_a_border_that_is_covered_piece_by_piece_is_taken(seed: int) -> None:
    # Any pieces, overlapping, either way round, longer than the wall, off by rounding.
    rng = np.random.default_rng(seed)
    pieces = []
    for a, b in zip(ROOM[:, :2], ROOM[:, 2:], strict=True):
        cuts = np.concatenate([[-0.1], np.sort(rng.uniform(0, 1, 6)), [1.1]])
        for low, high in zip(cuts, cuts[1:] + 0.02 * rng.random(7)[: len(cuts) - 1], strict=False):
            ends = np.array([a + low * (b - a), a + high * (b - a)])
            pieces.append(ends[:: rng.choice([-1, 1])].ravel())
    xy = np.array(pieces) + rng.uniform(-1e-9, 1e-9, (len(pieces), 4))
    env = bounded_by(xy)
    # Far from the origin, turned, coordinates are rounded to a hundredth of a micrometre.
    env.transformed(0.7, 5e5, -4e6)
    # One piece less leaves its stretch bare, if the others do not cover it.
    lengths = np.hypot(xy[:, 2] - xy[:, 0], xy[:, 3] - xy[:, 1])
    with pytest.raises(InputError, match="no segment lies on the border"):
        bounded_by(np.delete(xy, int(np.argmax(lengths)), axis=0))
