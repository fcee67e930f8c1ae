"""Likelihood field: distance of every point to the nearest wall, and likelihood of a scan.

AMCL takes the distance from the map's occupied cells, and fills a thick wall in, which draws a
robot 3 to 4 cm towards it. Here it is the distance to the wall segments, exact at every point of
the lattice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ambinav.config import as_positive
from ambinav.geometry.environment import Environment
from ambinav.localization.sine_cosine import sine_cosine
from ambinav.maps.lattice_values import bilinear
from ambinav.runtime.array_types import Bools, Floats32
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

# A lattice of more points than this (1.6 GB) is refused.
MOST_POINTS = 400_000_000
# A product of factors beyond these goes on as its logarithm: one for each factor takes four times
# as long.
TINY = 1e-100
HUGE = 1e100
# Particles weighed at once: their poses and places stay in the first cache.
BLOCK = 256


@dataclass(frozen=True, eq=False)
class LikelihoodField:
    """Distances to the walls on a square lattice, up to a maximum.

    Attributes:
        distance: float32, shape (rows, columns), metres, at most `max_distance`. The lattice
            reaches `max_distance` beyond the environment, so that off it every point is at
            least that far from a wall.
        origin: x and y of distance[0, 0], metres; row 0 lies at the smallest y.
        resolution: Spacing of the lattice, metres.
        max_distance: Metres.
    """

    distance: Floats32
    origin: tuple[float, float]
    resolution: float
    max_distance: float

    @classmethod
    def of(
        cls,
        environment: Environment,
        resolution: float = 0.025,
        max_distance: float = 2.0,
        *,
        frontiers: bool = False,
        only: Bools | None = None,
    ) -> LikelihoodField:
        """Compute the field of an environment.

        Args:
            environment: The environment.
            resolution: Spacing of the lattice, metres.
            max_distance: Farther from a wall than this is all the same, metres.
            frontiers: Count the frontiers to unknown space as walls.
            only: The segments that count, shape (N,); None: all walls.

        Raises:
            InputError: a number is not positive, the lattice would be too large, or there is no
                wall.
        """
        step = as_positive(resolution, "resolution", "metres")
        reach = as_positive(max_distance, "max_distance", "metres")
        segments = environment.segments
        chosen = segments.walls | frontiers if only is None else only
        xy = segments.xy[chosen]
        if len(xy) == 0:
            raise InputError(
                f"environment {environment.name!r} has no walls; a likelihood field needs some."
            )
        xmin, ymin, xmax, ymax = environment.bounds
        columns = math.ceil((xmax - xmin + 2.0 * reach) / step) + 1
        rows = math.ceil((ymax - ymin + 2.0 * reach) / step) + 1
        if rows * columns > MOST_POINTS:
            raise InputError(
                f"resolution is {step:g}, which makes {rows * columns} points of environment "
                f"{environment.name!r}; give a coarser one."
            )
        distance = np.empty((rows, columns), dtype=np.float32)
        origin = (xmin - reach, ymin - reach)
        run_rows(_distances, rows, np.ascontiguousarray(xy), *origin, step, reach, distance)
        return cls(distance, origin, step, reach)

    def hits(self, sigma: float) -> Floats32:
        """Return exp(-d^2 / (2 sigma^2)) of the distances d, (rows, columns); `sigma` in metres."""
        values = np.square(self.distance)
        values *= np.float32(-0.5 / sigma**2)
        return np.exp(values, out=values)


@kernel
def _distances(begin, end, xy, x0, y0, step, reach, distance):
    """Write the distance from each lattice point to the nearest segment, row by row.

    Only the piece of a segment within reach of the row can matter, and only to the columns
    within reach of that piece.
    """
    columns = distance.shape[1]
    best = np.empty(columns)
    for row in range(begin, end):
        y = y0 + row * step
        best[:] = reach * reach
        for k in range(xy.shape[0]):
            ax, ay, bx, by = xy[k, 0], xy[k, 1], xy[k, 2], xy[k, 3]
            if min(ay, by) > y + reach or max(ay, by) < y - reach:
                continue
            ex, ey = bx - ax, by - ay
            low, high = 0.0, 1.0
            if abs(ey) > 1e-12:
                bound, other_bound = (y - reach - ay) / ey, (y + reach - ay) / ey
                low, high = max(low, min(bound, other_bound)), min(high, max(bound, other_bound))
            left = min(ax + low * ex, ax + high * ex) - reach
            right = max(ax + low * ex, ax + high * ex) + reach
            first = max(int(math.ceil((left - x0) / step - 1e-9)), 0)
            last = min(int(math.floor((right - x0) / step + 1e-9)), columns - 1)
            per_square = 1.0 / (ex * ex + ey * ey)
            wy = y - ay
            for column in range(first, last + 1):
                wx = x0 + column * step - ax
                s = min(max((wx * ex + wy * ey) * per_square, 0.0), 1.0)
                dx, dy = wx - s * ex, wy - s * ey
                best[column] = min(best[column], dx * dx + dy * dy)
        for column in range(columns):
            distance[row, column] = math.sqrt(best[column])


@kernel(forceinline=True)
def hit_at(u, v, hits, smooth):
    """Return the lattice's value at column u and row v: the nearest point's, or interpolated.

    0 off the lattice, where AMCL too takes the largest distance.
    """
    rows, columns = hits.shape
    if smooth:
        if not (u >= 0.0 and v >= 0.0 and u < columns - 1 and v < rows - 1):
            return 0.0
        column, row = int(u), int(v)
        a, b = u - column, v - row
        return bilinear(
            hits[row, column], hits[row, column + 1],
            hits[row + 1, column], hits[row + 1, column + 1], a, b,
        )  # fmt: skip
    u += 0.5
    v += 0.5
    if not (u >= 0.0 and v >= 0.0 and u < columns and v < rows):
        return 0.0
    return float(hits[int(v), int(u)])


@kernel(_nrt=False)
def factors_at_once(least, most):
    """Return how many factors between `least` and `most` have a product that is a normal float.

    A logarithm of such a product, instead of one for each factor, takes a third of the time.
    """
    largest = max(abs(math.log(least)) if least > 0.0 else math.inf, abs(math.log(most)))
    return max(1, int(min(600.0 / max(largest, 1e-3), 1e6)))


@kernel
def nearest_totals(
    particles, count, end, floor, used, z_hit, hits, x0, y0, inverse, log, totals,
):  # fmt: skip
    """Sum what the beams say with the nearest lattice points; see `field_factors`.

    Beam by beam for a block of particles, whose end points lie close together in memory, in loops
    without branches: in half the time of particle by particle.
    """
    rows, columns = hits.shape
    lattice = hits.ravel()
    pose, share, place = np.empty((4, BLOCK)), np.empty(BLOCK), np.empty(BLOCK, dtype=np.int32)
    product = np.ones(BLOCK)
    at_once = factors_at_once(floor[:used].min(), z_hit + floor[:used].max()) if log else used
    for first in range(0, count, BLOCK):
        n = min(BLOCK, count - first)
        for k in range(n):
            x, y, t = particles[first + k, 0], particles[first + k, 1], particles[first + k, 2]
            pose[0, k], pose[1, k] = (x - x0) * inverse, (y - y0) * inverse
            s, c = sine_cosine(t)
            pose[2, k], pose[3, k] = c * inverse, s * inverse
            totals[first + k] = 0.0 if log else 1.0
        for b in range(used):
            forward, left, least = end[b, 0], end[b, 1], floor[b]
            for k in range(n):
                u = pose[0, k] + pose[2, k] * forward - pose[3, k] * left + 0.5
                v = pose[1, k] + pose[3, k] * forward + pose[2, k] * left + 0.5
                on = (u >= 0.0) & (v >= 0.0) & (u < columns) & (v < rows)
                row, column = np.int32(v if on else 0.0), np.int32(u if on else 0.0)
                place[k] = row * np.int32(columns) + column
                share[k] = z_hit if on else 0.0
            if not log:
                for k in range(n):
                    p = share[k] * lattice[np.uint32(place[k])] + least
                    totals[first + k] += p * p * p
                continue
            for k in range(n):
                product[k] *= share[k] * lattice[np.uint32(place[k])] + least
            if (b + 1) % at_once == 0 or b + 1 == used:
                for k in range(n):
                    totals[first + k] += math.log(product[k])
                    product[k] = 1.0


@kernel
def field_factors(
    particles, count, end, floor, used, z_hit, hits, x0, y0, inverse, smooth, log, power, scratch,
    channel=None, fits=None,
):  # fmt: skip
    """Multiply the weights by the field's likelihood of a scan; return the factors' base.

    Two ways of putting the beams together, p_i = z_hit hit_i + z_rand / max_range_i:
    AMCL's `likelihood_field`, 1 + sum p_i^3; and with `log` its `likelihood_field_prob`, the
    product of all p_i to the power `power` (Probabilistic Robotics, section 6.3.4).

    Args:
        particles: x, y, theta and weight, float64, shape (M, ...); the weights are written.
        count: How many of them there are.
        end: End points of the beams in the robot's frame, shape (B, 2), metres.
        floor: z_rand / max_range of each beam, shape (B,).
        used: How many of the beams there are.
        z_hit: Share of the hits.
        hits: See `LikelihoodField.hits`.
        x0: Place of hits[0, 0], metres.
        y0: As x0.
        inverse: Lattice points per metre.
        smooth: Interpolate between the lattice points.
        log: Product instead of the sum of cubes.
        power: Exponent of the product.
        scratch: Work space, float64, shape (M,).
        channel: An `IntensityModel`, or None.
        fits: How well the intensity of each beam fits a wall and a reflector, shape (B, 2).

    Returns:
        The logarithm that all factors were divided by (0 for the sum), so that products of many
        beams do not vanish.
    """
    if channel is None and not smooth:
        nearest_totals(
            particles, count, end, floor, used, z_hit, hits, x0, y0, inverse, log, scratch
        )
        for i in range(count if log else 0):
            scratch[i] *= power
        return apply_factors(particles, count, scratch, log)
    for i in range(count):
        px, py = (particles[i, 0] - x0) * inverse, (particles[i, 1] - y0) * inverse
        c, s = math.cos(particles[i, 2]) * inverse, math.sin(particles[i, 2]) * inverse
        total = 0.0 if log else 1.0
        product, fit, log_fit = 1.0, 1.0, 0.0
        for b in range(used):
            u = px + c * end[b, 0] - s * end[b, 1]
            v = py + s * end[b, 0] + c * end[b, 1]
            if channel is None:
                p = z_hit * hit_at(u, v, hits, smooth) + floor[b]
            else:
                dark = hit_at(u, v, channel.walls, smooth)
                light = hit_at(u, v, channel.reflectors, smooth)
                # The nearer of both, as in `hits`.
                p = z_hit * max(dark, light) + floor[b]
                met = max(fits[b, 0] * dark, fits[b, 1] * light)
                fit *= met + fits[b, 0] * (1.0 - max(dark, light))
                if fit < TINY:
                    log_fit += math.log(fit)
                    fit = 1.0
            if not log:
                total += p * p * p
            else:
                product *= p
                if not TINY < product < HUGE:
                    total += math.log(product)
                    product = 1.0
        scratch[i] = power * (total + math.log(product)) if log else total
        if channel is not None:
            log_fit = power * (log_fit + math.log(fit))
            scratch[i] = scratch[i] + log_fit if log else scratch[i] * math.exp(log_fit)
    return apply_factors(particles, count, scratch, log)


@kernel(_nrt=False)
def apply_factors(particles, count, factors, log):
    """Multiply weights by factors, or by exponentials of logarithms less the largest one.

    Returns that largest logarithm; 0 for plain factors.
    """
    if not log:
        for i in range(count):
            particles[i, 3] *= factors[i]
        return 0.0
    top = -math.inf
    for i in range(count):
        top = max(top, factors[i])
    for i in range(count):
        particles[i, 3] *= math.exp(factors[i] - top)
    return top
