"""Reflectors in the Kalman filter: bearings at which they are seen.

Which surface a beam meets does not change smoothly with the pose, so it has no derivative; the
direction of a reflector has. Beams that are surely bright, and end where a reflector of the map is
expected, are taken for it, as scanners that navigate by reflectors do; the mean of their directions
is one reading of the middle between the two ends that the robot sees, with the deviations of a
beam's place between its neighbours and of the reflector's own place. It is gated like the ranges.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.geometry.environment import Environment
from ambinav.localization.odometry import wrapped
from ambinav.runtime.array_types import Floats, Ints
from ambinav.runtime.kernels import kernel
from ambinav.sensing.scanner import RangeScanner

SURE: Final = 0.9
"""A beam is bright whose intensity speaks for a reflector with this share (`intensity`)."""
WIDEST: Final = 1.0
"""Radians: a reflector is not looked for in a wider window to either side."""
SLACK: Final = 0.2
"""Metres that a bright beam may end before or behind a reflector, the pose aside."""


class TagModel(NamedTuple):
    """Reflectors, and the K beams that read intensities.

    Attributes:
        point: Corners of the reflectors, one after the other, shape (V, 2), metres.
        first: Those of reflector l are first[l] to first[l + 1] - 1, shape (L + 1,).
        beam: Which beams, shape (K,).
        mount: x, y (metres), and x, y of the unit vectors along them, shape (K, 4).
        bright: Intensities from here on are surely bright, shape (K,).
        near: Readings below do not count, shape (K,), metres.
        far: Nor do those from here on, shape (K,).
        turn: Variance of a beam's place between its neighbours, square radians.
        place: Variance of a reflector's place, square metres.
    """

    point: Floats
    first: Ints
    beam: Ints
    mount: Floats
    bright: Floats
    near: Floats
    far: Floats
    turn: float
    place: float


def tag_model(environment: Environment, scanner: RangeScanner, map_std: float) -> TagModel | None:
    """Build the kernel's model; None without a channel or without reflectors.

    Args:
        environment: The map.
        scanner: The scanner.
        map_std: Standard deviation of a reflector's place, metres.
    """
    beam = scanner.intensity_beams.astype(np.int64)
    segments = environment.segments
    if not len(beam) or not segments.reflectors.any():
        return None
    lines = shapely.linestrings(segments.xy[segments.reflectors].reshape(-1, 2, 2))
    tags = shapely.get_parts(shapely.line_merge(shapely.union_all(lines)))
    corners = [shapely.get_coordinates(tag) for tag in tags]
    steps = np.diff(np.sort(np.mod(scanner.mounts[beam, 2], 2.0 * math.pi)))
    step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else WIDEST
    return TagModel(
        np.concatenate(corners),
        np.cumsum([0, *map(len, corners)]),
        beam,
        scanner.axes(beam),
        *bright_readings(scanner, beam),
        step * step / 12.0,
        map_std**2,
    )


def bright_readings(
    scanner: RangeScanner, beams: NDArray[np.integer]
) -> tuple[Floats, Floats, Floats]:
    """Return from which intensity, and in which ranges, beams with the channel are surely bright.

    Args:
        scanner: The scanner.
        beams: Some of its `intensity_beams`, shape (K,).

    Returns:
        `TagModel.bright`, `near` and `far` of these beams, each of shape (K,).
    """
    rows = []
    for sensor in (scanner.sensors[k] for k in scanner.sensor_of_beam[beams]):
        channel = sensor.intensity
        assert channel is not None  # of `intensity_beams`
        middle, apart = channel.wall + channel.reflector, channel.reflector - channel.wall
        # Intensity at which the normal densities have the ratio SURE to 1 - SURE.
        bright = middle / 2.0 + channel.std**2 * math.log(SURE / (1.0 - SURE)) / apart
        rows.append((bright, max(sensor.min_range, channel.min_range), sensor.max_range))
    bright, near, far = np.ascontiguousarray(np.array(rows).T)
    return bright, near, far


@kernel
def take_in_tags(mean, cov, ranges, intensities, gate, tags):
    """Update a robot's estimate with the reflectors that it sees, in place.

    Args:
        mean: Its pose, shape (3,).
        cov: Shape (3, 3).
        ranges: Readings, shape (B,).
        intensities: Beside them, shape (B,); nan for none.
        gate: Standard deviations beyond which a direction is left out.
        tags: See `TagModel`.

    Returns:
        How many reflectors were used.
    """
    # Range and direction from the robot's centre, of the beams that are surely bright.
    place = np.empty((tags.beam.size, 2))
    bright = used = 0
    for k in range(tags.beam.size):
        z, i = ranges[tags.beam[k]], intensities[tags.beam[k]]
        if i >= tags.bright[k] and z >= tags.near[k] and z < tags.far[k]:
            dx = tags.mount[k, 0] + z * tags.mount[k, 2]
            dy = tags.mount[k, 1] + z * tags.mount[k, 3]
            place[bright, 0], place[bright, 1] = math.hypot(dx, dy), math.atan2(dy, dx)
            bright += 1
    if bright > 0:
        for tag in range(tags.first.size - 1):
            used += _take_in(mean, cov, tag, place[:bright], gate, tags)
    return used


@kernel
def _take_in(mean, cov, tag, place, gate, tags):
    """Update with one reflector; return 1 if it was seen and used, else 0."""
    x, y, theta = mean[0], mean[1], mean[2]
    low, high = tags.first[tag], tags.first[tag + 1]
    base = math.atan2(tags.point[low, 1] - y, tags.point[low, 0] - x)
    right = left = low
    least, most, near, far = 0.0, 0.0, math.inf, 0.0
    for v in range(low, high):
        dx, dy = tags.point[v, 0] - x, tags.point[v, 1] - y
        angle, away = wrapped(math.atan2(dy, dx) - base), math.hypot(dx, dy)
        near, far = min(near, away), max(far, away)
        if angle < least:
            least, right = angle, v
        if angle > most:
            most, left = angle, v
    if not near > 0.0:
        return 0
    expected = base + 0.5 * (least + most) - theta
    hx = hy = 0.0
    for v in (right, left):
        dx, dy = tags.point[v, 0] - x, tags.point[v, 1] - y
        hx += 0.5 * dy / (dx * dx + dy * dy)
        hy -= 0.5 * dx / (dx * dx + dy * dy)
    # Of the direction: it turns against the robot.
    px = cov[0, 0] * hx + cov[0, 1] * hy - cov[0, 2]
    py = cov[1, 0] * hx + cov[1, 1] * hy - cov[1, 2]
    pt = cov[2, 0] * hx + cov[2, 1] * hy - cov[2, 2]
    noise = tags.turn + tags.place / (near * near)
    variance = hx * px + hy * py - pt + noise
    window = gate * math.sqrt(variance) + 0.5 * (most - least)
    if not window <= WIDEST:
        return 0
    slack = SLACK + gate * math.sqrt(cov[0, 0] + cov[1, 1])
    total, seen = 0.0, 0
    for k in range(place.shape[0]):
        if place[k, 0] >= near - slack and place[k, 0] <= far + slack:
            off = wrapped(place[k, 1] - expected)
            if abs(off) <= window:
                total += off
                seen += 1
    if seen == 0:
        return 0
    off = total / seen
    if off * off > gate * gate * variance:
        return 0
    mean[0], mean[1] = x + px * off / variance, y + py * off / variance
    mean[2] = wrapped(theta + pt * off / variance)
    gain = (px, py, pt)
    for i in range(3):
        for j in range(3):
            cov[i, j] -= gain[i] * gain[j] / variance
    return 1
