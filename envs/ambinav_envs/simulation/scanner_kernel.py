"""The scanner of all robots as the kernels read it, and one scan of what is truly there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.kernels import kernel
from ambinav.localization.casting import CastTables, cast_rays, nearest_echoes
from ambinav.localization.information import TABLE
from ambinav.localization.random import uniform, ziggurats
from ambinav.sensing.scanner import RangeScanner
from ambinav_envs.simulation.ground import cast_tables_of, ground_of
from ambinav_envs.simulation.layout import EYES
from ambinav_envs.simulation.obstacles import shade

Floats = NDArray[np.float64]


class Eyes(NamedTuple):
    """A scanner of R rays, B beams and S different sensors.

    Attributes:
        origin: See `ambinav.localization.casting.CastTables`, as the next eleven.
        first: See there.
        cosine: See there.
        sine: See there.
        beam: See there.
        limit: See there.
        incidence: See there.
        start: See there.
        reach: See there.
        plain: See there.
        anchor: See there.
        inner: See there.
        near: Minimum range, shape (B,), metres.
        far: Maximum range, shape (B,), metres.
        sensor: Which sensor each beam is of, shape (B,).
        shift: Bias over the true range from 0 to the maximum, shape (S, TABLE), metres.
        std: Deviation likewise.
        run: Beams run[k] to run[k + 1] - 1 are of one sensor, shape (runs + 1,).
        reading: Minimum and maximum range, resolution (metres), number of bins, share of random
            and of lost readings, whether bias and deviation are the same at any range,
            shape (S, 7).
    """

    origin: Floats
    first: NDArray[np.int64]
    cosine: Floats
    sine: Floats
    beam: NDArray[np.int64]
    limit: Floats
    incidence: Floats
    start: Floats
    reach: Floats
    plain: NDArray[np.bool_]
    anchor: NDArray[np.bool_]
    inner: NDArray[np.bool_]
    near: Floats
    far: Floats
    sensor: NDArray[np.int64]
    shift: Floats
    std: Floats
    run: NDArray[np.int64]
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
        *tables[:12],
        np.array([s.min_range for s in scanner.sensors])[which],
        np.array([s.max_range for s in scanner.sensors])[which],
        np.array(which, dtype=np.int64),
        np.array([sensor.bias_at(d) for sensor, d in pairs]),
        np.array([sensor.std_at(d) for sensor, d in pairs]),
        np.concatenate([[0], np.flatnonzero(np.diff(which)) + 1, [len(which)]]).astype(np.int64),
        np.array(
            [
                (
                    s.min_range,
                    s.max_range,
                    s.resolution,
                    s.bins,
                    s.random_share,
                    s.lost_share,
                    np.ptp(s.bias_at(d)) == 0.0 and np.ptp(s.std_at(d)) == 0.0,
                )
                for s, d in pairs
            ]
        ),
    )


@kernel(forceinline=True)
def look(memory, eyes, i, scratch):
    """Read the scanner of robot i where it truly is, into `Memory.readings`."""
    state, settings = memory.state[i], memory.settings[0]
    x, y, theta = state.truth[0], state.truth[1], state.truth[2]
    tables = cast_tables_of(ground_of(memory.where[i]), eyes)
    cast_rays(x, y, theta, tables, scratch.cast)
    if memory.people.shape[1] > 0 or state.boxes > 0:
        shade(
            x, y, theta, memory.people, settings.person_radius, memory.boxes, state.boxes, i,
            tables, scratch.cast, eyes.far.max(),
        )  # fmt: skip
    nearest_echoes(tables, scratch.cast, scratch.ranges, scratch.ray, scratch.edge)
    capture(scratch.ranges, eyes, state.random[EYES], scratch.noise, memory.readings, i)


@kernel(forceinline=True)
def capture(ranges, eyes, random, noise, readings, row):
    """One reading of each true range: bias and noise, resolution, random and lost ones.

    As `ambinav.sensing.RangeSensor.read`; a sensor outside of the free space (nan) reads "too
    near".

    Args:
        ranges: True ranges, shape (B,), metres.
        eyes: See `Eyes`.
        random: State of the random numbers.
        noise: Work space, shape (B,).
        readings: Row `row` is written, shape (N, B).
        row: Which.
    """
    ziggurats(random, noise)
    for run in range(eyes.run.size - 1):
        first, end = eyes.run[run], eyes.run[run + 1]
        s = eyes.sensor[first]
        _err(ranges[first:end], eyes.shift[s], eyes.std[s], eyes.reading[s], noise[first:end])
        _round(noise[first:end], eyes.reading[s], readings[row, first:end])
        _confuse(eyes.reading[s], random, readings[row, first:end])


@kernel(forceinline=True)
def _err(ranges, shifts, stds, sensor, noise):
    """Make standard normal numbers what a sensor measures, metres: nan where the range is nan."""
    least, most, steady = sensor[0], sensor[1], sensor[6]
    if steady > 0.0:
        # The loop of a sensor without tables needs a tenth of the time.
        shift, std = shifts[0], stds[0]
        for b in range(ranges.size):
            noise[b] = ranges[b] + shift + std * noise[b]
        return
    per_metre = (TABLE - 1) / most
    for b in range(ranges.size):
        d = ranges[b]
        place = min(d if d > least else least, most) * per_metre
        low = min(max(int(place), 0), TABLE - 2)
        share = place - low
        shift = shifts[low] * (1.0 - share) + shifts[low + 1] * share
        std = stds[low] * (1.0 - share) + stds[low + 1] * share
        noise[b] = d + shift + std * noise[b]


@kernel(forceinline=True)
def _round(values, sensor, readings):
    """Readings of what is measured: the middles of bins; inf no echo, -inf too near (or nan)."""
    least, most, resolution, last = sensor[0], sensor[1], sensor[2], sensor[3] - 1.0
    for b in range(values.size):
        low_edge = least + resolution * min(np.floor((values[b] - least) / resolution), last)
        middle = 0.5 * (low_edge + min(low_edge + resolution, most))
        middle = math.inf if values[b] >= most else middle
        readings[b] = middle if values[b] >= least else -math.inf


@kernel(forceinline=True)
def _confuse(sensor, random, readings):
    """Put random readings and lost ones in the place of some."""
    least, most, resolution, bins, odd, lost = sensor[:6]
    share = odd + lost
    if share <= 0.0:
        return
    # How many beams are passed over is geometric: few draws where few are concerned.
    per_beam, b = 1.0 / math.log1p(-share), 0
    while True:
        passed = math.log(1.0 - uniform(random)) * per_beam
        if not passed < readings.size - b:
            return
        b += int(passed)
        chance = share * uniform(random)
        # Below the share of random ones, chance / odd is itself uniform on [0, 1).
        low_edge = least + resolution * min(np.floor(chance / odd * bins), bins - 1.0)
        middle = 0.5 * (low_edge + min(low_edge + resolution, most))
        readings[b] = middle if chance < odd else math.inf
        b += 1
