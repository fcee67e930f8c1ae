"""Kernels of online localizability: which readings the map explains, and their information.

See `online` for the sources and the formulas.
"""

from __future__ import annotations

import math

from ambinav.localization.information import beam_lines, line_space
from ambinav.runtime.kernels import kernel


@kernel
def share_of_map(z, mean, variance, far, z_hit, z_short, z_rand, decay):
    """Return the probability, by the beam model's mixture, that reading z is of the expected wall.

    Args:
        z: The reading, metres, below `far`.
        mean: What is expected, metres.
        variance: Variance of the reading about it, square metres.
        far: Maximum range, metres.
        z_hit: Prior share of readings of the map.
        z_short: Prior share of readings of what stands before it.
        z_rand: Prior share of readings at random.
        decay: lambda_short, 1 / metres.
    """
    off = z - mean
    hit = z_hit * math.exp(-0.5 * off * off / variance) / math.sqrt(2.0 * math.pi * variance)
    other = z_rand / far
    if off < 0.0:
        other += z_short * decay * math.exp(-decay * z) / -math.expm1(-decay * mean)
    total = hit + other
    return hit / total if total > 0.0 else 0.0


@kernel
def weighted_information(
    x, y, theta, reading, spread, z_hit, z_short, z_rand, decay, least, cast, noise, work, ranges,
    ray, edge, line, weight, information,
):  # fmt: skip
    """Compute a scan's information; each beam is weighted by the probability that it met the map.

    Args:
        x: Metres, map frame.
        y: Metres, map frame.
        theta: Radians.
        reading: Reading of each beam, shape (B,), metres; inf no echo, -inf too near, nan none.
        spread: Covariance of the pose, shape (3, 3): it makes the expected range uncertain.
        z_hit: See `share_of_map`, as the next three.
        z_short: See there.
        z_rand: See there.
        decay: See there.
        least: Beams of a lower probability are left out of the information.
        cast: See `casting.CastTables`.
        noise: See `information.BeamNoise`.
        work: See `casting.work_space`.
        ranges: Work space, as for `information.beam_lines`, as the next three.
        ray: Likewise.
        edge: Likewise.
        line: Likewise.
        weight: Written, shape (B,): the probabilities; 0 where an echo is missing, nan where
            there is no reading or the map tells of no echo.
        information: Written, shape (3, 3).
    """
    beam_lines(x, y, theta, cast, noise, work, ranges, ray, edge, line)
    information[:] = 0.0
    for b in range(reading.size):
        z, variance = reading[b], line[b, 4]
        weight[b] = math.nan
        if not variance < math.inf or math.isnan(z) or z == -math.inf:
            continue
        weight[b] = 0.0
        if z >= noise.far[b]:
            continue
        total = variance
        for i in range(3):
            for j in range(3):
                total += line[b, 1 + i] * spread[i, j] * line[b, 1 + j]
        weight[b] = share_of_map(z, line[b, 0], total, noise.far[b], z_hit, z_short, z_rand, decay)
        if weight[b] < least:
            continue
        for i in range(3):
            for j in range(3):
                information[i, j] += weight[b] * line[b, 1 + i] * line[b, 1 + j] / variance


@kernel
def weighted_informations(
    low,
    high,
    poses,
    readings,
    spreads,
    z_hit,
    z_short,
    z_rand,
    decay,
    cast,
    noise,
    weights,
    information,
):
    """Compute `weighted_information` of some of N scans; `spreads` has shape (N, 3, 3)."""
    work, ranges, ray, edge, line = line_space(noise.far.size, cast.cosine.size)
    for p in range(low, high):
        weighted_information(
            poses[p, 0], poses[p, 1], poses[p, 2], readings[p], spreads[p], z_hit, z_short,
            z_rand, decay, 0.0, cast, noise, work, ranges, ray, edge, line, weights[p],
            information[p],
        )  # fmt: skip
