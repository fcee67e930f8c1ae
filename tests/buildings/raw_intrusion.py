"""How far a route puts a footprint over the occupied cells of a map, found on the raw cells alone.

Nothing here is shared with the collision checker: cells are squares, a disc's way is a line with a
distance to each of them, a polygon is laid down at poses a centimetre and half a degree apart. All
of it happens in the grid's own frame. The course of a curve is `Steering.dense`, which
tests/geometry/test_curves.py holds against OMPL's.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.geometry.occupancy_grid import OCCUPIED, OccupancyGrid

Array = NDArray[Any]

STEP = 0.01
"""Between poses, metres."""
ROUNDING = 1e-6
"""An intrusion of less than this, metres, is rounding."""


def in_grid(grid: OccupancyGrid, xy: Array) -> Array:
    """Points of the map frame, (N, 2), in the grid's own frame, metres."""
    x0, y0, yaw = grid.origin
    x, y = xy[:, 0] - x0, xy[:, 1] - y0
    c, s = math.cos(yaw), math.sin(yaw)
    return np.stack([c * x + s * y, -s * x + c * y], axis=-1)


def squares_near(grid: OccupancyGrid, points: Array, reach: float) -> Array:
    """The occupied cells with a point of theirs within `reach` of a point (grid frame), boxes."""
    size = grid.resolution
    low = np.floor((points.min(axis=0) - reach) / size).astype(int) - 1
    high = np.ceil((points.max(axis=0) + reach) / size).astype(int) + 1
    (c0, r0), (c1, r1) = np.maximum(low, 0), np.maximum(high, 0)
    rows, columns = np.nonzero(grid.state[r0:r1, c0:c1] == OCCUPIED)
    middles = (np.stack([columns + c0, rows + r0], axis=-1) + 0.5) * size
    if len(middles) == 0:
        return np.array([])
    limit = reach + size
    away, _ = cKDTree(points).query(middles, distance_upper_bound=limit)
    x, y = middles[away < limit].T
    return np.asarray(shapely.box(x - size / 2, y - size / 2, x + size / 2, y + size / 2))


def disc_intrusion(grid: OccupancyGrid, radius: float, xy: Array) -> float:
    """Metres that a disc reaches into an occupied cell on the way along points; 0 if none."""
    points = in_grid(grid, xy)
    if len(points) == 1:
        points = np.concatenate([points, points + np.array([ROUNDING, 0.0])])
    spread = shapely.get_coordinates(shapely.segmentize(shapely.LineString(points), radius / 2))
    squares = squares_near(grid, spread, 1.5 * radius)
    if len(squares) == 0:
        return 0.0
    lines = shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1))
    _, away = shapely.STRtree(lines).query_nearest(squares, all_matches=False, return_distance=True)
    return max(radius - float(away.min()), 0.0)


def polygon_intrusion(grid: OccupancyGrid, corners: Array, poses: Array) -> float:
    """Metres that a polygon at poses, (N, 3), reaches into an occupied cell at most; 0 if none."""
    places = in_grid(grid, poses[:, :2])
    turn = poses[:, 2] - grid.origin[2]
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    u, v = np.asarray(corners).T
    shapes = shapely.polygons(np.stack([c * u - s * v, s * u + c * v], -1) + places[:, None])
    squares = squares_near(grid, places, float(np.hypot(u, v).max()))
    if len(squares) == 0:
        return 0.0
    shape, square = shapely.STRtree(squares).query(shapes, predicate="intersects")
    # How far the furthest corner of the common part lies within the footprint.
    common = shapely.intersection(shapes[shape], squares[square])
    xy, which = shapely.get_coordinates(common, return_index=True)
    if len(xy) == 0:
        return 0.0
    outlines = shapely.get_exterior_ring(shapes[shape])
    return float(shapely.distance(outlines[which], shapely.points(xy)).max())


def route_intrusion(
    grid: OccupancyGrid, footprint: Footprint, steering: Steering, route: Array
) -> float:
    """Metres that a footprint on a route, (N, 3), reaches into an occupied cell at most."""
    if footprint.is_disc and not steering.turns:
        return disc_intrusion(grid, footprint.radius, route[:, :2])
    step = STEP
    if steering.space == "se2":
        # Half a degree of turning counts as a step.
        turned = np.abs(np.remainder(np.diff(route[:, 2]) + np.pi, 2 * np.pi) - np.pi)
        length = np.hypot(*np.diff(route[:, :2], axis=0).T)
        per_metre = float((turned / np.maximum(length, 1e-3)).max(initial=0.0))
        step = STEP / max(1.0, per_metre * STEP / math.radians(0.5))
    poses = steering.dense(route, step)[0]
    if footprint.is_disc:
        # An arc lies beside its chord by no more than this.
        slack = step**2 / (8.0 * steering.radius)
        return max(disc_intrusion(grid, footprint.radius, poses[:, :2]) - slack, 0.0)
    return polygon_intrusion(grid, footprint.corners, poses)
