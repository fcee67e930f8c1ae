"""No route of any planner covers an occupied cell of the map that it was planned on.

Routes are planned on every occupancy map of the data folder and checked on its raw cells. Maps of
more than four million cells are cropped to their busiest part; the ambiguity maps are coarse, which
does not matter to what is checked.
"""

from __future__ import annotations

import functools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

pytest.importorskip("ompl")

import ambinav as an
from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.map_server import load_map_server
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from ambinav_planners import NotFoundError, RoutePlanner, planners
from ambinav_planners.search.lattice_graph import lattice_of
from tests.buildings import raw_intrusion

FOLDERS = ("maps", "maps_from_logs", "maps_research_only", "planner_maps")
MOST_CELLS, WINDOW, BLOCK = 4_000_000, 1200, 100
CELLS = 8000
"""About so many cells has the ambiguity map."""
BODY = Footprint.polygon([(-0.15, -0.12), (0.22, -0.12), (0.26, 0.0), (0.22, 0.12), (-0.15, 0.12)])
SCANNER = an.RangeScanner.planar(
    sensor=an.RangeSensor(max_range=2.0, std=0.03, resolution=0.01), beams=36, aperture=math.tau
)


@functools.cache
def all_maps(data_dir: Path) -> tuple[Path, ...]:
    found = [path for name in FOLDERS for path in sorted((data_dir / name).glob("*.yaml"))]
    assert len(found) >= 30
    return tuple(found)


def cropped(grid: OccupancyGrid) -> OccupancyGrid:
    """The grid; of a large one the window where the most blocks hold walls and floor."""
    rows, columns = grid.state.shape
    if grid.state.size <= MOST_CELLS:
        return grid
    state = grid.state[: rows // BLOCK * BLOCK, : columns // BLOCK * BLOCK]
    blocks = state.reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK)
    busy = (blocks == FREE).any(axis=(1, 3)) & (blocks == OCCUPIED).any(axis=(1, 3))
    n = WINDOW // BLOCK
    count = np.lib.stride_tricks.sliding_window_view(np.pad(busy, ((0, n), (0, n))), (n, n))
    row, column = np.unravel_index(count.sum(axis=(2, 3)).argmax(), busy.shape) * np.array([BLOCK])
    part = grid.state[row : row + WINDOW, column : column + WINDOW]
    x, y = grid.to_world(column, row)
    return OccupancyGrid(part, grid.resolution, (float(x), float(y), grid.origin[2]))


def check_motions(grid: OccupancyGrid, env: Environment, radius: float) -> None:
    """Random motions of a disc: what is free is free on the cells, and where rays are cast."""
    rng = np.random.default_rng(1)
    checker = CollisionChecker(env, Footprint.disc(radius), Steering())
    xmin, ymin, xmax, ymax = env.bounds
    a = rng.uniform((xmin, ymin, 0), (xmax, ymax, 0), (40_000, 3))
    a = a[checker.poses_free(a)][:3000]
    b = a + rng.normal(0.0, (5 * radius, 5 * radius, 0.0), a.shape)
    free = checker.motions_free(a, b)
    assert free.sum() > 100
    ends = raw_intrusion.in_grid(grid, np.concatenate([a[free, :2], b[free, :2]]))
    lines = shapely.linestrings(np.stack(np.split(ends, 2), axis=1))
    spread = shapely.get_coordinates(shapely.segmentize(lines, radius))
    squares = raw_intrusion.squares_near(grid, spread, 2 * radius)
    if len(squares):
        tree = shapely.STRtree(lines)
        _, away = tree.query_nearest(squares, all_matches=False, return_distance=True)
        assert away.min() >= radius - raw_intrusion.ROUNDING
    assert CollisionChecker(env, checker.footprint, Steering(), simulated=True).poses_free(a).all()


def pair(robot: RoutePlanner, seed: int, reach: float) -> list[NDArray[Any]]:
    """Two free places of the largest part of the floor, no further apart than `reach` metres."""
    graph = lattice_of(robot.service, robot.checker).graph
    parts = graph.components()
    places = graph.poses[parts == np.bincount(parts).argmax()]
    rng = np.random.default_rng(seed)
    start = places[rng.integers(len(places))]
    near = places[np.hypot(*(places - start)[:, :2].T) <= reach]
    return [start, near[rng.integers(len(near))]]


@pytest.mark.parametrize(
    "step", [pytest.param(32, marks=pytest.mark.slow), pytest.param(1, marks=pytest.mark.sweep)]
)
def test_on_every_map(data_dir: Path, step: int) -> None:
    names = sorted(planners())
    found: dict[str, int] = dict.fromkeys([*names, "se2", "dubins", "reeds-shepp"], 0)
    maps = all_maps(data_dir)[::step]
    for number, path in enumerate(maps):
        grid = cropped(load_map_server(path))
        env = environment_from_grid(grid)
        # Where a cell is as large as a room the robot is too.
        scale = max(1.0, 2.0 * grid.resolution)
        check_motions(grid, env, 0.2 * scale)
        spacing = max(0.2 * scale, math.sqrt(env.free.area / CELLS))
        amap = an.build_map(env, SCANNER, spacing=spacing, radius=2 * spacing)
        disc = RoutePlanner(amap, footprint=0.2 * scale)
        # Every planner plans, where there are fewer maps than planners too.
        others = names[number :: len(maps)] or [names[number % len(names)]]
        for name in sorted({"reference", *others}):
            # Those that grow a tree take a sample an iteration; the others take many.
            tree = name.endswith(("rrtstar", "bitstar"))
            budget = {"iterations": 20_000 if tree else 1000, "seconds": math.inf}
            for seed in range(2 if name == "reference" else 1):
                # Tree planners get a short path, so that they find one soon.
                ends = pair(disc, seed, math.inf if name == "reference" else 40 * spacing)
                try:
                    route = disc.plan(*ends, planner_name=name, seed=seed, **budget)
                except NotFoundError:
                    continue
                deep = raw_intrusion.route_intrusion(
                    grid, disc.checker.footprint, disc.checker.steering, route.poses
                )
                assert deep <= raw_intrusion.ROUNDING, (path.name, name, deep)
                found[name] += 1
        space = ("se2", "dubins", "reeds-shepp")[number % 3]
        body = BODY if scale == 1.0 else Footprint.polygon(scale * BODY.corners)
        car = RoutePlanner(
            disc.service, footprint=body, space=space, turning_radius=0.0 if space == "se2" else 0.4
        )
        ends = pair(disc, 1, 20 * spacing)
        if not car.checker.poses_free(ends).all():
            continue
        try:
            route = car.plan(
                *ends, planner_name="prmstar", seconds=math.inf, iterations=300, seed=0
            )
        except NotFoundError:
            continue
        deep = raw_intrusion.route_intrusion(grid, body, car.checker.steering, route.poses)
        assert deep <= raw_intrusion.ROUNDING, (path.name, space, deep)
        found[space] += 1
    assert found.pop("reference") * step >= 50
    assert min(found.values()) >= 1 or (step > 1 and sum(map(bool, found.values())) > 5), found


def test_a_route_on_an_opened_map_goes_round_a_table_leg(tmp_path: Path) -> None:
    state = np.full((40, 60), OCCUPIED, dtype=np.uint8)
    state[2:-2, 2:-2] = FREE
    state[20, 30] = OCCUPIED
    grid = OccupancyGrid(state, 0.05)
    an.build_map(environment_from_grid(grid), SCANNER, spacing=0.1).save(tmp_path / "a.zarr")
    robot = RoutePlanner(an.AmbiguityMap.open(tmp_path / "a.zarr"), footprint=0.2)
    budget = {"iterations": 1000, "seconds": math.inf}
    for name in ("reference", "prmstar", "rrtstar"):
        route = robot.plan((0.5, 1.025), (2.5, 1.025), planner_name=name, weight=0.0, **budget)
        assert route.length > 2.01
        assert raw_intrusion.disc_intrusion(grid, 0.2, route.poses[:, :2]) <= raw_intrusion.ROUNDING
