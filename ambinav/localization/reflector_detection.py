"""Reflectors in a scan: clusters of bright beams, as ranges and bearings.

A scanner that navigates by reflectors ignores walls. Beams that are surely bright (`tag_bearings`)
and close together, in direction and in range, are one cluster. Its bearing is halfway between its
first and its last beam, its range the mean of the readings, without the sensor's bias. How it
relates to the middle of a reflector depends on the reflector: `reflector_view`.
"""

from __future__ import annotations

import itertools
import math
from typing import Final, NamedTuple

import numpy as np

from ambinav.localization.information import sensor_line
from ambinav.localization.odometry import wrapped
from ambinav.localization.tag_bearings import bright_readings
from ambinav.runtime.array_types import Floats, Ints
from ambinav.runtime.kernels import kernel
from ambinav.sensing.scanner import RangeScanner

LINK: Final = 2.5
"""Beams of a cluster are at most so many steps apart: one of them may be read as dark."""
JUMP: Final = 0.1
"""Metres that their ranges may differ by, across the line of sight,"""
SLOPE: Final = 2.0
"""and metres more for each metre between them: incidence up to 63 degrees."""
BEARING, RANGE, EXTENT, VARIANCE, SIZE = range(5)
"""Columns of a detection: bearing in the robot's frame (radians), range from the sensor (metres),
angle from the first beam to the last, variance of the range, number of beams."""
_FIRST, _LAST, _LATEST = BEARING, EXTENT, 5
"""Columns while clusters grow: angles of the first and the last beam, and the last range."""
COLUMNS: Final = 6


class ReflectorBeams(NamedTuple):
    """The K beams that read intensities, sensor by sensor and in the order of their directions.

    Attributes:
        beam: Number of the scanner's beam, shape (K,).
        yaw: Direction in the robot's frame, radians, shape (K,).
        bright: See `bright_readings`, like `near` and `far`; shape (K,).
        near: See there.
        far: See there.
        first: Those of head h, a sensor at one place, are first[h] to first[h + 1] - 1.
        head: x, y in the robot's frame, metres, shape (H, 2).
        step: Angle between two beams, radians, shape (H,).
    """

    beam: Ints
    yaw: Floats
    bright: Floats
    near: Floats
    far: Floats
    first: Ints
    head: Floats
    step: Floats


def reflector_beams(scanner: RangeScanner) -> ReflectorBeams:
    """Sort the beams of a scanner that has at least one with intensities."""
    beam = scanner.intensity_beams.astype(np.int64)
    x, y, yaw = scanner.mounts[beam].T
    places = np.column_stack([scanner.sensor_of_beam[beam], x, y])
    heads, head = np.unique(places, axis=0, return_inverse=True)
    order = np.lexsort((np.mod(yaw, 2.0 * math.pi), head))
    beam, yaw = beam[order], yaw[order]
    first = np.searchsorted(head[order], np.arange(len(heads) + 1))
    turns = [np.unique(np.round(yaw[a:b], 9)) for a, b in itertools.pairwise(first)]
    steps = [np.median(np.diff(turn)) if len(turn) > 1 else math.pi for turn in turns]
    return ReflectorBeams(
        beam, yaw, *bright_readings(scanner, beam), first.astype(np.int64),
        np.ascontiguousarray(heads[:, 1:]), np.array(steps, dtype=np.float64),
    )  # fmt: skip


@kernel
def detect_reflectors(h, ranges, intensities, beams, noise, detections):
    """Find the clusters of bright beams of one head.

    Args:
        h: The head.
        ranges: Readings of all beams of the scanner, shape (B,), metres.
        intensities: Beside them, shape (B,); nan for none.
        beams: See `ReflectorBeams`.
        noise: See `information.BeamNoise`.
        detections: Written, columns as above, shape (K, COLUMNS).

    Returns:
        How many there are.
    """
    turn, step = 2.0 * math.pi, beams.step[h]
    bright = np.empty(beams.first[h + 1] - beams.first[h], dtype=np.int64)
    count = 0
    for k in range(beams.first[h], beams.first[h + 1]):
        z, i = ranges[beams.beam[k]], intensities[beams.beam[k]]
        if i >= beams.bright[k] and z >= beams.near[k] and z < beams.far[k]:
            bright[count] = k
            count += 1
    # Behind the widest gap, so that no cluster lies across the first direction.
    start, widest = 0, -1.0
    for m in range(count):
        gap = (beams.yaw[bright[m]] - beams.yaw[bright[m - 1 if m else count - 1]]) % turn
        if gap > widest:
            start, widest = m, gap
    clusters = 0
    for m in range(count):
        k = bright[(start + m) % count]
        angle = (beams.yaw[k] - beams.yaw[bright[start]]) % turn
        z = float(ranges[beams.beam[k]])
        shift, _, variance = sensor_line(z, beams.beam[k], noise)
        z -= shift
        # Of the last two: a random reading amid a cluster does not end it.
        joined = -1
        for c in range(clusters - 1, max(clusters - 3, -1), -1):
            away = angle - detections[c, _LAST]
            near = JUMP + SLOPE * away * z
            if joined < 0 and away <= LINK * step and abs(z - detections[c, _LATEST]) <= near:
                joined = c
        if joined < 0:
            joined = clusters
            detections[joined] = 0.0
            detections[joined, _FIRST] = angle
            clusters += 1
        detections[joined, _LAST], detections[joined, _LATEST] = angle, z
        detections[joined, RANGE] += z
        detections[joined, VARIANCE] += variance
        detections[joined, SIZE] += 1.0
    for c in range(clusters):
        first, last, size = detections[c, _FIRST], detections[c, _LAST], detections[c, SIZE]
        direction = beams.yaw[bright[start]] + 0.5 * (first + last)
        detections[c, BEARING], detections[c, EXTENT] = wrapped(direction), last - first
        detections[c, RANGE] /= size
        detections[c, VARIANCE] /= size * size
    return clusters
