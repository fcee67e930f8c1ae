"""ROS messages to ambinav's arrays and back, as plain values: no ROS is imported here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from ambinav import AmbiguityMap, AmbiguityService, InputError, RangeScanner, export_map

Floats = NDArray[np.float64]
Quaternion = tuple[float, float, float, float]
"""x, y, z, w, as in geometry_msgs."""

UNKNOWN = -1
"""Of an OccupancyGrid: no floor."""
FILTERS = ("nav2-keepout", "nav2-preference", "nav2-speed", "nav2-binary")
"""Kinds of masks, as of `ambinav export`."""
FREE, NOT_FREE, OUTSIDE, NOT_FINITE = range(4)
"""Of the service ambinav_interfaces/GetAmbiguity."""
_ALIGNED = 0.02
"""Radians that a beam of the scanner may lie off a reading, beyond half a step of the scan."""


@dataclass(frozen=True)
class Grid:
    """What a nav_msgs/OccupancyGrid holds.

    Attributes:
        width: Cells along x.
        height: Cells along y.
        resolution: Metres.
        origin: x and y of the lower left corner of cell (0, 0), metres, map frame.
        data: int8, row after row from the smallest y, x rising within each; -1 unknown, 0 to 100.
    """

    width: int
    height: int
    resolution: float
    origin: tuple[float, float]
    data: NDArray[np.int8]


def occupancy_grid(amap: AmbiguityMap, layer: str = "level") -> Grid:
    """A layer from 0 to 1 as an occupancy grid: 0 to 100, -1 where there is no floor.

    Our arrays and the message both begin at the smallest y: nothing is turned over, as it is for
    the image of a map_server.

    Args:
        amap: The map.
        layer: Its name; where the heading matters, the mean over all is taken.

    Raises:
        InputError: no such layer, or one with a unit of its own.
    """
    values = amap.floor(layer).values
    if not amap.is_share(layer):
        raise InputError(f"layer: {layer!r} does not run from 0 to 1; give level, major or minor.")
    free = np.asarray(amap.dataset["free"].values, dtype=np.bool_) & np.isfinite(values)
    data = np.full(values.shape, UNKNOWN, dtype=np.int8)
    data[free] = np.clip(np.rint(100.0 * values[free]), 0, 100).astype(np.int8)
    return Grid(data.shape[1], data.shape[0], amap.spacing, amap.bounds[:2], data.ravel())


def filter_mask(amap: AmbiguityMap, kind: str) -> tuple[Grid, tuple[int, float, float]]:
    """Mask of a costmap filter of Nav2, and type, base and multiplier of its CostmapFilterInfo.

    Both are read from the files that `ambinav export` writes.

    Args:
        amap: The map.
        kind: One of `FILTERS`.

    Raises:
        InputError: no such kind.
    """
    if kind not in FILTERS:
        raise InputError(f"filter: {kind!r}; give one of {', '.join(FILTERS)}, or none.")
    with TemporaryDirectory() as folder:
        mask, image, params, *_ = export_map(amap, kind, Path(folder) / "mask.yaml")
        header, nodes = (yaml.safe_load(path.read_text()) for path in (mask, params))
        with Image.open(image) as picture:
            data = np.asarray(picture, dtype=np.int8)[::-1]
    (info,) = (nodes[name]["ros__parameters"] for name in nodes if name.endswith("info_server"))
    x, y, _ = header["origin"]
    grid = Grid(data.shape[1], data.shape[0], header["resolution"], (x, y), data.ravel())
    return grid, (info["type"], info["base"], info["multiplier"])


def yaw_of(quaternion: Quaternion) -> float:
    """Yaw of a rotation, radians in (-pi, pi]; roll and pitch are left out.

    Raises:
        InputError: it is no rotation: all zero, as in a message that nobody filled, or not finite.
    """
    x, y, z, w = quaternion
    squared = x * x + y * y + z * z + w * w
    if not (math.isfinite(squared) and squared > 1e-6):
        raise InputError(
            f"orientation: ({x:g}, {y:g}, {z:g}, {w:g}) is not a rotation; give a unit quaternion."
        )
    return math.atan2(2.0 * (w * z + x * y), squared - 2.0 * (y * y + z * z))


def directions(angle_min: float, angle_increment: float, count: int, mounted: Quaternion) -> Floats:
    """Directions of a LaserScan's readings in the robot's frame, radians, shape (count,).

    A negative increment (a scanner that turns clockwise) and one that hangs upside down are both
    taken into account.

    Args:
        angle_min: Of the first reading, radians, in the scanner's frame.
        angle_increment: From one to the next, radians; of either sign.
        count: Number of readings.
        mounted: Rotation of the scanner's frame in the robot's.

    Raises:
        InputError: no rotation, or readings that do not differ in their angle.
    """
    if count > 1 and not (math.isfinite(angle_increment) and angle_increment != 0.0):
        raise InputError(f"angle_increment: {angle_increment:g}; give the angle between readings.")
    yaw_of(mounted)
    x, y, z, w = np.asarray(mounted) / math.hypot(*mounted)
    angle = angle_min + angle_increment * np.arange(count)
    ahead, left = np.cos(angle), np.sin(angle)
    # The upper left part of the rotation matrix.
    across = (1.0 - 2.0 * (y * y + z * z)) * ahead + 2.0 * (x * y - w * z) * left
    along = 2.0 * (x * y + w * z) * ahead + (1.0 - 2.0 * (x * x + z * z)) * left
    return np.asarray(np.arctan2(along, across))


def readings(ranges: ArrayLike, range_min: float, range_max: float) -> Floats:
    """Ranges of a LaserScan as ambinav has them: metres, inf no echo, -inf too near, nan nothing.

    REP 117 says so too. Drivers that are older give range_max or more for no echo, and 0 for
    whatever went wrong, of which nothing is concluded.
    """
    values = np.array(ranges, dtype=np.float64)
    values[values >= range_max] = math.inf
    values[(values > 0.0) & (values < range_min)] = -math.inf
    values[np.isfinite(values) & (values <= 0.0)] = math.nan
    return values


def beams_of(scanner: RangeScanner, ranges: ArrayLike, towards: ArrayLike, step: float) -> Floats:
    """Readings for the beams of a scanner: of each the one in its direction.

    Args:
        scanner: Whose beams, B of them.
        ranges: As `readings` gives them, shape (N,).
        towards: Their directions in the robot's frame, as `directions` gives them, shape (N,).
        step: Angle between two of them, radians, of either sign.

    Returns:
        Shape (B,); nan where the scan has none in the direction, and inf beyond a beam's range.
    """
    values, angles = np.asarray(ranges, dtype=np.float64), np.asarray(towards, dtype=np.float64)
    found = np.full(scanner.beams, math.nan)
    if not values.size:
        return found
    wanted = scanner.mounts[:, 2]
    order = np.argsort(np.mod(angles, math.tau))
    turned = np.mod(angles, math.tau)[order]
    at = np.searchsorted(turned, np.mod(wanted, math.tau))
    pair = np.stack([order[(at - 1) % order.size], order[at % order.size]])
    off = np.abs(np.angle(np.exp(1j * (angles[pair] - wanted))))
    nearest = off.argmin(axis=0)
    each = np.arange(scanner.beams)
    near = off[nearest, each] <= 0.5 * abs(step) + _ALIGNED
    found[near] = values[pair[nearest, each]][near]
    limits = np.array([sensor.max_range for sensor in scanner.sensors])[scanner.sensor_of_beam]
    found[found >= limits] = math.inf
    return found


def ask(
    service: AmbiguityService, x: Sequence[float], y: Sequence[float], theta: Sequence[float]
) -> tuple[Floats, Floats, NDArray[np.uint8]]:
    """Costs, levels and states of poses.

    Args:
        service: Of the map.
        x: Metres.
        y: Metres, as many.
        theta: Radians, as many, or none: the mean over all headings.

    Returns:
        Cost per metre (inf where a robot cannot be), level (nan there) and one of `FREE`,
        `NOT_FREE`, `OUTSIDE`, `NOT_FINITE`; each of as many as x.

    Raises:
        InputError: not equally many.
    """
    xs, ys = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    angles = np.asarray(theta, dtype=np.float64)
    if ys.size != xs.size or angles.size not in (0, xs.size):
        raise InputError(
            f"poses: {xs.size} x, {ys.size} y and {angles.size} theta; give as many of each, or "
            "no theta."
        )
    amap = service.map
    heading = angles if angles.size else None
    level = np.asarray(amap.sample("level", xs, ys, heading), dtype=np.float64)
    if heading is not None or "theta" not in amap.dataset[service.layer].dims:
        cost = np.asarray(service.cost(xs, ys, heading), dtype=np.float64)
    else:
        cost = _mean_cost(service, xs, ys)
    xmin, ymin, xmax, ymax = amap.bounds
    state = np.where(np.isnan(level) | np.isinf(cost), NOT_FREE, FREE).astype(np.uint8)
    state[(xs < xmin) | (xs > xmax) | (ys < ymin) | (ys > ymax)] = OUTSIDE
    state[~np.isfinite(xs + ys + (angles if angles.size else 0.0))] = NOT_FINITE
    cost[state != FREE], level[state != FREE] = math.inf, math.nan
    return cost, level, state


def _mean_cost(service: AmbiguityService, x: Floats, y: Floats) -> Floats:
    """Mean of the costs at all headings of the map at which a robot can stand; inf without any."""
    total, number = np.zeros(x.shape), np.zeros(x.shape)
    for heading in service.map.dataset["theta"].values:
        cost = np.asarray(service.cost(x, y, np.full(x.shape, heading)), dtype=np.float64)
        stands = np.isfinite(cost)
        total[stands] += cost[stands]
        number += stands
    mean = np.full(x.shape, math.inf)
    np.divide(total, number, out=mean, where=number > 0)
    return mean
