"""Likelihood of a scan by the ray model with a table of ranges, as an ensemble's filters weigh it.

`beam_model.beam_factors` takes an exponential and a logarithm for each beam and particle. Here the
exponentials are looked up, and a logarithm is taken of eight beams at a time. Weights are those of
`beam_factors` to five digits: not bit for bit, so drives keep to that.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ambinav.localization.filter_state import BEAM_PRODUCT, FilterModel
from ambinav.localization.likelihood_field import apply_factors
from ambinav.localization.range_table import looked_up
from ambinav.runtime.array_types import Floats32
from ambinav.runtime.kernels import kernel

# Entries of the curve for each deviation, and deviations beyond which it is 0.
PER_SIGMA, MOST_SIGMA = 256, 8
# Beams whose likelihoods are multiplied before their logarithm is taken.
TOGETHER = 8


class HitCurve(NamedTuple):
    """Likelihood of a hit, exp(-u^2 / 2), over the deviations u that it is off.

    Attributes:
        values: float32, shape (N,): at 0, 1 / PER_SIGMA ...
        scale: Entries per metre.
    """

    values: Floats32
    scale: float


def hit_curve(model: FilterModel) -> HitCurve | None:
    """Tabulate a filter's hits; None if it does not multiply beams with ranges from a table."""
    if model.kind != BEAM_PRODUCT or model.trust > 0.0 or not len(model.table.ranges):
        return None
    off = np.arange(PER_SIGMA * MOST_SIGMA + 1) / PER_SIGMA
    values = np.exp(-0.5 * off**2)
    return HitCurve(values.astype(np.float32), PER_SIGMA / model.sigma_hit)


@kernel
def ray_factors(particles, count, readings, model, curve, beams, scratch):
    """Multiply weights by a scan's likelihood, as `mcl_update.weigh`; return the factors' base.

    Args:
        particles: x, y, theta and weight, shape (M, ...); the weights are written.
        count: How many of them there are.
        readings: Of all beams of the scanner, shape (B,), metres; none is nan.
        model: See `FilterModel`.
        curve: See `HitCurve`.
        beams: Work space, shape (4, U).
        scratch: Work space, shape (M,).
    """
    ranges, reading, other, short = beams[0], beams[1], beams[2], beams[3]
    for b in range(model.beam.size):
        least, far = max(model.near[b], 0.0), model.far[b]
        reading[b] = min(max(readings[model.beam[b]], least), far)
        short[b] = model.z_short * model.lambda_short * math.exp(-model.lambda_short * reading[b])
        other[b] = model.z_max if reading[b] >= far else model.z_rand / far
    last = float(curve.values.size - 2)
    for i in range(count):
        looked_up(particles[i, 0], particles[i, 1], particles[i, 2], model.table, ranges)
        total, product = 0.0, 1.0
        for b in range(model.beam.size):
            expected = min(max(ranges[b], max(model.near[b], 0.0)), model.far[b])
            off = reading[b] - (0.0 if math.isnan(ranges[b]) else expected)
            place = min(abs(off) * curve.scale, last)
            k = np.uint64(place)
            low, high = curve.values[k], curve.values[k + np.uint64(1)]
            p = model.z_hit * (low + (place - float(k)) * (high - low)) + other[b]
            product *= p + (short[b] if off < 0.0 else 0.0)
            if b % TOGETHER == TOGETHER - 1:
                total += math.log(product)
                product = 1.0
        scratch[i] = model.power * (total + math.log(product))
    return apply_factors(particles, count, scratch, True)
