"""Single rays and clearances, against every segment one by one and against shapely."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.casting.plane.grid import SegmentGrid
from ambinav.casting.plane.raycast import cast_rays, clearances
from ambinav.casting.plane.walk import LEAST, walk_rays
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError
from tests.geometry import scenes

SEEDS = (1, 2, 3)
REACH = 80.0


@pytest.fixture(scope="module", params=SEEDS)
def env(request: pytest.FixtureRequest) -> Environment:
    return scenes.scene(request.param)


# -- against every segment ---------------------------------------------------------------------


def test_cast_is_exact(env: Environment) -> None:
    xy = scenes.points_inside(env, 3000, seed=5)
    angle = np.random.default_rng(6).uniform(-7, 7, len(xy))
    distance, segment = env.cast_hits(*xy.T, angle, REACH)
    expected, which = scenes.cast_slowly(env.segments.xy, *xy.T, angle)
    assert np.isfinite(expected).all()
    assert np.abs(distance - expected).max() < 1e-5
    # Only where two segments are hit at the same distance may either be named.
    other = np.flatnonzero(segment != which)
    for i in other:
        alone, _ = scenes.cast_slowly(env.segments.xy[[segment[i]]], *xy[[i]].T, angle[[i]])
        assert alone[0] == pytest.approx(expected[i], abs=1e-9)
    assert len(other) < 5


def test_order_of_rays_changes_nothing(env: Environment) -> None:
    # Many enough to be put in order, some outside, some far beyond any building.
    rng = np.random.default_rng(8)
    xmin, ymin, xmax, ymax = env.bounds
    corners = (xmin - 2.0, ymin - 2.0), (xmax + 2.0, ymax + 2.0)
    x, y = np.ascontiguousarray(rng.uniform(*corners, (3 * LEAST, 2)).T)
    x[:3], y[3:6] = (1e308, -1e308, 1e9), (1e308, -1e308, -1e9)
    angle = rng.uniform(-7, 7, len(x))
    together = walk_rays(env, x, y, angle, REACH)
    few = LEAST // 2
    for low in range(0, len(x), few):
        part = slice(low, low + few)
        alone = walk_rays(env, x[part], y[part], angle[part], REACH)
        inside = alone[2]
        assert np.array_equal(together[2][part], inside)
        for one, other in zip(together[:2], alone[:2], strict=True):
            assert np.array_equal(one[part][inside], other[inside])


@pytest.mark.parametrize("cell", [0.05, 0.3, 1.0, 7.0, 60.0])
def test_size_of_the_cells_does_not_matter(cell: float) -> None:
    env = scenes.scene(4, size=20.0)
    xy = scenes.points_inside(env, 500, seed=7)
    angle = np.random.default_rng(8).uniform(-math.pi, math.pi, len(xy))
    x, y = (np.ascontiguousarray(v) for v in xy.T)
    distance, _ = cast_rays(SegmentGrid.build(env.segments, cell), x, y, angle, REACH)
    assert np.abs(distance - scenes.cast_slowly(env.segments.xy, x, y, angle)[0]).max() < 1e-9


def test_along_the_axes_from_multiples_of_the_cell(env: Environment) -> None:
    # Rays that run on the lines of the grid, in both directions.
    x0, y0, cell, rows, columns = env.grid.arrays[:5]
    steps = np.arange(1, min(rows, columns) - 1, 3)
    x, y = (g.ravel() for g in np.meshgrid(x0 + steps * cell, y0 + steps * cell))
    # On a wall a ray may start on either side of it.
    apart = np.asarray(env.clearance(x, y)) > 1e-9
    x, y = x[apart], y[apart]
    for turn in range(8):
        angle = np.full(len(x), turn * math.pi / 4)
        distance, _ = env.cast_hits(x, y, angle, REACH)
        expected, _ = scenes.cast_slowly(env.segments.xy, x, y, angle)
        assert np.abs(distance - np.minimum(expected, REACH)).max() < 1e-5


def test_threads_change_nothing(env: Environment, monkeypatch: pytest.MonkeyPatch) -> None:
    xy = scenes.points_inside(env, 3000, seed=9)
    x, y = (np.ascontiguousarray(v) for v in xy.T)
    angle = np.linspace(0, 6, len(x))
    monkeypatch.setattr("numba.get_num_threads", lambda: 1)
    one = (*cast_rays(env.grid, x, y, angle, 10.0), clearances(env.grid, x, y, 3.0))
    one += walk_rays(env, x, y, angle, 10.0)
    monkeypatch.setattr("numba.get_num_threads", lambda: 2)
    two = (*cast_rays(env.grid, x, y, angle, 10.0), clearances(env.grid, x, y, 3.0))
    two += walk_rays(env, x, y, angle, 10.0)
    for a, b in zip(one, two, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_origins_outside_the_grid(angle: float) -> None:
    env = scenes.room(4.0, 3.0).transformed(angle)
    rng = np.random.default_rng(3)
    xy = rng.uniform(-30, 30, (2000, 2))
    towards = np.arctan2(*(rng.uniform((0, 0), (4, 3), xy.shape) - xy).T[::-1])
    for direction in (towards, rng.uniform(-math.pi, math.pi, len(xy))):
        distance, segment = env.cast_hits(*xy.T, direction, 100.0)
        expected, _ = scenes.cast_slowly(env.segments.xy, *xy.T, direction)
        assert np.abs(distance - np.minimum(expected, 100.0)).max() < 1e-5
        assert ((segment >= 0) == np.isfinite(expected)).all()
    assert env.cast(-5.0, -9.0, -math.pi / 2, 100.0) == 100.0


# -- limits ------------------------------------------------------------------------------------


def test_closed_form_in_a_room() -> None:
    env = scenes.room(4.0, 3.0)
    assert env.cast(1.0, 1.0, 0.0, 10.0) == pytest.approx(3.0)
    assert env.cast(1.0, 1.0, math.pi / 2, 10.0) == pytest.approx(2.0)
    assert env.cast(1.0, 1.0, 5 * math.pi / 4, 10.0) == pytest.approx(math.sqrt(2))


def test_nothing_within_range_gives_the_range() -> None:
    env = scenes.room(4.0, 3.0)
    distance, segment = env.cast_hits(1.0, 1.0, np.array([0.0, math.pi]), 1.5)
    assert distance.tolist() == [1.5, pytest.approx(1.0)]
    assert segment[0] == -1 and segment[1] >= 0


def test_scalars_broadcasting_and_nan() -> None:
    env = scenes.room(4.0, 3.0)
    assert isinstance(env.cast(1, 1, 0, 10), float)
    table = env.cast(np.array([[1.0], [2.0]]), 1.0, np.array([0.0, math.pi, math.nan]), 10.0)
    assert np.shape(table) == (2, 3)
    assert np.asarray(table)[:, :2] == pytest.approx(np.array([[3.0, 1.0], [2.0, 2.0]]))
    assert np.isnan(np.asarray(table)[:, 2]).all()
    assert math.isnan(env.cast(math.inf, 0.0, 0.0, 5.0))
    distance, segment = env.cast_hits(math.nan, 1.0, 0.0, 5.0)
    assert distance.shape == () and math.isnan(distance) and segment == -1
    assert np.shape(env.cast(np.empty(0), 1.0, 0.0, 5.0)) == (0,)


@pytest.mark.parametrize("reach", [0.0, -1.0, math.nan])
def test_range_must_be_positive(reach: float) -> None:
    with pytest.raises(InputError, match="max_range"):
        scenes.room(4.0, 3.0).cast(1.0, 1.0, 0.0, reach)


def test_infinite_range() -> None:
    env = scenes.room(4.0, 3.0)
    assert env.cast(1.0, 1.0, 0.0, math.inf) == pytest.approx(3.0)
    assert env.cast(9.0, 9.0, 0.0, math.inf) == math.inf


# -- corners and thin walls ----------------------------------------------------------------------


@pytest.mark.parametrize("turn", [0.0, 0.1, 1.0, 2.5])
def test_no_ray_leaks_through_a_shared_corner(turn: float) -> None:
    corners = 60
    around = 2 * math.pi * np.arange(corners) / corners
    disc = shapely.Polygon(5.0 * np.column_stack([np.cos(around), np.sin(around)]))
    env = scenes.environment(disc).transformed(turn)
    rng = np.random.default_rng(2)
    xy = np.vstack([[0.0, 0.0], rng.uniform(-3, 3, (40, 2))])[:, None]
    towards = env.segments.xy[:, :2] - xy
    angle = np.arctan2(towards[..., 1], towards[..., 0])
    for tiny in (0.0, 1e-15, -1e-15, 1e-12):
        distance = np.asarray(env.cast(xy[..., 0], xy[..., 1], angle + tiny, 100.0))
        assert np.abs(distance - np.hypot(*towards.transpose(2, 0, 1))).max() < 1e-6


def test_no_ray_leaks_where_segments_cross_the_lines_of_the_grid() -> None:
    env = scenes.room(30.0, 30.0, np.array([15.0, 0.5, 15.0, 29.5]))
    y = np.linspace(0.6, 29.4, 4001)
    assert np.asarray(env.cast(1.0, y, 0.0, 100.0)) == pytest.approx(14.0)
    assert np.asarray(env.cast(29.0, y, math.pi, 100.0)) == pytest.approx(14.0)


def test_thin_walls_stop_rays_from_both_sides_grazing_ones_too() -> None:
    env = scenes.room(10.0, 4.0, np.array([1.0, 2.0, 9.0, 2.0]))
    for slope in (0.4, 1e-2, 1e-4, 1e-6):
        height = 2.0 - 4.0 * slope
        angle = math.atan(slope)
        expected = 4.0 / math.cos(angle)
        assert env.cast(1.0, height, angle, 50.0) == pytest.approx(expected, abs=1e-5)
        assert env.cast(1.0, 4.0 - height, -angle, 50.0) == pytest.approx(expected, abs=1e-5)
    # Beside it and parallel to it a ray goes on to the far wall.
    assert env.cast(1.0, 2.0 + 1e-6, 0.0, 50.0) == pytest.approx(9.0)


def test_normals_stand_on_the_segments() -> None:
    env = scenes.scene(1)
    normal = env.normals(np.arange(len(env.segments)))
    along = env.segments.xy[:, 2:] - env.segments.xy[:, :2]
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0)
    assert np.abs((normal * along).sum(axis=1)).max() < 1e-9
    assert (along[:, 0] * normal[:, 1] - along[:, 1] * normal[:, 0] > 0).all()
    assert np.isnan(env.normals(-1)).all()


# -- clearance -----------------------------------------------------------------------------------


def test_clearance_is_shapelys_distance(env: Environment) -> None:
    rng = np.random.default_rng(11)
    x, y = rng.uniform(-15, 65, (2, 1500))
    lines = shapely.multilinestrings(shapely.linestrings(env.segments.xy.reshape(-1, 2, 2)))
    expected = shapely.distance(shapely.points(x, y), lines)
    assert np.abs(np.asarray(env.clearance(x, y)) - expected).max() < 1e-9
    limited = np.asarray(env.clearance(x, y, 1.5))
    assert np.abs(limited - np.minimum(expected, 1.5)).max() < 1e-9


def test_clearance_of_plain_numbers() -> None:
    env = scenes.room(10.0, 5.0)
    assert env.clearance(3.0, 2.0) == pytest.approx(2.0)
    assert isinstance(env.clearance(3.0, 2.0), float)
    assert np.isnan(
        np.asarray(env.clearance([math.nan, 1.0, 1.0], [0.0, math.inf, -math.inf]))
    ).all()
    assert env.clearance(-3.0, 9.0) == pytest.approx(5.0)
    assert np.asarray(env.clearance([[5.0]], [1.0, 2.0])) == pytest.approx(np.array([[1.0, 2.0]]))
