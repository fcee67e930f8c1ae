"""Resampling: as many particles as their spread needs, some of them placed at random.

`MclParameters.resampling` describes the three methods.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.localization.bins import bin_of, find_bins, kld_count, place_of
from ambinav.localization.random import uniform
from ambinav.runtime.kernels import kernel

MULTINOMIAL, SYSTEMATIC, LOW_VARIANCE = range(3)
# Distances by which groups of bits are swapped, and the lower groups of each.
_SHIFT = tuple(np.uint64(1 << k) for k in range(5))
_EVERY = tuple(
    np.uint64(mask) for mask in (0x55555555, 0x33333333, 0x0F0F0F0F, 0x00FF00FF, 0x0000FFFF)
)
CODES = {"multinomial": MULTINOMIAL, "systematic": SYSTEMATIC, "low_variance": LOW_VARIANCE}


@kernel(inline="always")
def van_der_corput(m):
    """Return the m-th term of van der Corput's sequence in base 2: 0, 1/2, 1/4, 3/4, 1/8 ...

    For m below 2^32: its bits in reverse, swapped in groups of 1, 2, 4, 8 and 16. (A loop over the
    bits takes 7 times as long, a fifth of a resampling.)
    """
    bits = np.uint64(m)
    bits = (bits >> _SHIFT[0] & _EVERY[0]) | (bits & _EVERY[0]) << _SHIFT[0]
    bits = (bits >> _SHIFT[1] & _EVERY[1]) | (bits & _EVERY[1]) << _SHIFT[1]
    bits = (bits >> _SHIFT[2] & _EVERY[2]) | (bits & _EVERY[2]) << _SHIFT[2]
    bits = (bits >> _SHIFT[3] & _EVERY[3]) | (bits & _EVERY[3]) << _SHIFT[3]
    bits = (bits >> _SHIFT[4] & _EVERY[4]) | (bits & _EVERY[4]) << _SHIFT[4]
    return float(bits) / 2.0**32


@kernel(inline="always")
def first_above(value, cumulated, count):
    """Return the first index of `cumulated`[:count] with an entry above `value`, or the last."""
    low, high = 0, count - 1
    while low < high:
        middle = (low + high) >> 1
        if cumulated[middle] > value:
            high = middle
        else:
            low = middle + 1
    return low


@kernel(_nrt=False)
def fill_guide(cumulated, count, guide):
    """Write where a search among `cumulated`[:count] begins, for each of `count` equal parts.

    The guide table of Chen & Asau 1974, "On generating random variates from an empirical
    distribution", AIIE Transactions 6(2): a search takes a step or two on average.
    """
    i = 0
    for part in range(count):
        while i < count - 1 and cumulated[i] <= part / count * cumulated[count - 1]:
            i += 1
        guide[part] = i


@kernel(inline="always")
def guided_first_above(value, cumulated, count, guide):
    """Return what `first_above` does, by a guide table; `value` is in [0, cumulated[count - 1]]."""
    i = guide[min(int(value / cumulated[count - 1] * count), count - 1)]
    while i > 0 and cumulated[i - 1] > value:
        i -= 1
    while i < count - 1 and cumulated[i] <= value:
        i += 1
    return i


@kernel(_nrt=False)
def random_pose(areas, corner, state):
    """Sample a pose uniformly in the free space and over all headings.

    Args:
        areas: Cumulated areas of the triangles of the free space, shape (T,), square metres.
        corner: Their corners, shape (3 T, 2), metres.
        state: State of the generator.
    """
    t = first_above(uniform(state) * areas[-1], areas, areas.size)
    # A point of the parallelogram, folded back into the triangle.
    a, b = uniform(state), uniform(state)
    if a + b > 1.0:
        a, b = 1.0 - a, 1.0 - b
    o, p, q = 3 * t, 3 * t + 1, 3 * t + 2
    x = corner[o, 0] + a * (corner[p, 0] - corner[o, 0]) + b * (corner[q, 0] - corner[o, 0])
    y = corner[o, 1] + a * (corner[p, 1] - corner[o, 1]) + b * (corner[q, 1] - corner[o, 1])
    return x, y, (2.0 * uniform(state) - 1.0) * math.pi


@kernel(_nrt=False)
def comb_count(particles, cumulated, count, error, quantile, least, most, shift, keys):
    """Return KLD's count for the bins that an even comb of `most` teeth hits; fill `keys`."""
    keys[:] = -1
    bins = 0
    i = 0
    before = -1
    for m in range(most):
        place = (m + shift) / most * cumulated[count - 1]
        while i < count - 1 and cumulated[i] <= place:
            i += 1
        if i != before:
            key = bin_of(particles[i, 0], particles[i, 1], particles[i, 2])
            k = place_of(key, keys)
            if keys[k] < 0:
                keys[k] = key
                bins += 1
            before = i
    return kld_count(bins, error, quantile, least, most)


@kernel(_nrt=False)
def resample(
    particles, count, out, method, share, error, quantile, least, most, areas, corner, state,
    cumulated, guide, keys, entry, places, known, found,
):  # fmt: skip
    """Draw a new set of particles of equal weight.

    Args:
        particles: x, y, theta, weight, shape (M, ...); the weights need not sum to 1.
        count: How many of them there are.
        out: Written, shape (M, 5): the new set; the last column is 1 for a particle that was put
            anywhere, else 0.
        method: One of `CODES`.
        share: Share of particles that are put anywhere in the free space.
        error: pf_err of KLD.
        quantile: pf_z of KLD.
        least: Fewest particles.
        most: Most particles, at most M.
        areas: See `random_pose`.
        corner: See `random_pose`.
        state: State of the generator.
        cumulated: Work space, float64, shape (M,).
        guide: Work space, int32, shape (M,).
        keys: Written: bins of the new set, as `bins.fill_bins` does.
        entry: Written, likewise.
        places: Written, likewise.
        known: Work space, int32, shape (M,).
        found: Work space, int64, shape (M,).

    Returns:
        How many particles and how many occupied bins there are.
    """
    total = 0.0
    for i in range(count):
        total += particles[i, 3]
        cumulated[i] = total
    fill_guide(cumulated, count, guide)
    shift = uniform(state)
    fixed = -1
    if method == LOW_VARIANCE:
        fixed = comb_count(particles, cumulated, count, error, quantile, least, most, shift, keys)
    keys[:] = -1
    drawn = bins = 0
    enough = fixed if method == LOW_VARIANCE else most
    # Entry of the bin of each particle that has been drawn before: copies share it.
    known[:count] = -1
    find_bins(particles, count, found)
    while drawn < enough:
        k = -1
        if share > 0.0 and uniform(state) < share:
            x, y, t = random_pose(areas, corner, state)
            key = bin_of(x, y, t)
            out[drawn, 4] = 1.0
        else:
            out[drawn, 4] = 0.0
            if method == MULTINOMIAL:
                place = uniform(state)
            elif method == SYSTEMATIC:
                place = van_der_corput(drawn) + shift
                place -= math.floor(place)
            else:
                place = (drawn + shift) / fixed
            i = guided_first_above(place * total, cumulated, count, guide)
            x, y, t = particles[i, 0], particles[i, 1], particles[i, 2]
            key, k = found[i], known[i]
        if k < 0:
            k = place_of(key, keys)
            if out[drawn, 4] == 0.0:
                known[i] = k
        out[drawn, 0], out[drawn, 1], out[drawn, 2] = x, y, t
        places[drawn] = k
        drawn += 1
        if keys[k] < 0:
            keys[k] = key
            entry[bins] = k
            bins += 1
            if method != LOW_VARIANCE:
                enough = kld_count(bins, error, quantile, least, most)
    out[:drawn, 3] = 1.0 / drawn
    return drawn, bins
