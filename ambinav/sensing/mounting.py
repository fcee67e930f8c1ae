"""Mounting of a sensor on the robot, and its directions in the robot's frame."""

from __future__ import annotations

import math
from typing import Any, Final, TypeAlias

import numpy as np

from ambinav.casting.space import SpaceRays
from ambinav.config import as_degrees, as_number, as_numbers
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

Mount: TypeAlias = tuple[float, float, float]
"""x and y in metres and yaw in radians, robot frame."""

TURN = 2.0 * math.pi
CENTRE: Mount = (0.0, 0.0, 0.0)
LEVEL = (0.0, 0.0)
"""z and elevation of a beam in the plane."""
STEEPEST = math.pi / 2


def as_mount(value: object) -> Mount:
    """Return a mount with checked numbers; raises `InputError`."""
    numbers = as_numbers(value, "mount")
    if len(numbers) != 3:
        raise InputError(f"mount is {value!r}; give x, y and yaw.")
    return numbers[0], numbers[1], numbers[2]


def plain_mount(mount: Mount) -> list[float]:
    """Return the YAML form of a mount: yaw in degrees."""
    return [mount[0], mount[1], as_degrees(mount[2])]


def as_elevation(value: object, where: str) -> float:
    """Return a checked angle above the horizon, radians; `InputError` beyond vertical."""
    angle = as_number(value, where)
    if not abs(angle) <= STEEPEST + 1e-12:
        raise InputError(
            f"{where} is {math.degrees(angle):g} degrees; give -90 to 90 (in Python -pi/2 to pi/2 "
            "radians)."
        )
    return angle


def as_turn(value: object) -> float:
    """Return a fan's checked opening angle, radians; `InputError` beyond a turn."""
    aperture = as_number(value, "aperture")
    if not 0 <= aperture <= TURN + 1e-9:
        raise InputError(
            f"aperture is {math.degrees(aperture):g} degrees; give 0 to 360 (in Python 0 to 2 pi "
            "radians)."
        )
    return aperture


def set_pose(layout: Any) -> None:
    """Convert mount, z, pitch and roll of a frozen layout to their types; raises `InputError`."""
    pose = {
        "mount": as_mount(layout.mount),
        "z": as_number(layout.z, "z"),
        "pitch": as_elevation(layout.pitch, "pitch"),
        "roll": as_number(layout.roll, "roll"),
    }
    for name, value in pose.items():
        object.__setattr__(layout, name, value)


def plain_tilt(z: float, pitch: float, roll: float) -> dict[str, float]:
    """Return the YAML form of height, pitch and roll that are not 0, angles in degrees."""
    plain = {"z": z, "pitch_deg": as_degrees(pitch), "roll_deg": as_degrees(roll)}
    return {key: value for key, value in plain.items() if value != 0.0}


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
    for kept in range(most - 1, 0, -1):
        stride = gaps // kept
        spare = gaps - kept * stride
        if spare <= stride:
            break
    return kept + 1, kept * stride * step
