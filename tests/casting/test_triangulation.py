"""The triangulated free space: what lies in it, how its edges join, and its border."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.casting.plane.triangulation import LEFT, RIGHT, Triangulation
from ambinav.geometry.environment import Environment
from tests.geometry import scenes


@pytest.fixture(scope="module", params=[1, 2, 3])
def env(request: pytest.FixtureRequest) -> Environment:
    return scenes.scene(request.param)


@pytest.mark.slow
def test_contains_is_shapelys(env: Environment) -> None:
    rng = np.random.default_rng(4)
    xmin, ymin, xmax, ymax = env.bounds
    x, y = rng.uniform((xmin - 2, ymin - 2), (xmax + 2, ymax + 2), (20000, 2)).T
    points = shapely.points(x, y)
    expected = shapely.contains(env.free, points)
    differs = env.triangulation.contains(x, y) != expected
    # The slits of the thin walls, 2 micrometres wide, are outside; nothing else is.
    assert (np.asarray(env.clearance(x[differs], y[differs])) < 1e-5).all()
    assert differs.sum() <= 2


def test_area_is_that_of_the_free_space(env: Environment) -> None:
    corner = env.triangulation.corner.reshape(-1, 3, 2)
    a, b, c = corner[:, 0], corner[:, 1], corner[:, 2]
    area = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert (area > 0).all(), "counter-clockwise"
    assert area.sum() == pytest.approx(env.free.area, abs=1e-3)


def test_twins_and_border(env: Environment) -> None:
    mesh = env.triangulation
    half = np.arange(len(mesh.twin))
    following = half // 3 * 3 + (half + 1) % 3
    inner = mesh.twin >= 0
    assert (mesh.twin[mesh.twin[inner]] == half[inner]).all()
    assert (mesh.corner[inner] == mesh.corner[following[mesh.twin[inner]]]).all()
    assert (mesh.twin[inner] // 3 != half[inner] // 3).all()
    assert sorted(-1 - mesh.twin[~inner]) == list(range(len(mesh.border)))
    edge = np.hstack([mesh.corner, mesh.corner[following]])
    assert (mesh.border[-1 - mesh.twin[~inner]] == edge[~inner]).all()


def test_border_edges_know_their_segment(env: Environment) -> None:
    border = env.triangulation.border
    lines = shapely.linestrings(env.segments.xy.reshape(-1, 2, 2))[env.border_segment]
    for ends in (border[:, :2], border[:, 2:]):
        # 1.5 micrometres: the corners of the slits.
        assert shapely.distance(shapely.points(ends), lines).max() < 1.5e-6
    assert set(env.border_segment.tolist()) == set(range(len(env.segments)))


def test_all_neighbours_of_a_triangle_are_reached_by_onward(env: Environment) -> None:
    mesh = env.triangulation
    half = np.arange(len(mesh.twin))
    previous, following = half // 3 * 3 + (half + 2) % 3, half // 3 * 3 + (half + 1) % 3
    assert (mesh.node[:, :2] == mesh.corner[previous]).all()
    assert (mesh.hops[:, LEFT] == mesh.twin[previous]).all()
    assert (mesh.hops[:, RIGHT] == mesh.twin[following]).all()


def test_a_single_triangle() -> None:
    points = np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])
    mesh = Triangulation.from_triangles(points)
    assert (mesh.twin < 0).all() and len(mesh.border) == 3
    x, y = np.array([0.2, 0.9, -0.1, math.nan, 1e9]), np.array([0.2, 0.9, 0.2, 0.2, 0.2])
    assert mesh.contains(x, y).tolist() == [True, False, False, False, False]


def test_rooms_apart_are_both_free() -> None:
    free = shapely.MultiPolygon([shapely.box(0, 0, 1, 1), shapely.box(5, 5, 6, 6)])
    env = scenes.environment(free)
    assert env.is_free([0.5, 5.5, 3.0], [0.5, 5.5, 3.0]).tolist() == [True, True, False]


@pytest.mark.parametrize("angle", [0.0, 0.123, 0.8])
def test_thin_walls_that_meet_cross_and_touch_the_border(angle: float) -> None:
    thin = np.array(
        [[2.0, 0, 2, 3], [2, 3, 4, 3], [1, 2, 5, 2], [5, 2, 5, 1], [0, 4, 3, 4], [7, 1, 9, 4]]
    )
    env = scenes.room(10.0, 5.0, thin).transformed(angle)
    mesh = env.triangulation
    corner = mesh.corner.reshape(-1, 3, 2)
    a, b, c = corner[:, 0], corner[:, 1], corner[:, 2]
    area = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert area.sum() == pytest.approx(50.0, abs=1e-4)
    assert set(env.border_segment.tolist()) == set(range(len(env.segments)))
