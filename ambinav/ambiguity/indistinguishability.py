"""Probability that two true ranges, or two scans, give the same discretized readings.

The published definition (Ruiz-Mayor, Crespo and Trivino 2017) is `same_reading`: the probability
that two ranges are captured in the same discretized value. The rest is ambinav's own model.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from ambinav.runtime.array_types import Floats, Floats32
from ambinav.sensing.sensor import RangeSensor

# The steps of the table of evidence, in effective deviations, and how far it reaches.
Z_STEP = 1.0 / 32.0
Z_MAX = 24.0
# Where bins are this wide (in effective deviations) or finer, the evidence is z^2 / 4 to 1e-4.
FINE = 0.5
# The evidence is cut here: exp(-200) is nothing, and float32 squares it without harm.
MOST = 200.0
# The effective deviation at which a share of outliers is stated, metres: that of drawn walls. The
# cap of a beam grows below it, see `most_evidence`.
STATED_STD = 0.02
# No range is compared more finely, metres: a lattice of cells resolves no less, and of a sensor
# without any noise a pose would have no indistinguishable neighbour, itself included.
FINEST_STD = 1e-3
# Dimensions in which a scan may fix a pose, and one for the margin.
SHARPNESS = 4.0


def same_reading(sensor: RangeSensor, first: ArrayLike, second: ArrayLike) -> Floats:
    """Compute J: probability of equal readings of two true ranges, metres, inf: no echo; broadcast.

    Sums P(k | first) P(k | second) over all readings k (docs/model.md), so it depends on where the
    ranges lie within their bins; `same_reading_averaged` does not.
    """
    first, second = np.broadcast_arrays(np.asarray(first, float), np.asarray(second, float))
    product = sensor.reading_probabilities(first) * sensor.reading_probabilities(second)
    return np.asarray(product.sum(axis=-1))


def indistinguishability(sensor: RangeSensor, first: ArrayLike, second: ArrayLike) -> Floats:
    """Compute rho: `same_reading` relative to each range with itself, (0, 1]; broadcast."""
    first, second = np.broadcast_arrays(np.asarray(first, float), np.asarray(second, float))
    p, q = sensor.reading_probabilities(first), sensor.reading_probabilities(second)
    norm = np.sqrt((p * p).sum(axis=-1) * (q * q).sum(axis=-1))
    return np.asarray(np.minimum((p * q).sum(axis=-1) / norm, 1.0))


def same_reading_averaged(
    difference: ArrayLike, std1: ArrayLike, std2: ArrayLike, resolution: float
) -> Floats:
    """Average J over the phase of the bins in closed form (docs/model.md), broadcast.

    Args:
        difference: Difference D of the two true ranges, metres.
        std1: Standard deviation of the first reading, metres.
        std2: Standard deviation of the second reading, metres.
        resolution: Width delta of a bin, metres.

    Returns:
        [f(D + delta) - 2 f(D) + f(D - delta)] / delta with f(u) = u Phi(u/t) + t phi(u/t) and
        t^2 = std1^2 + std2^2; the triangle max(0, 1 - |D| / delta) where t is 0.
    """
    d = np.abs(np.asarray(difference, dtype=float))
    t = np.hypot(std1, std2)
    safe = np.where(t > 0.0, t, 1.0)

    def f(u: Floats) -> Floats:
        smooth = u * ndtr(u / safe) + safe / math.sqrt(2 * math.pi) * np.exp(-0.5 * (u / safe) ** 2)
        return np.where(t > 0.0, smooth, np.maximum(u, 0.0))

    # f(u) = u + f(-u): on the negative side the second difference does not cancel.
    value = (f(resolution - d) - 2.0 * f(-d) + f(-resolution - d)) / resolution
    return np.asarray(np.maximum(value, 0.0))


def evidence(z: ArrayLike, width: float) -> Floats:
    """Compute -log rho of ranges that differ by `z` effective deviations, at most `MOST`.

    The effective variance of a reading is s^2 = sigma^2 + delta^2 / 12. With it the evidence of
    fine bins is z^2 / 4; coarse bins (`width` = delta / s, up to sqrt(12) for a sensor without
    noise) tell less at first and everything once the bins no longer overlap.
    """
    size = np.abs(np.asarray(z, dtype=np.float64))
    delta = min(width, math.sqrt(12.0))
    sigma = math.sqrt(max(1.0 - delta * delta / 12.0, 0.0))
    if delta < 1e-6:
        return np.asarray(np.minimum(size * size / 4.0, MOST))
    value = same_reading_averaged(size, sigma, sigma, delta)
    peak = float(same_reading_averaged(0.0, sigma, sigma, delta))
    with np.errstate(divide="ignore"):
        return np.asarray(np.minimum(-np.log(value / peak), MOST))


def evidence_table(widths: Floats) -> Floats32:
    """Tabulate `evidence` over z^2 / 4 of fine bins, at multiples of `Z_STEP`: float32, (W, Z).

    One row a width, from z = 0 to `Z_MAX` and one step more; the ratio is smooth where the
    evidence itself starts from nothing, so it can be interpolated linearly.
    """
    # At z = 0 the ratio is a limit; 0.01 is near enough for float32 and far enough for float64.
    z = np.maximum(np.arange(round(Z_MAX / Z_STEP) + 2) * Z_STEP, 0.01)
    return np.stack([evidence(z, float(w)) / (z * z / 4.0) for w in widths]).astype(np.float32)


def most_evidence(odd: float, std: float) -> float:
    """Return U_max: the maximum evidence of one beam.

    A reading that the map does not explain falls anywhere, whatever the precision; one that it
    explains falls within a stretch proportional to the deviation s. The floor that capped beams
    leave over the whole neighbourhood must therefore shrink with s at least as fast as the integral
    of the peak, s^3 where a scan fixes x, y and theta: else a sharper sensor would look more
    ambiguous. Above `STATED_STD` the share is taken as it is stated.

    Args:
        odd: Share of readings that the map does not explain, between 0 and 1.
        std: Effective deviation s of the sensor's most precise reading, metres.

    Returns:
        -log(odd) + 4 log(max(1, s0 / s)), s0 = `STATED_STD`.
    """
    sharper = STATED_STD / max(std, FINEST_STD)
    return -math.log(odd) + SHARPNESS * math.log(max(sharper, 1.0))
