"""Table of expected ranges of each kind of sensor, by position and direction.

A cone is many rays, and casting them for each particle is most of what the ray model costs. Here
they are cast once, from the points of a lattice in evenly spaced directions, and looked up at the
nearest point and direction (the idea of Fox, Burgard & Thrun, "Markov localization for mobile
robots in dynamic environments", JAIR 11, 1999, section 3.4).
"""

from __future__ import annotations

import math
from itertools import groupby
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.runtime.array_types import Bools, Floats, Floats32, Ints, Ints32
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav.sensing.casting import cast_reflectors
from ambinav.sensing.scanner import RangeScanner

# Directions of a table, at least; a laser's are 1 degree apart, a cone's a sixth of its aperture.
LASER_DIRECTIONS, CONE_SHARE = 360, 6.0
# A table of more bytes than this is refused.
MOST_BYTES = 4_000_000_000
CHUNK = 2048


class RangeTable(NamedTuple):
    """Ranges of the S kinds of beams of a scanner, at N free points in D directions.

    Beams of one kind are of one sensor, in space also of one height and elevation.

    Attributes:
        ranges: float32, shape (S, N, D), metres; inf without an echo. Direction k is
            2 pi k / D, map frame.
        cells: Number of each lattice point, int32, shape (rows, columns); -1 if it is not free.
        x: x of the point in column 0, metres.
        y: y of the point in row 0, metres.
        inverse: Points per metre.
        sensor: Kind of each beam, int64, shape (U,).
        mount: x, y (metres) and direction (radians) of each beam in the robot frame, shape (U, 3).
        reflects: Whether a reflector is met there, as `ranges`; of shape (0, 0, 1) where no sensor
            reads intensities, or there is no reflector.
    """

    ranges: Floats32
    cells: Ints32
    x: float
    y: float
    inverse: float
    sensor: Ints
    mount: Floats
    reflects: Bools


def empty_range_table() -> RangeTable:
    """Return a table for filters that do not use it."""
    return RangeTable(
        np.zeros((0, 0, 1), dtype=np.float32), np.zeros((1, 1), dtype=np.int32), 0.0, 0.0, 1.0,
        np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 0, 1), dtype=np.bool_),
    )  # fmt: skip


# The latest table of each environment: a study drives many routes with the same.
_latest: WeakKeyDictionary[Environment, tuple[tuple[object, ...], RangeTable]] = WeakKeyDictionary()


def range_table(
    environment: Environment, scanner: RangeScanner, beams: Ints, resolution: float
) -> RangeTable:
    """Return the table of chosen beams; the latest one of an environment is cached.

    Args:
        environment: The map.
        scanner: The scanner of the beams.
        beams: Which of them, shape (U,).
        resolution: Spacing of the lattice, metres.

    Raises:
        InputError: the resolution is of no use, or the table would be too large.
    """
    key = (scanner, tuple(beams.tolist()), resolution)
    entry = _latest.get(environment)
    if entry is None or entry[0] != key:
        entry = key, _cast(environment, scanner, beams, resolution)
        _latest[environment] = entry
    return entry[1]


def _cast(
    environment: Environment, scanner: RangeScanner, beams: Ints, resolution: float
) -> RangeTable:
    lattice = Lattice.over(environment, resolution)
    in_space = environment.space is not None
    # In the plane heights mean nothing, and all elevations are 0.
    upright = scanner.upright[beams] * in_space
    kinds, sensor = np.unique(
        np.column_stack([scanner.sensor_of_beam[beams], upright]), axis=0, return_inverse=True
    )
    sensors = [scanner.sensors[int(k)] for k in kinds[:, 0]]
    # An even number, since a planar scanner's beams begin behind, at -pi.
    directions = 2 * max(
        math.ceil(math.pi * CONE_SHARE / s.aperture) if s.aperture else LASER_DIRECTIONS // 2
        for s in sensors
    )
    rows, columns = np.nonzero(lattice.free)
    size = 4 * len(sensors) * len(rows) * directions
    if size > MOST_BYTES:
        raise InputError(
            f"beam_table_resolution is {resolution:g}, which makes a table of {size / 1e9:.1f} GB "
            f"for {environment.name!r}; give the localizer a coarser one, or 0 for none."
        )
    x, y = lattice.x[columns], lattice.y[rows]
    ranges = np.empty((len(sensors), len(rows), directions), dtype=np.float32)
    has_intensity = environment.has_reflectors and any(
        model.intensity is not None for model in sensors
    )
    reflects = np.zeros(ranges.shape if has_intensity else (0, 0, 1), dtype=np.bool_)
    # Those of one sensor and height together: in space the layers of a column walk as one.
    for _, group in groupby(range(len(kinds)), lambda k: tuple(kinds[k, :2])):
        which = list(group)
        model, height = sensors[which[0]], kinds[which[0], 1]
        around = RangeScanner.layered(model, directions, kinds[which, 2].tolist(), z=height)
        for first in range(0, len(rows), CHUNK):
            part = slice(first, first + CHUNK)
            seen = around.scan(environment, x[part], y[part], 0.0)
            ranges[which, part] = _from_ahead(seen, len(which))
            if has_intensity:
                met = cast_reflectors(
                    environment, around.rays(), model.max_range, x[part], y[part], 0.0
                )
                reflects[which, part] = _from_ahead(met, len(which))
    return RangeTable(
        ranges, lattice.index, float(lattice.x[0]), float(lattice.y[0]), 1.0 / resolution,
        sensor.reshape(-1).astype(np.int64), np.ascontiguousarray(scanner.mounts[beams]), reflects,
    )  # fmt: skip


def _from_ahead(seen: NDArray[Any], layers: int) -> NDArray[Any]:
    """Reorder N points with L layers, (N, L D), to layer by layer from ahead, (L, N, D)."""
    parted = seen.reshape(len(seen), layers, -1).transpose(1, 0, 2)
    return np.roll(parted, -(parted.shape[2] // 2), axis=2)


# What follows takes arrays out of a table once for all beams. Without a sign, numba need not ask at
# each access whether an index counts from the end.
@kernel(inline="always")
def point_at(x, y, left, low, inverse, cells):
    """Return the nearest point of a table; -1 where it is not free.

    Args:
        x: x of the sensor, metres, map frame.
        y: The same.
        left: See `RangeTable.x`.
        low: See `RangeTable.y`.
        inverse: See `RangeTable`, as `cells`.
        cells: See there.
    """
    u = (x - left) * inverse + 0.5
    v = (y - low) * inverse + 0.5
    if u >= 0.0 and v >= 0.0 and u < cells.shape[1] and v < cells.shape[0]:
        return cells[np.uint64(v), np.uint64(u)]
    return -1


@kernel(inline="always")
def direction_of(heading, directions):
    """Return the nearest of a table's directions to a heading, radians, map frame."""
    k = int(math.floor(heading * (directions / (2.0 * math.pi)) + 0.5))
    # Nearly all are within a turn of the circle: without a division, which takes as long as all
    # the rest.
    k += directions if k < 0 else 0
    k -= directions if k >= directions else 0
    return np.uint64(k if 0 <= k < directions else k % directions)


@kernel(_nrt=False)
def reflectors_looked_up(x, y, theta, table, met):
    """Write to `met`, shape (U,), whether each beam ought to meet a reflector; see `looked_up`."""
    co, si = math.cos(theta), math.sin(theta)
    cells, sensor, mount, reflects = table.cells, table.sensor, table.mount, table.reflects
    left, low, inverse, directions = table.x, table.y, table.inverse, table.ranges.shape[2]
    for b in range(sensor.size):
        mx, my = mount[b, 0], mount[b, 1]
        point = point_at(x + co * mx - si * my, y + si * mx + co * my, left, low, inverse, cells)
        k = direction_of(theta + mount[b, 2], directions)
        met[b] = point >= 0 and reflects[np.uint64(sensor[b]), np.uint64(point), k]


@kernel(_nrt=False)
def looked_up(x, y, theta, table, ranges):
    """Look up the expected range of each beam at one pose.

    Args:
        x: Metres, map frame.
        y: Metres, map frame.
        theta: Radians.
        table: See `RangeTable`.
        ranges: Written, shape (U,), metres: inf without an echo, nan where the nearest point to
            the sensor is not free.
    """
    co, si = math.cos(theta), math.sin(theta)
    cells, sensor, mount, values = table.cells, table.sensor, table.mount, table.ranges
    left, low, inverse, directions = table.x, table.y, table.inverse, values.shape[2]
    point, at_x, at_y = -1, math.nan, math.nan
    for b in range(sensor.size):
        mx, my = mount[b, 0], mount[b, 1]
        # Most beams start where the one before does.
        if mx != at_x or my != at_y:
            at_x, at_y = mx, my
            point = point_at(
                x + co * mx - si * my, y + si * mx + co * my, left, low, inverse, cells
            )
        k = direction_of(theta + mount[b, 2], directions)
        ranges[b] = values[np.uint64(sensor[b]), np.uint64(point), k] if point >= 0 else math.nan
