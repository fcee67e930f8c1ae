"""The planning problem: start, goal, robot, cost; checked before any planner runs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import product
from weakref import WeakKeyDictionary, WeakValueDictionary

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.config import check_kind
from ambinav.drive.noise import OdometryNoise
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import OPEN
from ambinav.runtime.array_types import Bools, Floats, Pose
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.belief.model import BeliefModel
from ambinav_planners.one_way import OneWayLanes
from ambinav_planners.search.limit import BadStretchLimit


@dataclass(frozen=True, eq=False)
class Problem:
    """A start, a goal, and everything that determines the best path between them.

    Attributes:
        service: Service for the cost per metre.
        checker: Collision checker of the robot, with its kind of motion.
        start: x, y, theta in the map frame; metres, radians.
        goal: As `start`.
        limit: How many metres in a row may be bad, or None.
        belief: For planners that look at what the robot will know of its position.
        odometry: Noise of the odometry, for the same planners.
        one_way: Lanes that are driven in one direction only, or None.
    """

    service: AmbiguityService
    checker: CollisionChecker
    start: Pose
    goal: Pose
    limit: BadStretchLimit | None = None
    belief: BeliefModel = field(default_factory=BeliefModel)
    odometry: OdometryNoise = field(default_factory=OdometryNoise)
    one_way: OneWayLanes | None = None

    @property
    def steering(self) -> Steering:
        """The kind of motion."""
        return self.checker.steering

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax) of the free space, metres."""
        xmin, ymin, xmax, ymax = self.checker.environment.free.bounds
        return xmin, ymin, xmax, ymax

    @property
    def ends(self) -> Floats:
        """Start and goal, shape (2, 3)."""
        return np.array([self.start, self.goal])


_checkers: WeakKeyDictionary[
    AmbiguityMap, WeakValueDictionary[tuple[object, ...], CollisionChecker]
] = WeakKeyDictionary()


def make_checker(
    service: AmbiguityService,
    footprint: Footprint,
    steering: Steering,
    *,
    avoid_open: bool = False,
    keep_out: BaseGeometry | None = None,
) -> CollisionChecker:
    """Return the checker of where the robot fits in the building of the service's map.

    Equal robots on one map share it, and so what is kept for as long as it lives.

    Args:
        service: Its map gives the building and its zones.
        footprint: The robot's outline.
        steering: The kind of motion.
        avoid_open: Forbid the cells of the open zone as if they were walls. With headings, a cell
            counts as open by its mean over heading.
        keep_out: Forbid the cells that meet this polygon too, map frame, metres.
    """
    check_kind(service, AmbiguityService, "service")
    check_kind(footprint, Footprint, "footprint", "give a Footprint, such as Footprint.disc")
    amap = service.map
    forbidden = None
    if avoid_open:
        forbidden = np.asarray(amap.floor("zone").values == OPEN)
    if keep_out is not None:
        kept_out = cells_met(amap, keep_out, "keep_out")
        forbidden = kept_out if forbidden is None else forbidden | kept_out
    closed = None if forbidden is None else forbidden.tobytes()
    key = footprint.radius, footprint.corners.tobytes(), steering, closed
    by_key = _checkers.setdefault(amap, WeakValueDictionary())
    checker = by_key.get(key)
    if checker is None:
        x, y = (float(amap.dataset[name].values[0]) for name in ("x", "y"))
        checker = CollisionChecker(
            amap.environment,
            footprint,
            steering,
            forbidden=forbidden,
            origin=(x, y),
            spacing=amap.spacing,
        )
        by_key[key] = checker
    return checker


def check_on_map(amap: AmbiguityMap, shapes: Iterable[BaseGeometry], name: str) -> None:
    """Check that a shape of some, map frame, metres, meets the map.

    Raises:
        InputError: none does.
    """
    xmin, ymin, xmax, ymax = amap.bounds
    box = shapely.box(xmin, ymin, xmax, ymax)
    drawn = [shape for shape in shapes if not shape.is_empty]
    if drawn and not any(shape.intersects(box) for shape in drawn):
        # Of an edge at 0 rounding leaves something like -3e-17.
        xmin, ymin, xmax, ymax = (round(edge, 6) + 0.0 for edge in amap.bounds)
        raise InputError(
            f"{name}: all of it lies beside the map, which covers x from {xmin:.4g} to {xmax:.4g} "
            f"m and y from {ymin:.4g} to {ymax:.4g} m; give metres in the map's frame."
        )


def cells_met(amap: AmbiguityMap, shape: BaseGeometry, name: str, margin: float = 0.0) -> Bools:
    """Return the cells of a map that meet a shape, bool, (rows, columns).

    Args:
        amap: The map.
        shape: Map frame, metres.
        name: Names the shape in the error.
        margin: Distance by which the shape grows, metres.

    Raises:
        InputError: it is no geometry, or its coordinates are not finite.
    """
    if not isinstance(shape, BaseGeometry):
        raise InputError(f"{name} is {shape!r}; give a shapely geometry in the map's frame.")
    if not np.isfinite(shapely.get_coordinates(shape)).all():
        raise InputError(f"{name} has coordinates that are not finite; give metres.")
    # Of an outline that crosses itself, a buffer loses parts.
    shape = shape if shape.is_valid else shapely.make_valid(shape)
    shape = shape.buffer(margin) if margin > 0.0 else shape
    half = 0.5 * amap.spacing
    x, y = (amap.dataset[axis].values for axis in "xy")
    mask = np.zeros((len(y), len(x)), dtype=np.bool_)
    if not shape.is_empty:
        xmin, ymin, xmax, ymax = shape.bounds
        columns, rows = (
            slice(*np.searchsorted(values, (low - half, high + half)))
            for values, low, high in ((x, xmin, xmax), (y, ymin, ymax))
        )
        u, v = np.meshgrid(x[columns], y[rows])
        shapely.prepare(shape)
        mask[rows, columns] = shapely.intersects(
            shape, shapely.box(u - half, v - half, u + half, v + half)
        )
    return mask


def check_pose(name: str, pose: Sequence[float], checker: CollisionChecker) -> Pose:
    """Return a start or goal as x, y, theta; two numbers get heading 0.

    Raises:
        InputError: not two or three finite numbers, or the robot does not fit there; the message
            says why not and where the nearest free point is.
    """
    try:
        values = [float(value) for value in pose]
    except (TypeError, ValueError):
        raise InputError(f"{name} is {pose!r}; give x and y in metres.") from None
    if len(values) not in (2, 3) or not all(map(math.isfinite, values)):
        turned = checker.steering.space != "r2" or len(values) > 2
        heading_text = ", and a heading in radians if it matters" if turned else ""
        raise InputError(f"{name} is {tuple(values)}; give x and y in metres{heading_text}.")
    x, y, theta = (*values, 0.0)[:3]
    reason = checker.why_not(x, y, theta) or _beyond_a_wall(x, y, theta, checker)
    if reason is None:
        return x, y, theta
    nearest = checker.nearest_free(x, y, theta)
    where = "no other place in this building is free for the robot"
    if nearest is not None:
        where = f"the nearest free point is {_to_digits(nearest, checker)}, {nearest[3]:.2f} m away"
    raise InputError(f"{name} ({x:.10g}, {y:.10g}) is {reason}; {where}.")


def _to_digits(place: tuple[float, float, float, float], checker: CollisionChecker) -> str:
    """Format a point near by with the fewest digits for which it is free when it is typed."""
    x, y, theta, _ = place
    for digits in (2, 3, 4, 6):
        step = 10.0**-digits
        around = [
            (round(x + i * step, digits), round(y + j * step, digits), theta)
            for i, j in sorted(
                product((-1, 0, 1), repeat=2), key=lambda ij: abs(ij[0]) + abs(ij[1])
            )
        ]
        free = checker.poses_free(around)
        if free.any():
            u, v, _ = around[int(free.argmax())]
            return f"({u:.{digits}f}, {v:.{digits}f})"
    return f"({x!r}, {y!r})"


def _beyond_a_wall(x: float, y: float, theta: float, checker: CollisionChecker) -> str | None:
    """Return a text if a wall separates the reference point from the footprint, else None."""
    footprint = checker.footprint
    if footprint.is_disc or footprint.shape.covers(shapely.Point(0.0, 0.0)):
        return None
    inner = footprint.shape.representative_point()
    reach, side = math.hypot(inner.x, inner.y), math.atan2(inner.y, inner.x)
    if checker.geometry.cast(x, y, theta + side, reach) < reach:
        return "such that a wall stands between the reference point and the footprint"
    return None
