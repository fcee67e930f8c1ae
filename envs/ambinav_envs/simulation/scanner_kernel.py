"""The scanner's arrays for the kernels, and a simulated scan from the true pose."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ambinav.casting.plane.fan import cast_fan
from ambinav.casting.plane.triangulation import locate
from ambinav.drive.world import unicycle
from ambinav.localization.casting import cast_rays, nearest_echoes
from ambinav.localization.information import TABLE
from ambinav.localization.random import uniform, ziggurats
from ambinav.runtime.array_types import Floats, Ints
from ambinav.runtime.kernels import kernel
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.space_layout import InSpace
from ambinav_envs.simulation.layout import SCANNER
from ambinav_envs.simulation.obstacles import shade
from ambinav_envs.simulation.space_scan import sense_in_space


class ScannerArrays(NamedTuple):
    """Sensor model of a scanner with B beams and S different sensors.

    Attributes:
        near: Minimum range, shape (B,), metres.
        far: Maximum range, shape (B,), metres.
        moment: When each beam of a scan is taken, shape (B,): -1 is its begin, 0 its end.
        height: Height of each ray's start above the floor, in space (`RangeScanner.rays`), shape
            (R,), metres.
        rise: Sine of its elevation, shape (R,).
        sensor: Which sensor each beam is of, shape (B,).
        shift: Bias over the true range from 0 to the maximum, shape (S, TABLE), metres.
        std: Deviation likewise.
        run: Beams run[k] to run[k + 1] - 1 are of one sensor, shape (runs + 1,).
        reading: Minimum and maximum range, resolution (metres), number of bins, share of random
            and of lost readings, whether bias and deviation are the same at any range,
            shape (S, 7).
    """

    near: Floats
    far: Floats
    moment: Floats
    height: Floats
    rise: Floats
    sensor: Ints
    shift: Floats
    std: Floats
    run: Ints
    reading: Floats


def scanner_arrays(scanner: RangeScanner) -> ScannerArrays:
    """Convert a scanner to arrays."""
    which, rays = scanner.sensor_of_beam, scanner.rays(in_space=True)
    ranges = [np.linspace(0.0, sensor.max_range, TABLE) for sensor in scanner.sensors]
    pairs = list(zip(scanner.sensors, ranges, strict=True))
    run = np.concatenate([[0], np.flatnonzero(np.diff(which)) + 1, [len(which)]]).astype(np.int64)
    return ScannerArrays(
        np.array([s.min_range for s in scanner.sensors])[which],
        np.array([s.max_range for s in scanner.sensors])[which],
        _moments(scanner, run),
        rays.height,
        np.sin(rays.elevation),
        np.array(which, dtype=np.int64),
        np.array([sensor.bias_at(d) for sensor, d in pairs]),
        np.array([sensor.std_at(d) for sensor, d in pairs]),
        run,
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


def _moments(scanner: RangeScanner, run: Ints) -> Floats:
    """Return `ScannerArrays.moment`; by default the beams of a sensor follow each other in time."""
    moment = np.concatenate([np.arange(1 - count, 1) / count for count in np.diff(run)])
    first = 0
    for part in scanner.parts:
        end = first + len(part.layout.upright())
        if isinstance(part.layout, InSpace):
            moment[first:end] = part.layout.moments()
        first = end
    return moment


@kernel(forceinline=True)
def sense(cast, scanner, state, settings, people, boxes, readings, i, scratch):
    """Simulate the scan of robot i at its true pose into row i of `Memory.readings`."""
    if sense_in_space(cast.space, cast, scanner, state, settings, people, boxes, i, scratch):
        pass
    elif settings.scan_time > 0.0:
        sweep(cast, scanner, state, settings, people, boxes, i, scratch)
    else:
        x, y, theta = state.truth[0], state.truth[1], state.truth[2]
        cast_rays(x, y, theta, cast, scratch.cast)
        if people.shape[1] > 0 or state.boxes > 0:
            shade(
                x, y, theta, people, settings.person_radius, boxes, state.boxes, i, cast.origin,
                cast.start, scratch.cast, scanner.far.max(),
            )  # fmt: skip
    nearest_echoes(cast, scratch.cast, scratch.ranges, scratch.ray, scratch.edge)
    capture(scratch.ranges, scanner, state.random[SCANNER], scratch.noise, readings, i)


@kernel
def sweep(cast, scanner, state, settings, people, boxes, i, scratch):
    """Cast and shade each ray from the robot's pose at the ray's own time.

    The arguments are those of `cast_rays` and `shade`.

    On its way the robot has driven as in the last step; people stand where they are now.
    """
    ux, uy, distance, hit, stack = scratch.cast
    speed, rate = state.ground[0], state.ground[1]
    met, far = people.shape[1] > 0 or state.boxes > 0, scanner.far.max()
    for g in range(cast.origin.shape[0]):
        for j in range(cast.first[g], cast.first[g + 1]):
            ago = scanner.moment[cast.beam[j]] * settings.scan_time
            x, y, theta = unicycle(state.truth[0], state.truth[1], state.truth[2], speed, rate, ago)
            co, si = math.cos(theta), math.sin(theta)
            px = x + co * cast.start[j, 0] - si * cast.start[j, 1]
            py = y + si * cast.start[j, 0] + co * cast.start[j, 1]
            ux[j] = co * cast.cosine[j] - si * cast.sine[j]
            uy[j] = si * cast.cosine[j] + co * cast.sine[j]
            t = locate(
                px, py, cast.grid_x, cast.grid_y, cast.cell, cast.rows, cast.columns,
                cast.grid_start, cast.item, cast.triangle,
            )  # fmt: skip
            if t < 0:
                distance[j], hit[j] = math.nan, -1
                continue
            ray = ux[j : j + 1], uy[j : j + 1], distance[j : j + 1], hit[j : j + 1], stack
            cast_fan(
                px, py, ray[0], ray[1], 1, t, cast.reach[g], cast.corner, cast.twin, cast.node,
                cast.hops, cast.border, stack, ray[2], ray[3],
            )  # fmt: skip
            if met:
                shade(
                    x, y, theta, people, settings.person_radius, boxes, state.boxes, i,
                    cast.origin, cast.start[j : j + 1], ray, far,
                )  # fmt: skip


@kernel(forceinline=True)
def capture(ranges, scanner, random, noise, readings, row):
    """Turn true ranges into readings: bias and noise, resolution, random and lost ones.

    As `ambinav.sensing.RangeSensor.read`; a sensor outside of the free space (nan) reads "too
    near".

    Args:
        ranges: True ranges, shape (B,), metres.
        scanner: See `ScannerArrays`.
        random: State of the random numbers.
        noise: Work space, shape (B,).
        readings: Row `row` is written, shape (N, B).
        row: Which.
    """
    ziggurats(random, noise)
    for run in range(scanner.run.size - 1):
        first, end = scanner.run[run], scanner.run[run + 1]
        s = scanner.sensor[first]
        _add_noise(
            ranges[first:end],
            scanner.shift[s],
            scanner.std[s],
            scanner.reading[s],
            noise[first:end],
        )
        _round(noise[first:end], scanner.reading[s], readings[row, first:end])
        _add_outliers(scanner.reading[s], random, readings[row, first:end])


@kernel(forceinline=True)
def _add_noise(ranges, shifts, stds, sensor, noise):
    """Scale standard normal numbers to measured ranges, metres: nan where the range is nan."""
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
        entry = min(d if d > least else least, most) * per_metre
        low = min(max(int(entry), 0), TABLE - 2)
        share = entry - low
        shift = shifts[low] * (1.0 - share) + shifts[low + 1] * share
        std = stds[low] * (1.0 - share) + stds[low + 1] * share
        noise[b] = d + shift + std * noise[b]


@kernel(forceinline=True)
def _round(values, sensor, readings):
    """Round measured ranges to bin centres; inf for no echo, -inf for too near (or nan)."""
    least, most, resolution, last = sensor[0], sensor[1], sensor[2], sensor[3] - 1.0
    for b in range(values.size):
        low_edge = least + resolution * min(np.floor((values[b] - least) / resolution), last)
        middle = 0.5 * (low_edge + min(low_edge + resolution, most))
        middle = math.inf if values[b] >= most else middle
        readings[b] = middle if values[b] >= least else -math.inf


@kernel(forceinline=True)
def _add_outliers(sensor, random, readings):
    """Replace some readings by random and lost ones."""
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
