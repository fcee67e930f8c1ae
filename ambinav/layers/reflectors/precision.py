"""Precision of a position from ranges and bearings to reflectors.

The Fisher information of one reflector at the range r, in the direction b of the map frame, about
x, y and theta is g g^T / sigma_r^2 + h h^T / sigma_b^2 with g = [-cos b, -sin b, 0] and
h = [sin b / r, -cos b / r, -1]. Their sum over the reflectors is inverted, and what is reported is
the standard deviation along the worst direction of x and y: no unbiased estimate has a lower one
(Cramer, Rao). A single reflector fixes no position.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ambinav.layers.reflectors.targets import Targets
from ambinav.layers.reflectors.views import beam_directions
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav.sensing.scanner import RangeScanner

RANGES: Final = 200
"""Ranges at which the deviation of a reading is tabulated."""


def position_stds(
    scanner: RangeScanner, map_std: float, targets: Targets, poses: Floats, seen: Bools
) -> Floats:
    """Compute the standard deviation of the position along its worst direction, metres.

    A bearing is that of a beam, rounded to the angle between two, and a reflector's place is known
    to `map_std`.

    Args:
        scanner: The scanner; of several sensors with intensities the first counts.
        map_std: Standard deviation of a reflector's place, metres.
        targets: L reflectors.
        poses: x, y, theta, shape (N, 3).
        seen: Which are seen from each, shape (N, L).

    Returns:
        Shape (N,); inf where fewer than two reflectors are seen.
    """
    number = scanner.sensor_of_beam[scanner.intensity_beams[0]]
    sensor = scanner.sensors[number]
    yaw = beam_directions(scanner.mounts[scanner.sensor_of_beam == number, 2])
    step = float(np.median(np.diff(np.append(yaw, yaw[0] + 2.0 * math.pi))))
    ranges = np.linspace(0.0, sensor.max_range, RANGES)
    variance = sensor.std_at(ranges) ** 2 + sensor.resolution**2 / 12.0
    stds = np.empty(len(poses))
    run_rows(
        _stds, len(poses), np.ascontiguousarray(poses, dtype=np.float64), targets.middle,
        np.ascontiguousarray(seen), variance, sensor.max_range, step * step / 12.0, map_std**2,
        stds, least=256,
    )  # fmt: skip
    return stds


@kernel
def _stds(low, high, poses, middle, seen, variance, far, turn, place, stds):
    for p in range(low, high):
        xx = xy = yy = xt = yt = tt = 0.0
        for k in range(middle.shape[0]):
            if not seen[p, k]:
                continue
            dx, dy = middle[k, 0] - poses[p, 0], middle[k, 1] - poses[p, 1]
            r = max(math.hypot(dx, dy), 1e-3)
            c, s = dx / r, dy / r
            at = min(r / far, 1.0) * (variance.size - 1)
            below = min(int(at), variance.size - 2)
            of_range = variance[below] + (at - below) * (variance[below + 1] - variance[below])
            by_range = 1.0 / (of_range + place)
            by_turn = 1.0 / (turn + place / (r * r))
            xx += by_range * c * c + by_turn * s * s / (r * r)
            xy += by_range * c * s - by_turn * s * c / (r * r)
            yy += by_range * s * s + by_turn * c * c / (r * r)
            xt -= by_turn * s / r
            yt += by_turn * c / r
            tt += by_turn
        stds[p] = math.inf
        if tt > 0.0:
            # x and y with the heading unknown: what the bearings leave of them.
            a, b, d = xx - xt * xt / tt, xy - xt * yt / tt, yy - yt * yt / tt
            least = 0.5 * (a + d) - math.hypot(0.5 * (a - d), b)
            if least > 1e-9 * (a + d):
                stds[p] = 1.0 / math.sqrt(least)
