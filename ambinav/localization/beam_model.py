"""Beam model: likelihood of a scan at a pose, from the ranges expected there.

Thrun, Burgard & Fox (2005), "Probabilistic Robotics", section 6.3 and table 6.1, in the form of
nav2 (nav2_amcl, beam_model.cpp): a reading z where z* is expected has the likelihood

    p = z_hit exp(-(z - z*)^2 / (2 sigma_hit^2)) + z_short lambda exp(-lambda z) [z < z*]
        + z_max [z out of range] + z_rand / max_range [z in range]

and the beams together 1 + sum p^3, or, as in the book (section 6.1), the product of all p, to a
power below 1 where neighbouring beams err together. AMCL walks through the cells of its map; here
z* is exact: the nearest echo of the beam's rays among the wall segments, so that cones and
incidence limits count; or looked up in a table of such ranges.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.localization.casting import expected_ranges, work_space
from ambinav.localization.likelihood_field import HUGE, TINY, apply_factors
from ambinav.localization.range_table import looked_up, reflectors_looked_up
from ambinav.runtime.kernels import kernel


@kernel
def beam_factors(
    particles, count, reading, near, far, z_hit, z_short, z_max, z_rand, sigma, decay, tables,
    lookup, log, power, scratch, channel=None, fits=None,
):  # fmt: skip
    """Multiply the weights by the beam model's likelihood of a scan; return the factors' base.

    Args:
        particles: x, y, theta and weight, float64, shape (M, ...); the weights are written.
        count: How many of them there are.
        reading: Reading of each beam, shape (B,), metres; `far` where it is out of range, nan where
            there is none.
        near: What is expected nearer than this is expected to read this, shape (B,), metres.
        far: Maximum range of each beam, shape (B,), metres.
        z_hit: See the module, as the next three.
        z_short: See there.
        z_max: See there.
        z_rand: See there.
        sigma: sigma_hit, metres.
        decay: lambda_short, 1 / metres.
        tables: The beams, see `casting.CastTables`. Where a pose puts a sensor outside of the
            free space, its beams are expected to read 0.
        lookup: A `RangeTable` to take the ranges from; one without sensors is not looked at.
        log: Product instead of the sum of cubes.
        power: Exponent of the product.
        scratch: Work space, float64, shape (M,).
        channel: An `IntensityModel`, or None.
        fits: How well the intensity of each beam fits a wall and a reflector, shape (B, 2).

    Returns:
        The logarithm that all factors were divided by (0 for the sum), so that products of many
        beams do not vanish.
    """
    beams = far.size
    work = work_space(tables.cosine.size)
    ranges = np.empty(beams)
    ray = np.empty(beams, dtype=np.int32)
    edge = np.empty(beams, dtype=np.int32)
    met = np.empty(beams, dtype=np.bool_)
    short, rand = np.empty(beams), np.empty(beams)
    for b in range(beams):
        short[b] = z_short * decay * math.exp(-decay * reading[b])
        rand[b] = z_max if reading[b] >= far[b] else z_rand / far[b]
    per_square = -0.5 / (sigma * sigma)
    by_table = lookup.ranges.shape[0] > 0
    for i in range(count):
        if by_table:
            looked_up(particles[i, 0], particles[i, 1], particles[i, 2], lookup, ranges)
        else:
            expected_ranges(
                particles[i, 0], particles[i, 1], particles[i, 2], tables, work, ranges, ray, edge
            )
        if channel is not None:
            if by_table:
                reflectors_looked_up(particles[i, 0], particles[i, 1], particles[i, 2], lookup, met)
            else:
                for b in range(beams):
                    met[b] = edge[b] >= 0 and channel.reflects[edge[b]]
        total = 0.0 if log else 1.0
        product, fit, log_fit = 1.0, 1.0, 0.0
        for b in range(beams):
            if math.isnan(reading[b]):
                continue
            expected = 0.0 if math.isnan(ranges[b]) else min(max(ranges[b], near[b]), far[b])
            off = reading[b] - expected
            p = z_hit * math.exp(off * off * per_square) + rand[b]
            if off < 0.0:
                p += short[b]
            if not log:
                total += p * p * p
            else:
                product *= p
                if not TINY < product < HUGE:
                    total += math.log(product)
                    product = 1.0
            if channel is not None:
                hit = math.exp(off * off * per_square)
                fit *= hit * fits[b, int(met[b])] + (1.0 - hit) * fits[b, 0]
                if fit < TINY:
                    log_fit += math.log(fit)
                    fit = 1.0
        scratch[i] = power * (total + math.log(product)) if log else total
        if channel is not None:
            log_fit = power * (log_fit + math.log(fit))
            scratch[i] = scratch[i] + log_fit if log else scratch[i] * math.exp(log_fit)
    return apply_factors(particles, count, scratch, log)
