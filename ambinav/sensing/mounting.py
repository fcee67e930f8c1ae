"""Mounting of a sensor on the robot, and its directions in the robot's frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Final, TypeAlias

import numpy as np
from pydantic import AfterValidator

from ambinav.casting.space import SpaceRays
from ambinav.config import FaultError, Number, row, some_numbers
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

TURN = 2.0 * math.pi
LEVEL = (0.0, 0.0)
"""z and elevation of a beam in the plane."""
STEEPEST = math.pi / 2


def _angle(allowed: Callable[[float], bool], wish: str) -> AfterValidator:
    """Return a validator of radians; its message is in degrees."""

    def check(angle: float) -> float:
        if not allowed(angle):
            raise FaultError(f"is {math.degrees(angle):g} degrees; {wish}")
        return angle

    return AfterValidator(check)


NOT_BEYOND_VERTICAL: Final = _angle(
    lambda a: abs(a) <= STEEPEST + 1e-12, "give -90 to 90 (in Python -pi/2 to pi/2 radians)"
)
Angle: TypeAlias = Annotated[Number, "radians"]
Turn: TypeAlias = Annotated[
    Number, _angle(lambda a: 0.0 <= a <= TURN + 1e-9, "give 0 to 360 (in Python 0 to 2 pi radians)")
]
"""Opening angle of a fan, radians."""
Elevation: TypeAlias = Annotated[Number, NOT_BEYOND_VERTICAL]
"""Angle from the horizontal, radians."""
Elevations: TypeAlias = Annotated[tuple[Elevation, ...], some_numbers]
FieldOfView: TypeAlias = Annotated[
    Number, _angle(lambda a: 0.0 <= a < math.pi, "a camera sees less than 180")
]
"""Field of view of a pinhole camera, radians."""
Mount: TypeAlias = Annotated[tuple[Number, Number, Angle], row(3, "give x, y and yaw")]
"""x and y in metres and yaw in radians, robot frame."""

CENTRE: Mount = (0.0, 0.0, 0.0)

HORIZONTAL: Final = 1e-12
"""A beam whose elevation is less than this many radians is horizontal."""


def directed(
    azimuth: Floats, elevation: Floats, mount: Mount, z: float, pitch: float, roll: float
) -> tuple[Floats, Floats]:
    """Rotate the directions of a sensor's beams into the robot's frame by its mount.

    Args:
        azimuth: In the sensor's frame, shape (B,), radians.
        elevation: Likewise.
        mount: Mount of the sensor.
        z: Metres above the floor.
        pitch: Radians about y, positive looks down (REP 103).
        roll: Radians about x, applied first.

    Returns:
        x, y and azimuth, shape (B, 3); z and elevation, shape (B, 2).
    """
    x, y, yaw = mount
    rays = SpaceRays(np.zeros((len(azimuth), 3)), azimuth, elevation)
    rays = rays.mounted(x, y, z, yaw, pitch, roll)
    across = np.column_stack([np.full(len(azimuth), x), np.full(len(azimuth), y), rays.azimuth])
    # A laser upside down is level, but sin(pi) is not 0 in floats.
    elevation = np.where(np.abs(rays.elevation) < HORIZONTAL, 0.0, rays.elevation)
    return across, np.column_stack([np.full(len(azimuth), z), elevation])


def fan_angles(beams: int, aperture: float) -> Floats:
    """Return directions of an even fan about 0, shape (beams,), radians; see `Planar`."""
    if aperture > TURN - 1e-9 and beams > 1:
        return TURN * np.arange(beams) / beams - math.pi
    half = aperture / 2 if beams > 1 else 0.0
    return np.linspace(-half, half, beams)


def beams_for_aperture(beams: int, before: float, after: float) -> int:
    """Return the number of beams of a fan of another aperture with about the same angle between.

    Args:
        beams: Number of beams now.
        before: Aperture now, radians.
        after: The other aperture, radians.

    Raises:
        InputError: the fan has a single direction.
    """
    gaps = beams if before > TURN - 1e-9 else beams - 1
    if gaps < 1 or not before > 0.0:
        raise InputError("a single beam leaves no angle between beams to keep; give two.")
    count = round(after * gaps / before)
    return max(count if after > TURN - 1e-9 else count + 1, 1)


def divisor(number: int, most: int) -> int | None:
    """Return the largest divisor of a number that is at most `most` and at least its half."""
    sizes = range(most, (most - 1) // 2, -1)
    return next((size for size in sizes if number % size == 0), None)


def thinned_fan(beams: int, aperture: float, most: int) -> tuple[int, float]:
    """Return beams and aperture of a fan with at most `most` beams; see `Planar.thinned`."""
    if beams <= most:
        return beams, aperture
    if aperture > TURN - 1e-9:
        return divisor(beams, most) or most, aperture
    if most == 1:
        return 1, 0.0
    gaps, step = beams - 1, aperture / (beams - 1)
    for spaces in range(most - 1, 0, -1):
        stride = gaps // spaces
        spare = gaps - spaces * stride
        if spare <= stride:
            break
    return spaces + 1, spaces * stride * step
