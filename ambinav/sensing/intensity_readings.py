"""Simulated intensities beside the simulated ranges of a scanner."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ambinav.runtime.array_types import Floats32
from ambinav.runtime.errors import InputError
from ambinav.sensing.casting import cast_reflectors, is_in_space
from ambinav.sensing.scanner import RangeScanner

if TYPE_CHECKING:
    from ambinav.geometry.environment import Environment


def read_intensity(
    scanner: RangeScanner,
    env: Environment,
    x: ArrayLike,
    y: ArrayLike,
    theta: ArrayLike,
    readings: Floats32,
    rng: np.random.Generator,
) -> Floats32:
    """Return a simulated intensity beside each reading.

    Args:
        scanner: What reads them.
        env: As in `RangeScanner.scan`, like the next three.
        x: See there.
        y: See there.
        theta: See there.
        readings: What `RangeScanner.read` gave there, shape (..., B).
        rng: The source of randomness.

    Returns:
        float32, shape (..., B), in the unit of `Intensity`; nan where there is no echo, where it is
        too near, or where the sensor has no such channel.

    Raises:
        InputError: a pose is not finite, or the readings have another shape.
    """
    reflects = cast_reflectors(env, scanner.rays(is_in_space(env)), scanner.max_range, x, y, theta)
    readings = np.asarray(readings, dtype=np.float32)
    if readings.shape != reflects.shape:
        raise InputError(
            f"readings have the shape {readings.shape}; give what `RangeScanner.read` gave there, "
            f"{reflects.shape}."
        )
    intensities = np.full(readings.shape, np.nan, dtype=np.float32)
    for i, sensor in enumerate(scanner.sensors):
        if sensor.intensity is not None:
            beams = scanner.sensor_of_beam == i
            intensities[..., beams] = sensor.intensity.read(reflects[..., beams], rng)
    intensities[~np.isfinite(readings)] = np.nan
    return intensities
