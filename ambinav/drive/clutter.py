"""Boxes that were added to a building after its map was made, unknown to the localizer."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely import affinity
from shapely.geometry.base import BaseGeometry

from ambinav.casting.prisms.prisms import Solid
from ambinav.casting.solids import with_solids
from ambinav.config import as_number
from ambinav.geometry.edit import polygons_of
from ambinav.geometry.environment import Environment
from ambinav.geometry.motion.steering import checked_poses
from ambinav.geometry.segments import WALL, Segments
from ambinav.runtime.errors import InputError

OBSTACLE_HEIGHT: Final = 1.0
"""Height of added obstacles in a building in space, metres: between a table (0.75 m) and a loaded
pallet or trolley (1.2 m and more). Scanners of small robots see it, those on a mast look over it.
"""
TRIES = 10_000
# A piece of outline shorter than this, in metres, is left out: rounding at a wall.
SHORTEST = 1e-6


def with_obstacles(
    environment: Environment, obstacles: list[BaseGeometry], *, height: float = OBSTACLE_HEIGHT
) -> Environment:
    """Return the environment with polygons as obstacles; their outlines are walls.

    In a building in space they are solids on the floor, over which rays may pass; a robot does not
    get under or over them.

    Args:
        environment: The environment as mapped; it is left as it is.
        obstacles: Polygons in the map frame, metres. What of them lies outside of the free space
            changes nothing.
        height: Height of all of them, metres; read in a building in space alone.

    Raises:
        InputError: an obstacle is no polygon, no free space is left, the height is not positive,
            or the building in space is neither prisms nor a mesh.
    """
    if not 0.0 < height < math.inf:
        raise InputError(f"height is {height}; give that of the obstacles, above 0 m.")
    for i, shape in enumerate(obstacles):
        if shape.geom_type not in ("Polygon", "MultiPolygon") or not shape.is_valid:
            raise InputError(
                f"obstacles[{i}] is a {shape.geom_type} that cannot be used; give polygons whose "
                "edges do not cross."
            )
    if not obstacles:
        return environment
    solid = shapely.union_all(obstacles)
    free = environment.free.difference(solid)
    outline = shapely.get_parts(shapely.line_merge(solid.boundary.intersection(environment.free)))
    pieces = [
        np.hstack([xy[:-1], xy[1:]])
        for xy in (shapely.get_coordinates(line) for line in outline)
        if len(xy) > 1
    ]
    fresh = np.vstack([np.empty((0, 4)), *pieces])
    fresh = fresh[np.hypot(fresh[:, 2] - fresh[:, 0], fresh[:, 3] - fresh[:, 1]) > SHORTEST]
    old, drivable = environment.segments, environment.drivable
    made = Environment(
        Segments(
            np.vstack([old.xy, fresh]),
            np.concatenate([old.kind, np.full(len(fresh), WALL, dtype=np.uint8)]),
        ),
        free,
        name=environment.name,
        source=environment.source,
        checksum=environment.checksum,
        resolution=environment.resolution,
        notes=(*environment.notes, f"{len(obstacles)} obstacles were put into it"),
        extent=environment.extent,
        drivable=None if drivable is None else drivable.difference(solid),
    )
    if environment.space is None:
        return made
    floor = environment.floor
    on_floor = shapely.get_parts(polygons_of(solid.intersection(environment.free)))
    standing = [Solid(part, floor, floor + height) for part in on_floor]
    return made.in_space(with_solids(environment.space, standing), floor)


def scattered_boxes(
    environment: Environment,
    count: int,
    rng: np.random.Generator,
    *,
    sizes: tuple[float, float] = (0.3, 0.8),
    route: ArrayLike | None = None,
    margin: float = 0.5,
) -> list[BaseGeometry]:
    """Sample boxes at random poses in the free space, off a route.

    Args:
        environment: Where they stand.
        count: How many.
        rng: The source of randomness.
        sizes: Least and greatest edge, metres.
        route: Poses, shape (N, 3); the boxes keep off the lines between them.
        margin: By this much, metres.

    Raises:
        InputError: the sizes or the count are of no use, or there is no room.
    """
    try:
        low, high = (as_number(size, "sizes") for size in sizes)
    except (TypeError, ValueError):
        raise InputError(f"sizes is {sizes!r}; give the least and the greatest edge.") from None
    margin = as_number(margin, "margin")
    if not 0.0 < low <= high:
        raise InputError(f"sizes is {sizes}; give the least and the greatest edge, above 0 m.")
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 0:
        raise InputError(f"count is {count!r}; give a whole number from 0 on.")
    line = None if route is None else shapely.LineString(checked_poses(route, "route")[:, :2])
    shapely.prepare(environment.free)
    xmin, ymin, xmax, ymax = environment.bounds
    boxes: list[BaseGeometry] = []
    for _ in range(TRIES):
        if len(boxes) == count:
            return boxes
        x, y = rng.uniform((xmin, ymin), (xmax, ymax))
        width, depth = rng.uniform(low, high, 2)
        box = affinity.rotate(
            shapely.box(x - width / 2, y - depth / 2, x + width / 2, y + depth / 2),
            rng.uniform(0.0, 90.0),
        )
        if environment.free.contains(box) and (line is None or line.distance(box) >= margin):
            boxes.append(box)
    if len(boxes) == count:
        return boxes
    raise InputError(
        f"count is {count}; there is room for {len(boxes)} boxes of up to {high:g} m, "
        f"{margin:g} m off the route: give fewer or smaller ones."
    )
