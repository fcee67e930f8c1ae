"""Rotational symmetry of a set of beams about a centre."""

from __future__ import annotations

import math

import numpy as np

from ambinav.geometry.frames import wrap_angles
from ambinav.runtime.array_types import Floats, Indices

TOLERANCE = 1e-6
TURN = 2.0 * math.pi


def own_centres(mounts: Floats, sensor_of_beam: Indices) -> Floats:
    """Return the centre of each sensor's beams, the only possible centre of their turns.

    A turn that maps beams onto themselves maps their mean position onto itself.

    Args:
        mounts: x, y, yaw of each beam in the robot frame, shape (B, 3), metres and radians.
        sensor_of_beam: Which sensor each beam has, shape (B,).

    Returns:
        x and y of the mean of each sensor's beams, shape (sensors, 2), metres.
    """
    count = np.bincount(sensor_of_beam)
    return np.column_stack(
        [np.bincount(sensor_of_beam, weights=mounts[:, axis]) / count for axis in (0, 1)]
    )


def rotation_order(mounts: Floats, upright: Floats, sensor_of_beam: Indices) -> int:
    """Return the largest n such that a turn by 2 pi / n maps the beams onto themselves.

    Args:
        mounts: x, y, yaw of each beam in the robot frame, shape (B, 3), metres and radians.
        upright: z and elevation of each, shape (B, 2), metres and radians.
        sensor_of_beam: Which sensor each beam has, shape (B,).

    Returns:
        n of at least 1; positions and angles count as equal within 1e-6.
    """
    yaws = [mounts[rows, 2] % TURN for rows in _alike(mounts, upright, sensor_of_beam)]
    share = math.gcd(*(len(yaw) for yaw in yaws))
    orders = (n for n in range(share, 1, -1) if share % n == 0)
    return next((n for n in orders if all(_invariant(yaw, n) for yaw in yaws)), 1)


def _alike(mounts: Floats, upright: Floats, sensor_of_beam: Indices) -> list[Indices]:
    """Group the beams that a turn could map onto each other.

    They have the same sensor, height and elevation, and see the robot's centre at the same place.
    """
    x, y, yaw = mounts.T
    along = x * np.cos(yaw) + y * np.sin(yaw)
    across = y * np.cos(yaw) - x * np.sin(yaw)
    left, groups = np.arange(len(mounts)), []
    while len(left):
        first = left[0]
        same = (
            (sensor_of_beam[left] == sensor_of_beam[first])
            & (np.abs(along[left] - along[first]) < TOLERANCE)
            & (np.abs(across[left] - across[first]) < TOLERANCE)
            & (np.abs(upright[left] - upright[first]) < TOLERANCE).all(axis=1)
        )
        groups.append(left[same])
        left = left[~same]
    return groups


def _invariant(yaw: Floats, n: int) -> bool:
    """Return whether a turn by 2 pi / n maps these directions onto themselves."""
    turned = np.sort((yaw + TURN / n) % TURN)
    # Rounding may move a direction across 0, so both lists are also compared one place on.
    original = np.sort(yaw)
    for shift in (-1, 0, 1):
        difference = np.roll(turned, shift) - original
        if np.all(np.abs(wrap_angles(difference)) < TOLERANCE):
            return True
    return False
