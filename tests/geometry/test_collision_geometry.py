"""Where footprints fit on occupancy maps, checked on the raw cells (`raw_intrusion.py`)."""

from __future__ import annotations

import json
import math
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import ambinav as an
from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.map_server import load_map_server
from ambinav.drive.clutter import with_obstacles
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.collision.collision_geometry import NOTCH_CELLS, cut_notches, drivable_space
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from ambinav.runtime.errors import InputError
from tests.buildings import raw_intrusion
from tests.geometry import scenes

Array = NDArray[Any]

BODY = [(-0.3, -0.25), (0.45, -0.25), (0.55, 0.0), (0.45, 0.25), (-0.3, 0.25)]
STEERINGS = [
    Steering("r2"), Steering("se2"), Steering("dubins", 0.5), Steering("reeds-shepp", 0.4),
]  # fmt: skip


def room(columns: int = 60, rows: int = 40) -> Array:
    """A room of free cells with a wall of two cells around it."""
    state = np.full((rows, columns), OCCUPIED, dtype=np.uint8)
    state[2:-2, 2:-2] = FREE
    return state


def grid_of(state: Array, origin: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> OccupancyGrid:
    return OccupancyGrid(state, 0.05, origin)


def leg_room() -> OccupancyGrid:
    """A room of 3 m by 2 m with a table leg of one cell in its middle."""
    state = room()
    state[20, 30] = OCCUPIED
    return grid_of(state)


def disc(env: Environment, radius: float, **more: Any) -> CollisionChecker:
    return CollisionChecker(env, Footprint.disc(radius), Steering(), **more)


# -- what was wrong ----------------------------------------------------------------------------


def test_a_table_leg_of_one_cell_is_kept() -> None:
    env = environment_from_grid(leg_room())
    x, y = 30.5 * 0.05, 20.5 * 0.05
    # Rays do not know it: it is a speck to them.
    assert env.cast(0.5, y, 0.0, 10.0) == pytest.approx(2.9 - 0.5)
    checker = disc(env, 0.2)
    assert not checker.poses_free([[x, y, 0.0]])[0]
    assert not checker.poses_free([[x, y + 0.22, 0.0]])[0]
    assert checker.poses_free([[x, y + 0.226, 0.0]])[0]
    assert not checker.motions_free([[0.5, y, 0.0]], [[2.5, y, 0.0]])[0]
    assert checker.clearance([[x, y + 0.425, 0.0]])[0] == pytest.approx(0.2)
    assert not env.is_free(x, y, 0.2)
    assert env.is_free(x, y)
    near = checker.nearest_free(x, y)
    assert near is not None and near[3] == pytest.approx(0.225, abs=0.02)
    assert checker.why_not(x, y) == "among cells that the map calls occupied"


@pytest.mark.slow
def test_the_corner_of_a_shelf_is_not_cut() -> None:
    """A slanted shelf whose fitted edge passes through its cells."""
    state = room(80, 60)
    rows, columns = np.indices(state.shape)
    state[(columns - 40) * 0.6 + (rows - 30) * 0.8 > 12.0] = OCCUPIED
    grid = grid_of(state)
    env = environment_from_grid(grid)
    rng = np.random.default_rng(0)
    poses = rng.uniform((0, 0, 0), (4, 3, 0), (6_000, 3))
    deepest = {}
    for simulated in (True, False):
        free = poses[disc(env, 0.2, simulated=simulated).poses_free(poses)]
        deepest[simulated] = max(raw_intrusion.disc_intrusion(grid, 0.2, p[None, :2]) for p in free)
    assert deepest[True] > 0.005
    assert deepest[False] <= raw_intrusion.ROUNDING


def test_passages_between_cells_are_as_wide_as_the_cells_leave_them() -> None:
    state = room()
    state[2:14, 30] = OCCUPIED
    state[24:-2, 30] = OCCUPIED
    env = environment_from_grid(grid_of(state))
    a, b = [[0.5, 0.95, 0.0]], [[2.5, 0.95, 0.0]]
    assert disc(env, 0.2499).motions_free(a, b)[0]
    assert not disc(env, 0.2501).motions_free(a, b)[0]


# -- what else holds ---------------------------------------------------------------------------


def test_drawn_plans_are_their_own() -> None:
    env = scenes.room(6.0, 4.0, np.array([[2.0, 2.0, 3.0, 3.0]]))
    assert env.drivable is None and env.collision is env
    clean = environment_from_grid(grid_of(room()))
    assert clean.drivable is None and clean.collision is clean


def test_why_not_tells_unknown_space_from_walls() -> None:
    state = room()
    state[10:30, -2:] = UNKNOWN
    state[20, 30] = OCCUPIED
    env = environment_from_grid(grid_of(state))
    assert env.collision is not env
    checker = disc(env, 0.2)
    assert "from unknown space" in str(checker.why_not(2.85, 1.0))
    assert "from a wall" in str(checker.why_not(1.5, 0.2))
    assert "from a wall" in str(checker.why_not(30.5 * 0.05, 22.0 * 0.05))


def test_turned_and_cluttered_environments_keep_the_cells() -> None:
    grid = leg_room()
    env = environment_from_grid(grid)
    x, y = 30.5 * 0.05, 20.5 * 0.05
    turned = env.transformed(0.5, 3.0, -2.0)
    c, s = math.cos(0.5), math.sin(0.5)
    assert not disc(turned, 0.2).poses_free([[c * x - s * y + 3.0, s * x + c * y - 2.0, 0.0]])[0]
    cluttered = with_obstacles(env, [shapely.box(0.5, 0.5, 0.8, 0.8)])
    assert cluttered.extent == env.extent is not None
    poses = [[x, y, 0.0], [0.65, 0.65, 0.0], [2.3, 1.0, 0.0]]
    assert disc(cluttered, 0.2).poses_free(poses).tolist() == [False, False, True]
    assert disc(cluttered, 0.2, simulated=True).poses_free(poses).tolist() == [True, False, True]
    again = pickle.loads(pickle.dumps(env))
    assert not disc(again, 0.2).poses_free([[x, y, 0.0]])[0]


def test_notches_are_cut_inwards_only_and_around_what_stands_in_them() -> None:
    stair = [(4.0, 4.0)]
    for k in range(10):
        stair += [(4.0 - 0.1 * k, 4.1 + 0.1 * k), (3.9 - 0.1 * k, 4.1 + 0.1 * k)]
    space = shapely.Polygon([(0.0, 0.0), (4.0, 0.0), *stair, (0.0, 5.0)])
    assert space.is_valid
    cut = cut_notches(shapely.MultiPolygon([space]), 0.08)
    assert len(shapely.get_coordinates(cut)) <= 8
    assert shapely.difference(cut, space).area < 1e-9
    assert 0.0 < shapely.difference(space, cut).area <= 10 * 0.5 * 0.1**2 + 1e-9
    # A hole that reaches into a notch keeps that notch.
    hole = shapely.box(3.53, 4.4, 3.58, 4.48)
    assert space.contains(hole)
    around = cut_notches(shapely.MultiPolygon([space.difference(hole)]), 0.08)
    assert around.is_valid
    assert around.intersection(hole).area < 1e-9


# -- maps on disk ------------------------------------------------------------------------------


def amap_of(grid: OccupancyGrid) -> an.AmbiguityMap:
    scanner = an.RangeScanner.planar(
        sensor=an.RangeSensor(max_range=2.0, std=0.02, resolution=0.01), beams=12, aperture=math.tau
    )
    return an.build_map(environment_from_grid(grid), scanner, spacing=0.1)


@pytest.mark.slow
def test_a_stored_map_is_as_safe(tmp_path: Path) -> None:
    amap = amap_of(leg_room())
    amap.save(tmp_path / "a.zarr")
    again = an.AmbiguityMap.open(tmp_path / "a.zarr").environment
    before = amap.environment.collision
    assert again.collision is not again
    assert again.collision.free.equals_exact(before.free, 0.0)
    assert (again.collision.segments.xy == before.segments.xy).all()
    assert (again.collision.segments.kind == before.segments.kind).all()
    assert not disc(again, 0.2).poses_free([[1.525, 1.025, 0.0]])[0]


def test_a_stored_drawn_plan_is_its_own(tmp_path: Path) -> None:
    amap = amap_of(grid_of(room()))
    amap.save(tmp_path / "a.zarr")
    env = an.AmbiguityMap.open(tmp_path / "a.zarr").environment
    assert env.collision is env


def test_a_damaged_outline_is_the_files_fault() -> None:
    dataset = amap_of(leg_room()).dataset.copy(deep=True)
    dataset["drivable"][:] = 7
    with pytest.raises(InputError, match="drivable, the outline of the drivable space"):
        _ = an.AmbiguityMap(dataset, source="b.zarr").environment
    with pytest.raises(InputError, match="drivable, the outline of the drivable space"):
        _ = an.AmbiguityMap(dataset.drop_vars("drivable"), source="b.zarr").environment
    assert json.loads(dataset.attrs["environment_notes"]) == []


# -- drawn by chance ---------------------------------------------------------------------------


def drawn(seed: int) -> OccupancyGrid:
    """A building of cells: thin walls with doors, slanted shelves, legs, noise, unknown blocks."""
    rng = np.random.default_rng(seed)
    rows, columns = rng.integers(40, 90, size=2)
    state = room(columns, rows)
    v, u = np.indices(state.shape) + 0.5
    for _ in range(rng.integers(0, 4)):
        if rng.random() < 0.5:
            at, width = rng.integers(8, columns - 8), rng.integers(1, 4)
            state[:, at : at + width] = OCCUPIED
            door = rng.integers(2, rows - 12)
            state[door : door + rng.integers(4, 16), at : at + width] = FREE
        else:
            angle = rng.uniform(0, np.pi)
            x, y = rng.uniform((6, 6), (columns - 6, rows - 6))
            along = (u - x) * math.cos(angle) + (v - y) * math.sin(angle)
            across = (v - y) * math.cos(angle) - (u - x) * math.sin(angle)
            half = rng.uniform(0.6, 4.0)
            state[(np.abs(along) < rng.uniform(4, 20)) & (np.abs(across) < half)] = OCCUPIED
    for _ in range(rng.integers(0, 12)):
        row, column = rng.integers(2, rows - 3), rng.integers(2, columns - 3)
        size = rng.integers(1, 3)
        state[row : row + size, column : column + size] = OCCUPIED
    if rng.random() < 0.3:
        state[rng.random(state.shape) < 0.01] = OCCUPIED
    if rng.random() < 0.4:
        row, column = rng.integers(0, rows - 8), rng.integers(0, columns - 8)
        block = state[row : row + 8, column : column + 8]
        block[block == FREE] = UNKNOWN
    state[[0, 1, -2, -1]] = OCCUPIED
    state[:, [0, 1, -2, -1]] = OCCUPIED
    yaw = float(rng.choice([0.0, 0.3, rng.uniform(-3.0, 3.0)]))
    return grid_of(state, (*rng.uniform(-50, 50, 2), yaw))


def some_poses(grid: OccupancyGrid, rng: np.random.Generator, count: int) -> Array:
    rows, columns = grid.state.shape
    u, v = rng.uniform((0, 0), (columns, rows), (count, 2)).T
    x, y = grid.to_world(u, v)
    return np.stack([x, y, rng.uniform(-np.pi, np.pi, count)], axis=-1)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 100_000), radius=st.sampled_from([0.0, 0.03, 0.1, 0.2]))
def test_what_is_free_is_free_on_the_cells(seed: int, radius: float) -> None:
    grid = drawn(seed)
    try:
        env = environment_from_grid(grid)
    except InputError:
        return
    rng = np.random.default_rng(seed)
    poses = some_poses(grid, rng, 400)
    size = grid.resolution
    rows, columns = np.nonzero(grid.state == OCCUPIED)
    cells = shapely.box(columns * size, rows * size, (columns + 1) * size, (rows + 1) * size)
    points = shapely.points(raw_intrusion.in_grid(grid, poses[:, :2]))
    _, away = shapely.STRtree(cells).query_nearest(points, all_matches=False, return_distance=True)
    free = disc(env, radius).poses_free(poses)
    assert (away[free] >= radius - raw_intrusion.ROUNDING).all()
    if radius > 0.0:
        assert (free == env.is_free(poses[:, 0], poses[:, 1], radius)).all()
    # And all that keeps off the cells, and off the border that rays know, by the bound.
    spare = radius + NOTCH_CELLS * size + 1e-6
    inside = np.asarray(env.is_free(poses[:, 0], poses[:, 1]))
    border = shapely.distance(env.free.boundary, shapely.points(poses[:, :2]))
    assert free[inside & (away >= spare) & (border >= spare)].all()


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 100_000),
    steering=st.sampled_from(STEERINGS),
    footprint=st.sampled_from([Footprint.disc(0.1), Footprint.disc(0.2), Footprint.polygon(BODY)]),
)
def test_motions_that_are_free_are_free_on_the_cells(
    seed: int, steering: Steering, footprint: Footprint
) -> None:
    grid = drawn(seed)
    try:
        checker = CollisionChecker(environment_from_grid(grid), footprint, steering)
    except InputError:
        return
    rng = np.random.default_rng(seed)
    a = some_poses(grid, rng, 400)
    a = a[checker.poses_free(a)][:60]
    b = a + rng.normal(0.0, (0.5, 0.5, 1.0), a.shape)
    free = checker.motions_free(a, b)
    for start, end in zip(a[free], b[free], strict=True):
        route = steering.oriented(np.stack([start, end]))
        found = raw_intrusion.route_intrusion(grid, footprint, steering, route)
        assert found <= raw_intrusion.ROUNDING


# -- a real map --------------------------------------------------------------------------------


def test_what_cannot_be_driven_is_little(data_dir: Path) -> None:
    """The bound on a real map: what is lost lies within half a cell of a border or a cell."""
    grid = load_map_server(data_dir / "maps" / "willow_full_005.yaml")
    env = environment_from_grid(grid)
    exact = drivable_space(grid, env.free)
    assert exact is not None and env.drivable is not None
    assert 0.99 * env.free.area < env.drivable.area < env.free.area
    assert len(env.collision.segments) < 2 * len(env.segments)
