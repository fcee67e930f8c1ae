"""Real scans in the form that the ambiguity kernel compares: reading, derivative, variance."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.beam_table import TABLE
from ambinav.ambiguity.returns import BEYOND, BLIND, GRAZING
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

Floats = NDArray[np.float64]

# A surface's direction is fitted to readings this far to either side, metres. It is as long as the
# edges of a map made of cells of 5 cm and simplified to two of them, and bridges the noise.
WINDOW: Final = 0.15
# Most readings to either side that take part in the fit.
MOST: Final = 12
# Readings that lie farther from their line, root mean square in metres, are of no one surface.
ROUGH: Final = 0.04
# Next readings of one surface differ by no more than this, metres, and this share of the range.
JUMP: Final = 0.1
JUMP_SHARE: Final = 0.1
# The range's relative change per radian at the most oblique incidence that the model knows.
STEEPEST: Final = math.sqrt(1.0 / GRAZING**2 - 1.0)


def surface_slopes(ranges: NDArray[np.float32], angles: Floats) -> Floats:
    """Compute the relative change of the range with direction, r'(a) / r(a), of each reading.

    A line is fitted (total least squares) to the readings around, to both sides or to either
    one, whichever lies straightest. It is 0, as on a surface that faces the scanner, where none is
    straight.

    Args:
        ranges: Readings, shape (S, B), metres; what is not finite belongs to no surface.
        angles: Their directions, shape (B,), radians, rising.

    Returns:
        1 / radian, shape (S, B), at most `STEEPEST` in size.
    """
    slopes = np.zeros(ranges.shape)
    run_rows(_slopes, len(ranges), ranges.astype(np.float64), angles, slopes)
    return slopes


def returns_of_scans(
    ranges: NDArray[np.float32],
    slopes: Floats,
    angles: Floats,
    scan: NDArray[np.intp],
    turn: Floats,
    heading: Floats,
    directions: Floats,
    limit: float,
    spread: NDArray[np.float32],
    width: int,
) -> NDArray[np.float32]:
    """Interpolate real scans in the directions of another robot's beams.

    Between two readings of one surface the inverse of the range is interpolated, which is nearly
    exact on a straight wall; between two surfaces the nearer direction's reading is taken.

    Args:
        ranges: Readings, shape (S, B), metres; inf for no return, -inf for too near.
        slopes: See `surface_slopes`, shape (S, B).
        angles: Directions of the readings in the laser's frame, shape (B,), radians, rising.
        scan: Which scan, shape (N,).
        turn: Heading of that scan's laser minus that of the other robot, shape (N,), radians.
        heading: Heading of the other robot in the map frame, shape (N,), radians.
        directions: Its beams, shape (P,), radians, in its own frame.
        limit: Maximum range, metres. As in a map's returns, ranges are followed one metre beyond.
        spread: Half the squared effective deviation at ranges from 0 to `limit`, shape (T,).
        width: Number of beams with padding, at least P.

    Returns:
        float32, shape (N, 5, width), as `Returns.data`. A direction that the scan did not look to
        and a beam without return tell nothing (`BLIND`): what swallows an echo may be near.
    """
    data = np.zeros((len(scan), 5, width), dtype=np.float32)
    data[:, 4] = 1.0
    run_rows(
        _returns, len(scan), ranges.astype(np.float64), slopes, angles, scan, turn, heading,
        directions, limit, spread, data, least=16,
    )  # fmt: skip
    return data


@kernel(inline="always")
def same_surface(a, b):
    """Return whether two neighbouring readings, metres, are of one surface."""
    return abs(a - b) <= JUMP + JUMP_SHARE * min(a, b)


@kernel
def _line(x, y, low, high):
    """Return the direction of the line through points low to high - 1, and their distance to it."""
    n = high - low
    mx, my = 0.0, 0.0
    for j in range(low, high):
        mx += x[j]
        my += y[j]
    mx /= n
    my /= n
    xx, xy, yy = 0.0, 0.0, 0.0
    for j in range(low, high):
        dx, dy = x[j] - mx, y[j] - my
        xx += dx * dx
        xy += dx * dy
        yy += dy * dy
    middle, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    return 0.5 * math.atan2(2.0 * xy, xx - yy), math.sqrt(max(middle - half, 0.0) / n)


@kernel
def _reach(ranges, x, y, b, step):
    """Return the last reading on the surface of reading b in one direction; two if possible."""
    end = b
    while 0 <= end + step < ranges.size and abs(end - b) < MOST:
        following = end + step
        far = math.hypot(x[following] - x[b], y[following] - y[b]) > WINDOW
        if not np.isfinite(ranges[following]) or (far and abs(end - b) >= 2):
            break
        if not same_surface(ranges[following], ranges[end]):
            break
        end = following
    return end


@kernel
def _slopes(begin, end, ranges, angles, slopes):
    count = angles.size
    for s in range(begin, end):
        x, y = ranges[s] * np.cos(angles), ranges[s] * np.sin(angles)
        for b in range(count):
            r = ranges[s, b]
            if not np.isfinite(r) or r <= 0.0:
                continue
            low = _reach(ranges[s], x, y, b, -1)
            high = _reach(ranges[s], x, y, b, 1)
            best, bearing = ROUGH, angles[b] + 0.5 * math.pi
            # Both sides first: only a straighter side alone takes its place.
            if high > b > low:
                turned, rough = _line(x, y, low, high + 1)
                if rough < best:
                    best, bearing = 0.5 * rough, turned
            if b - low >= 2:
                turned, rough = _line(x, y, low, b + 1)
                if rough < best:
                    best, bearing = rough, turned
            if high - b >= 2:
                turned, rough = _line(x, y, b, high + 1)
                if rough < best:
                    bearing = turned
            along = math.cos(bearing - angles[b])
            across = math.sin(bearing - angles[b])
            if abs(along) >= STEEPEST * abs(across):
                slopes[s, b] = math.copysign(STEEPEST, along * across)
            else:
                slopes[s, b] = along / across


@kernel
def _returns(
    begin, end, ranges, slopes, angles, scan, turn, heading, directions, limit, spread, data
):  # fmt: skip
    count = angles.size
    edge = 0.5 * (angles[1] - angles[0]) + 1e-9
    for k in range(begin, end):
        s = scan[k]
        for i in range(directions.size):
            # Relative to the scan's first direction, to avoid the wrap at pi.
            bearing = directions[i] - turn[k] - angles[0] + edge
            bearing = (
                bearing - math.floor(bearing / (2.0 * math.pi)) * 2.0 * math.pi + angles[0] - edge
            )
            data[k, 0, i] = limit + BEYOND
            data[k, 4, i] = BLIND
            if bearing > angles[count - 1] + edge:
                continue
            right = min(max(np.searchsorted(angles, bearing), 1), count - 1)
            share = (bearing - angles[right - 1]) / (angles[right] - angles[right - 1])
            share = min(max(share, 0.0), 1.0)
            near = right if share >= 0.5 else right - 1
            r, slope = ranges[s, near], slopes[s, near]
            if not np.isfinite(r) or r <= 0.0:
                continue
            a, b = ranges[s, right - 1], ranges[s, right]
            if np.isfinite(a) and np.isfinite(b) and min(a, b) > 0.0 and same_surface(a, b):
                r = 1.0 / ((1.0 - share) / a + share / b)
                slope = (1.0 - share) * slopes[s, right - 1] + share * slopes[s, right]
            c, n = math.cos(heading[k] + directions[i]), math.sin(heading[k] + directions[i])
            if r < limit + BEYOND:
                data[k, 0, i] = r
                data[k, 1, i] = -c - slope * n
                data[k, 2, i] = -n + slope * c
                data[k, 3, i] = slope * r
            place = min(r / limit, 1.0) * (TABLE - 1)
            low = min(int(place), TABLE - 2)
            data[k, 4, i] = spread[low] + (spread[low + 1] - spread[low]) * (place - low)
