"""Walls of one to three cells stay where the map has them, however the outline runs around them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ambinav.buildings.boundary import environment_from_grid
from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from tests import recorded
from tests.buildings import raw_cells

# Cells from a wall's cell to the nearest segment: the default tolerance.
NEAREST = 2.0


def drawn(room: shapely.Geometry, walls: list[shapely.Geometry], cell: float) -> OccupancyGrid:
    """A map of a room with walls in it: three cells of wall around it, unknown space behind."""
    x0, y0 = np.array(room.bounds[:2]) - 8.3 * cell
    columns, rows = (np.array(room.bounds[2:]) - (x0, y0)) / cell + 8
    x, y = np.meshgrid(
        x0 + (np.arange(int(columns)) + 0.5) * cell, y0 + (np.arange(int(rows)) + 0.5) * cell
    )
    state = np.full(x.shape, UNKNOWN, np.uint8)
    state[shapely.contains_xy(room.buffer(3 * cell), x, y)] = OCCUPIED
    free = shapely.contains_xy(room, x, y)
    for wall in walls:
        free &= ~shapely.contains_xy(wall, x, y)
    state[free] = FREE
    return OccupancyGrid(state, cell, (x0, y0, 0.0))


def parted_room(
    thickness: int, door: int, degrees: float, cell: float, ends: str, length: float = 10.0
) -> tuple[OccupancyGrid, np.ndarray]:
    """A room with a wall across it that has a door, and the middle of the door.

    `ends`: "one" if the door is at one end of the wall, "both" if it is in the middle, "none" if
    there is half of it at each end.
    """
    wide, half, opening = thickness * cell, length / 2, door * cell
    pieces = {
        "one": [(0.0, length - opening)],
        "both": [(0.0, half - opening / 2), (half + opening / 2, length)],
        "none": [(opening, length - opening)],
    }[ends]
    middle = {"one": length - opening / 2, "both": half, "none": opening / 2}[ends]
    walls = [shapely.box(a, 2.0, b, 2.0 + wide) for a, b in pieces]
    turned = [
        shapely.affinity.rotate(shape, degrees, origin=(0, 0))
        for shape in (shapely.box(0, 0, length, 4.0), *walls, shapely.Point(middle, 2 + wide / 2))
    ]
    return drawn(turned[0], turned[1:-1], cell), shapely.get_coordinates(turned[-1])[0]


def assert_walls_stand(grid: OccupancyGrid, env: Environment, rays: int = 2000) -> None:
    wall, floor = raw_cells.wall_mask(grid), raw_cells.floor_mask(grid)
    cells = raw_cells.beside(wall, floor)
    assert len(cells) > 0
    away = raw_cells.from_segments(grid, env, cells)
    assert away.max() <= NEAREST + 1e-9, (away.max(), cells[away.argmax()])
    near = raw_cells.close_to(wall, floor)
    rng = np.random.default_rng(0)
    _, through = raw_cells.rays_through_walls(grid, env, wall, floor, rays, rng, near)
    assert len(through) == 0, through[:3]


@pytest.mark.parametrize(
    "degrees",
    [
        0.0,
        7.0,
        pytest.param(45.0, marks=pytest.mark.slow),
        *(pytest.param(turn, marks=pytest.mark.sweep) for turn in (30.0, 83.0)),
    ],
)
@pytest.mark.parametrize("thickness", [1, pytest.param(2, marks=pytest.mark.sweep), 3])
@pytest.mark.parametrize("ends", ["one", "both", "none"])
def test_a_wall_with_a_door_stands_and_the_door_is_open(
    thickness: int, degrees: float, ends: str
) -> None:
    for door in (2, 3, 5, 12, 40):
        grid, middle = parted_room(thickness, door, degrees, 0.05, ends)
        env = environment_from_grid(grid)
        assert_walls_stand(grid, env)
        if door >= 5:
            # Across the middle of the door, 1 m from one side of the wall to the other.
            across = math.radians(degrees + 90.0)
            x, y = middle - 0.5 * np.array([math.cos(across), math.sin(across)])
            assert env.cast(x, y, across, 5.0) > 1.0, door
        # Straight walls are drawn with few strokes: the room's 4, and 4 a piece of wall.
        if degrees == 0.0:
            assert len(env.segments) <= 4 + 4 * 2, door


@pytest.mark.parametrize("cell", [0.025, 0.1])
def test_a_wall_with_a_door_at_other_resolutions(cell: float) -> None:
    for thickness, degrees, door in ((1, 0.0, 8), (1, 18.0, 20), (2, 0.0, 3), (2, 60.0, 40)):
        grid, _ = parted_room(thickness, door, degrees, cell, "both", 6.0)
        assert_walls_stand(grid, environment_from_grid(grid))


@pytest.mark.parametrize("thickness", [1, 2])
def test_both_sides_of_a_thin_wall_are_straight_and_where_they_were(thickness: int) -> None:
    grid, _ = parted_room(thickness, 20, 0.0, 0.05, "one")
    env = environment_from_grid(grid)
    a, b = env.segments.xy[:, :2], env.segments.xy[:, 2:]
    long = (env.segments.lengths > 8.5) & (np.abs(a[:, 1] - 2.0) < 0.2)
    assert long.sum() == 2
    low, high = sorted(0.5 * (a + b)[long, 1])
    assert high - low == pytest.approx(0.05 * thickness, abs=1e-6)
    assert np.abs((b - a)[long, 1]).max() < 1e-6
    # The wall's end, 9 m from its foot.
    assert env.segments.xy[long, 0::2].max() == pytest.approx(9.0, abs=0.05)


def cross_and_comb(degrees: float) -> OccupancyGrid:
    """Two thin walls that cross, a T, and a comb of stubs of 10 to 40 cells, two cells apart."""
    walls = [
        shapely.box(2, 2, 4, 2.05),
        shapely.box(3, 1, 3.05, 3),
        shapely.box(5, 0, 5.05, 3),
        shapely.box(4.5, 3, 5.5, 3.05),
        *(shapely.box(6 + 0.25 * k, 0, 6.06 + 0.25 * k, 0.5 + 0.15 * k) for k in range(11)),
    ]
    shapes = [
        shapely.affinity.rotate(s, degrees, origin=(0, 0))
        for s in (shapely.box(0, 0, 9, 4), *walls)
    ]
    return drawn(shapes[0], shapes[1:], 0.05)


@pytest.mark.parametrize("degrees", [0.0, 11.0, 45.0])
def test_crosses_and_combs(degrees: float) -> None:
    grid = cross_and_comb(degrees)
    assert_walls_stand(grid, environment_from_grid(grid))


@pytest.mark.parametrize("turn", range(8))
def test_mirrored_and_turned_grids_keep_their_walls(turn: int) -> None:
    state = np.rot90(cross_and_comb(11.0).state, turn % 4)
    grid = OccupancyGrid(np.ascontiguousarray(state if turn < 4 else state.T), 0.05)
    assert_walls_stand(grid, environment_from_grid(grid))


def test_a_thin_wall_is_no_speck() -> None:
    # A wall of 1 x 30 cells in the middle of a room; gaps of six cells are closed.
    state = np.full((84, 124), OCCUPIED, np.uint8)
    state[2:-2, 2:-2] = FREE
    state[40, 40:70] = OCCUPIED
    state[20:26, 80:86] = OCCUPIED
    env = environment_from_grid(OccupancyGrid(state, 0.05), gap=0.3)
    assert len(env.free.interiors) == 1
    assert env.cast(2.75, 1.0, math.pi / 2, 5.0) == pytest.approx(1.0, abs=0.06)


def test_a_pillar_in_a_niche_is_not_swallowed() -> None:
    # At a tolerance of 12 cells the niche is part of the wall, and the pillar stood behind it.
    state = np.full((120, 220), OCCUPIED, np.uint8)
    state[10:80, 10:210] = FREE
    state[80:90, 90:130] = FREE
    state[82:87, 108:113] = OCCUPIED
    grid = OccupancyGrid(state, 0.05)
    env = environment_from_grid(grid, tolerance=0.6)
    assert env.free.is_valid and env.notes == ()
    assert len(env.free.interiors) == 1
    wall, floor = raw_cells.wall_mask(grid), raw_cells.floor_mask(grid)
    away = raw_cells.from_segments(grid, env, raw_cells.beside(wall, floor))
    assert away.max() <= 12.0


@st.composite
def buildings(draw: st.DrawFn) -> OccupancyGrid:
    """A turned room with thin walls from its sides, islands and unknown patches."""
    width, depth = draw(st.floats(3.0, 7.0)), draw(st.floats(3.0, 6.0))
    cell = draw(st.sampled_from([0.025, 0.05, 0.1]))
    walls = []
    for _ in range(draw(st.integers(1, 6))):
        thick = cell * draw(st.sampled_from([1.0, 1.4, 2.0, 3.0]))
        # Up and down or across, from a side or from the middle, or at an angle.
        x, y = draw(st.floats(0.0, width)), draw(st.sampled_from([0.0, 0.0, 0.5 * depth]))
        long = draw(st.floats(0.3, depth))
        wall = shapely.box(x, y - cell, x + thick, y + long)
        wall = shapely.affinity.rotate(
            wall, draw(st.sampled_from([0.0, 0.0, 90.0, -90.0, 30.0, -57.0])), origin=(x, y)
        )
        door = draw(st.floats(0.0, 1.0)) * long
        gap = shapely.Point(wall.centroid).buffer(draw(st.integers(0, 20)) * 0.5 * cell)
        walls.append(wall.difference(shapely.affinity.translate(gap, 0.0, 0.2 * door)))
    degrees = draw(st.sampled_from([0.0, 0.0, 5.0, 27.0, 45.0]))
    shapes = [
        shapely.affinity.rotate(shape, degrees, origin=(0, 0))
        for shape in (shapely.box(0, 0, width, depth), *walls)
    ]
    grid = drawn(shapes[0], shapes[1:], cell)
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    speckle = rng.random(grid.state.shape) < draw(st.sampled_from([0.0, 0.0, 0.002, 0.02]))
    grid.state[speckle] = rng.integers(0, 3, int(speckle.sum()))
    return grid


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(grid=buildings())
def test_any_building_of_thin_walls(grid: OccupancyGrid) -> None:
    env = environment_from_grid(grid)
    assert env.free.is_valid
    assert_walls_stand(grid, env)


@pytest.mark.slow(kept=("3",))
@pytest.mark.parametrize("part", range(4))
def test_the_walls_of_every_map_stand(data_dir: Path, part: int) -> None:
    for path in recorded.all_maps(data_dir)[part::4]:
        env, warned = recorded.read(path)
        grid = env.occupancy
        assert grid is not None and not warned and env.free.is_valid
        drawn = path.parent.name not in ("maps", "maps_from_logs")
        said = "are not taken for floor" if drawn else "each is smaller than 0.25 m²"
        assert all(said in note for note in env.notes), path
        known = (grid.state == FREE).sum() * grid.resolution**2
        assert drawn or 0.8 * known < env.free.area < 1.02 * known, path
        wall, floor = raw_cells.wall_mask(grid), raw_cells.floor_mask(grid)
        away = raw_cells.from_segments(grid, env, raw_cells.beside(wall, floor))
        assert away.max() <= NEAREST + 1e-9, path
        near, rng = raw_cells.close_to(wall, floor), np.random.default_rng(1)
        _, through = raw_cells.rays_through_walls(grid, env, wall, floor, 5000, rng, near)
        assert len(through) == 0, (path, through[:3])
