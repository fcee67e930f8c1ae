"""Free length and permitted speed of a disc on circular arcs among points."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ambinav.runtime.array_types import Floats

STRAIGHT: Final = 1e-4
"""An arc of less curvature, 1/m, is a straight line."""


def room_around(x: Floats, y: Floats, radius: float, margin: float) -> Floats:
    """Return the radius that each robot keeps free, shape (N,), metres.

    It is the radius of its disc plus a margin. Where an obstacle is already nearer, the margin
    shrinks, by half at most, so that the robot can drive along the obstacle.

    Args:
        x: X of points in the robot's frame, shape (N, P), metres; inf: none.
        y: The same.
        radius: Radius of the disc, metres.
        margin: Metres.
    """
    nearest = np.hypot(x, y).min(axis=1, initial=np.inf)
    return np.asarray(np.clip(nearest, radius + 0.5 * margin, radius + margin), dtype=np.float64)


def free_lengths(x: Floats, y: Floats, curvature: Floats, radius: Floats, most: float) -> Floats:
    """Return the metres that a disc drives forwards on each arc until it touches a point.

    A point on the disc stops motion towards it and none away from it, so that a robot that stands
    too near can leave.

    Args:
        x: X of points in the robot's frame, shape (N, P), metres; inf: none.
        y: The same.
        curvature: Curvature of C arcs, positive to the left, shape (N, C), 1/m.
        radius: Radius of each disc, shape (N,), metres.
        most: The result where nothing is touched that far, metres.

    Returns:
        Shape (N, C), 0 to `most`.
    """
    near = np.isfinite(x) & (np.hypot(x, y) <= most + radius[:, None])
    radius = radius[:, None, None]
    px, py = np.where(near, x, 0.0)[:, None, :], np.where(near, y, 0.0)[:, None, :]
    bend = curvature[:, :, None]
    bent = np.abs(bend) > STRAIGHT
    turn = 1.0 / np.where(bent, np.abs(bend), 1.0)
    side = np.where(bend < 0.0, -py, py)
    # On a line: it is touched where the disc's front arc meets the point.
    inside = radius**2 - py**2
    line = np.where(inside > 0.0, px - np.sqrt(np.maximum(inside, 0.0)), np.inf)
    line = np.where(px > 0.0, line, np.inf)
    # On a circle about (0, turn): the two circles' crossing, seen from that centre.
    away = np.hypot(px, side - turn)
    cosine = (turn**2 + away**2 - radius**2) / np.maximum(2.0 * turn * away, 1e-12)
    touches = np.abs(turn - away) < radius
    at = np.arctan2(px, turn - side) - np.arccos(np.clip(cosine, -1.0, 1.0))
    circle = np.where(touches, turn * (at % (2.0 * math.pi)), np.inf)
    length = np.where(bent, circle, line)
    touching = np.hypot(px, py) < radius
    length = np.where(touching, np.where(px > 0.0, 0.0, np.inf), length)
    length = np.where(near[:, None, :], length, np.inf)
    first = length.min(axis=2, initial=np.inf)
    return np.asarray(np.clip(first, 0.0, most), dtype=np.float64)


def stopping_speed(length: Floats, braking: float, dt: float) -> Floats:
    """Return the highest speed from which a robot can stop within a length, metres per second.

    It drives one more time step at that speed before it brakes: v dt + v^2 / (2 a) = length; the
    admissible velocities of Fox, Burgard and Thrun (1997) with that step added.

    Args:
        length: Free metres ahead.
        braking: a, metres per second squared.
        dt: The time step, seconds.
    """
    return np.asarray(braking * (np.sqrt(dt**2 + 2.0 * length / braking) - dt), dtype=np.float64)
