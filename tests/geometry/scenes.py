"""Random scenes and the plain, slow ways to answer what the kernels answer fast."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments

Array = NDArray[Any]


def rings(free: shapely.Geometry) -> Array:
    """The border of `free` as segments, shape (N, 4)."""
    found = []
    for polygon in shapely.get_parts(free):
        for ring in (polygon.exterior, *polygon.interiors):
            xy = shapely.get_coordinates(ring)
            found.append(np.hstack([xy[:-1], xy[1:]]))
    return np.vstack(found)


def environment(free: shapely.Geometry, thin: Array | None = None) -> Environment:
    """Free space with walls all around it, and walls without thickness in it."""
    xy = rings(free)
    if thin is not None:
        xy = np.vstack([xy, np.reshape(thin, (-1, 4))])
    return Environment(Segments(xy, np.zeros(len(xy))), free, name="scene")


def room(width: float, depth: float, thin: Array | None = None) -> Environment:
    """A room from (0, 0) to (width, depth)."""
    return environment(shapely.box(0.0, 0.0, width, depth), thin)


def scene(seed: int, size: float = 50.0, blocks: int = 25, thin: int = 12) -> Environment:
    """A hall of size x size with turned blocks, discs and thin walls in it; one piece."""
    rng = np.random.default_rng(seed)
    free = shapely.box(0, 0, size, size)
    for k in range(blocks):
        x, y = rng.uniform(0, size, 2)
        wide, deep = rng.uniform(0.3, 0.12 * size, 2)
        block = shapely.box(x - wide / 2, y - deep / 2, x + wide / 2, y + deep / 2)
        if k % 5 == 0:
            block = shapely.Point(x, y).buffer(wide / 2)
        free -= shapely.affinity.rotate(block, rng.uniform(0, 90))
    free = max(shapely.get_parts(free), key=lambda part: part.area)
    walls = []
    while len(walls) < thin:
        x, y = rng.uniform(0, size, 2)
        angle, length = rng.uniform(0, math.pi), rng.uniform(0.5, 0.15 * size)
        line = [x, y, x + length * math.cos(angle), y + length * math.sin(angle)]
        if free.contains(shapely.LineString([line[:2], line[2:]])):
            walls.append(line)
    return environment(free, np.array(walls))


def points_inside(env: Environment, count: int, seed: int, margin: float = 0.02) -> Array:
    """Points of the free space at least `margin` from every segment, shape (count, 2)."""
    rng = np.random.default_rng(seed)
    xmin, ymin, xmax, ymax = env.bounds
    lines = shapely.multilinestrings(shapely.linestrings(env.segments.xy.reshape(-1, 2, 2)))
    shapely.prepare(env.free)
    found = np.empty((0, 2))
    while len(found) < count:
        xy = rng.uniform((xmin, ymin), (xmax, ymax), (2 * count, 2))
        points = shapely.points(xy)
        good = shapely.contains(env.free, points) & (shapely.distance(points, lines) > margin)
        found = np.vstack([found, xy[good]])
    return found[:count]


def cast_slowly(segments: Array, x: Array, y: Array, angle: Array) -> tuple[Array, Array]:
    """Every ray against every segment: distance, shape (N,), and segment, inf and -1 for none."""
    ux, uy = np.cos(angle)[:, None], np.sin(angle)[:, None]
    wx, wy = segments[:, 0] - x[:, None], segments[:, 1] - y[:, None]
    ex, ey = segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = ux * ey - uy * ex
        along, part = (wx * ey - wy * ex) / cross, (wx * uy - wy * ux) / cross
    hit = (along >= 0) & (part >= -1e-9) & (part <= 1 + 1e-9)
    along = np.where(hit, along, np.inf)
    nearest = along.argmin(axis=1)
    distance = along[np.arange(len(x)), nearest]
    return distance, np.where(np.isfinite(distance), nearest, -1)
