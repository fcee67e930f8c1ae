"""Obstacles added and parts removed: known rooms, and random edits against plain geometry."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import ambinav as an
from ambinav.buildings.boundary import environment_from_grid
from ambinav.geometry.obstacle import Obstacle
from ambinav.geometry.occupancy_grid import OCCUPIED, OccupancyGrid
from ambinav.geometry.segments import FRONTIER, REFLECTOR, WALL, edges_of
from ambinav.maps.content_digest import environment_digest
from tests.geometry import scenes


@pytest.fixture
def hall() -> an.Environment:
    """10 x 6 m, a wall at x = 3 from y = 0 to 4, a block, and an opening in the east."""
    return an.environment_from_shapes(
        [shapely.box(0, 0, 10, 6)],
        [shapely.box(6, 2, 7, 3)],
        [[(3, 0), (3, 4)]],
        [[(10, 2), (10, 4)]],
    )


def kept(before: an.Environment, after: an.Environment) -> np.ndarray:
    """Rows of the first that the second has, in the second's order."""
    known = {row.tobytes(): k for k, row in enumerate(before.segments.xy)}
    return np.array([known[r.tobytes()] for r in after.segments.xy if r.tobytes() in known])


def test_a_post_is_met_by_rays_and_robots(hall: an.Environment) -> None:
    edited = hall.edited([Obstacle.post(5.0, 5.0, 0.3)])
    assert edited.cast(4.0, 5.0, 0.0, 9.0) == pytest.approx(0.7, abs=1e-3)
    assert hall.free.area - edited.free.area == pytest.approx(math.pi * 0.09, rel=0.01)
    assert not edited.is_free(5.0, 5.0)
    assert not edited.is_free(4.4, 5.0, radius=0.4)
    assert edited.is_free(4.4, 5.0, radius=0.25)
    assert (kept(hall, edited) == np.arange(len(hall.segments))).all()


def test_a_needle_is_met_too(hall: an.Environment) -> None:
    edited = hall.edited([Obstacle.post(5.0, 5.0, 1e-4)])
    assert edited.cast(4.0, 5.0, 0.0, 9.0) == pytest.approx(1.0, abs=1e-3)


def test_a_wall_without_thickness_stands_in_the_way(hall: an.Environment) -> None:
    edited = hall.edited([Obstacle.panel(4.0, 1.0, 5.0, 1.0)])
    assert edited.cast(4.5, 0.5, math.pi / 2, 9.0) == pytest.approx(0.5, abs=1e-12)
    assert edited.free is hall.free
    np.testing.assert_array_equal(edited.segments.xy[-1], [4.0, 1.0, 5.0, 1.0])
    assert len(edited.segments) == len(hall.segments) + 1


def test_a_wall_is_cut_to_the_floor(hall: an.Environment) -> None:
    edited = hall.edited([Obstacle.wall([(5.0, 5.0), (5.0, 8.0)])])
    np.testing.assert_allclose(edited.segments.xy[-1], [5.0, 5.0, 5.0, 6.0], atol=1e-12)


def test_an_obstacle_parts_a_thin_wall_that_it_stands_on(hall: an.Environment) -> None:
    edited = hall.edited([Obstacle.panel(2.0, 2.0, 4.0, 2.0, 0.2)])
    rows = {tuple(row) for row in edited.segments.xy.round(9).tolist()}
    assert {(3.0, 0.0, 3.0, 1.9), (3.0, 2.1, 3.0, 4.0)} <= rows
    assert (3.0, 0.0, 3.0, 4.0) not in rows


def test_an_obstacle_at_a_wall_leaves_the_wall_whole(hall: an.Environment) -> None:
    """Its middle is hidden: it is no wall within the free space for that."""
    edited = hall.edited([Obstacle(shapely.box(4.0, 5.5, 6.0, 6.5))])
    assert (kept(hall, edited) == np.arange(len(hall.segments))).all()
    assert len(edited.thin_walls) == len(hall.thin_walls)
    assert edited.cast(5.0, 5.0, math.pi / 2, 9.0) == pytest.approx(0.5, abs=1e-12)


def test_what_is_removed_is_floor(hall: an.Environment) -> None:
    edited = hall.edited(remove=shapely.box(2.5, 1.0, 6.5, 2.5))
    assert edited.cast(2.0, 1.5, 0.0, 20.0) == pytest.approx(8.0)
    assert hall.cast(2.0, 1.5, 0.0, 20.0) == pytest.approx(1.0)
    assert edited.free.area == pytest.approx(hall.free.area + 0.25)
    assert edited.cast(2.0, 3.5, 0.0, 20.0) == pytest.approx(1.0), "the rest of the wall stays"


def test_a_niche_has_walls_and_the_opening_keeps_its_kind(hall: an.Environment) -> None:
    edited = hall.edited(remove=shapely.box(9.0, 1.0, 11.0, 3.0))
    distance, segment = edited.cast_hits(9.5, [2.0, 3.5], 0.0, 20.0)
    np.testing.assert_allclose(distance, [1.5, 0.5])
    assert edited.segments.kind[segment].tolist() == [WALL, FRONTIER]
    assert edited.bounds[2] == 11.0


def test_reflectors(hall: an.Environment) -> None:
    edited = hall.edited(
        [
            Obstacle.post(5.0, 5.0, 0.2, reflective=True),
            Obstacle.panel(1.0, 6.0, 2.0, 6.0, reflective=True),
        ]
    )
    _, met = edited.cast_hits([4.0, 1.5, 2.5], [5.0, 5.0, 5.0], [0, math.pi / 2, math.pi / 2], 9.0)
    assert edited.segments.kind[met].tolist() == [REFLECTOR, REFLECTOR, WALL]
    assert edited.free.equals(hall.edited([Obstacle.post(5.0, 5.0, 0.2)]).free)


def test_removing_what_was_added_leaves_the_segments_as_they_were(hall: an.Environment) -> None:
    edited = hall.edited([Obstacle.post(5.0, 5.0, 0.3)])
    back = edited.edited(remove=shapely.box(4.5, 4.5, 5.5, 5.5))
    assert back.segments.same_as(hall.segments)
    assert back.free.equals(hall.free)


def test_an_edit_of_nothing_is_the_building_itself(hall: an.Environment) -> None:
    assert hall.edited() is hall
    assert hall.edited(remove=shapely.box(4.0, 4.5, 5.0, 5.0)) is hall
    called = hall.edited(name="other")
    assert (called.name, called.checksum) == ("other", hall.checksum)


def test_a_changed_building_is_distinguished_by_checksum_and_digest(hall: an.Environment) -> None:
    ones = [hall, *(hall.edited([Obstacle.post(x, 5.0, 0.3)]) for x in (5.0, 5.5))]
    assert len({one.checksum for one in ones}) == len({environment_digest(o) for o in ones}) == 3
    assert ones[1].checksum == hall.edited([Obstacle.post(5.0, 5.0, 0.3)]).checksum
    assert ones[1].notes == ("Edited: 1 obstacles added.",)


def test_cells_of_an_occupancy_map_follow() -> None:
    state = np.zeros((60, 80), dtype=np.uint8)
    state[[0, -1]] = state[:, [0, -1]] = OCCUPIED
    state[30, 40] = OCCUPIED
    env = environment_from_grid(OccupancyGrid(state, 0.1, (1.0, 2.0, 0.3)), gap=0.1)
    assert env.drivable is not None, "the single cell is in the way of footprints alone"
    x, y = (float(v) for v in env.occupancy.to_world(20.5, 20.5))
    edited = env.edited([Obstacle.panel(x - 0.5, y, x + 0.5, y), Obstacle.post(x, y + 1.0, 0.2)])
    assert edited.occupancy.state_at(x, y) == edited.occupancy.state_at(x, y + 1.1) == OCCUPIED
    assert env.is_free(x, y + 0.1, radius=0.2) and not edited.is_free(x, y + 0.1, radius=0.2)
    assert not edited.is_free(x, y + 1.3, radius=0.2)
    at = [float(v) for v in env.occupancy.to_world(40.5, 30.5)]
    assert not env.is_free(*at, radius=0.2)
    cleared = env.edited(remove=shapely.Point(at).buffer(0.3))
    assert cleared is not env and cleared.is_free(*at, radius=0.2)
    assert cleared.occupancy.state_at(*at) != OCCUPIED


def test_cells_under_several_obstacles_are_those_under_each() -> None:
    rng = np.random.default_rng(4)
    state = np.zeros((60, 80), dtype=np.uint8)
    state[[0, -1]] = state[:, [0, -1]] = OCCUPIED
    env = environment_from_grid(OccupancyGrid(state, 0.1, (1.0, 2.0, 0.3)), gap=0.1)
    at = np.column_stack(env.occupancy.to_world(rng.uniform(5, 75, 4), rng.uniform(5, 55, 4)))
    posts = [Obstacle.post(x, y, 0.2) for x, y in at.tolist()]
    each = [env.edited(add=[post]).occupancy.state for post in posts]
    together = env.edited(add=posts).occupancy.state
    np.testing.assert_array_equal(together == OCCUPIED, np.any(np.array(each) == OCCUPIED, axis=0))


@pytest.mark.parametrize(
    ("add", "remove", "says"),
    [
        ([Obstacle.post(20.0, 2.0, 0.3)], None, "outside the floor"),
        ([Obstacle.panel(0.0, -1.0, 5.0, -1.0)], None, "outside the floor"),
        ([Obstacle.panel(0.0, 0.0, 5.0, 0.0)], None, "outside the floor"),
        ([Obstacle.panel(0.0, -1.0, 5.0, -1.0, reflective=True)], None, "outside the floor"),
        ([Obstacle(shapely.box(-1, -1, 20, 20))], None, "all of its floor"),
        ([], shapely.LineString([(0, 0), (1, 1)]), "give a Polygon"),
        ([], shapely.box(0, 0, math.inf, 1), "finite"),
        ([], shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]), "cross"),
    ],
)
def test_bad_edits(hall, add, remove, says) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(an.InputError, match=says):
        hall.edited(add, remove)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Obstacle.post(0.0, 0.0, 0.0), "radius is 0.0"),
        (lambda: Obstacle.post(0.0, math.nan, 1.0), "y is nan"),
        (lambda: Obstacle.post(math.inf, 0.0, 1.0), "x is inf"),
        (lambda: Obstacle.post(0.0, 0.0, math.inf), "radius is inf"),
        (lambda: Obstacle.panel(0.0, 0.0, 1.0, 0.0, -0.1), "thickness is -0.1"),
        (lambda: Obstacle.panel(1.0, 1.0, 1.0, 1.0), "no extent"),
        (lambda: Obstacle.panel(1.0, 1.0, math.nan, 1.0), "x1 is nan"),
        (lambda: Obstacle.wall([(0.0, 0.0)]), "shape"),
        (lambda: Obstacle(shapely.Point(0, 0)), "a Point"),
        (lambda: Obstacle(shapely.Polygon()), "empty"),
        (lambda: Obstacle(shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)])), "cross"),
    ],
)
def test_bad_obstacles(make, says) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(an.InputError, match=says):
        make()


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_rays_in_a_random_edit_are_those_of_plain_geometry(seed: int) -> None:
    rng = np.random.default_rng(seed)
    env = scenes.scene(seed % 7, size=8.0, blocks=4, thin=2)
    x, y = rng.uniform(1.0, 7.0, (2, 3))
    box = shapely.box(x[0] - 0.5, y[0] - 0.4, x[0] + 0.6, y[0] + 0.5)
    add = [
        Obstacle.post(x[1], y[1], rng.uniform(0.02, 0.5)),
        Obstacle.panel(x[2], y[2], x[1], y[2], 0.1),
    ]
    try:
        edited = env.edited(add, box)
    except an.InputError:
        return
    solid = shapely.union_all([one.outline for one in add])
    expected = env.free.union(box).difference(solid)
    assert edited.free.symmetric_difference(expected).area < 1e-5
    stays = ~np.isin(np.arange(len(env.segments)), kept(env, edited))
    lines = shapely.linestrings(env.segments.xy[stays].reshape(-1, 2, 2))
    assert shapely.intersects(lines, solid.union(box)).all(), "what is not reached stays"
    assert (np.diff(kept(env, edited)) > 0).all()
    xy = scenes.points_inside(edited, 40, seed)
    angle = rng.uniform(-math.pi, math.pi, len(xy))
    walls = np.vstack([edges_of(expected), edited.thin_walls])
    truth, _ = scenes.cast_slowly(walls, *xy.T, angle)
    np.testing.assert_allclose(edited.cast(*xy.T, angle, 50.0), truth, atol=1e-5)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_rays_that_end_in_a_window_are_the_same(seed: int) -> None:
    rng = np.random.default_rng(seed)
    env = scenes.scene(seed % 7, size=20.0, blocks=12, thin=6)
    x, y = rng.uniform(4.0, 16.0, 2).tolist()
    window = env.window((x - 4.0, y - 3.0, x + 3.0, y + 4.0))
    assert window is not None
    px, py = rng.uniform(x - 1.0, x + 1.0, 200), rng.uniform(y - 1.0, y + 1.0, 200)
    angle = rng.uniform(0.0, 7.0, 200)
    inside = env.is_free(px, py)
    assert (window.is_free(px, py) == inside).all()
    one, other = (e.cast_hits(px[inside], py[inside], angle[inside], 1.9) for e in (env, window))
    np.testing.assert_array_equal(one[0], other[0])
    met = one[1] >= 0
    np.testing.assert_array_equal(env.segments.xy[one[1][met]], window.segments.xy[other[1][met]])


def test_a_window_on_all_is_the_building_and_on_nothing_none(hall: an.Environment) -> None:
    assert hall.window((-1.0, -1.0, 11.0, 7.0)) is hall
    assert hall.window((6.2, 2.2, 6.8, 2.8)) is None
