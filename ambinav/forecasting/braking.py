"""Speed at which a robot that does not know exactly where it is can still stop before a wall.

A robot that drives at v stops after the distance v t + v^2 / 2a, with the time t until it brakes.
It can stop wherever it truly is within k standard deviations of where it is expected, if

    v t + v^2 / (2 a) <= d,    d = min clearance(p + e) - radius    over e with e' P^-1 e <= k^2,

P the forecast's covariance of the position at p. This is the admissible velocity of Fox, Burgard &
Thrun 1997, "The dynamic window approach to collision avoidance" (v <= sqrt(2 a d)), with a reaction
time, held for every position in the error's ellipse. It matters for walls that only the map knows:
glass, stairs, keep-out zones; before what its scanner sees a robot brakes wherever it thinks it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import NonNegative, Positive, check_fields
from ambinav.forecasting.forecast import Forecast
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Floats

DIRECTIONS = 16
"""Directions, and parts of the radius, at which the ellipse is looked at."""
RINGS = 6


@dataclass(frozen=True, kw_only=True)
class BrakingRule:
    """Rule that bounds the speed by the room that a localization error leaves to stop.

    Attributes:
        sigmas: Standard deviations of the position's error for which it holds (3: 98.9 % of
            positions, if they are normally distributed).
        radius: Radius of the robot, with any margin to walls, metres.
        acceleration: Deceleration, metres per second squared.
        reaction: Time until it brakes, seconds.
        creep: Speed where there is no room to stop, metres per second.

    Raises:
        InputError: a number is not finite, below 0, or 0 where it must not be.
    """

    radius: NonNegative
    acceleration: Positive
    sigmas: NonNegative = 3.0
    reaction: NonNegative = 0.2
    creep: Positive = 0.1

    def __post_init__(self) -> None:
        check_fields(self, "braking rule")

    def speeds(self, room: ArrayLike) -> Floats:
        """Return the speed from which the robot stops within a distance, at least `creep`.

        Args:
            room: Metres; below 0 counts as 0.
        """
        room = np.maximum(np.asarray(room, dtype=np.float64), 0.0)
        gain, late = self.acceleration, self.reaction
        return np.maximum(gain * (np.sqrt(late * late + 2.0 * room / gain) - late), self.creep)

    def bound(self, amap: AmbiguityMap, forecast: Forecast) -> Floats:
        """Return the `bound` of a speed profile along a forecast route, shape (n, 2).

        Raises:
            InputError: the map has no layer `clearance`.
        """
        room = free_distance(amap, forecast.poses, forecast.covariance, self.sigmas) - self.radius
        return np.column_stack([forecast.distance, self.speeds(room)])

    def creep_metres(self, bound: Floats) -> float:
        """Return the metres with no room to stop even from the creep speed, of a `bound`."""
        return float(np.diff(bound[:, 0], prepend=0.0)[bound[:, 1] <= self.creep].sum())


def free_distance(amap: AmbiguityMap, poses: Floats, covariance: Floats, sigmas: float) -> Floats:
    """Return the smallest clearance in the error's ellipse at poses, metres, shape (n,).

    Args:
        amap: A map with the layer `clearance`; what is not free has none.
        poses: Shape (n, 3).
        covariance: Of x, y and heading, shape (n, 3, 3).
        sigmas: Radius of the ellipse in standard deviations.

    Raises:
        InputError: the map has no such layer.
    """
    angles = 2.0 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS
    unit = np.stack([np.cos(angles), np.sin(angles)])
    values, axes = np.linalg.eigh(covariance[:, :2, :2])
    ends = (axes * np.sqrt(np.maximum(values, 0.0))[:, np.newaxis]) @ unit
    nearest = np.full(len(poses), np.inf)
    for share in np.linspace(0.0, sigmas, RINGS + 1):
        x, y = poses[:, :2].T[:, :, np.newaxis] + share * ends.transpose(1, 0, 2)
        clearance = np.nan_to_num(amap.sample("clearance", x, y), nan=0.0, posinf=np.inf)
        nearest = np.minimum(nearest, clearance.min(axis=1))
    return nearest
