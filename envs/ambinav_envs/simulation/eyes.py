"""The scanner of all robots as the kernels read it, and one scan of what is truly there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ambinav.localization.casting import CastTables, cast_rays, nearest_echoes
from ambinav.localization.information import TABLE
from ambinav.localization.random import uniform, ziggurat
from ambinav.sensing.scanner import RangeScanner
from ambinav_envs.simulation.ground import cast_tables_of
from ambinav_envs.simulation.layout import EYES
from ambinav_envs.simulation.obstacles import shade

Floats = NDArray[np.float64]


class Eyes(NamedTuple):
    """A scanner of R rays, B beams and S different sensors.

    Attributes:
        origin: See `ambinav.localization.casting.CastTables`, as the next seven.
        first: See there.
        cosine: See there.
        sine: See there.
        beam: See there.
        limit: See there.
        incidence: See there.
        start: See there.
        near: Minimum range, shape (B,), metres.
        far: Maximum range, shape (B,), metres.
        sensor: Which sensor each beam is of, shape (B,).
        shift: Bias over the true range from 0 to the maximum, shape (S, TABLE), metres.
        std: Deviation likewise.
        reading: Minimum and maximum range, resolution (metres), number of bins, share of random
            and of lost readings, shape (S, 6).
    """

    origin: Floats
    first: NDArray[np.int64]
    cosine: Floats
    sine: Floats
    beam: NDArray[np.int64]
    limit: Floats
    incidence: Floats
    start: Floats
    near: Floats
    far: Floats
    sensor: NDArray[np.int64]
    shift: Floats
    std: Floats
    reading: Floats


def eyes_of(scanner: RangeScanner, tables: CastTables) -> Eyes:
    """Lay out a scanner.

    Args:
        scanner: The scanner.
        tables: Of all its beams, in any environment.
    """
    which = scanner.sensor_of_beam
    ranges = [np.linspace(0.0, sensor.max_range, TABLE) for sensor in scanner.sensors]
    pairs = list(zip(scanner.sensors, ranges, strict=True))
    return Eyes(
        *tables[:8],
        np.array([s.min_range for s in scanner.sensors])[which],
        np.array([s.max_range for s in scanner.sensors])[which],
        np.array(which, dtype=np.int64),
        np.array([sensor.bias_at(d) for sensor, d in pairs]),
        np.array([sensor.std_at(d) for sensor, d in pairs]),
        np.array(
            [
                (s.min_range, s.max_range, s.resolution, s.bins, s.random_share, s.lost_share)
                for s in scanner.sensors
            ]
        ),
    )


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def look(memory, eyes, i, scratch):
    """Read the scanner of robot i where it truly is, into `Memory.readings`."""
    state, settings = memory.state[i], memory.settings[0]
    x, y, theta = state.truth[0], state.truth[1], state.truth[2]
    tables = cast_tables_of(memory.ground[i], eyes)
    cast_rays(x, y, theta, tables, scratch.cast)
    if memory.people.shape[1] > 0 or state.boxes > 0:
        shade(
            x, y, theta, memory.people, settings.person_radius, memory.boxes, state.boxes, i,
            tables, scratch.cast, eyes.far.max(),
        )  # fmt: skip
    nearest_echoes(tables, scratch.cast, scratch.ranges, scratch.ray, scratch.edge)
    capture(scratch.ranges, eyes, state.random[EYES], memory.readings, i)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def capture(ranges, eyes, random, readings, row):
    """One reading of each true range: bias and noise, resolution, random and lost ones.

    As `ambinav.sensing.RangeSensor.read`; a sensor outside of the free space (nan) reads "too
    near".

    Args:
        ranges: True ranges, shape (B,), metres.
        eyes: See `Eyes`.
        random: State of the random numbers.
        readings: Row `row` is written, shape (N, B).
        row: Which.
    """
    for b in range(ranges.size):
        d, s = ranges[b], eyes.sensor[b]
        least, most, resolution = eyes.reading[s, 0], eyes.reading[s, 1], eyes.reading[s, 2]
        odd, lost = eyes.reading[s, 4], eyes.reading[s, 5]
        noise = ziggurat(random)
        chance = uniform(random) if odd + lost > 0.0 else 1.0
        if chance < odd:
            # Given that it is below the share, chance / share is itself uniform on [0, 1).
            value = least + resolution * (chance / odd * eyes.reading[s, 3])
        elif chance < odd + lost or d == math.inf:
            readings[row, b] = math.inf
            continue
        else:
            place = min(max(d, least) / most * (TABLE - 1), TABLE - 1.0)
            low = min(int(place), TABLE - 2)
            share = place - low
            shift = eyes.shift[s, low] * (1.0 - share) + eyes.shift[s, low + 1] * share
            std = eyes.std[s, low] * (1.0 - share) + eyes.std[s, low + 1] * share
            value = d + shift + std * noise
            # Written so that nan is too near.
            if not value >= least:
                readings[row, b] = -math.inf
                continue
            if value >= most:
                readings[row, b] = math.inf
                continue
        position = min(math.floor((value - least) / resolution), eyes.reading[s, 3] - 1.0)
        low_edge = least + resolution * position
        readings[row, b] = 0.5 * (low_edge + min(low_edge + resolution, most))
