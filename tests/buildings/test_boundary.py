from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
import shapely

from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.map_server import load_map_server
from ambinav.buildings.ring_checks import crossing
from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from ambinav.geometry.segments import FRONTIER, WALL
from ambinav.runtime.errors import InputError

CELL = {".": FREE, "#": OCCUPIED, "?": UNKNOWN}
# An L-shaped room with 8 corners: 8 x 5 m with a notch of 1.3 x 2 m in its upper wall.
NOTCHED = np.array([[0, 0], [8, 0], [8, 5], [4.9, 5], [4.9, 3], [3.6, 3], [3.6, 5], [0, 5]])


def drawn(
    text: str, resolution: float = 1.0, **origin: tuple[float, float, float]
) -> OccupancyGrid:
    """A grid from a drawing whose last line is row 0."""
    rows = text.split()
    state = np.array([[CELL[c] for c in row] for row in reversed(rows)], dtype=np.uint8)
    return OccupancyGrid(state, resolution, **origin)


def rasterized(
    shape: shapely.Polygon, offset: tuple[float, float] = (0.013, 0.027)
) -> OccupancyGrid:
    """What a map of this room is like at 5 cm: walls of 15 cm, unknown behind them."""
    cell = 0.05
    x0, y0 = shape.bounds[0] - 0.5 + offset[0], shape.bounds[1] - 0.5 + offset[1]
    columns = int((shape.bounds[2] - x0 + 0.5) / cell) + 1
    rows = int((shape.bounds[3] - y0 + 0.5) / cell) + 1
    x, y = np.meshgrid(x0 + (np.arange(columns) + 0.5) * cell, y0 + (np.arange(rows) + 0.5) * cell)
    near = shapely.contains_xy(shape.buffer(0.15), x, y)
    state = np.where(shapely.contains_xy(shape, x, y), FREE, np.where(near, OCCUPIED, UNKNOWN))
    return OccupancyGrid(state.astype(np.uint8), cell, (x0, y0, 0.0))


def turned(points: np.ndarray, degrees: float) -> np.ndarray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return points @ np.array([[c, s], [-s, c]])


def assert_consistent(env: Environment) -> None:
    """The free space is valid and the segments are the edges of its rings, each once."""
    assert env.free.is_valid
    rings = [
        np.asarray(ring.coords)
        for p in shapely.get_parts(env.free)
        for ring in (p.exterior, *p.interiors)
    ]
    edges = {tuple(np.concatenate(pair)) for r in rings for pair in itertools.pairwise(r)}
    reverse = {(c, d, a, b) for a, b, c, d in edges}
    segments = {tuple(s) for s in env.segments.xy}
    assert len(segments) == len(env.segments) == len(edges)
    assert segments <= edges | reverse


SQUARE = """
    ??????
    ?####?
    ?#..#?
    ?#..#?
    ?####?
    ??????
"""


def test_square_room_without_simplification() -> None:
    # Free cells x in [2, 4], y in [2, 4]; corners are cut through the middles of their edges.
    env = environment_from_grid(drawn(SQUARE), tolerance=0.0)
    assert env.bounds == (2.0, 2.0, 4.0, 4.0)
    assert env.free.area == pytest.approx(4.0 - 4 * 0.125)
    assert env.segments.walls.all()
    assert_consistent(env)


def test_origin_and_yaw_move_the_free_space() -> None:
    plain = environment_from_grid(drawn(SQUARE, 0.5), tolerance=0.0, gap=0.0)
    moved = environment_from_grid(
        drawn(SQUARE, 0.5, origin=(10.0, -3.0, math.pi / 2)), tolerance=0.0, gap=0.0
    )
    np.testing.assert_allclose(
        moved.segments.xy, plain.segments.transformed(math.pi / 2, 10.0, -3.0).xy, atol=1e-12
    )


def test_the_rim_of_the_image_is_a_frontier() -> None:
    # A corridor that leaves the image on the left and ends in unknown space on the right.
    rows = ["#" * 20] + 12 * ["." * 14 + "?" * 6] + ["#" * 20]
    grid = drawn(" ".join(rows), 0.1)
    env = environment_from_grid(grid, tolerance=0.1)
    x = env.segments.xy[:, 0::2].mean(axis=1)
    frontier = env.segments.kind == FRONTIER
    # Walls reach one cell into each end of the frontiers, which are 1.2 m long.
    assert env.segments.lengths[frontier & (x < 0.05)].sum() == pytest.approx(1.0, abs=0.2)
    assert env.segments.lengths[frontier & (x > 1.35)].sum() == pytest.approx(1.0, abs=0.2)
    assert not frontier[(x > 0.2) & (x < 1.2)].any()
    assert_consistent(env)


ROOMS = """
    #########
    #...#...#
    #...#...#
    #.......#
    #...#...#
    #...#...#
    #########
"""


def test_gap_closes_an_opening_of_one_cell() -> None:
    joined = environment_from_grid(drawn(ROOMS), gap=0.0)
    apart = environment_from_grid(drawn(ROOMS), gap=1.0)
    assert len(shapely.get_parts(joined.free)) == 1
    assert len(shapely.get_parts(apart.free)) == 2
    # The default closes cracks of 0.1 m at most: a cell of a metre is a door.
    assert environment_from_grid(drawn(ROOMS)).free.equals(joined.free)
    assert len(shapely.get_parts(environment_from_grid(drawn(ROOMS, 0.1), min_area=0.1).free)) == 2


def test_free_cells_that_touch_at_a_corner_are_apart() -> None:
    grid = drawn("##### #..## #..## ##..# ##..# #####")
    assert len(shapely.get_parts(environment_from_grid(grid, tolerance=0.0).free)) == 1
    grid = drawn("###### #..### #..### ###..# ###..# ######")
    assert len(shapely.get_parts(environment_from_grid(grid, tolerance=0.0).free)) == 2


def pillars(*sizes: int, kind: int = OCCUPIED) -> OccupancyGrid:
    """A room of 4 x 1 m at 5 cm with square pillars of so many cells."""
    state = np.full((24, 84), OCCUPIED, np.uint8)
    state[2:-2, 2:-2] = FREE
    for k, size in enumerate(sizes):
        state[10 : 10 + size, 10 + 15 * k : 10 + 15 * k + size] = kind
    return OccupancyGrid(state, 0.05)


def test_specks_are_noise_and_legs_are_not() -> None:
    assert len(environment_from_grid(pillars(1, 2, 4)).free.interiors) == 2
    assert len(environment_from_grid(pillars(1, 2, 4), gap=0.0).free.interiors) == 3
    assert len(environment_from_grid(pillars(1, 2, 4), gap=0.1).free.interiors) == 1
    # Three gaps square where nothing is known to be occupied.
    assert len(environment_from_grid(pillars(3, 4, kind=UNKNOWN)).free.interiors) == 1


def test_pillars_keep_their_size() -> None:
    env = environment_from_grid(pillars(3, 6, 10))
    areas = sorted(shapely.Polygon(ring).area for ring in env.free.interiors)
    np.testing.assert_allclose(areas, [0.0225, 0.09, 0.25], rtol=0.15)


def test_small_free_components_are_left_out() -> None:
    state = np.full((40, 60), OCCUPIED, np.uint8)
    state[5:35, 5:35] = FREE  # 2.25 m^2
    state[5:14, 45:54] = FREE  # 0.2025 m^2
    grid = OccupancyGrid(state, 0.05)
    assert len(shapely.get_parts(environment_from_grid(grid).free)) == 1
    assert len(shapely.get_parts(environment_from_grid(grid, min_area=0.1).free)) == 2
    with pytest.raises(InputError, match="no piece of free space has 9 m"):
        environment_from_grid(grid, min_area=9.0)


@pytest.mark.parametrize("degrees", [0, 3, 6, 11, 18, 30, 42, 45])
def test_walls_come_out_straight_at_any_angle(degrees: float) -> None:
    room = shapely.Polygon(turned(NOTCHED, degrees))
    env = environment_from_grid(rasterized(room))
    assert_consistent(env)
    assert len(env.segments) == 8
    vertices = env.segments.xy[:, :2]
    for a, b in itertools.pairwise(np.asarray(room.exterior.coords)):
        start = np.hypot(*(vertices - a).T)
        end = np.hypot(*(env.segments.xy[:, 2:] - b).T)
        nearest = int(np.argmin(start + end))
        assert max(start[nearest], end[nearest]) < 0.03
        run = env.segments.xy[nearest, 2:] - env.segments.xy[nearest, :2]
        wall = b - a
        turn = math.degrees(
            math.asin((run[0] * wall[1] - run[1] * wall[0]) / math.hypot(*run) / math.hypot(*wall))
        )
        # Half a cell at each end of a short wall is already a degree.
        assert abs(turn) < (0.5 if math.hypot(*wall) > 2.5 else 1.0)


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.013, 0.021), (0.03, 0.04)])
def test_round_room(offset: tuple[float, float]) -> None:
    circle = shapely.Point(0.0, 0.0).buffer(5.0, quad_segs=200)
    env = environment_from_grid(rasterized(circle, offset))
    points = shapely.get_coordinates(shapely.segmentize(env.free.exterior, 0.05))
    radius = np.hypot(points[:, 0], points[:, 1])
    assert np.abs(radius - 5.0).max() < 0.045
    assert abs(radius.mean() - 5.0) < 0.005
    assert len(env.segments) < 50


def test_rough_walls_come_out_straight() -> None:
    rng = np.random.default_rng(5)
    grid = rasterized(shapely.Polygon(turned(np.array([[0, 0], [12, 0], [12, 2], [0, 2]]), 17)))
    free = grid.state == FREE
    rim = free & ~(
        np.roll(free, 1, 0) & np.roll(free, -1, 0) & np.roll(free, 1, 1) & np.roll(free, -1, 1)
    )
    grid.state[rim & (rng.random(rim.shape) < 0.3)] = OCCUPIED
    env = environment_from_grid(grid)
    long = env.segments.lengths > 3.0
    assert env.segments.lengths[long].sum() > 22.0
    run = env.segments.xy[long, 2:] - env.segments.xy[long, :2]
    angle = np.degrees(np.arctan2(run[:, 1], run[:, 0])) % 180.0
    assert np.abs(angle - 17.0).max() < 0.7


@pytest.mark.parametrize(
    "seed", [*range(6), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(6, 9))]
)
def test_noise_gives_a_valid_free_space(seed: int) -> None:
    rng = np.random.default_rng(seed)
    coarse = rng.choice([FREE, FREE, FREE, OCCUPIED, UNKNOWN], size=(20, 25))
    state = np.kron(coarse, np.ones((4, 4))).astype(np.uint8)
    flip = rng.random(state.shape) < 0.1
    state[flip] = rng.integers(0, 3, int(flip.sum()))
    grid = OccupancyGrid(state, 0.05, (1.0, 2.0, 0.3))
    for tolerance in (None, 0.0, 0.3):
        env = environment_from_grid(grid, tolerance=tolerance)
        assert_consistent(env)
        assert set(np.unique(env.segments.kind)) <= {WALL, FRONTIER}


def test_free_space_is_on_the_left() -> None:
    env = environment_from_grid(pillars(6))
    middle = 0.5 * (env.segments.xy[:, :2] + env.segments.xy[:, 2:])
    run = env.segments.xy[:, 2:] - env.segments.xy[:, :2]
    left = np.stack([-run[:, 1], run[:, 0]], axis=1) / env.segments.lengths[:, None]
    assert shapely.contains_xy(env.free, *(middle + 0.01 * left).T).all()


def test_crossing_edges_are_found() -> None:
    ring = np.array([[0, 0], [4, 0], [4, 4], [0, 4.0]])
    tie = np.array([[10, 0], [14, 4], [14, 0], [10, 4.0]])
    spike = np.array([[20, 0], [24, 0], [22, 0], [22, 3.0]])
    edges = [np.hstack([r, np.roll(r, -1, axis=0)]) for r in (ring, tie, spike)]
    bad = crossing(np.concatenate(edges), np.repeat([0, 1, 2], 4))
    assert bad.tolist() == 4 * [False] + [True, False, True, False] + [True, True, True, False]


@pytest.mark.parametrize("key", ["tolerance", "gap", "min_area"])
@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_wrong_parameters(key: str, value: float) -> None:
    with pytest.raises(InputError, match=key):
        environment_from_grid(drawn(SQUARE), **{key: value})


def test_willow_has_few_segments(data_dir: Path) -> None:
    env = environment_from_grid(load_map_server(data_dir / "maps" / "willow_full_005.yaml"))
    assert 2500 < len(env.segments) < 5000
    assert_consistent(env)
