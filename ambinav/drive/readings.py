"""Readings of each run's scanner: the walls, people who stand before them, and noise."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ambinav.casting.scans import scan_rays
from ambinav.casting.upright import cylinder_entry
from ambinav.drive.people import PERSON_HEIGHT
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import REFLECTOR
from ambinav.localization.random import normals, uniform
from ambinav.runtime.array_types import Bools, Floats, Floats32, Ints32, UInts
from ambinav.runtime.arrays import copy_into
from ambinav.runtime.kernels import kernel
from ambinav.sensing.scanner import RangeScanner


class Readings:
    """Simulated readings of one scanner in many runs at once.

    As `RangeScanner.read`, but each run has random numbers of its own, people may block beams,
    and a sensor outside of the free space (its robot touches a wall) reads "too near". One thread
    does it: the work of a time step is too short to wait for others.

    Args:
        environment: What is truly there.
        scanner: The scanner.
        beams: The beams that are simulated, in rising order; None: all. B is their number.

    Attributes:
        sensors: Minimum and maximum range, resolution (metres), number of bins, share of random and
            of lost readings of each beam, shape (B, 6).
    """

    def __init__(
        self,
        environment: Environment,
        scanner: RangeScanner,
        beams: NDArray[np.integer] | None = None,
    ) -> None:
        self.environment = environment
        self._reflects = environment.surface_kind == REFLECTOR
        self.scanner = scanner
        self._rays = scanner.rays(environment.space is not None)
        self._sensor_of_beam = scanner.sensor_of_beam
        if beams is not None:
            self._rays = self._rays.of_beams(beams)
            self._sensor_of_beam = self._sensor_of_beam[beams]
        sensors = [scanner.sensors[i] for i in self._sensor_of_beam]
        self.sensors = np.array(
            [
                (s.min_range, s.max_range, s.resolution, s.bins, s.random_share, s.lost_share)
                for s in sensors
            ]
        )

    def true_ranges(
        self, poses: Floats, people: Floats | None = None, radius: float = 0.0
    ) -> Floats32:
        """Return each beam's range, float32, shape (R, B), as `RangeScanner.scan`.

        Args:
            poses: Poses of the robots, shape (R, 3), metres and radians, map frame.
            people: Where people stand, shape (R, P, 2 or more), metres; columns x and y.
            radius: Radius of a person, metres.
        """
        rays = self._rays
        return rays.nearest(self._cast(poses, people, radius)[0])

    def look(
        self, poses: Floats, people: Floats | None = None, radius: float = 0.0
    ) -> tuple[Floats32, Bools]:
        """Return `true_ranges`, and whether each beam's first ray meets a reflector, (R, B)."""
        echo, distance, segment = self._cast(poses, people, radius)
        first = self._rays.start[:-1]
        met = segment[:, first]
        # No person stands before the reflector.
        seen = echo[:, first] == distance[:, first]
        return self._rays.nearest(echo), self._reflects[met] & (met >= 0) & seen

    def _cast(
        self, poses: Floats, people: Floats | None, radius: float
    ) -> tuple[Floats32, Floats32, Ints32]:
        """Return each ray's echo, its distance to the surface behind people, and that surface."""
        x, y, theta = np.ascontiguousarray(poses.T)
        rays = self._rays
        distance, segment, incidence = scan_rays(
            self.environment, x, y, theta, rays.origin, rays.angle, self.scanner.max_range,
            height=rays.height, elevation=rays.elevation, incidence=rays.specular,
        )  # fmt: skip
        echo = rays.echoes(distance, incidence)
        if people is not None and people.shape[1]:
            args = poses, people, float(radius), rays.origin, rays.angle, rays.max_range
            if self.environment.space is None:
                _block(*args, distance, echo)
            else:
                _block_in_space(*args, rays.height, rays.elevation, distance, echo)
        return echo, distance, segment

    def capture(self, true_ranges: Floats32, states: UInts) -> Floats32:
        """Simulate one reading per true range, float32, (R, B): -inf too near, inf no echo.

        Args:
            true_ranges: Shape (R, B), as `true_ranges` gives them.
            states: States of the random numbers, shape (R, 4).
        """
        mean, std = self.moments(true_ranges)
        out = np.empty(mean.shape, dtype=np.float32)
        capture(mean, std, self.sensors, states, out)
        return out

    def moments(self, true_ranges: Floats32) -> tuple[Floats, Floats]:
        """Return mean and deviation of each reading before it is rounded, shape (R, B), metres."""
        mean = np.array(true_ranges, dtype=np.float64)
        std = np.empty_like(mean)
        for i, sensor in enumerate(self.scanner.sensors):
            beams = self._sensor_of_beam == i
            d = mean[:, beams]
            std[:, beams] = sensor.std_at(d)
            mean[:, beams] = d + sensor.bias_at(d)
        return mean, std

    def intensities(self, reflects: Bools, readings: Floats32, states: UInts) -> Floats32:
        """Simulate each reading's intensity, float32, shape (R, B); nan for none.

        Args:
            reflects: Whether each beam meets a reflector, shape (R, B), as `look` gives it.
            readings: Shape (R, B), as `capture` gives them.
            states: States of the random numbers, shape (R, 4).
        """
        result = np.full(readings.shape, np.nan, dtype=np.float32)
        noise = standard_normals(states, readings.shape[1])
        for i, sensor in enumerate(self.scanner.sensors):
            if sensor.intensity is not None:
                beams = self._sensor_of_beam == i
                result[:, beams] = sensor.intensity.reading(reflects[:, beams], noise[:, beams])
        result[~np.isfinite(readings)] = np.nan
        return result


def standard_normals(states: UInts, count: int) -> Floats:
    """Draw `count` standard normal numbers for each run, shape (R, count)."""
    out = np.empty((len(states), count))
    _normals(states, out)
    return out


@kernel
def _normals(states, out):
    for r in range(out.shape[0]):
        for k in range(out.shape[1]):
            out[r, k] = normals(states[r])[0]


@kernel
def _block(poses, people, radius, origin, angle, limit, distance, echo):
    """Shorten rays that meet a person before the wall; a person on a sensor is not seen."""
    for r in range(len(poses)):
        x, y, t = poses[r]
        co, si = math.cos(t), math.sin(t)
        for i in range(len(angle)):
            px = x + co * origin[i, 0] - si * origin[i, 1]
            py = y + si * origin[i, 0] + co * origin[i, 1]
            ux, uy = math.cos(t + angle[i]), math.sin(t + angle[i])
            best = np.float64(distance[r, i])
            met = False
            for k in range(people.shape[1]):
                wx, wy = people[r, k, 0] - px, people[r, k, 1] - py
                along = wx * ux + wy * uy
                inside = radius * radius - (wx * uy - wy * ux) ** 2
                if along > 0.0 and inside > 0.0 and wx * wx + wy * wy > radius * radius:
                    d = along - math.sqrt(inside)
                    if d < best:
                        best, met = d, True
            if met:
                echo[r, i] = best if best <= limit[i] else np.inf


@kernel
def _block_in_space(
    poses, people, radius, origin, angle, limit, height, elevation, distance, echo
):  # fmt: skip
    """Block rays by people as `_block` does; people are cylinders, rays have elevations."""
    for r in range(len(poses)):
        x, y, t = poses[r]
        co, si = math.cos(t), math.sin(t)
        for i in range(len(angle)):
            px = x + co * origin[i, 0] - si * origin[i, 1]
            py = y + si * origin[i, 0] + co * origin[i, 1]
            flat, rise = math.cos(elevation[i]), math.sin(elevation[i])
            ux, uy = flat * math.cos(t + angle[i]), flat * math.sin(t + angle[i])
            best = np.float64(distance[r, i])
            met = False
            for k in range(people.shape[1]):
                wx, wy = people[r, k, 0] - px, people[r, k, 1] - py
                d = cylinder_entry(wx, wy, ux, uy, rise, height[i], radius, PERSON_HEIGHT)
                if d < best:
                    best, met = d, True
            if met:
                echo[r, i] = best if best <= limit[i] else np.inf


@kernel
def capture(mean, std, sensors, states, out):
    """Simulate readings with noise and resolution, as `RangeSensor.read`.

    Args:
        mean: See `Readings.moments`, shape (R, B).
        std: See there.
        sensors: See `Readings.sensors`.
        states: States of the random numbers, shape (R, 4).
        out: Written, float32, shape (R, B): metres, -inf too near, inf no echo.
    """
    for r in range(out.shape[0]):
        state = states[r].copy()
        spare, left = 0.0, False
        for b in range(out.shape[1]):
            if left:
                noise = spare
            else:
                noise, spare = normals(state)
            left = not left
            chance = uniform(state)
            least, most, resolution, bins, odd, lost = sensors[b]
            value = mean[r, b] + std[r, b] * noise
            # Written so that nan counts as too near.
            too_near, no_echo = not value >= least, value >= most
            position = (value - least) / resolution
            if chance < odd:
                # Given that it is below the share, chance / share is itself uniform on [0, 1).
                position, too_near, no_echo = chance / odd * bins, False, False
            elif chance < odd + lost:
                no_echo = True
            if no_echo:
                out[r, b] = np.inf
            elif too_near:
                out[r, b] = -np.inf
            else:
                low = least + resolution * min(math.floor(position), bins - 1.0)
                out[r, b] = 0.5 * (low + min(low + resolution, most))
        copy_into(states[r], state)
