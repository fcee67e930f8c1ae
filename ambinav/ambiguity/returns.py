"""What each beam returns at each pose, with its derivative: the input of the ambiguity kernel."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.environment import Environment
from ambinav.geometry.raycasting.fan import scan_rays
from ambinav.geometry.segments import FRONTIER
from ambinav.kernels import kernel
from ambinav.localization.casting import echo_normal
from ambinav.sensing.scanner import RangeScanner
from ambinav.threads import run_rows

# A beam is followed this far beyond its maximum range, metres: a surface just out of range is
# about to come into range, and the derivative says when.
BEYOND = 1.0
# A range changes no faster than at this cosine of the incidence angle (87 degrees): beyond it
# the linear model of a cell would be wrong by more than it tells.
GRAZING = 0.05
# The variance of a beam that ends in unknown space and so tells nothing, square metres.
BLIND = 1e20
TABLE = 1024
# Beams are padded to a multiple of this, so that the kernel's loops fill the vector registers.
LANES = 8


@dataclass(frozen=True, eq=False)
class Returns:
    """Beams at N poses; the columns are the beams, padded as in `BeamTable`.

    One array holds all that the kernel reads of a pose side by side.

    Attributes:
        data: float32, shape (N, 5, P). Row 0: mean reading in metres (true range and bias),
            beyond the maximum range where nothing is in range. Rows 1 to 3: its derivative by
            x, y (1) and theta (metres per radian) of the robot. Row 4: half the squared effective
            deviation s^2 = sigma^2 + delta^2 / 12 + map_std^2, square metres; `BLIND` where the
            beam ends in unknown space. At poses that are impossible (`standing`) a sensor sees
            nothing: the numbers there are finite, and mean nothing.
    """

    data: NDArray[np.float32]

    @property
    def range(self) -> NDArray[np.float32]:
        """Mean reading, shape (N, P), metres."""
        return self.data[:, 0]

    @property
    def gradient(self) -> NDArray[np.float32]:
        """Derivative of the range by x, y and theta, shape (N, 3, P)."""
        return self.data[:, 1:4]

    @property
    def variance(self) -> NDArray[np.float32]:
        """Squared effective deviation s^2, shape (N, P), square metres."""
        return 2.0 * self.data[:, 4]


@dataclass(frozen=True, eq=False)
class BeamTable:
    """What the kernels need to know of each beam.

    `limit`, `inverse_cap` and `use` are padded from B beams to P, a multiple of `LANES`.

    Attributes:
        limit: Maximum range, metres, float32, shape (P,).
        inverse_cap: 1 / (most evidence that the beam can give), float32, shape (P,).
        use: 1 for a beam and 0 for padding, float32, shape (P,).
        nearest: Minimum range, metres, float32, shape (B,).
        spread: float32, shape (B, TABLE): s^2 / 2 at ranges from 0 to the maximum, square metres.
        bias: float32, shape (B, TABLE): mean of reading minus true range, metres.
        width: Resolution by effective deviation at its widest, float64, shape (B,).
    """

    limit: NDArray[np.float32]
    inverse_cap: NDArray[np.float32]
    use: NDArray[np.float32]
    nearest: NDArray[np.float32]
    spread: NDArray[np.float32]
    bias: NDArray[np.float32]
    width: NDArray[np.float64]

    @classmethod
    def of(cls, scanner: RangeScanner, map_std: float, outlier_share: float) -> BeamTable:
        """Tabulate the scanner's sensors, beam by beam."""
        limit, cap, nearest, spread, bias, width = [], [], [], [], [], []
        for sensor in scanner.sensors:
            ranges = np.linspace(0.0, sensor.max_range, TABLE)
            squared = sensor.std_at(ranges) ** 2 + sensor.resolution**2 / 12.0 + map_std**2
            odd = min(outlier_share + sensor.random_share + sensor.lost_share, 0.99)
            limit.append(sensor.max_range)
            cap.append(-1.0 / math.log(odd))
            nearest.append(sensor.min_range)
            spread.append(squared / 2.0)
            bias.append(sensor.bias_at(ranges))
            width.append(sensor.resolution / math.sqrt(float(squared.min())))
        beam = scanner.sensor_of_beam
        padding = (0, -len(beam) % LANES)
        return cls(
            np.pad(np.array(limit, dtype=np.float32)[beam], padding, constant_values=1.0),
            np.pad(np.array(cap, dtype=np.float32)[beam], padding),
            np.pad(np.ones(len(beam), dtype=np.float32), padding),
            np.array(nearest, dtype=np.float32)[beam],
            np.array(spread, dtype=np.float32)[beam],
            np.array(bias, dtype=np.float32)[beam],
            np.array(width)[beam],
        )

    @property
    def beams(self) -> int:
        """Number of beams B."""
        return len(self.nearest)


def beam_returns(
    env: Environment,
    scanner: RangeScanner,
    table: BeamTable,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    theta: float,
    data: NDArray[np.float32],
) -> None:
    """Cast every beam of `scanner` at the poses (x, y, theta).

    Args:
        env: The environment.
        scanner: The scanner.
        table: Its beams, tabulated.
        x: Poses, shape (N,), metres.
        y: Poses, shape (N,), metres.
        theta: Heading of all poses, radians.
        data: Written, float32, shape (N, 5, B): see `Returns`.
    """
    rays = scanner.rays()
    reach = scanner.max_range + BEYOND
    heading = np.full(len(x), theta)
    distance, segment, incidence = scan_rays(
        env, x, y, heading, rays.origin, rays.angle, reach,
        incidence=bool(np.isfinite(rays.max_incidence).any()),
    )  # fmt: skip
    run_rows(
        _beam_returns, len(x), distance, segment, incidence,
        env.normals(np.arange(len(env.segments))), env.segments.kind == FRONTIER, rays.origin,
        theta + rays.angle, theta, rays.start, rays.max_incidence, table.nearest, table.limit,
        table.spread, table.bias, data, least=128,
    )  # fmt: skip


@kernel
def _beam_returns(
    begin, end, distance, segment, incidence, normal, frontier, origin, angle, theta, start,
    max_incidence, nearest, limit, spread, bias, data,
):  # fmt: skip
    cos_a, sin_a = np.cos(angle), np.sin(angle)
    # How the sensor itself moves when the robot turns.
    turn_x = -math.sin(theta) * origin[:, 0] - math.cos(theta) * origin[:, 1]
    turn_y = math.cos(theta) * origin[:, 0] - math.sin(theta) * origin[:, 1]
    for p in range(begin, end):
        for b in range(nearest.size):
            best, d = -1, limit[b] + BEYOND
            blind = False
            for r in range(start[b], start[b + 1]):
                blind |= math.isnan(distance[p, r])
                if distance[p, r] < d:
                    if incidence.size > 0 and incidence[p, r] > max_incidence[r]:
                        continue
                    d = distance[p, r]
                    best = r
            gx = gy = gt = 0.0
            if best >= 0:
                k = segment[p, best]
                ux, uy = cos_a[best], sin_a[best]
                inner = start[b] < best < start[b + 1] - 1
                nx, ny = echo_normal(inner, ux, uy, normal[k, 0], normal[k, 1])
                facing = nx * ux + ny * uy
                facing = math.copysign(max(abs(facing), GRAZING), facing)
                gx, gy = -nx / facing, -ny / facing
                swing = d * (ny * ux - nx * uy) + nx * turn_x[best] + ny * turn_y[best]
                gt = -swing / facing
                blind |= frontier[k] and d < limit[b]
            if d < nearest[b]:
                d = nearest[b]
                gx = gy = gt = 0.0
            place = min(d / limit[b], 1.0) * (spread.shape[1] - 1)
            low = min(int(place), spread.shape[1] - 2)
            share = place - low
            # The scan is compared by what the sensor reads in the mean, not by the true range.
            shift = bias[b, low] * (1.0 - share) + bias[b, low + 1] * share
            rise = (bias[b, low + 1] - bias[b, low]) * (spread.shape[1] - 1) / limit[b]
            stretch = 1.0 + rise if d < limit[b] else 1.0
            data[p, 0, b] = d + shift
            data[p, 1, b], data[p, 2, b], data[p, 3, b] = gx * stretch, gy * stretch, gt * stretch
            half = spread[b, low] * (1.0 - share) + spread[b, low + 1] * share
            data[p, 4, b] = BLIND if blind else half
