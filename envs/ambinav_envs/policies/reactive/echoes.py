"""Obstacle points around the robot from a scan."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ambinav.geometry.frames import wrap_angles
from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.sensing.scanner import RangeScanner

Points = tuple[Floats, Floats]

ARC: Final = math.radians(10.0)
"""An echo of a cone may be anywhere on an arc, which is taken as points at most this far apart."""
MARGIN: Final = math.radians(5.0)
"""A direction this far outside of the next beam is still seen: what is remembered there is not
needed."""
DIRECTIONS: Final = 360
"""Number of directions for which visible points are tabulated."""


class ScanPoints:
    """Positions of a scan's obstacles in the robot's frame (x ahead, y to the left).

    A laser's echo is a point. That of a cone is the nearest thing in it: points on its arc from
    edge to edge. No echo is nothing; too near is an obstacle at the sensor's least range.

    Attributes:
        beams: Number of readings.
        all_around: Whether every direction is seen.
    """

    def __init__(self, scanner: RangeScanner) -> None:
        sensors = [scanner.sensors[i] for i in scanner.sensor_of_beam]
        offsets = [_offsets(sensor.aperture) for sensor in sensors]
        self.beams = scanner.beams
        # Of each point: its beam, where that begins and the direction it looks in.
        self._beam = np.repeat(np.arange(len(sensors)), [len(row) for row in offsets])
        angle = scanner.mounts[self._beam, 2] + np.concatenate(offsets)
        self._x, self._y = scanner.mounts[self._beam, 0], scanner.mounts[self._beam, 1]
        self._cos, self._sin = np.cos(angle), np.sin(angle)
        self._max_range = np.array([sensor.max_range for sensor in sensors])
        self._min_range = np.array([sensor.min_range for sensor in sensors])
        half = np.array([0.5 * sensor.aperture for sensor in sensors]) + MARGIN
        directions = (np.arange(DIRECTIONS) + 0.5) * (2.0 * math.pi / DIRECTIONS)
        offset = np.abs(wrap_angles(directions[:, None] - scanner.mounts[:, 2]))
        self._in_view = np.asarray((offset <= half).any(axis=1))
        self.all_around = bool(self._in_view.all())

    def points(self, scan: Floats32) -> tuple[Floats, Floats]:
        """Return x and y of N scans, shape (N, P) each, metres; inf where there is no echo.

        Args:
            scan: The observation's part `scan`, shape (N, B): reading / maximum range.
        """
        share = scan.astype(np.float64)
        reading = np.maximum(share * self._max_range, self._min_range)[:, self._beam]
        echo = (share < 1.0)[:, self._beam]
        reach = np.where(echo, reading, 0.0)
        x = np.where(echo, self._x + reach * self._cos, np.inf)
        y = np.where(echo, self._y + reach * self._sin, np.inf)
        return x, y

    def in_view(self, angle: Floats) -> Bools:
        """Return whether the scanner sees these directions, radians in the robot's frame."""
        part = np.floor(angle * (DIRECTIONS / (2.0 * math.pi))).astype(np.int64)
        return self._in_view[part % DIRECTIONS]


def nearest_by_direction(x: Floats, y: Floats, count: int) -> Points:
    """Return the nearest point in each of `count` directions, shape (N, count); inf without one.

    Args:
        x: X of points, shape (N, P), metres; inf: none.
        y: The same.
        count: Number of directions. Up to this many points are returned unchanged.
    """
    if x.shape[1] <= count:
        return x, y
    rows = np.arange(len(x))[:, None]
    is_echo = np.isfinite(x)
    distance = np.hypot(x, y)
    angle = np.arctan2(np.where(is_echo, y, 0.0), np.where(is_echo, x, 0.0))
    part = np.floor(angle * (count / (2.0 * math.pi))).astype(np.int64) % count
    # From far to near: of several points in a direction the last that is written stays.
    order = np.argsort(-distance, axis=1, kind="stable")
    nearest = np.full((len(x), count), -1)
    nearest[rows, np.take_along_axis(part, order, axis=1)] = np.where(
        np.take_along_axis(is_echo, order, axis=1), order, -1
    )
    near_x = np.where(nearest >= 0, x[rows, nearest], np.inf)
    near_y = np.where(nearest >= 0, y[rows, nearest], np.inf)
    return near_x, near_y


def _offsets(aperture: float) -> Floats:
    """Return directions within a cone, from edge to edge; only the axis for a laser."""
    if aperture <= 0.0:
        return np.zeros(1)
    return np.linspace(-0.5, 0.5, 1 + 2 * math.ceil(0.5 * aperture / ARC)) * aperture
